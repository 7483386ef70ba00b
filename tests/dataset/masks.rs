//! Masks and transparent pixels.

use std::fs;
use std::path::Path;

use image::{GrayImage, Luma, Rgba, RgbaImage};
use psrgs_vk::dataset::{Dataset, Error, HostShare, LoadOptions, MaskIgnores, Role, Warning};
use psrgs_vk::train::prepare;

use crate::NAMES;
use crate::colmap_folder::{CameraRow, Folder};

/// The left third is white, the rest black.
fn write_mask(file: &Path, width: u32, height: u32, white: u8) {
    fs::create_dir_all(file.parent().expect("parent")).expect("folder");
    GrayImage::from_fn(width, height, |x, _| Luma([if 3 * x < width { white } else { 0 }])).save(file).expect("mask");
}

fn load(root: &Path, mask_ignores: MaskIgnores) -> Result<Dataset, Error> {
    Dataset::load(root, &LoadOptions { mask_ignores, ..LoadOptions::default() })
}

/// Columns whose pixels count; all rows must agree.
fn counting(dataset: &Dataset, view: usize) -> Vec<usize> {
    let photograph = dataset.views[view].photograph().expect("decodes");
    let width = photograph.width as usize;
    let alpha = |x: usize, y: usize| photograph.rgba8()[4 * (y * width + x) + 3];
    assert!((0..photograph.height as usize).all(|y| (0..width).all(|x| alpha(x, y) == alpha(x, 0))));
    (0..width).filter(|x| alpha(*x, 0) == 255).collect()
}

#[test]
fn all_namings_in_both_polarities() {
    let names = ["a.png", "sub/b.png", "c.v2.png"];
    for (naming, file) in [
        ("extension appended", (|name: &str| format!("{name}.png")) as fn(&str) -> String),
        ("extension replaced", |name: &str| format!("{}.png", name.trim_end_matches(".png"))),
    ] {
        for ignores in [MaskIgnores::Black, MaskIgnores::White] {
            let root = Folder::ring(&names, [0.0; 3]).dataset(false);
            for name in &names[..2] {
                write_mask(&root.path().join("masks").join(file(name)), 24, 16, 255);
            }
            let dataset = load(root.path(), ignores).expect(naming);
            let masks = dataset.masks.as_ref().expect("masks");
            assert_eq!((masks.matched, masks.of, masks.place.ends_with("masks")), (2, 3, true), "{naming}");
            let kept: Vec<usize> = if ignores == MaskIgnores::Black { (0..8).collect() } else { (8..24).collect() };
            // Sorted: a.png, c.v2.png, sub/b.png.
            for view in [0, 2] {
                assert_eq!(counting(&dataset, view), kept, "{naming}, {ignores:?} is ignored, view {view}");
            }
            assert_eq!(counting(&dataset, 1).len(), 24, "without a mask all counts");
        }
    }
    // A photograph in JPEG: both names of its mask.
    for mask in ["a.jpg.png", "a.png"] {
        let root = Folder::ring(&["a.jpg"], [0.0; 3]).dataset(false);
        write_mask(&root.path().join("masks").join(mask), 24, 16, 255);
        assert_eq!(counting(&load(root.path(), MaskIgnores::Black).expect(mask), 0), (0..8).collect::<Vec<_>>());
    }
}

#[test]
fn masks_of_other_sizes_fit_or_are_named() {
    let root = Folder::ring(&NAMES, [0.0; 3]).dataset(false);
    let mask = root.path().join("masks/a.png");
    for (width, height, white) in [(48, 32, 255), (12, 8, 255), (24, 16, 1), (24, 16, 90)] {
        write_mask(&mask, width, height, white);
        let dataset = load(root.path(), MaskIgnores::Black).expect("fits");
        assert_eq!(counting(&dataset, 0), (0..8).collect::<Vec<_>>(), "{width}x{height}, white is {white}");
    }
    write_mask(&mask, 16, 16, 255);
    let error = load(root.path(), MaskIgnores::Black).expect_err("another shape");
    assert!(matches!(&error, Error::MaskSize { mask: (16, 16), photograph: (24, 16), .. }), "{error}");
    assert!(error.to_string().contains("a.png") && error.to_string().contains("16x16"), "{error}");
    fs::write(&mask, "no picture").expect("written");
    let error = load(root.path(), MaskIgnores::Black).expect_err("foreign").to_string();
    assert!(error.contains("a.png: header at byte"), "{error}");
    // Poses alone need no masks.
    let options = LoadOptions { photographs: false, ..LoadOptions::default() };
    assert!(Dataset::load(root.path(), &options).expect("poses").masks.is_none());
    fs::rename(&mask, root.path().join("masks/z.png")).expect("renamed");
    let dataset = load(root.path(), MaskIgnores::Black).expect("none matches");
    assert!(dataset.masks.is_none());
    assert_eq!(dataset.warnings, [Warning::NoMaskMatches { folder: root.path().join("masks") }]);
}

#[test]
fn masks_reach_through_the_lens_and_through_reduction() {
    let mut folder = Folder::ring(&NAMES, [0.0; 3]);
    let params = vec![200.0, 120.0, 80.0, -0.1];
    folder.cameras = vec![CameraRow { id: 1, model: ("SIMPLE_RADIAL", 2), size: [240, 160], params }];
    let root = folder.dataset(false);
    write_mask(&root.path().join("masks/b.png"), 240, 160, 255);
    for max_side in [240, 80] {
        let options = LoadOptions { max_side: Some(max_side), ..LoadOptions::default() };
        let dataset = Dataset::load(root.path(), &options).expect("loads");
        let view = &dataset.views[1];
        let (lens, camera) = (view.lens.expect("a lens"), view.camera);
        let photograph = view.photograph().expect("decodes");
        for (k, p) in photograph.rgba8().chunks_exact(4).enumerate() {
            let (i, j) = (k as u32 % camera.width, k as u32 / camera.width);
            let ray = [(f64::from(i) + 0.5 - camera.cx) / camera.fx, (f64::from(j) + 0.5 - camera.cy) / camera.fy];
            let (place, _) = lens.project(ray).expect("inside");
            // Near the edge of the mask, the filter mixes both sides.
            let reach = 2.0 * 240.0 / f64::from(max_side) + 1.0;
            if (place[0] - 80.0).abs() > reach && place.iter().all(|v| *v > 0.5) {
                assert_eq!(p[3], if place[0] < 80.0 { 255 } else { 0 }, "{max_side}: {i}, {j} shows {place:?}");
            }
        }
    }
}

#[test]
fn transparent_pixels_are_left_out_and_keep_their_colours() {
    let root = Folder::ring(&NAMES, [0.0; 3]).dataset(false);
    let transparent = |x: u32| if x < 10 { 0 } else { 255 };
    RgbaImage::from_fn(24, 16, |x, _| Rgba([40, 90, 200, transparent(x)]))
        .save(root.path().join("images/b.png"))
        .expect("photograph");
    let dataset = load(root.path(), MaskIgnores::Black).expect("loads");
    assert_eq!(counting(&dataset, 1), (10..24).collect::<Vec<_>>());
    let reduced = LoadOptions { max_side: Some(12), ..LoadOptions::default() };
    let photograph = Dataset::load(root.path(), &reduced).expect("loads").views[1].photograph().expect("decodes");
    for (k, p) in photograph.rgba8().chunks_exact(4).enumerate() {
        assert_eq!(p[..3], [40, 90, 200], "also where nothing is opaque: windows of SSIM reach there");
        match k % 12 {
            0..=2 => assert_eq!(p[3], 0),
            7.. => assert_eq!(p[3], 255),
            _ => {}
        }
    }
}

#[test]
fn transparent_pixels_show_the_background_that_is_asked_for() {
    let root = Folder::ring(&NAMES, [0.0; 3]).dataset(false);
    let clear = |x: u32| if x < 8 { 0 } else { 255 };
    RgbaImage::from_fn(24, 16, |x, _| Rgba([40, 90, 200, clear(x)]))
        .save(root.path().join("images/b.png"))
        .expect("photograph");
    let said = |behind| {
        let options = LoadOptions { behind, ..LoadOptions::default() };
        let dataset = Dataset::load(root.path(), &options).expect("loads");
        let (views, _) = prepare::views(&dataset, Role::Train, &mut HostShare::unlimited()).expect("decoded");
        let told: Vec<String> =
            prepare::left_out(&dataset, Role::Train, &views).iter().map(ToString::to_string).collect();
        (told.join("\n"), views.iter().map(|view| view.masked()).sum::<u32>())
    };
    let (told, masked) = said(None);
    assert!(
        told.contains("1 photograph has transparent pixels (128 in all)") && told.contains("set `transparent`"),
        "{told}"
    );
    assert_eq!(masked, 128);
    assert_eq!(said(Some([1.0; 3])), (String::new(), 0));

    // At full size and reduced: no colour of transparent pixels remains at their edge.
    for (max_side, edge) in [(24, 8), (12, 4)] {
        let options = LoadOptions { behind: Some([1.0, 1.0, 0.0]), max_side: Some(max_side), ..LoadOptions::default() };
        let photograph = Dataset::load(root.path(), &options).expect("loads").views[1].photograph().expect("decodes");
        for (k, p) in photograph.rgba8().chunks_exact(4).enumerate() {
            match (k as u32 % max_side).cmp(&edge) {
                std::cmp::Ordering::Less if k as u32 % max_side + 2 < edge => assert_eq!(p, [255, 255, 0, 255]),
                std::cmp::Ordering::Greater if k as u32 % max_side > edge + 1 => assert_eq!(p, [40, 90, 200, 255]),
                _ => assert_eq!(p[3], 255),
            }
        }
    }
}

#[test]
fn a_mask_leaves_out_of_a_photograph_that_is_laid_over_a_colour() {
    let root = Folder::ring(&NAMES, [0.0; 3]).dataset(false);
    RgbaImage::from_pixel(24, 16, Rgba([40, 90, 200, 0])).save(root.path().join("images/b.png")).expect("photograph");
    std::fs::create_dir(root.path().join("masks")).expect("folder");
    GrayImage::from_fn(24, 16, |x, _| Luma([if x < 8 { 255 } else { 0 }]))
        .save(root.path().join("masks/b.png.png"))
        .expect("mask");
    let options = LoadOptions { behind: Some([0.0; 3]), ..LoadOptions::default() };
    let dataset = Dataset::load(root.path(), &options).expect("loads");
    assert_eq!(counting(&dataset, 1), (0..8).collect::<Vec<_>>());
}

/// A mask as image editors export: all white, with the mask in the alpha channel.
fn write_clear_mask(file: &Path) {
    fs::create_dir_all(file.parent().expect("parent")).expect("folder");
    RgbaImage::from_fn(24, 16, |x, _| Rgba([255, 255, 255, if x < 8 { 255 } else { 0 }])).save(file).expect("mask");
}

#[test]
fn a_mask_in_the_transparency_masks_and_says_so() {
    let root = Folder::ring(&NAMES, [0.0; 3]).dataset(false);
    for name in NAMES {
        write_clear_mask(&root.path().join("masks").join(name));
    }
    for (ignores, kept) in [(MaskIgnores::Black, 0..8), (MaskIgnores::White, 8..24)] {
        let dataset = load(root.path(), ignores).expect("loads");
        assert_eq!(counting(&dataset, 1), kept.collect::<Vec<_>>(), "{ignores:?}");
        assert_eq!(
            told(&dataset),
            ["2 of 2 masks, the first that of 'b.png', say by their transparency what is left out, as their \
            colour says nothing: transparent counts as black"]
        );
    }
}

/// Warnings about the training photographs.
fn told(dataset: &Dataset) -> Vec<String> {
    let (views, _) = prepare::views(dataset, Role::Train, &mut HostShare::unlimited()).expect("decoded");
    prepare::left_out(dataset, Role::Train, &views).iter().map(ToString::to_string).collect()
}

#[test]
fn masks_that_leave_out_nothing_or_all_are_counted_and_named() {
    let root = Folder::ring(&["a.png", "b.png", "c.png", "d.png"], [0.0; 3]).dataset(false);
    let mask = |name: &str, grey: u8| {
        let file = root.path().join("masks").join(name);
        fs::create_dir_all(file.parent().expect("parent")).expect("folder");
        GrayImage::from_pixel(24, 16, Luma([grey])).save(file).expect("mask");
    };
    // "a.png" is held out.
    mask("b.png", 255);
    mask("c.png", 255);
    write_mask(&root.path().join("masks/d.png"), 24, 16, 255);
    let dataset = load(root.path(), MaskIgnores::Black).expect("loads");
    assert_eq!(told(&dataset), ["2 of 3 masks leave out no pixel, the first that of 'b.png'"]);
    assert_eq!(counting(&dataset, 1).len(), 24);
    let dataset = load(root.path(), MaskIgnores::White).expect("loads");
    let all = "2 photographs, the first 'b.png': every pixel is masked; they are left out";
    assert_eq!(told(&dataset), [all]);
}

/// Masks of several pixel formats.
#[test]
fn masks_of_one_bit_of_palettes_and_of_sixteen_bits_are_read() {
    let pictures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/dataset/pictures");
    let root = Folder::ring(&["a.tif.png"], [0.0; 3]).dataset(false);
    fs::create_dir_all(root.path().join("masks")).expect("folder");
    let mask = root.path().join("masks/a.tif.png");
    for name in ["bits.png", "group4.tif", "bits_deflate.tif", "mask_palette.png"] {
        fs::copy(pictures.join(name), &mask).expect("copied");
        assert_eq!(
            counting(&load(root.path(), MaskIgnores::Black).expect(name), 0),
            (12..24).collect::<Vec<_>>(),
            "{name}"
        );
    }
    // Labels of 0 and 1 in 16 bits, which a reduction to 8 bits would make 0.
    image::ImageBuffer::<Luma<u16>, _>::from_fn(24, 16, |x, _| Luma([u16::from(x >= 12)])).save(&mask).expect("mask");
    assert_eq!(counting(&load(root.path(), MaskIgnores::Black).expect("labels"), 0), (12..24).collect::<Vec<_>>());
    // Turned by 90 degrees against its photograph, as with an ignored orientation tag.
    write_mask(&mask, 16, 24, 255);
    let error = load(root.path(), MaskIgnores::Black).expect_err("turned").to_string();
    assert!(error.contains("16x24") && error.contains("turned by 90 degrees the mask would fit"), "{error}");
}
