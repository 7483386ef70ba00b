//! Photographs with little content, and backgrounds that hide holes.

use psrgs_vk::raster::{RenderView, Viewer};
use psrgs_vk::train::Input;
use psrgs_vk::train::settings::Background;
use psrgs_vk::vk::Gpu;

use super::common;
use super::common::plane_scene;
use super::training::{mapped_input, settings, tail, trained};

/// A twentieth of the light, and a twentieth of the contrast about grey, in 8 bits. The gradient of an absolute
/// difference does not shrink with the contrast, so models learn and grow. On black photographs models only fade.
#[test]
fn dark_and_low_contrast_photographs() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(6, 64, 48, 300);
    let mut s = settings(100);
    s.density.densify_until = 50;
    let (_, plain) = trained(&gpu, input.clone(), &s);
    let dark = |p: [u8; 4]| [0, 1, 2, 3].map(|k| if k < 3 { (f64::from(p[k]) * 0.05).round() as u8 } else { p[k] });
    let flat = |p: [u8; 4]| {
        [0, 1, 2, 3].map(|k| if k < 3 { (127.5 + 0.05 * (f64::from(p[k]) - 127.5)).round() as u8 } else { p[k] })
    };
    let black = |p: [u8; 4]| [0, 0, 0, p[3]];
    let cases = [
        ("dark", mapped_input(&input, dark), true),
        ("low contrast", mapped_input(&input, flat), true),
        ("black", mapped_input(&input, black), false),
    ];
    for (what, input, grows) in cases {
        let (mut trainer, told) = trained(&gpu, input, &s);
        let (first, last) = (told.losses[0], tail(&told.losses, 6));
        let psnr = trainer.evaluate().unwrap().psnr;
        println!(
            "{what}: loss {first:.4} to {last:.4}, {psnr:.1} dB held out, {} splats grown ({} with all of the light)",
            told.grown(),
            plain.grown()
        );
        assert!(told.losses.iter().all(|l| l.is_finite()), "{what}");
        assert!(last < 0.6 * first, "{what}: loss {first} to {last}");
        assert!(!grows || told.grown() > 0, "{what}: nothing grew");
    }
}

/// Mean transmittance of the unmasked pixels, and the loss of their PSNR by a white background.
fn holes(gpu: &Gpu, input: &Input, background: Background) -> [f64; 2] {
    let mut s = settings(150);
    s.model.background = background;
    s.density.max_splats = Some(1500);
    let (mut trainer, told) = trained(gpu, input.clone(), &s);
    assert!(told.losses.iter().all(|l| l.is_finite()));
    let model = trainer.model().unwrap();
    let mut viewer = Viewer::new(gpu);
    let planes = viewer.upload(&model).unwrap();
    let (mut through, mut drop) = (0.0, 0.0);
    for view in &input.held_out {
        let pixels = view.photograph.pixels().unwrap();
        let rgba = pixels.rgba8();
        let counts: Vec<usize> = (0..rgba.len() / 4).filter(|i| rgba[4 * i + 3] == 255).collect();
        let mut render = |background: [f32; 3]| {
            let projection = psrgs_vk::pass::camera::Projection::default();
            let shot = RenderView { camera: view.camera, projection, background };
            viewer.render(&planes, model.len() as u32, &shot, false).unwrap().rgbt
        };
        let [dark, bright] = [render([0.0; 3]), render([1.0; 3])];
        let error = |shown: &[f32]| -> f64 {
            let squares = counts.iter().flat_map(|i| (0..3).map(move |c| (*i, c)));
            let squares =
                squares.map(|(i, c)| (f64::from(shown[4 * i + c]) - f64::from(rgba[4 * i + c]) / 255.0).powi(2));
            squares.sum::<f64>() / (3 * counts.len()) as f64
        };
        through += counts.iter().map(|i| f64::from(dark[4 * i + 3])).sum::<f64>() / counts.len() as f64;
        drop += 10.0 * (error(&bright) / error(&dark)).log10();
    }
    [through / 2.0, drop / 2.0]
}

/// A dark ground in front of a black background: holes in the ground look right. A background of random colours closes
/// the holes.
#[test]
fn background_cheating() {
    let Some(gpu) = common::gpu() else { return };
    // Pixels beside the ground are masked.
    let dark = |p: [u8; 4]| {
        let alpha = if p[..3] == [0; 3] { 0 } else { 255 };
        [p[0] / 4, p[1] / 4, p[2] / 4, alpha]
    };
    let input = mapped_input(&plane_scene::input(6, 64, 48, 600), dark);
    let black = holes(&gpu, &input, Background::Black);
    let random = holes(&gpu, &input, Background::Random);
    println!("black: {:.3} of the light comes through, white costs {:.1} dB", black[0], black[1]);
    println!("random: {:.3} of the light comes through, white costs {:.1} dB", random[0], random[1]);
    assert!(random[0] < 0.25 * black[0], "{random:?} and {black:?}");
    assert!(random[1] < 0.5 * black[1], "{random:?} and {black:?}");
}
