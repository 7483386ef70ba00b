//! Sources of a render's error: one stage at a time in f32 and all others in double precision.

use psrgs_vk::pass::camera::CameraPush;
use psrgs_vk::raster::Variants;
use psrgs_vk::twin::Real;
use psrgs_vk::twin::project::project;
use psrgs_vk::twin::splat::{Splat, TwinCamera};

use super::common;
use super::common::splats::{camera, seeded, spread};
use super::device::{Scene, decided, worst};
use super::projection::needles;

/// The stage that is computed in f32.
#[derive(Clone, Copy, PartialEq)]
enum Stage {
    /// Projected centres.
    Means,
    /// Projected covariances: A, B, C and C - B^2 / A.
    Conics,
    /// Opacities and colours.
    Colours,
    /// No arithmetic; rows are stored in f32.
    Storage,
    /// The two squares, from rows in f32.
    Squares,
    /// The exponent in its plain form, from rows in f32, for comparison with the squares.
    PlainForm,
    /// 2^x.
    Exponential,
    /// Transmittances and sums of colours.
    Products,
}

const STAGES: [(Stage, &str); 8] = [
    (Stage::Means, "projected means"),
    (Stage::Conics, "projected conics"),
    (Stage::Colours, "opacities and colours"),
    (Stage::Storage, "rows stored in f32"),
    (Stage::Squares, "exponent as squares"),
    (Stage::PlainForm, "exponent, plain form"),
    (Stage::Exponential, "exponential"),
    (Stage::Products, "transmittance, sums"),
];

pub(crate) fn single(v: f64) -> f64 {
    f64::from(v as f32)
}

/// The exponent (base e) of a row in the arithmetic of `R`, in the form of blending or in the plain form.
pub(crate) fn exponent<R: Real>(row: &[f64; 12], d: [f64; 2], plain: bool) -> f64 {
    let [a, b, c, rest] = [row[2], row[3], row[4], row[7]].map(R::of);
    let [dx, dy] = d.map(R::of);
    let half = R::of(0.5);
    let power = if plain {
        -half * (a * dx * dx + c * dy * dy) - b * dx * dy
    } else {
        let p = (half * a).sqrt();
        let x = p * dx + half * b / p * dy;
        let y = (half * rest).sqrt() * dy;
        -(x * x) - y * y
    };
    power.f64()
}

/// Rows of the visible splats, front to back, each with its splat. Columns `taken` are projected in f32, all others in
/// f64.
pub(crate) fn rows(scene: &Scene, taken: &[usize]) -> Vec<(usize, [f64; 12])> {
    let exact = TwinCamera::<f64>::exact(&scene.shot.camera, &scene.shot.projection);
    let rounded = TwinCamera::<f32>::of(&CameraPush::new(&scene.shot.camera, &scene.shot.projection));
    let mut rows: Vec<(usize, [f64; 12])> = (0..scene.model.len())
        .filter_map(|i| {
            let mut row = project(&scene.splats[i], &exact, None).ok()?.row();
            let single = project(&Splat::<f32>::of(&scene.model, i), &rounded, None).ok()?.row().map(f64::from);
            taken.iter().for_each(|k| row[*k] = single[*k]);
            Some((i, row))
        })
        .collect();
    rows.sort_by(|a, b| a.1[6].total_cmp(&b.1[6]));
    rows
}

/// Colours of all pixels with a stage in f32.
fn picture(scene: &Scene, stage: Option<Stage>) -> Vec<[f64; 3]> {
    let is = |other: Stage| stage == Some(other);
    let (width, height) = (scene.shot.camera.width as usize, scene.shot.camera.height as usize);
    let taken: &[usize] = match stage {
        Some(Stage::Means) => &[0, 1],
        Some(Stage::Conics) => &[2, 3, 4, 7],
        Some(Stage::Colours) => &[5, 8, 9, 10],
        _ => &[],
    };
    let mut rows: Vec<[f64; 12]> = rows(scene, taken).into_iter().map(|(_, row)| row).collect();
    if is(Stage::Storage) || is(Stage::Squares) || is(Stage::PlainForm) {
        rows.iter_mut().for_each(|row| *row = row.map(single));
    }
    let products = |v: f64| if is(Stage::Products) { single(v) } else { v };
    (0..width * height)
        .map(|pixel| {
            let (x, y) = ((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
            let (mut colour, mut transmittance) = ([0.0; 3], 1.0);
            for row in &rows {
                let d = [x - row[0], y - row[1]];
                let power = match stage {
                    Some(Stage::Squares) => exponent::<f32>(row, d.map(single), false),
                    Some(Stage::PlainForm) => exponent::<f32>(row, d.map(single), true),
                    _ => exponent::<f64>(row, d, false),
                };
                let falloff = if is(Stage::Exponential) { f64::from((power as f32).exp()) } else { power.exp() };
                let alpha = (row[5] * falloff).min(0.99);
                if alpha < 1.0 / 255.0 {
                    continue;
                }
                let next = products(transmittance * products(1.0 - products(alpha)));
                if next < 1e-4 {
                    break;
                }
                let weight = products(products(alpha) * transmittance);
                (0..3).for_each(|k| colour[k] = products(colour[k] + products(weight * row[8 + k])));
                transmittance = next;
            }
            std::array::from_fn(|k| colour[k] + transmittance * f64::from(scene.shot.background[k]))
        })
        .collect()
}

/// 200 ordinary splats and needles of aspect 10, 100 and 1,000, each with the share of pixels that may be near a
/// decision.
pub(crate) fn scenes() -> Vec<(String, f64, Scene)> {
    let mut random = seeded(77);
    let seen = camera(64, 48);
    let ordinary: Vec<_> = (0..200).map(|_| spread(&mut random, &seen, 1.2)).collect();
    let mut scenes = vec![("ordinary".to_owned(), 0.005, Scene::new(&ordinary, seen, false))];
    for (ratio, left_out) in [(10.0, 0.005), (100.0, 0.005), (1000.0, 0.05)] {
        scenes.push((format!("needles {ratio}"), left_out, needles(&mut seeded(ratio as u64), ratio)));
    }
    scenes
}

/// The errors of the stages add up to the device's error, so no stage is missing. Prints the table of
/// `docs/ACCURACY.md`.
#[test]
fn error_of_a_picture_by_stage() {
    let Some(gpu) = common::gpu() else { return };
    for (name, left_out, scene) in scenes() {
        let image = scene.wanted();
        let decided = decided(&name, &image, left_out);
        let largest = |colours: &[[f64; 3]]| {
            let off = (0..colours.len()).filter(|i| decided[*i]);
            off.flat_map(|i| (0..3).map(move |k| (i, k)))
                .map(|(i, k)| (colours[i][k] - image.colour[i][k]).abs())
                .fold(0.0f64, f64::max)
        };
        let none = largest(&picture(&scene, None));
        assert!(none < 1e-9, "{name}: in double precision the stages are {none:e} off the reference");
        let parts: Vec<f64> = STAGES.iter().map(|(stage, _)| largest(&picture(&scene, Some(*stage)))).collect();
        let device = worst(&image, &decided, &scene.picture(&gpu, Variants::choose(&gpu, false)));
        for ((_, what), part) in STAGES.iter().zip(&parts) {
            println!("{name}: {what} {part:.1e}");
        }
        println!("{name}: device {device:.1e}");
        let part = |stage: Stage| parts[STAGES.iter().position(|(s, _)| *s == stage).unwrap()];
        // Rows in f32 are part of both forms of the exponent.
        let together: f64 =
            [Stage::Means, Stage::Conics, Stage::Colours, Stage::Squares, Stage::Exponential, Stage::Products]
                .map(part)
                .iter()
                .sum();
        assert!(device < 2.0 * together, "{name}: the device is off by {device:e}, its stages by {together:e}");
        assert!(part(Stage::Squares) < 1.5 * part(Stage::PlainForm), "{name}: squares lose more than the plain form");
    }
}
