//! Photographs within a memory budget: equal pixels in every form of storage, and no more bytes than the budget.

use std::path::Path;

use image::{Rgb, RgbImage};
use psrgs_vk::dataset::{Dataset, Error, HostShare, LoadOptions, Pixels, Role, Supply};

use crate::colmap_folder::{CameraRow, Folder, PINHOLE};

/// A smooth picture with waves that a reduction by three still shows.
fn texture(x: u32, y: u32) -> Rgb<u8> {
    let (x, y) = (f64::from(x), f64::from(y));
    let wave = |a: f64, b: f64| (127.5 + 60.0 * (a * x + b * y).sin() + 50.0 * (0.013 * x).cos()) as u8;
    Rgb([wave(0.11, 0.05), wave(0.03, -0.13), wave(-0.07, 0.09)])
}

fn folder(names: &[&str], width: u32, height: u32) -> tempfile::TempDir {
    let mut folder = Folder::ring(names, [0.0; 3]);
    let size = [u64::from(width), u64::from(height)];
    let center = [0.5 * f64::from(width), 0.5 * f64::from(height)];
    let params = vec![f64::from(width), f64::from(width), center[0], center[1]];
    folder.cameras = vec![CameraRow { id: 1, model: PINHOLE, size, params }];
    let root = tempfile::tempdir().expect("temporary folder");
    folder.write(root.path(), &folder.binary());
    std::fs::create_dir_all(root.path().join("images")).expect("folder");
    for (i, name) in names.iter().enumerate() {
        let shift = 7 * i as u32;
        RgbImage::from_fn(width, height, |x, y| texture(x + shift, y))
            .save(root.path().join("images").join(name))
            .expect("photograph");
    }
    root
}

fn load(root: &Path, max_side: u32) -> Dataset {
    Dataset::load(root, &LoadOptions { max_side: Some(max_side), ..LoadOptions::default() }).expect("loads")
}

fn taken(dataset: &Dataset, keep: u64) -> (Vec<Supply>, u64) {
    let mut share = HostShare { keep, decoding: 1, threads: 3 };
    let supplies = dataset.take_in(Role::Train, &mut share).expect("decoded");
    let kept: u64 = supplies.iter().flatten().map(Supply::kept_bytes).sum();
    assert_eq!(kept, keep - share.keep, "kept bytes are not taken off the budget");
    (supplies.into_iter().flatten().collect(), kept)
}

#[test]
fn pixels_are_the_same_however_they_are_kept() {
    let names = ["a.png", "b.png", "c.jpg", "d.png", "e.jpg", "f.png"];
    let root = folder(&names, 120, 80);
    // At full size the files are kept; reduced, packed pixels.
    for side in [120, 60] {
        let dataset = load(root.path(), side);
        let (decoded, all) = taken(&dataset, 1 << 30);
        assert_eq!(all, 5 * u64::from(side) * u64::from(side) * 4 * 2 / 3);
        assert!(decoded.iter().all(Supply::is_decoded));
        let truth: Vec<_> = decoded.iter().map(|supply| supply.pixels().expect("decoded")).collect();
        let (compressed, some) = taken(&dataset, all - 1);
        assert!(some > 0 && compressed.iter().all(|s| !s.is_decoded() && s.kept_bytes() > 0), "{some} of {all}");
        let (mixed, few) = taken(&dataset, some - 1);
        assert!(few < some && mixed.iter().any(|s| s.kept_bytes() == 0) && mixed.iter().any(|s| s.kept_bytes() > 0));
        let (read_again, none) = taken(&dataset, 0);
        assert_eq!(none, 0);
        for supplies in [compressed, mixed, read_again] {
            for (supply, truth) in supplies.iter().zip(&truth) {
                for _ in 0..2 {
                    assert!(supply.pixels().expect("decoded") == *truth, "side {side}");
                }
                assert_eq!((supply.depth(), supply.masked()), (truth.depth(), 0));
            }
        }
    }
}

/// A change that keeps size and format: only the checksum differs.
#[test]
fn a_changed_photograph_or_mask_is_told_when_it_is_read_again() {
    let root = folder(&["a.png", "b.png", "c.png", "d.png"], 24, 16);
    let (image, mask) = (root.path().join("images/c.png"), root.path().join("masks/c.png"));
    std::fs::create_dir(root.path().join("masks")).expect("folder");
    let grey =
        |left_out: u32| image::GrayImage::from_fn(24, 16, |x, _| image::Luma([if x < left_out { 0 } else { 255 }]));
    grey(5).save(&mask).expect("mask");
    let dataset = load(root.path(), 24);
    for changed in [&image, &mask] {
        let before = std::fs::read(changed).expect("there");
        let (supplies, _) = taken(&dataset, 0);
        assert!(supplies[1].file().ends_with("c.png") && supplies[1].masked() == 5 * 16);
        supplies[1].pixels().expect("as it was");
        if changed == &image {
            std::fs::copy(root.path().join("images/d.png"), changed).expect("copied");
        } else {
            grey(6).save(changed).expect("mask");
        }
        let error = supplies[1].pixels().expect_err("another one");
        assert!(matches!(&error, Error::ChangedSince { file } if file.ends_with("images/c.png")), "{error}");
        assert!(error.to_string().contains("has changed"), "{error}");
        supplies[0].pixels().expect("untouched");
        std::fs::write(changed, before).expect("written");
    }
}

#[test]
fn of_several_damaged_photographs_the_first_is_told() {
    let root = folder(&["a.png", "b.png", "c.png", "d.png"], 24, 16);
    for name in ["b.png", "d.png"] {
        let file = root.path().join("images").join(name);
        let bytes = std::fs::read(&file).expect("photograph");
        std::fs::write(&file, &bytes[..bytes.len() / 2]).expect("truncated");
    }
    let mut share = HostShare { keep: 0, decoding: 1 << 20, threads: 4 };
    let error = load(root.path(), 24).take_in(Role::Train, &mut share).expect_err("damaged");
    assert!(matches!(&error, Error::Undecodable { file, .. } if file.ends_with("b.png")), "{error}");
}

#[test]
fn large_jpegs_decoded_at_reduced_scale_show_the_same_picture() {
    let root = folder(&["a.jpg", "b.png", "c.jpg"], 3200, 400);
    let file = |name: &str| root.path().join("images").join(name);
    // Equal pixels without the shortcut: PNG is always decoded whole.
    image::open(file("c.jpg")).expect("photograph").save(file("b.png")).expect("photograph");
    for (side, divisor) in [(1600, 1), (1000, 2), (400, 4), (200, 4)] {
        let dataset = load(root.path(), side);
        let (whole, reduced) = (&dataset.views[1], &dataset.views[2]);
        let full = whole.decoding_bytes();
        assert_eq!(reduced.decoding_bytes() < full, divisor > 1, "{side}");
        let (Pixels::Rgba8(want), Pixels::Rgba8(got)) =
            (whole.photograph().expect("decodes").pixels, reduced.photograph().expect("decodes").pixels)
        else {
            panic!("depth")
        };
        let off: Vec<f64> = want.iter().zip(&got).map(|(a, b)| f64::from(a.abs_diff(*b))).collect();
        let rms = (off.iter().map(|v| v * v).sum::<f64>() / off.len() as f64).sqrt();
        println!("{side}: rms {rms:.3}, at most {}", off.iter().fold(0.0, |a: f64, b| a.max(*b)));
        assert!(rms < 1.0, "{side} px: {rms}");
        assert_eq!(rms == 0.0, divisor == 1, "{side} px at 1/{divisor}: {rms}");
    }
    // A size that does not divide is decoded whole.
    let odd = folder(&["a.jpg", "b.jpg"], 3201, 401);
    let dataset = load(odd.path(), 200);
    assert!(dataset.views[1].decoding_bytes() > 3201 * 401 * 7);
}
