//! Compact formats: round trips within the steps of each format, extremes, refusals.

use std::fs;
use std::path::Path;

use psrgs_vk::format::ply::{self, Model};
use psrgs_vk::format::splats::placement::{self, Turned};
use psrgs_vk::format::splats::spz::{self, Version};
use psrgs_vk::format::splats::{self, Format, gltf, sog, splat};
use psrgs_vk::scene::{Gaussians, SH_GROUP_FLOATS, Similarity};

use super::splats as random_splats;

pub(crate) const ALL: [Format; 6] =
    [Format::Ply, Format::CompressedPly, Format::Spz(Version::Four), Format::Sog, Format::Splat, Format::Glb];

/// A model of random splats.
fn model(n: usize, sh_degree: u32) -> Model {
    Model { gaussians: random_splats(n), sh_degree, antialias: Some(true), ..Model::default() }
}

/// The value of a plane's row farthest from that of the other model, by a distance of values.
pub(crate) fn farthest(a: &[f32], b: &[f32], distance: impl Fn(f64, f64) -> f64) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| distance(f64::from(*a), f64::from(*b))).fold(0.0, f64::max)
}

pub(crate) fn opacity(logit: f64) -> f64 {
    1.0 / (1.0 + (-logit).exp())
}

/// Largest angle between the rotations of two models, in radians.
pub(crate) fn angle(a: &Gaussians, b: &Gaussians) -> f64 {
    let dot = |(a, b): (&[f32], &[f32])| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
    let pairs = a.quats.chunks_exact(4).zip(b.quats.chunks_exact(4));
    pairs.map(|pair| 2.0 * dot(pair).abs().min(1.0).acos()).fold(0.0, f64::max)
}

/// The constant coefficients.
pub(crate) fn colours(g: &Gaussians) -> Vec<f32> {
    g.sh[0].chunks_exact(SH_GROUP_FLOATS).flat_map(|row| &row[..3]).copied().collect()
}

#[test]
fn sog_comes_back_within_its_steps() {
    for n in [1, 2, 17, 700] {
        let written = model(n, 0);
        let bytes = sog::encode(&written, 0).expect("written");
        let read = sog::decode(Path::new("a.sog"), &bytes, false).expect("read");
        let (old, new) = (written.gaussians.in_morton_order(), &read.gaussians);
        let log = |v: f64| v.abs().ln_1p().copysign(v);
        let step = 2.0 * 4.0_f64.ln() / 65_535.0;
        assert!(farthest(&old.means, &new.means, |a, b| (log(a) - log(b)).abs()) <= 0.51 * step);
        assert!(farthest(&old.opacities, &new.opacities, |a, b| (opacity(a) - opacity(b)).abs()) <= 0.501 / 255.0);
        // Uniform numbers from -3 to 3 in 256 steps; few numbers are kept exactly.
        let coded = if 3 * n <= 256 { 0.0 } else { 4.0 * 6.0 / 256.0 };
        assert!(farthest(&old.scales, &new.scales, |a, b| (a - b).abs()) <= coded);
        assert!(farthest(&colours(&old), &colours(new), |a, b| (a - b).abs()) <= coded);
        assert!(angle(&old, new) <= 0.02, "{}", angle(&old, new));
        assert_eq!((read.sh_degree, read.antialias, read.shift), (0, Some(true), [0.0; 3]));
        assert_eq!(sog::encode(&written, 0).expect("written"), bytes, "the same model gives the same bytes");
    }
}

/// The coefficients beyond the constant one, up to a degree.
pub(crate) fn rest(g: &Gaussians, degree: u32) -> Vec<f32> {
    let last = (degree as usize + 1).pow(2);
    let of = |i: usize, k: usize| &g.sh[k / 4][SH_GROUP_FLOATS * i + 3 * (k % 4)..][..3];
    (0..g.len()).flat_map(|i| (1..last).flat_map(move |k| of(i, k))).copied().collect()
}

/// The model with its harmonics beyond a degree set to zero, and all within -1 to 1.
pub(crate) fn with_degree(n: usize, degree: u32) -> Model {
    let mut written = model(n, degree);
    let last = (degree as usize + 1).pow(2);
    for (group, plane) in written.gaussians.sh.iter_mut().enumerate() {
        for (at, v) in plane.iter_mut().enumerate() {
            *v = if 4 * group + at % SH_GROUP_FLOATS / 3 < last { *v / 3.5 } else { 0.0 };
        }
    }
    written
}

#[test]
fn sog_keeps_harmonics_of_every_degree() {
    for degree in 1..=3 {
        // So few splats have entries of their own: only the codebook rounds.
        let written = with_degree(300, degree);
        let bytes = sog::encode(&written, 3).expect("written");
        let read = sog::decode(Path::new("a.sog"), &bytes, true).expect("read");
        let old = written.gaussians.in_morton_order();
        assert_eq!(read.sh_degree, degree);
        assert!(farthest(&rest(&old, 3), &rest(&read.gaussians, 3), |a, b| (a - b).abs()) <= 4.0 * 1.8 / 256.0);
        let less = sog::decode(Path::new("a.sog"), &sog::encode(&written, 1).expect("written"), true).expect("read");
        assert_eq!(less.sh_degree, 1);
    }
    // Many splats share entries. Random harmonics are the worst case: most of their variance is lost, and no more.
    let written = with_degree(3000, 3);
    let bytes = sog::encode(&written, 3).expect("written");
    let read = sog::decode(Path::new("a.sog"), &bytes, true).expect("read");
    let (old, new) = (rest(&written.gaussians.in_morton_order(), 3), rest(&read.gaussians, 3));
    let square = |v: f32| f64::from(v).powi(2);
    let lost: f64 = old.iter().zip(&new).map(|(a, b)| square(a - b)).sum();
    assert!(lost < 0.9 * old.iter().map(|v| square(*v)).sum::<f64>(), "{lost}");
}

#[test]
fn an_unpacked_sog_is_read_as_the_packed_one() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let written = with_degree(300, 2);
    let ordered = Model { gaussians: written.gaussians.in_morton_order(), shift: [5e5, 0.0, -7.0], ..written };
    let names: Vec<String> = sog::files(&ordered, 3)
        .expect("written")
        .into_iter()
        .map(|(name, bytes)| {
            fs::write(folder.path().join(&name), bytes).expect("written");
            name
        })
        .collect();
    let packed = sog::encode(&ordered, 3).expect("written");
    let packed = sog::decode(Path::new("a.sog"), &packed, true).expect("read");
    let meta = folder.path().join("meta.json");
    assert_eq!(splats::read(&meta, true).expect("read"), packed);
    // Every file is needed, and errors name the file.
    for name in names {
        let file = folder.path().join(&name);
        let bytes = fs::read(&file).expect("a file");
        fs::write(&file, &bytes[..bytes.len() / 2]).expect("written");
        assert!(splats::read(&meta, true).expect_err("cut off").to_string().contains(&name));
        fs::remove_file(&file).expect("removed");
        assert!(splats::read(&meta, true).expect_err("not there").to_string().contains(&name));
        fs::write(&file, bytes).expect("written");
    }
    // The list leads to no file elsewhere.
    let text = fs::read_to_string(&meta).expect("text");
    for name in ["../quats.webp", "/quats.webp", "a/quats.webp", "..", ""] {
        fs::write(&meta, text.replace("quats.webp", name)).expect("written");
        let error = splats::read(&meta, true).expect_err("a file elsewhere").to_string();
        assert!(error.contains("meta.json") && error.contains("not the name of a file"), "{error}");
    }
    fs::write(&meta, text.replace("\"count\":300", "\"count\":4000000000")).expect("written");
    assert!(splats::read(&meta, true).expect_err("too many").to_string().contains("number of splats"));
}

#[test]
fn spz_of_every_version_comes_back_within_its_steps() {
    // Version 2 leaves w to be found from the others, which near zero is its root of their rounding.
    for (version, turn) in [(Version::Two, 0.2), (Version::Three, 0.006), (Version::Four, 0.006)] {
        for degree in 0..=3 {
            let written = with_degree(if degree == 0 { 1 } else { 300 }, degree);
            let bytes = spz::encode(&written, 3, version).expect("written");
            let read = spz::decode(Path::new("a.spz"), &bytes, true).expect("read");
            let (old, new) = (written.gaussians.in_morton_order(), &read.gaussians);
            let near = |a: f64, b: f64| (a - b).abs();
            // Coordinates below 3 have 15 fractional bits.
            assert!(farthest(&old.means, &new.means, near) <= 0.5001 / 32_768.0);
            assert!(farthest(&old.scales, &new.scales, near) <= 0.5001 / 16.0);
            assert!(farthest(&old.opacities, &new.opacities, |a, b| near(opacity(a), opacity(b))) <= 0.501 / 255.0);
            assert!(farthest(&colours(&old), &colours(new), near) <= 0.5001 / (0.15 * 255.0));
            assert!(farthest(&rest(&old, 1), &rest(new, 1), near) <= 0.5001 / 64.0);
            assert!(farthest(&rest(&old, degree), &rest(new, degree), near) <= 0.5001 / 32.0);
            assert!(angle(&old, new) <= turn, "{version:?}: {}", angle(&old, new));
            assert_eq!((read.sh_degree, read.antialias), (degree, Some(true)));
        }
    }
}

#[test]
fn spz_cuts_no_coordinate_off_and_clamps_the_rest() {
    let mut written = model(4, 3);
    let g = &mut written.gaussians;
    g.means = vec![5e5, -4_194_303.0, 0.25, 1e-7, 0.0, -1e-30, 3e6, 3.0, 3.0, -2048.0, 2048.0, 7.0];
    (g.scales[0], g.scales[1], g.sh[0][0], g.sh[1][0]) = (40.0, -40.0, 9.0, -9.0);
    let bytes = spz::encode(&written, 3, Version::Four).expect("written");
    let read = spz::decode(Path::new("a.spz"), &bytes, true).expect("read").gaussians;
    assert!(farthest(&written.gaussians.in_morton_order().means, &read.means, |a, b| (a - b).abs()) <= 0.25);
    let ends = |plane: &[f32]| plane.iter().fold((0.0_f32, 0.0_f32), |(a, b), v| (a.min(*v), b.max(*v)));
    assert_eq!(ends(&read.scales), (-10.0, 5.9375));
    assert!((ends(&colours(&read)).1 - 10.0 / 3.0).abs() < 1e-5 && ends(&rest(&read, 3)).0 == -1.0);
    written.gaussians.means[0] = 1e9;
    let error = spz::encode(&written, 3, Version::Four).expect_err("too far").to_string();
    assert!(error.contains("position of splat 0 is 1000000000") && error.contains("nearer"), "{error}");
}

#[test]
fn compressed_ply_comes_back_within_its_steps() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("a.compressed.ply");
    for (n, degree) in [(1, 0), (256, 1), (257, 2), (700, 3)] {
        let written = Model { shift: [5e5, 4e6, -0.5], version: Some("0.1.0".to_owned()), ..with_degree(n, degree) };
        Format::CompressedPly.write(&file, &written, 3).expect("written");
        let read = splats::read(&file, true).expect("read");
        let (old, new) = (written.gaussians.in_morton_order(), &read.gaussians);
        let near = |a: f64, b: f64| (a - b).abs();
        assert!(farthest(&old.means, &new.means, near) <= 0.501 * 6.0 / 1023.0);
        assert!(farthest(&old.scales, &new.scales, near) <= 0.501 * 6.0 / 1023.0);
        assert!(farthest(&old.opacities, &new.opacities, |a, b| near(opacity(a), opacity(b))) <= 0.501 / 255.0);
        assert!(farthest(&colours(&old), &colours(new), near) <= 0.501 * 1.8 / 255.0);
        assert!(farthest(&rest(&old, degree), &rest(new, degree), near) <= 0.501 / 32.0);
        assert!(angle(&old, new) <= 0.005, "{}", angle(&old, new));
        assert_eq!((read.sh_degree, read.antialias, read.shift), (degree, Some(true), written.shift));
        assert_eq!(ply::read(&file).expect("read"), read, "each reader of PLY takes it");
    }
}

#[test]
fn splat_files_come_back_with_the_largest_splats_first() {
    let written = with_degree(300, 3);
    let bytes = splat::encode(&written).expect("written");
    assert_eq!(bytes.len(), 32 * 300);
    let read = splat::decode(Path::new("a.splat"), &bytes, true).expect("read").gaussians;
    let volume = |g: &Gaussians, i: usize| {
        g.scales[3 * i..3 * i + 3].iter().map(|s| f64::from(*s)).sum::<f64>().exp() * opacity(f64::from(g.opacities[i]))
    };
    // Opacities are rounded to bytes.
    assert!((1..300).all(|i| volume(&read, i) <= volume(&read, i - 1) * 1.5));
    let row = |i: usize| (0..300).find(|k| read.means[3 * k..3 * k + 3] == written.gaussians.means[3 * i..3 * i + 3]);
    let order: Vec<u32> = (0..300).map(|i| row(i).expect("every splat is there") as u32).collect();
    let sorted = read.rows(&order);
    let near = |a: f64, b: f64| (a - b).abs();
    assert!(farthest(&written.gaussians.scales, &sorted.scales, near) <= 1e-5);
    let shown = |v: f64| (0.5 + 0.282_094_79 * v).clamp(0.0, 1.0);
    assert!(
        farthest(&colours(&written.gaussians), &colours(&sorted), |a, b| near(shown(a), shown(b))) <= 0.501 / 255.0
    );
    assert!(angle(&written.gaussians, &sorted) <= 0.02, "{}", angle(&written.gaussians, &sorted));
    assert!(rest(&sorted, 3).iter().all(|v| *v == 0.0));
}

#[test]
fn glb_comes_back_in_f32() {
    for degree in 0..=3 {
        let written = with_degree(50, degree);
        let bytes = gltf::encode(&written, 3).expect("written");
        let read = gltf::decode(Path::new("a.glb"), &bytes, true).expect("read");
        let (old, new) = (&written.gaussians, &read.gaussians);
        let near = |a: f64, b: f64| (a - b).abs();
        assert_eq!((&old.means, read.sh_degree), (&new.means, degree));
        assert_eq!(rest(old, 3), rest(new, 3));
        assert!(
            farthest(&old.scales, &new.scales, near) < 1e-5 && farthest(&old.opacities, &new.opacities, near) < 1e-5
        );
        assert!(angle(old, new) < 2e-3, "{}", angle(old, new));
    }
}

#[test]
fn every_format_takes_no_splats_and_flat_or_far_ones() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let mut odd = model(3, 3);
    odd.gaussians.quats[..4].fill(0.0);
    odd.gaussians.opacities.copy_from_slice(&[-1e30, 1e30, 0.0]);
    odd.gaussians.scales.fill(-90.0);
    odd.gaussians.means.fill(5e5);
    for format in ALL {
        for written in [model(0, 3), odd.clone()] {
            let file = folder.path().join(format!("a.{}", format.extension()));
            format.write(&file, &written, 3).unwrap_or_else(|e| panic!("{e}"));
            let read = splats::read(&file, true).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(read.gaussians.len(), written.gaussians.len(), "{format:?}");
            let far = read.gaussians.means.iter().map(|v| (v - 5e5).abs()).fold(0.0, f32::max);
            assert!(far < 0.1, "{format:?}: {far}");
        }
    }
}

#[test]
fn values_that_are_not_finite_are_refused_with_their_splat() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let mut wrong = model(9, 3);
    wrong.gaussians.sh[2][12 * 4] = f32::NAN;
    for format in ALL.into_iter().filter(|format| *format != Format::Ply) {
        let file = folder.path().join(format!("a.{}", format.extension()));
        let error = format.write(&file, &wrong, 3).expect_err("refused").to_string();
        assert!(error.contains("spherical harmonics of splat 4 is NaN") && error.contains("leave"), "{error}");
        assert!(!file.exists(), "nothing is written");
    }
}

#[test]
fn a_file_is_told_by_content_before_its_name() {
    let folder = tempfile::tempdir().expect("temporary folder");
    for format in ALL {
        let file = folder.path().join(format!("a.{}", format.extension()));
        assert_eq!(Format::of_name(&file), Some(format));
        format.write(&file, &model(20, 0), 3).expect("written");
        assert_eq!(splats::read(&file, true).expect("read").gaussians.len(), 20, "{format:?}");
        let content = splats::read_content(&file, true).expect("read").0;
        assert!(matches!(content, ply::Content::Model(m) if m.gaussians.len() == 20), "{format:?}");
    }
    // A PLY file by any name is one.
    let other = folder.path().join("b.splat");
    fs::copy(folder.path().join("a.ply"), &other).expect("copied");
    assert_eq!(splats::read(&other, true).expect("read").gaussians.len(), 20);
    for (name, content) in
        [("c.spz", &b"GIF89a"[..]), ("c.sog", b"hello"), ("c.splat", &[7; 33]), ("c.ply", b"PK\x03\x04")]
    {
        let file = folder.path().join(name);
        fs::write(&file, content).expect("written");
        let error = splats::read(&file, true).expect_err(name).to_string();
        assert!(error.contains(name) && error.contains(" at byte "), "{error}");
    }
    assert_eq!(Format::of_name(Path::new("folder/fox.html")), None);
}

#[test]
fn models_that_were_moved_and_turned_come_back_to_their_dataset() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let written = Model { shift: [5e5, 4.6e6, 100.0], ..with_degree(200, 3) };
    for format in ALL {
        let own = Similarity {
            rotation: [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            scale: 2.0,
            translation: [10.0, -20.0, 5.0],
        };
        let same = Similarity::IDENTITY;
        for (from_dataset, centred, up) in [
            (same, false, None),
            (same, true, None),
            (same, false, Some([0.0, 0.0, 1.0])),
            (same, true, Some([0.3, 0.8, -0.4])),
            (own, false, None),
            (own, true, None),
            (own, true, Some([0.3, 0.8, -0.4])),
        ] {
            let file = folder.path().join(format!("a.{}", format.extension()));
            let turned = Turned::new(&written, &from_dataset, centred, up);
            format.write(&file, &turned.model, 3).expect("written");
            let beside = turned.write_beside(&file, format.holds_shift(), None).expect("written");
            assert_eq!(beside, up.is_some() || !format.holds_shift() || from_dataset != same, "{format:?}");
            assert_eq!(placement::file_beside(&file).is_file(), beside, "an old file is removed");
            let placed = splats::read_placed(&file, true).expect("read");
            assert_eq!(placed.by.is_some(), beside);
            let place = |m: &Model| {
                let sum = |k: usize| m.gaussians.means.iter().skip(k).step_by(3).map(|v| f64::from(*v)).sum::<f64>();
                [0, 1, 2].map(|k| sum(k) / 200.0 + m.shift[k])
            };
            let (old, new) = (from_dataset.inverse().point(place(&written)), place(&placed.model));
            assert!((0..3).all(|k| (old[k] - new[k]).abs() < 2e-3), "{format:?} {up:?}: {old:?} {new:?}");
            let energy = |m: &Model| rest(&m.gaussians, 3).iter().map(|v| v * v).sum::<f32>();
            let kept = energy(&placed.model) / energy(&written);
            assert!(format == Format::Splat || (kept - 1.0).abs() < 0.2, "{format:?}: {kept}");
        }
    }
    let up = Turned::new(&written, &Similarity::IDENTITY, true, Some([0.0, 0.0, 1.0]));
    let height = |m: &Model, axis: usize, sign: f32| -> Vec<f32> {
        m.gaussians.means.iter().skip(axis).step_by(3).map(|v| sign * v).collect()
    };
    let (old, new) = (height(&written, 2, 1.0), height(&up.model, 1, -1.0));
    assert!(old.iter().zip(&new).all(|(a, b)| (a - b - (old[0] - new[0])).abs() < 1e-5), "z is now -y");
}
