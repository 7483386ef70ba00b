//! The world through a lens with distortion against the world without distortion.

use psrgs_vk::dataset::{Dataset, LoadOptions};
use psrgs_vk::eval::psnr;
use psrgs_vk::format::image_out::read_depth;
use psrgs_vk::world::{CameraKind, Effects, World, WorldParams, generate};

use crate::small;

/// Lossless and without noise, so that only the lens makes a difference.
fn params(camera: CameraKind) -> WorldParams {
    let effects = Effects { jpeg_quality: 0, sensor_noise: 0.0, ..Effects::default() };
    WorldParams { images: 4, max_side: 160, camera, effects, ..small() }
}

/// Shift d of a picture against another in pixels: the least squares of a - b + gradient . d, by the normal equations
/// (Lucas and Kanade 1981).
fn shift(a: &[u8], b: &[u8], width: usize) -> [f64; 2] {
    let at = |p: &[u8], x: usize, y: usize| f64::from(p[3 * (y * width + x) + 1]);
    let (mut xx, mut xy, mut yy, mut x0, mut y0) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for y in 1..b.len() / 3 / width - 1 {
        for x in 1..width - 1 {
            let (gx, gy) = (0.5 * (at(b, x + 1, y) - at(b, x - 1, y)), 0.5 * (at(b, x, y + 1) - at(b, x, y - 1)));
            let d = at(a, x, y) - at(b, x, y);
            (xx, xy, yy, x0, y0) = (xx + gx * gx, xy + gx * gy, yy + gy * gy, x0 - gx * d, y0 - gy * d);
        }
    }
    let det = xx * yy - xy * xy;
    [(yy * x0 - xy * y0) / det, (xx * y0 - xy * x0) / det]
}

#[test]
fn undistorted_photographs_are_those_of_the_pinhole_world() {
    let dir = tempfile::tempdir().unwrap();
    let bent = params(CameraKind::Opencv);
    let summary = generate(&bent, dir.path(), &mut |_| ()).unwrap();
    assert!(summary.width == 160 && summary.height > 120, "barrel distortion takes a higher photograph");
    let data = Dataset::load(dir.path(), &LoadOptions::default()).unwrap();
    assert!(data.warnings.is_empty(), "{:?}", data.warnings);
    let straight = World::new(&params(CameraKind::Pinhole)).unwrap();
    for ((view, made), k) in data.views.iter().zip(straight.views()).zip(0..) {
        assert_eq!(view.model, "OPENCV");
        let (got, want) = (&view.camera, &made.reconstructed);
        assert_eq!((got.width, got.height), (want.width, want.height));
        for (a, b) in [(got.fx, want.fx), (got.fy, want.fy), (got.cx, want.cx), (got.cy, want.cy)] {
            assert!((a - b).abs() < 1e-6, "{got:?} {want:?}");
        }
        let photograph = view.photograph().unwrap();
        assert!(photograph.rgba8().chunks_exact(4).all(|p| p[3] == 255), "the photograph covers the picture");
        let rgb: Vec<u8> = photograph.rgba8().chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
        let (pinhole, depth) = straight.photograph(&made.camera, k);
        // The remaining error is interpolation, not a shift: a picture that is one pixel off is far worse.
        let quality = psnr(&rgb, pinhole.as_raw()).unwrap();
        let all = pinhole.as_raw();
        let shifted = psnr(&all[..all.len() - 3], &all[3..]).unwrap();
        let shift = shift(&rgb, all, 160);
        println!("{}: {quality:.2} dB, moved by {shift:.3?} px; {shifted:.2} dB one pixel off", view.name);
        assert!(quality > 27.0 && quality > shifted + 6.0, "{}: {quality} dB, one pixel off {shifted}", view.name);
        assert!(shift[0].hypot(shift[1]) < 0.05, "{}: moved by {shift:?} px", view.name);
        // The ground truth belongs to the undistorted photograph, so it equals that of the pinhole world.
        let known = read_depth(&dir.path().join("depth").join(made.file("exr"))).unwrap();
        assert_eq!((known.width, &known.values), (160, &depth));
    }
}
