//! Photographs with more than 8 bits per channel against 8-bit copies of the same picture.

use std::path::Path;

use image::{DynamicImage, ImageBuffer, Rgb, Rgb32FImage, RgbImage, Rgba, Rgba32FImage};
use psrgs_vk::dataset::{Dataset, Depth, LoadOptions, Photograph, Pixels, Role, Samples, Tone, Transfer};
use psrgs_vk::train::prepare;
use psrgs_vk::train::settings::Photographs;

use crate::colmap_folder::{CameraRow, Folder};

const SIZE: (u32, u32) = (48, 32);
const OPENCV: (&str, i32) = ("OPENCV", 4);

/// A smooth picture with every 8-bit level.
fn picture(x: u32, y: u32) -> [u8; 3] {
    [(x * 5) as u8, (y * 8) as u8, (x * y / 6) as u8]
}

/// Linear light of an 8-bit value, by the definition of sRGB's curve.
fn light(value: u8) -> f32 {
    let v = f64::from(value) / 255.0;
    (if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }) as f32
}

/// One picture as 8-bit PNG, 16-bit PNG and EXR, with a pinhole camera or with lens distortion.
fn copies(distorted: bool) -> tempfile::TempDir {
    let mut folder = Folder::ring(&["a.png", "b.png", "c.exr", "d.png"], [0.0; 3]);
    let size = [u64::from(SIZE.0), u64::from(SIZE.1)];
    let params =
        if distorted { vec![41.0, 42.0, 23.0, 17.0, -0.1, 0.02, 0.001, -0.002] } else { vec![41.0, 42.0, 23.0, 17.0] };
    let model = if distorted { OPENCV } else { crate::colmap_folder::PINHOLE };
    folder.cameras = vec![CameraRow { id: 1, model, size, params }];
    let root = tempfile::tempdir().expect("temporary folder");
    folder.write(root.path(), &folder.binary());
    let images = root.path().join("images");
    std::fs::create_dir_all(&images).expect("folder");
    RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| Rgb(picture(x, y))).save(images.join("a.png")).expect("8 bits");
    ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, y| Rgb(picture(x, y).map(|v| 257 * u16::from(v))))
        .save(images.join("b.png"))
        .expect("16 bits");
    Rgb32FImage::from_fn(SIZE.0, SIZE.1, |x, y| Rgb(picture(x, y).map(light)))
        .save(images.join("c.exr"))
        .expect("floats");
    // Scaled to 12 bits, as cameras write.
    ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, y| {
        Rgb(picture(x, y).map(|v| (f64::from(light(v)) * 4095.0).round() as u16))
    })
    .save(images.join("d.png"))
    .expect("12 bits");
    root
}

fn load(root: &Path, options: LoadOptions) -> Dataset {
    Dataset::load(root, &options).expect("loads")
}

fn decoded(dataset: &Dataset, view: usize) -> Photograph {
    dataset.views[view].photograph().expect("decodes")
}

/// The largest difference of two pictures, in units of an 8-bit number.
fn apart(eight: &Photograph, deep: &Photograph) -> f64 {
    let (Pixels::Rgba8(eight), Pixels::Rgba16(deep)) = (&eight.pixels, &deep.pixels) else { panic!("depths") };
    let pairs = eight.iter().zip(deep);
    pairs.map(|(e, d)| (f64::from(*e) - f64::from(*d) / 257.0).abs()).fold(0.0, f64::max)
}

#[test]
fn deep_photographs_decode_as_8_bit_copies_with_finer_digits() {
    for (distorted, max_side) in [(false, None), (false, Some(24)), (true, None), (true, Some(24))] {
        let root = copies(distorted);
        let dataset = load(root.path(), LoadOptions { max_side, ..LoadOptions::default() });
        let kinds: Vec<Samples> = dataset.views.iter().map(|view| view.samples).collect();
        assert_eq!(kinds, [Samples::Bits8, Samples::Bits16, Samples::Float, Samples::Bits16]);
        let eight = decoded(&dataset, 0);
        for view in [1, 2] {
            let deep = decoded(&dataset, view);
            assert_eq!((deep.width, deep.height, deep.pixels.depth()), (eight.width, eight.height, Depth::Sixteen));
            // Equal without resampling. With interpolation, the 8-bit copy is rounded.
            let bound = if distorted || max_side.is_some() { 0.5 + 1e-2 } else { 4e-3 };
            let found = apart(&eight, &deep);
            assert!(found <= bound, "view {view}, distorted {distorted}, {max_side:?}: {found}");
            assert_eq!(deep.clipped, 0);
        }
        let (Pixels::Rgba16(png), Pixels::Rgba16(exr)) = (decoded(&dataset, 1).pixels, decoded(&dataset, 2).pixels)
        else {
            panic!("depths")
        };
        let levels = |values: &[u16]| values.iter().collect::<std::collections::BTreeSet<_>>().len();
        assert!(
            max_side.is_none() && !distorted || levels(&png) > 300,
            "digits beyond 8 bits are kept: {}",
            levels(&png)
        );
        assert!(png.iter().zip(&exr).all(|(a, b)| a.abs_diff(*b) <= 2), "the 16-bit PNG and the EXR differ");
    }
}

#[test]
fn white_level_and_curve_are_those_that_are_named() {
    let root = copies(false);
    let tone = |white_level, transfer| LoadOptions { tone: Tone { white_level, transfer }, ..LoadOptions::default() };
    // Linear values of 12 bits, named as linear. In the shadows, a step of 12 bits is larger than a step of 8 bits.
    let dataset = load(root.path(), tone(Some(4095.0), Transfer::Linear));
    let eight = decoded(&dataset, 0);
    let developed = decoded(&dataset, 3);
    let found = apart(&eight, &developed);
    assert!((0.01..1.7).contains(&found), "{found}");
    // White level and curve do not apply to 8-bit photographs.
    assert_eq!(eight, decoded(&load(root.path(), LoadOptions::default()), 0));
    // With the sRGB curve, the stored values are used as they are.
    let Pixels::Rgba16(exr) = decoded(&load(root.path(), tone(None, Transfer::Srgb)), 2).pixels else {
        panic!("depth")
    };
    let want = (f64::from(light(picture(20, 10)[0])) * 65535.0).round() as u16;
    assert!(exr[4 * (10 * 48 + 20)].abs_diff(want) <= 1);
    // White at 0.5: brighter pixels become white and are counted.
    let cut = decoded(&load(root.path(), tone(Some(0.5), Transfer::Auto)), 2);
    let Pixels::Rgba16(values) = &cut.pixels else { panic!("depth") };
    let all = (0..SIZE.0 * SIZE.1).map(|k| picture(k % SIZE.0, k / SIZE.0));
    let brighter = all.filter(|p| p.iter().any(|v| light(*v) > 0.5)).count() as u64;
    assert!(brighter > 100 && cut.clipped == brighter, "{} of {brighter}", cut.clipped);
    assert_eq!(values[4 * (5 * 48 + 47)], u16::MAX);
    // The text before training.
    let said = load(root.path(), tone(Some(4095.0), Transfer::Linear)).deep_photographs().join("\n");
    assert!(said.contains("2 photographs: 16 bits per channel, white at 4095, linear"), "{said}");
    assert!(said.contains("1 photograph: floating point, white at 4095"), "{said}");
}

#[test]
fn what_is_cut_is_told_before_training() {
    let root = copies(false);
    let options = Photographs { white_level: Some(0.5), transfer: Transfer::Srgb, ..Photographs::default() };
    let dataset = load(root.path(), prepare::load_options(&options, [0.0; 3]));
    let (views, _) =
        prepare::views(&dataset, Role::Train, &mut psrgs_vk::dataset::HostShare::unlimited()).expect("decoded");
    let said: Vec<String> = prepare::left_out(&dataset, Role::Train, &views).iter().map(ToString::to_string).collect();
    assert!(said.len() == 1 && said[0].contains("3 photographs have pixels brighter than white"), "{said:?}");
}

/// Transparent pixels, NaN pixels, and premultiplied alpha.
#[test]
fn alpha_of_deep_photographs_masks() {
    let root = copies(false);
    let images = root.path().join("images");
    let exr = Rgba32FImage::from_fn(SIZE.0, SIZE.1, |x, _| match x % 4 {
        0 => Rgba([0.25, 0.25, 0.25, 1.0]),
        1 => Rgba([0.0, 0.0, 0.0, 0.0]),
        2 => Rgba([f32::NAN, 0.5, 0.5, 1.0]),
        _ => Rgba([0.2, 0.2, 0.2, 0.8]),
    });
    DynamicImage::ImageRgba32F(exr).save(images.join("c.exr")).expect("floats");
    ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, _| Rgba([40_000_u16, 1, 2, if x % 4 == 1 { 0 } else { u16::MAX }]))
        .save(images.join("b.png"))
        .expect("16 bits");
    let dataset = load(root.path(), LoadOptions::default());
    let alpha = |view: usize| {
        let Pixels::Rgba16(values) = decoded(&dataset, view).pixels else { panic!("depth") };
        values
    };
    let (png, exr) = (alpha(1), alpha(2));
    assert_eq!([0, 1, 2, 3].map(|x| png[4 * x + 3]), [65535, 0, 65535, 65535]);
    assert_eq!([0, 1, 2, 3].map(|x| exr[4 * x + 3]), [65535, 0, 0, (0.8_f64 * 65535.0).round() as u16]);
    assert!(exr[0].abs_diff(exr[12]) <= 1, "{} and {}: alpha is divided out", exr[0], exr[12]);
    let photographs = dataset.take_in(Role::Train, &mut psrgs_vk::dataset::HostShare::unlimited()).expect("decoded");
    let masked: Vec<u32> = photographs.iter().flatten().map(|supply| supply.masked()).collect();
    let quarter = SIZE.0 * SIZE.1 / 4;
    assert_eq!(masked, [quarter, 2 * quarter, 0], "b, c and d are trained on");
}
