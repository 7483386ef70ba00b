//! Photographs with distortion, against rays computed here from COLMAP's documented formulas, parameter by parameter.

use std::f64::consts::TAU;
use std::path::Path;

use image::{Rgb, RgbImage};
use psrgs_vk::dataset::lens::{Distortion, Lens};
use psrgs_vk::dataset::{Dataset, LoadOptions, View};
use psrgs_vk::scene::Camera;

use crate::colmap_folder::{CameraRow, Folder};

const SIZE: [u32; 2] = [168, 120];

/// A model of COLMAP with its parameters: focal lengths and principal point, then the distortion.
struct Case {
    model: (&'static str, i32),
    params: Vec<f64>,
}

fn cases() -> Vec<Case> {
    let case = |name, number, params: &[f64]| Case { model: (name, number), params: params.to_vec() };
    vec![
        case("SIMPLE_RADIAL", 2, &[130.0, 81.0, 63.5, -0.18]),
        case("SIMPLE_RADIAL", 2, &[130.0, 86.0, 58.0, 0.15]),
        case("RADIAL", 3, &[125.0, 85.0, 57.0, -0.25, 0.06]),
        case("OPENCV", 4, &[128.0, 133.0, 80.0, 62.0, -0.21, 0.05, 0.004, -0.006]),
        case("OPENCV", 4, &[128.0, 133.0, 90.0, 55.0, 0.08, 0.02, -0.003, 0.005]),
        case("FULL_OPENCV", 6, &[120.0, 122.0, 82.0, 61.0, 0.9, 0.4, 0.002, -0.003, 0.05, 1.1, 0.6, 0.08]),
        case("SIMPLE_RADIAL_FISHEYE", 8, &[95.0, 84.0, 60.0, 0.03]),
        case("RADIAL_FISHEYE", 9, &[80.0, 83.0, 61.0, -0.02, 0.004]),
        case("OPENCV_FISHEYE", 5, &[62.0, 63.0, 85.0, 59.0, 0.03, -0.012, 0.004, -0.0006]),
        // Strong distortion: 180 degrees across the longer side.
        case("OPENCV_FISHEYE", 5, &[53.5, 53.5, 84.0, 60.0, 0.0, 0.0, 0.0, 0.0]),
    ]
}

impl Case {
    /// (focal lengths, principal point, the rest) as COLMAP orders them.
    fn parts(&self) -> ([f64; 2], [f64; 2], &[f64]) {
        let p = &self.params;
        if self.model.0.contains("OPENCV") {
            ([p[0], p[1]], [p[2], p[3]], &p[4..])
        } else {
            ([p[0], p[0]], [p[1], p[2]], &p[3..])
        }
    }

    /// The pixel of a ray (x, y, 1), without regard to the range of the polynomial.
    fn pixel(&self, x: f64, y: f64) -> [f64; 2] {
        let ([fx, fy], [cx, cy], k) = self.parts();
        let r2 = x * x + y * y;
        let at = |i: usize| k.get(i).copied().unwrap_or(0.0);
        let (u, v) = if self.model.0.contains("FISHEYE") {
            let r = r2.sqrt();
            let theta = r.atan();
            let bent = (0..4).fold(theta, |sum, i| sum + at(i) * theta.powi(2 * i as i32 + 3));
            let by = if r > 0.0 { bent / r } else { 1.0 };
            (x * by, y * by)
        } else if self.model.0.contains("OPENCV") {
            let (p1, p2) = (at(2), at(3));
            let top = 1.0 + at(0) * r2 + at(1) * r2.powi(2) + at(4) * r2.powi(3);
            let radial = top / (1.0 + at(5) * r2 + at(6) * r2.powi(2) + at(7) * r2.powi(3));
            (
                x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                y * radial + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y),
            )
        } else {
            let radial = 1.0 + at(0) * r2 + at(1) * r2 * r2;
            (x * radial, y * radial)
        };
        [fx * u + cx, fy * v + cy]
    }

    /// The ray of a pixel: steps from the axis to the pixel, each corrected with finite differences.
    fn ray(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        let center = self.pixel(0.0, 0.0);
        let mut ray = [0.0; 2];
        for step in 1..=16 {
            let part = f64::from(step) / 16.0;
            let goal = [0, 1].map(|i| center[i] + part * (pixel[i] - center[i]));
            for _ in 0..6 {
                let (here, h) = (self.pixel(ray[0], ray[1]), 1e-6);
                let (a, b) = (self.pixel(ray[0] + h, ray[1]), self.pixel(ray[0], ray[1] + h));
                let j = [(a[0] - here[0]) / h, (b[0] - here[0]) / h, (a[1] - here[1]) / h, (b[1] - here[1]) / h];
                let det = j[0] * j[3] - j[1] * j[2];
                let miss = [goal[0] - here[0], goal[1] - here[1]];
                ray[0] += (j[3] * miss[0] - j[1] * miss[1]) / det;
                ray[1] += (j[0] * miss[1] - j[2] * miss[0]) / det;
            }
        }
        let back = self.pixel(ray[0], ray[1]);
        let found = (back[0] - pixel[0]).hypot(back[1] - pixel[1]) < 1e-6 && ray[0].hypot(ray[1]) < 20.0;
        found.then_some(ray)
    }

    /// The rays of all pixels of a photograph.
    fn rays(&self) -> Vec<Option<[f64; 2]>> {
        let pixel = |k: u32| [f64::from(k % SIZE[0]) + 0.5, f64::from(k / SIZE[0]) + 0.5];
        (0..SIZE[0] * SIZE[1]).map(|k| self.ray(pixel(k))).collect()
    }

    /// A dataset of two photographs of this camera, the first with the colours of its pixels, the second white.
    fn dataset(&self, colour: impl Fn(usize) -> [u8; 3]) -> tempfile::TempDir {
        let mut folder = Folder::ring(&["a.png", "b.png"], [0.0; 3]);
        let size = SIZE.map(u64::from);
        folder.cameras = vec![CameraRow { id: 1, model: self.model, size, params: self.params.clone() }];
        let root = folder.dataset(self.params.len().is_multiple_of(2));
        let draw = |x, y| Rgb(colour((y * SIZE[0] + x) as usize));
        RgbImage::from_fn(SIZE[0], SIZE[1], draw).save(root.path().join("images/a.png")).expect("photograph");
        RgbImage::from_pixel(SIZE[0], SIZE[1], Rgb([255; 3]))
            .save(root.path().join("images/b.png"))
            .expect("photograph");
        root
    }
}

fn first(root: &Path, max_side: Option<u32>) -> View {
    Dataset::load(root, &LoadOptions { max_side, ..LoadOptions::default() }).expect("loads").views[0].clone()
}

fn ray(camera: &Camera, i: u32, j: u32) -> [f64; 2] {
    [(f64::from(i) + 0.5 - camera.cx) / camera.fx, (f64::from(j) + 0.5 - camera.cy) / camera.fy]
}

/// Error of each undistorted pixel's position along an axis, measured by waves that are shifted by a part of a period.
/// In pixels of the undistorted picture or of the photograph, whichever are coarser there. `None` where the filter
/// reaches over the photograph's edge.
fn deviations(case: &Case, rays: &[Option<[f64; 2]>], camera: &Camera, axis: usize, moved: f64) -> Vec<Option<f64>> {
    const PERIOD: f64 = 28.0;
    let focal = [camera.fx, camera.fy][axis];
    let place = |ray: [f64; 2]| focal * ray[axis] / PERIOD + moved;
    let root = case.dataset(|k| {
        let phase = TAU * rays[k].map_or(0.0, place);
        [phase.sin(), phase.cos(), 0.0].map(|v| (127.5 + 127.0 * v).round() as u8)
    });
    let view = first(root.path(), None);
    assert_eq!(view.camera, *camera);
    let photograph = view.photograph().expect("decodes");
    let rgba = photograph.rgba8();
    let pixels = rgba.chunks_exact(4).enumerate();
    let deviation = |(k, p): (usize, &[u8])| {
        let ray = ray(camera, k as u32 % camera.width, k as u32 / camera.width);
        let [u, v] = case.pixel(ray[0], ray[1]);
        let inner = u > 3.0 && v > 3.0 && u < f64::from(SIZE[0]) - 3.0 && v < f64::from(SIZE[1]) - 3.0;
        let found = (f64::from(p[0]) - 127.5).atan2(f64::from(p[1]) - 127.5) / TAU;
        let mut next = ray;
        next[axis] += 1.0 / focal;
        let apart = case.pixel(next[0], next[1]);
        let scale = (apart[0] - u).hypot(apart[1] - v).min(1.0);
        (inner && p[3] != 0).then(|| scale * PERIOD * ((found - place(ray) + 0.5).rem_euclid(1.0) - 0.5))
    };
    pixels.map(deviation).collect()
}

#[test]
fn undistorted_pixels_are_where_their_rays_are() {
    for case in cases() {
        let camera = first(case.dataset(|_| [0; 3]).path(), None).camera;
        let rays = case.rays();
        for axis in 0..2 {
            // The mean over four shifts of the waves: rounding to 8 bits differs between shifts, a wrong place stays.
            let all = [0.0, 0.23, 0.51, 0.74].map(|moved| deviations(&case, &rays, &camera, axis, moved));
            let mean = |k: usize| all.iter().map(|one| one[k]).sum::<Option<f64>>().map(|sum| sum / 4.0);
            let found: Vec<f64> = (0..all[0].len()).filter_map(mean).collect();
            let worst = found.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
            println!("{} {:?} axis {axis}: {worst:.4} px", case.model.0, case.params);
            assert!(found.len() as u32 > camera.width * camera.height / 2, "{}: {}", case.model.0, found.len());
            assert!(worst < 0.05, "{} axis {axis}: {worst} pixels off", case.model.0);
        }
    }
}

#[test]
fn pixels_without_a_source_are_masked_and_no_others() {
    for case in cases() {
        let root = case.dataset(|_| [255; 3]);
        for max_side in [None, Some(71)] {
            let views =
                Dataset::load(root.path(), &LoadOptions { max_side, ..LoadOptions::default() }).expect("loads").views;
            let camera = views[1].camera;
            let photograph = views[1].photograph().expect("decodes");
            let mut empty = 0;
            for (k, p) in photograph.rgba8().chunks_exact(4).enumerate() {
                let (i, j) = (k as u32 % camera.width, k as u32 / camera.width);
                let ray = ray(&camera, i, j);
                let [u, v] = case.pixel(ray[0], ray[1]);
                let margin = u.min(v).min(f64::from(SIZE[0]) - u).min(f64::from(SIZE[1]) - v);
                if margin.abs() > 1e-6 {
                    assert_eq!(p[3], if margin > 0.0 { 255 } else { 0 }, "{} at {i}, {j}: {margin}", case.model.0);
                }
                assert!(p[3] == 0 || p[..3] == [255; 3], "{}: {p:?}", case.model.0);
                empty += u32::from(p[3] == 0);
            }
            let share = f64::from(empty) / f64::from(camera.width * camera.height);
            println!("{} {:?}: {:.1} % masked", case.model.0, case.params, 100.0 * share);
            assert!(share < 0.25, "{}: {share}", case.model.0);
            assert!(camera.width.max(camera.height) <= max_side.unwrap_or(SIZE[0]));
        }
    }
}

#[test]
fn lens_rays_invert_pixels_up_to_the_turn_of_the_polynomial() {
    for case in cases() {
        let root = case.dataset(|_| [0; 3]);
        let lens = first(root.path(), None).lens.expect("a lens");
        for k in 0..400 {
            let pixel = [f64::from(k % 20) * 8.0 + 3.3, f64::from(k / 20) * 5.7 + 2.2];
            let Some(want) = case.ray(pixel) else { continue };
            if want[0].hypot(want[1]) > 10.0 {
                continue;
            }
            let found = lens.ray(pixel).expect("inside");
            let apart = (found[0] - want[0]).hypot(found[1] - want[1]);
            assert!(apart < 1e-8 * (1.0 + want[0].hypot(want[1]).powi(2)), "{} {pixel:?}: {apart}", case.model.0);
            let (back, jacobian) = lens.project(found).expect("inside");
            assert!((back[0] - pixel[0]).hypot(back[1] - pixel[1]) < 1e-9);
            for axis in 0..2 {
                let h = 1e-6;
                let at = |h: f64| {
                    let mut ray = found;
                    ray[axis] += h;
                    lens.project(ray).expect("inside").0
                };
                for (row, of) in jacobian.iter().enumerate() {
                    let want = (at(h)[row] - at(-h)[row]) / (2.0 * h);
                    assert!((of[axis] - want).abs() < 1e-3 * (1.0 + want.abs()) * 1e-2, "{}: {of:?}", case.model.0);
                }
            }
        }
    }
    // r (1 - r^2 / 2) turns at r = sqrt(2 / 3), where it is (2 / 3) sqrt(2 / 3).
    let turns = (2.0_f64 / 3.0).sqrt();
    let lens = Lens::new([100.0; 2], [50.0; 2], [100, 100], Distortion::brown([-0.5, 0.0, 0.0], [0.0; 2]));
    assert!(lens.project([turns - 1e-6, 0.0]).is_some() && lens.project([turns + 1e-6, 0.0]).is_none());
    assert!(lens.ray([50.0 + 100.0 * turns * 2.0 / 3.0 - 1e-6, 50.0]).is_some());
    assert!(lens.ray([50.0 + 100.0 * turns * 2.0 / 3.0 + 1e-6, 50.0]).is_none());
    assert!(lens.project([f64::NAN, 0.0]).is_none());
    // A photograph that ends beyond the turn shows nothing twice: the frame stays within the range, and corners
    // are masked.
    let camera = Lens::new([90.0; 2], [100.0; 2], [200, 200], lens.distortion).pinhole();
    assert!(((0.5 - camera.cx) / camera.fx).abs() <= turns && camera.cx == camera.cy);
}

#[test]
fn a_lens_without_distortion_is_a_pinhole_camera() {
    let straight = [
        ("OPENCV", 4, vec![150.0, 151.0, 80.0, 61.0, 0.0, 0.0, 0.0, 0.0]),
        ("SIMPLE_RADIAL", 2, vec![150.0, 80.0, 61.0, 0.0]),
    ];
    for (name, number, params) in straight {
        let view = first(Case { model: (name, number), params }.dataset(|_| [9; 3]).path(), None);
        assert!(view.lens.is_none());
        assert_eq!((view.camera.cx, view.camera.cy, view.camera.width), (80.0, 61.0, SIZE[0]));
    }
}

#[test]
fn frames_keep_the_middle_and_what_reaches_the_sides() {
    // Barrel: filled to the edges, the middle of each side stays in place. Pincushion: smaller than the photograph.
    for (k, corners_empty) in [(-0.15, false), (0.15, true)] {
        let case = Case { model: ("SIMPLE_RADIAL", 2), params: vec![130.0, 90.0, 55.0, k] };
        let root = case.dataset(|_| [255; 3]);
        let view = first(root.path(), None);
        let camera = view.camera;
        let side = |x: f64, y: f64| case.pixel((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy);
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        for (found, want) in [
            (side(0.0, camera.cy)[0], 0.0),
            (side(w, camera.cy)[0], f64::from(SIZE[0])),
            (side(camera.cx, 0.0)[1], 0.0),
            (side(camera.cx, h)[1], f64::from(SIZE[1])),
        ] {
            assert!((found - want).abs() < 1e-6, "{k}: {found} instead of {want}");
        }
        let photograph = view.photograph().expect("decodes");
        assert_eq!(photograph.rgba8()[3] == 0, corners_empty);
        assert!(camera.width.max(camera.height) <= SIZE[0]);
        assert!((camera.fx / camera.fy - 1.0).abs() < 0.01, "pixels stay square up to the rounding of the size");
        let want = if k > 0.0 { 130.0..131.0 } else { 110.0..130.0 };
        assert!(want.contains(&camera.fx), "{}", camera.fx);
    }
}
