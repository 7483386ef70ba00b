//! Sources of the error of gradients: one stage at a time in f32 and all others in double precision.

use psrgs_vk::pass::camera::CameraPush;
use psrgs_vk::raster::Variants;
use psrgs_vk::twin::Real;
use psrgs_vk::twin::project_backward::{Grad2d, project_backward};
use psrgs_vk::twin::reference::Gradients;
use psrgs_vk::twin::splat::{Splat, TwinCamera};

use super::budget::{exponent, rows, scenes, single};
use super::common;
use super::common::splats::seeded;
use super::device::{NAMES, SCALES, Scene, decided, upstream};

/// The stage that is computed in f32.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    /// Projected centres.
    Means,
    /// Projected covariances: A, B, C and C - B^2 / A.
    Conics,
    /// Opacities and colours.
    Colours,
    /// No arithmetic; the rows that blending reads are stored in f32.
    Rows,
    /// The two squares, from rows in f32.
    Exponent,
    /// 2^x.
    Exponential,
    /// Transmittances: the product forward, and the division backward.
    Transmittance,
    /// The colour behind a splat, and so the gradient of alpha.
    Behind,
    /// The contributions of a tile's pixels to a splat, from rows in f32.
    Sums,
    /// Slots, and their sums over tiles.
    Slots,
    /// No arithmetic; the gradients that the projection reads are stored in f32.
    Stored,
    /// The projection's derivative, from gradients in f32.
    Projection,
    /// `Sums` in the frame of the two squares: no stage of the device, but a possible variant of blending.
    Squared,
}

const STAGES: [(Stage, &str); 13] = [
    (Stage::Means, "projected means"),
    (Stage::Conics, "projected conics"),
    (Stage::Colours, "opacities and colours"),
    (Stage::Rows, "rows stored in f32"),
    (Stage::Exponent, "exponent"),
    (Stage::Exponential, "exponential"),
    (Stage::Transmittance, "transmittance"),
    (Stage::Behind, "gradient of alpha"),
    (Stage::Sums, "sums in a tile"),
    (Stage::Squared, "sums in the squares' frame"),
    (Stage::Slots, "slots"),
    (Stage::Stored, "gradients stored in f32"),
    (Stage::Projection, "projection's derivative"),
];

/// Side of a tile.
const SIDE: usize = 8;

/// Number of compared planes: means, quats, scales, opacities, sh0.
const PLANES: usize = 5;

/// A splat's share of a pixel: weight, and gradient of the exponent (base e).
#[derive(Clone, Copy, Default)]
struct Share {
    weight: f64,
    v: f64,
}

/// Shares of all rows at the pixel whose centre is `at`, for the gradient `up` of its colour and transmittance.
fn shares(
    rows: &[(usize, [f64; 12])],
    at: [f64; 2],
    background: [f32; 3],
    up: &[f32],
    stage: Option<Stage>,
) -> Vec<Share> {
    let rounded = |of: Stage, v: f64| if stage == Some(of) { single(v) } else { v };
    let t = |v: f64| rounded(Stage::Transmittance, v);
    let b = |v: f64| rounded(Stage::Behind, v);
    let mut free = vec![0.0; rows.len()];
    let mut transmittance = 1.0;
    for ((_, row), free) in rows.iter().zip(&mut free) {
        let d = [at[0] - row[0], at[1] - row[1]];
        let power = match stage {
            Some(Stage::Exponent) => exponent::<f32>(row, d.map(single), false),
            _ => exponent::<f64>(row, d, false),
        };
        let falloff = if stage == Some(Stage::Exponential) { f64::from((power as f32).exp()) } else { power.exp() };
        let alpha = row[5] * falloff;
        if alpha < 1.0 / 255.0 {
            continue;
        }
        let next = t(transmittance * t(1.0 - t(alpha.min(0.99))));
        if next < 1e-4 {
            break;
        }
        *free = alpha;
        transmittance = next;
    }
    let dot = |colour: [f64; 3]| (0..3).fold(0.0, |sum, k| b(sum + b(colour[k] * f64::from(up[k]))));
    let mut behind = b(dot(background.map(f64::from)) + f64::from(up[3]));
    let mut out = vec![Share::default(); rows.len()];
    for (k, (_, row)) in rows.iter().enumerate().rev().filter(|(k, _)| free[*k] > 0.0) {
        let alpha = t(free[k].min(0.99));
        transmittance = t(transmittance / t(1.0 - alpha));
        let weight = t(alpha * transmittance);
        let difference = b(dot([row[8], row[9], row[10]]) - behind);
        behind = b(behind + b(alpha * difference));
        out[k] = Share { weight, v: if free[k] > 0.99 { 0.0 } else { b(weight * difference) } };
    }
    out
}

/// Sums over the lanes of a tile in the order of the butterfly.
fn fold<R: Real>(lanes: &[[R; 9]]) -> [R; 9] {
    match lanes {
        [one] => *one,
        _ => {
            // First the lanes that differ in the lowest bit.
            let next: Vec<[R; 9]> =
                lanes.chunks(2).map(|pair| std::array::from_fn(|c| pair[0][c] + pair[1][c])).collect();
            fold(&next)
        }
    }
}

/// The first nine columns of `grad2d` from the shares of a tile's pixels (row-major) whose corner is `corner`. With
/// `squared` columns 2 to 4 are sums of v times x^2, x y and y^2, where the exponent is -(x^2 + y^2) / 2.
fn tile_row<R: Real>(row: &[f64; 12], corner: [f64; 2], shares: &[Share], grads: &[[f32; 4]], squared: bool) -> [R; 9] {
    let [mx, my, a, b] = [row[0], row[1], row[2], row[3]].map(R::of);
    let [opacity, rest] = [row[5], row[7]].map(R::of);
    let p = a.sqrt();
    let (q, r) = (b / p, rest.sqrt());
    let (o, half) = (R::zero(), R::of(0.5));
    let lanes: Vec<[R; 9]> = (0..SIDE)
        .map(|lane| {
            let dx = R::of(corner[0] + lane as f64 + 0.5) - mx;
            let dy0 = R::of(corner[1] + 0.5) - my;
            let (mut sums, mut colours) = ([o; 3], [o; 3]);
            for j in 0..SIDE {
                let share = shares[SIDE * j + lane];
                let (v, dy) = (R::of(share.v), dy0 + R::of(j as f64));
                let along = if squared { R::of(j as f64 - 3.5) } else { dy };
                sums[0] += v;
                sums[1] += v * along;
                sums[2] += v * along * along;
                (0..3).for_each(|k| colours[k] += R::of(share.weight) * R::of(f64::from(grads[SIDE * j + lane][k])));
            }
            let [v0, v1, v2] = sums;
            let (mean, conic) = if squared {
                let middle = dy0 + R::of(3.5);
                let (x, y) = (p * dx + q * middle, r * middle);
                let (vx, vy) = (x * v0 + q * v1, y * v0 + r * v1);
                let xx = x * (vx + q * v1) + q * q * v2;
                let xy = y * vx + r * (x * v1 + q * v2);
                let yy = y * (vy + r * v1) + r * r * v2;
                ([p * vx, q * vx + r * vy], [xx, xy, yy])
            } else {
                let root = p * dx * v0 + q * v1;
                ([p * root, q * root + rest * v1], [-half * dx * dx * v0, -dx * v1, -half * v2])
            };
            let [red, green, blue] = colours;
            [mean[0], mean[1], conic[0], conic[1], conic[2], v0 / opacity, red, green, blue]
        })
        .collect();
    fold(&lanes)
}

/// Gradients of the conic from sums in the frame of the two squares.
fn unsquared(row: &[f64; 12], [xx, xy, yy]: [f64; 3]) -> [f64; 3] {
    let p = row[2].sqrt();
    let (q, r) = (row[3] / p, row[7].sqrt());
    let slope = q / r;
    [-0.5 * (xx - 2.0 * slope * xy + slope * slope * yy) / (p * p), -(xy - slope * yy) / (p * r), -0.5 * yy / (r * r)]
}

/// A row of `grad2d`.
type Row = [f64; 12];

/// Rows of `grad2d` by splat, from all tiles.
fn grad2d(scene: &Scene, upstream: &[f32], stage: Option<Stage>) -> (Vec<(usize, Row)>, Vec<Row>) {
    let (width, height) = (scene.shot.camera.width as usize, scene.shot.camera.height as usize);
    let taken: &[usize] = match stage {
        Some(Stage::Means) => &[0, 1],
        Some(Stage::Conics) => &[2, 3, 4, 7],
        Some(Stage::Colours) => &[5, 8, 9, 10],
        _ => &[],
    };
    let exact = rows(scene, taken);
    let mut rows = exact.clone();
    if matches!(stage, Some(Stage::Rows | Stage::Exponent | Stage::Sums | Stage::Squared)) {
        rows.iter_mut().for_each(|(_, row)| *row = row.map(single));
    }
    let mut out = vec![[0.0; 12]; scene.model.len()];
    for corner_y in (0..height).step_by(SIDE) {
        for corner_x in (0..width).step_by(SIDE) {
            let pixels = (0..SIDE * SIDE).map(|k| [corner_x + k % SIDE, corner_y + k / SIDE]);
            let grads: Vec<[f32; 4]> =
                pixels.clone().map(|[x, y]| std::array::from_fn(|c| upstream[4 * (width * y + x) + c])).collect();
            let of_pixels: Vec<Vec<Share>> = pixels
                .zip(&grads)
                .map(|([x, y], up)| shares(&rows, [x as f64 + 0.5, y as f64 + 0.5], scene.shot.background, up, stage))
                .collect();
            let corner = [corner_x as f64, corner_y as f64];
            for (k, (splat, row)) in rows.iter().enumerate() {
                let of_row: Vec<Share> = of_pixels.iter().map(|shares| shares[k]).collect();
                let mut sums: [f64; 9] = match stage {
                    Some(Stage::Sums) => tile_row::<f32>(row, corner, &of_row, &grads, false).map(f64::from),
                    Some(Stage::Squared) => tile_row::<f32>(row, corner, &of_row, &grads, true).map(f64::from),
                    _ => tile_row::<f64>(row, corner, &of_row, &grads, false),
                };
                if stage == Some(Stage::Squared) {
                    let conic = unsquared(row, [sums[2], sums[3], sums[4]]);
                    sums[2..5].copy_from_slice(&conic);
                }
                let slots = |v: f64| if stage == Some(Stage::Slots) { single(v) } else { v };
                (0..9).for_each(|c| out[*splat][c] = slots(out[*splat][c] + slots(sums[c])));
            }
        }
    }
    (exact, out)
}

/// Gradients of the planes with a stage in f32.
fn planes(scene: &Scene, upstream: &[f32], stage: Option<Stage>) -> [Vec<f64>; 8] {
    let (rows, mut grads) = grad2d(scene, upstream, stage);
    if matches!(stage, Some(Stage::Stored | Stage::Projection)) {
        grads.iter_mut().for_each(|row| *row = row.map(single));
    }
    let exact = TwinCamera::<f64>::exact(&scene.shot.camera, &scene.shot.projection);
    let push = TwinCamera::<f32>::of(&CameraPush::new(&scene.shot.camera, &scene.shot.projection));
    let zero = Splat::from_array(&[0.0; 59]);
    let mut splats = vec![zero; scene.model.len()];
    for (i, row) in &rows {
        let colour = [row[8], row[9], row[10]];
        splats[*i] = if stage == Some(Stage::Projection) {
            let g = Grad2d { row: grads[*i].map(|v| v as f32), normal: [0.0; 3] };
            let single = project_backward(&Splat::<f32>::of(&scene.model, *i), &push, colour.map(|v| v as f32), &g);
            Splat::from_array(&single.to_array().map(f64::from))
        } else {
            project_backward(&scene.splats[*i], &exact, colour, &Grad2d { row: grads[*i], normal: [0.0; 3] })
        };
    }
    Gradients { splats, grad2d: Vec::new(), normals: Vec::new() }.planes()
}

/// |got - want| / |want| of each plane.
fn relative(got: &[Vec<f64>; 8], want: &[Vec<f64>; 8]) -> [f64; PLANES] {
    std::array::from_fn(|p| {
        let error: f64 = got[p].iter().zip(&want[p]).map(|(g, w)| (g - w).powi(2)).sum();
        (error / want[p].iter().map(|w| w * w).sum::<f64>()).sqrt()
    })
}

fn shown(of: &[f64; PLANES]) -> String {
    let worst = (0..PLANES).max_by(|a, b| of[*a].total_cmp(&of[*b])).unwrap();
    let each: Vec<String> = of.iter().map(|e| format!("{e:.1e}")).collect();
    format!("{:.1e} ({}); {}", of[worst], NAMES[worst], each.join(" "))
}

/// Bound of a stage's error in a plane for needles of an aspect: a few times the measured error.
fn bound(stage: Stage, plane: usize, aspect: f64) -> f64 {
    match stage {
        // Rounding that does not depend on the shape of the splat.
        Stage::Colours | Stage::Exponential | Stage::Transmittance | Stage::Behind => 2e-6,
        // Coordinates up to 64 are rounded, where half a pixel across a needle counts.
        Stage::Means | Stage::Conics | Stage::Rows | Stage::Exponent | Stage::Squared => 3e-5,
        // Gradients of the conic are sums of dx^2, dx dy and dy^2, which grow with the length of a needle. The gradient
        // of the scale across the needle is a small difference of these three sums.
        Stage::Sums | Stage::Slots | Stage::Stored | Stage::Projection if plane == SCALES => 5e-6 + 4e-7 * aspect,
        Stage::Sums | Stage::Slots | Stage::Stored | Stage::Projection => 3e-5,
    }
}

/// The errors of the stages add up to the device's error, so no stage is missing. Prints the table of
/// `docs/ACCURACY.md`.
#[test]
fn error_of_gradients_by_stage() {
    let Some(gpu) = common::gpu() else { return };
    for ((name, left_out, scene), aspect) in scenes().into_iter().zip([3.0, 10.0, 100.0, 1000.0]) {
        let decided = decided(&name, &scene.wanted(), left_out);
        let g = upstream(&mut seeded(78), &decided);
        let want = scene.wanted_gradients(&g).planes();
        let none = relative(&planes(&scene, &g, None), &want);
        // The reference forms ac - b^2, which costs it digits by the square of the aspect.
        let exact = none.iter().all(|e| *e < 1e-12 + 1e-13 * aspect * aspect);
        assert!(exact, "{name}: in double precision the stages are off the reference: {}", shown(&none));
        let mut together = [0.0; PLANES];
        for (stage, what) in STAGES {
            let part = relative(&planes(&scene, &g, Some(stage)), &want);
            println!("{name}: {what}: {}", shown(&part));
            for (p, error) in part.into_iter().enumerate() {
                let most = bound(stage, p, aspect);
                assert!(error < most, "{name}: {what}, {}: {error:e} > {most:e}", NAMES[p]);
                // Rows in f32 are part of the exponent; the last stage is no part of the device.
                together[p] += if matches!(stage, Stage::Rows | Stage::Stored | Stage::Squared) { 0.0 } else { error };
            }
        }
        let got = scene.gradients(&gpu, Variants::choose(&gpu, false), &g).planes;
        let device = relative(&got.map(|plane| plane.into_iter().map(f64::from).collect()), &want);
        println!("{name}: device: {}", shown(&device));
        for p in 0..PLANES {
            let (device, parts) = (device[p], together[p]);
            assert!(device < 2.0 * parts, "{name}, {}: off by {device:e}, its stages by {parts:e}", NAMES[p]);
        }
    }
}
