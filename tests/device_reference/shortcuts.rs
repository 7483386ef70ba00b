//! Cheaper renders: a cut-off of alphas equals the brute-force renderer with the same cut-off, and half floats differ
//! by their rounding alone.

use half::f16;
use psrgs_vk::pass::alpha_min::alpha_min;
use psrgs_vk::raster::{self, GradientSum, Planes, Renderer, ShStorage, Size, Target, TileShape, Variants, Viewer};
use psrgs_vk::twin::reference::{self, Settings};
use psrgs_vk::twin::splat::Splat;
use psrgs_vk::vk::{Error, Memory};

use super::{Case, SHAPES, cases, common};

fn picture(gpu: &psrgs_vk::vk::Gpu, case: &Case, tile: TileShape) -> Vec<f32> {
    let mut viewer = Viewer::with_variants(gpu, Variants::new(tile, GradientSum::Slots));
    let planes = viewer.upload(&case.model).unwrap();
    viewer.render(&planes, case.model.len() as u32, &case.shot, false).unwrap().rgbt
}

#[test]
fn cut_offs_are_those_of_the_brute_force_renderer() {
    let Some(gpu) = common::gpu() else { return };
    for cutoff in [1000, 64] {
        let mut differs = 0.0f64;
        for mut case in cases(200).into_iter().take(3) {
            let before = case.image.colour.clone();
            case.settings = Settings { alpha_min: f64::from(alpha_min(Some(cutoff))), ..case.settings };
            case.image = reference::render(&case.splats, &case.shot.camera, &case.settings);
            for (a, b) in before.iter().flatten().zip(case.image.colour.iter().flatten()) {
                differs = differs.max((a - b).abs());
            }
            case.shot.projection.alpha_cutoff = Some(cutoff);
            for tile in SHAPES {
                let rgbt = picture(&gpu, &case, tile);
                for c in 0..3 {
                    case.check("colour", tile, 1.0, |i| case.image.colour[i][c], |i| rgbt[4 * i + c]);
                }
                case.check("transmittance", tile, 1.0, |i| case.image.transmittance[i], |i| rgbt[4 * i + 3]);
            }
        }
        println!("1/{cutoff}: colours differ by up to {differs:.1e} from the exact ones");
        assert!(differs > 1e-3, "1/{cutoff} changes no more than {differs:e}");
    }
    common::assert_no_messages(&gpu);
}

#[test]
fn half_floats_of_spherical_harmonics_are_their_rounding() {
    let Some(gpu) = common::gpu() else { return };
    for mut case in cases(200).into_iter().take(4) {
        let exact = case.image.colour.clone();
        case.model.sh.iter_mut().flatten().for_each(|v| *v = f16::from_f32(*v).to_f32());
        let rounded = case.model.clone();
        case.splats = Splat::all(&rounded);
        case.image = reference::render(&case.splats, &case.shot.camera, &case.settings);
        assert!(exact != case.image.colour);
        for tile in SHAPES {
            let mut viewer = Viewer::with_variants(&gpu, Variants::new(tile, GradientSum::Slots));
            let mut planes = viewer.upload_with(&case.model, ShStorage::Half).unwrap();
            let n = case.model.len() as u32;
            let rgbt = viewer.render(&planes, n, &case.shot, false).unwrap().rgbt;
            for c in 0..3 {
                case.check("colour", tile, 1.0, |i| case.image.colour[i][c], |i| rgbt[4 * i + c]);
            }
            assert_eq!(planes.bytes(), u64::from(n) * (4 * 11 + 2 * 48));
            planes.grow(&gpu, 2 * n).unwrap();
            assert_eq!(planes.read(&gpu, n).unwrap()[raster::SH0..], rounded.sh);
            assert!(planes.layout().iter().all(|plane| plane.bits == if plane.floats == 12 { 16 } else { 32 }));
        }
    }
    common::assert_no_messages(&gpu);
}

#[test]
fn half_floats_have_no_gradients() {
    let Some(gpu) = common::gpu() else { return };
    let case = &cases(20)[0];
    let variants = Variants::new(TileShape::Column, GradientSum::Slots);
    let viewer = Viewer::with_variants(&gpu, variants);
    let model = viewer.upload_with(&case.model, ShStorage::Half).unwrap();
    let size = Size { clamp_gradient_passes: false, ..Size::training(20, 5000, 64) };
    let renderer = Renderer::new(&gpu, variants, size).unwrap();
    let target = Target::new(&gpu, "", 64 * 64, false).unwrap();
    let of_model = Planes::new(&gpu, "g_", 20).unwrap();
    let upstream = gpu.buffer("grad_image", 16 * 64 * 64, Memory::Device).unwrap();
    let mut recorder = gpu.recorder("half").unwrap();
    let lists = renderer.record_forward(&mut recorder, &model, &case.shot, &target, false).unwrap();
    let of_image = (&upstream).into();
    let gradients = raster::Gradients { model: &model, of_model: &of_model, of_image };
    let refused = renderer.record_backward(&mut recorder, &lists, &gradients, &case.shot, &target);
    assert!(matches!(refused, Err(Error::Interface { kernel: "project_backward", .. })), "{refused:?}");
}
