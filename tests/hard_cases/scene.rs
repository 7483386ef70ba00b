//! Position and scale of a scene make no difference.

use std::path::Path;

use image::RgbaImage;
use psrgs_vk::dataset::{Dataset, LoadOptions, Role};
use psrgs_vk::train::{Input, Settings, prepare};
use psrgs_vk::vk::Gpu;

use super::colmap_folder::{CameraRow, Folder, ImageRow, PINHOLE, PointRow};
use super::common;
use super::common::plane_scene;
use super::device::{MEANS, NAMES, OPACITIES, SCALES, SH0, relative};
use super::training::{settings, state, trained};

/// The quaternion (w first) of a rotation matrix given by rows, by its largest component.
fn quaternion(r: &[[f64; 3]; 3]) -> [f64; 4] {
    let squares = [
        1.0 + r[0][0] + r[1][1] + r[2][2],
        1.0 + r[0][0] - r[1][1] - r[2][2],
        1.0 - r[0][0] + r[1][1] - r[2][2],
        1.0 - r[0][0] - r[1][1] + r[2][2],
    ];
    let largest = (1..4).fold(0, |best, k| if squares[k] > squares[best] { k } else { best });
    let s = 2.0 * squares[largest].sqrt();
    let (x, y, z) = ((r[2][1] - r[1][2]) / s, (r[0][2] - r[2][0]) / s, (r[1][0] - r[0][1]) / s);
    let (a, b, c) = ((r[0][1] + r[1][0]) / s, (r[0][2] + r[2][0]) / s, (r[1][2] + r[2][1]) / s);
    match largest {
        0 => [s / 4.0, x, y, z],
        1 => [x, s / 4.0, a, b],
        2 => [y, a, s / 4.0, c],
        _ => [z, b, c, s / 4.0],
    }
}

/// The plane scene as a dataset, scaled and then moved. Eight training photographs and two held-out ones.
fn write(root: &Path, scale: f64, offset: [f64; 3]) {
    let input = plane_scene::input(8, 48, 36, 300);
    let camera = &input.train[0].camera;
    let size = [u64::from(camera.width), u64::from(camera.height)];
    let cameras =
        vec![CameraRow { id: 1, model: PINHOLE, size, params: vec![camera.fx, camera.fy, camera.cx, camera.cy] }];
    // Positions 0 and 8 of the sorted names are held out.
    let order = [(&input.held_out[..1], "a"), (&input.train[..], "b"), (&input.held_out[1..], "c")];
    let mut images = Vec::new();
    for (view, name) in order.iter().flat_map(|(views, prefix)| views.iter().zip(std::iter::repeat(prefix))) {
        let name = format!("{name}{}.png", images.len());
        let r = view.camera.rotation;
        let translation = std::array::from_fn(|i| {
            scale * view.camera.translation[i] - (0..3).map(|j| r[i][j] * offset[j]).sum::<f64>()
        });
        let pixels = view.photograph.pixels().unwrap().rgba8().into_owned();
        std::fs::create_dir_all(root.join("images")).unwrap();
        let picture = RgbaImage::from_raw(view.camera.width, view.camera.height, pixels).unwrap();
        picture.save(root.join("images").join(&name)).unwrap();
        let id = images.len() as u32 + 1;
        images.push(ImageRow { id, quaternion: quaternion(&r), translation, camera: 1, name, keypoints: Vec::new() });
    }
    let points = (0..300)
        .map(|i| PointRow {
            id: i as u64 + 1,
            position: std::array::from_fn(|k| scale * f64::from(input.initial.means[3 * i + k]) + offset[k]),
            colour: [(i % 200) as u8 + 30, 128, 250 - (i % 200) as u8],
            error: 0.5,
            track: vec![(1, 0), (2, 0)],
        })
        .collect();
    let folder = Folder { cameras, images, points };
    folder.write(root, &folder.binary());
}

struct Loaded {
    dataset: Dataset,
    input: Input,
}

fn load(scale: f64, offset: [f64; 3]) -> Loaded {
    let root = tempfile::tempdir().unwrap();
    write(root.path(), scale, offset);
    let dataset = Dataset::load(root.path(), &LoadOptions::default()).unwrap();
    let input = prepare::input(&dataset, &Settings::default()).unwrap();
    assert_eq!((input.train.len(), input.held_out.len()), (8, 2));
    Loaded { dataset, input }
}

/// First moments after one step: a tenth of its gradients.
fn first_gradients(gpu: &Gpu, input: &Input) -> [Vec<f32>; 8] {
    let mut s = settings(2);
    s.density.no_densify = true;
    let (mut trainer, _) = trained(gpu, input.clone(), &s);
    let mut end = state(&mut trainer);
    assert_eq!(end.ids.len(), 300);
    end.moments.swap_remove(0)
}

/// Held-out PSNR after a training.
fn score(gpu: &Gpu, input: &Input, seed: u64) -> f64 {
    let mut s = settings(120);
    s.run.seed = seed;
    s.density.max_splats = Some(700);
    let (mut trainer, _) = trained(gpu, input.clone(), &s);
    trainer.evaluate().unwrap().psnr
}

/// Checks that both scenes agree up to rounding: of f32 parameters, and of f64 coordinates in files at a distance of
/// `far` from the origin.
fn assert_same_scene(what: &str, near: &Loaded, other: &Loaded, far: f64) {
    let file = 4.0 * far * f64::EPSILON * other.dataset.frame.scale;
    let close = |name: &str, a: f64, b: f64| {
        let ulp = f64::from((a as f32).abs().next_up() - (a as f32).abs());
        assert!((a - b).abs() <= ulp + file, "{what}, {name}: {a} and {b}");
    };
    let (a, b) = (&near.input.initial, &other.input.initial);
    assert_eq!(a.len(), b.len());
    for (name, x, y) in [("means", &a.means, &b.means), ("scales", &a.scales, &b.scales)] {
        x.iter().zip(y).for_each(|(x, y)| close(name, f64::from(*x), f64::from(*y)));
    }
    assert_eq!((&a.opacities, &a.quats, &a.sh), (&b.opacities, &b.quats, &b.sh), "{what}");
    for (x, y) in near.input.train.iter().zip(&other.input.train) {
        assert_eq!(x.name, y.name);
        let (x, y) = (&x.camera, &y.camera);
        for k in 0..3 {
            close("translation", x.translation[k], y.translation[k]);
            (0..3).for_each(|j| close("rotation", x.rotation[k][j], y.rotation[k][j]));
        }
    }
    assert!(near.dataset.views_of(Role::HeldOut).count() == 2);
}

/// First gradients within 1e-5 and the score of a training within the spread over seeds, for a scene in coordinates of
/// a national grid (where a float is half a metre wide) and one in units a hundred times smaller.
#[test]
fn utm_offset_and_scene_scale_x100() {
    let Some(gpu) = common::gpu() else { return };
    let near = load(1.0, [0.0; 3]);
    let utm = load(1.0, [5e5, 4.6e6, 100.0]);
    let large = load(100.0, [0.0; 3]);
    assert_same_scene("UTM", &near, &utm, 5e6);
    assert_same_scene("x100", &near, &large, 1e3);
    let want = first_gradients(&gpu, &near.input);
    for (what, other) in [("UTM", &utm), ("x100", &large)] {
        let found = first_gradients(&gpu, &other.input);
        // The first splats are round, so rotations have no gradient. Higher degrees of harmonics are not in use yet.
        for (p, got) in [MEANS, SCALES, OPACITIES, SH0].map(|p| (p, &found[p])) {
            let wide: Vec<f64> = want[p].iter().map(|v| f64::from(*v)).collect();
            assert!(wide.iter().any(|v| *v != 0.0), "{}", NAMES[p]);
            let error = relative(got, &wide);
            println!("{what}: first gradients of {} differ by {error:.1e}", NAMES[p]);
            assert!(error < 1e-5, "{what}: first gradients of {} differ by {error:e}", NAMES[p]);
        }
    }
    let seeds: Vec<f64> = (0..4).map(|seed| score(&gpu, &near.input, seed)).collect();
    let (low, high) = (seeds.iter().copied().fold(f64::MAX, f64::min), seeds.iter().copied().fold(0.0, f64::max));
    for (what, other) in [("UTM", &utm), ("x100", &large)] {
        let got = score(&gpu, &other.input, 0);
        println!("{what}: {got:.2} dB; {low:.2} to {high:.2} over seeds");
        // Four seeds do not show the whole spread.
        let spread = high - low;
        assert!(got > low - spread && got < high + spread, "{what}: {got} dB; {low} to {high} over seeds");
    }
}
