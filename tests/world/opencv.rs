//! The world through a lens with distortion against the same world without.

use psrgs_vk::dataset::{Dataset, LoadOptions};
use psrgs_vk::eval::psnr;
use psrgs_vk::format::image_out::read_depth;
use psrgs_vk::world::{CameraKind, Effects, World, WorldParams, generate};

use crate::small;

/// Lossless and without noise, so that nothing but the lens makes a difference.
fn params(camera: CameraKind) -> WorldParams {
    let effects = Effects { jpeg_quality: 0, sensor_noise: 0.0, ..Effects::default() };
    WorldParams { images: 4, max_side: 160, camera, effects, ..small() }
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
        assert!(photograph.rgba.chunks_exact(4).all(|p| p[3] == 255), "the photograph covers the picture");
        let rgb: Vec<u8> = photograph.rgba.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
        let (pinhole, depth) = straight.photograph(&made.camera, k);
        // What is left is the interpolation: half a pixel off would be a third of it.
        let quality = psnr(&rgb, pinhole.as_raw()).unwrap();
        println!("{}: {quality:.2} dB", view.name);
        let (width, moved) = (160, pinhole.as_raw().len() - 3);
        let shifted = psnr(&pinhole.as_raw()[..moved], &pinhole.as_raw()[3..]).unwrap();
        assert!(quality > 24.0 && quality > shifted + 6.0, "{}: {quality} dB, one pixel off {shifted}", view.name);
        // The truth is for the undistorted picture, so it is that of the pinhole world.
        let known = read_depth(&dir.path().join("depth").join(made.file("exr"))).unwrap();
        assert_eq!((known.width, &known.values), (width, &depth));
    }
}
