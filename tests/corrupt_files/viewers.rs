//! Files in the formats of viewers that are cut off, damaged, or claim more than they hold.

use std::fs;
use std::io::{Cursor, Write as _};
use std::path::Path;
use std::time::{Duration, Instant};

use psrgs_vk::format::ply::Model;
use psrgs_vk::format::splats::spz::Version;
use psrgs_vk::format::splats::{self, Format};
use psrgs_vk::scene::Gaussians;

use super::{damaged_everywhere, foreign, names_the_place, replace, truncated_everywhere};

/// Longer than any of these files takes, and far shorter than to unpack what they claim.
const SOON: Duration = Duration::from_secs(5);

fn written(file: &Path, format: Format, splats: usize, sh_degree: u32) {
    let mut gaussians = Gaussians::zeros(splats);
    gaussians.means.iter_mut().enumerate().for_each(|(k, v)| *v = k as f32);
    gaussians.quats.iter_mut().step_by(4).for_each(|v| *v = 1.0);
    format.write(file, &Model { gaussians, sh_degree, ..Model::default() }, 3).expect("written");
}

fn read(file: &Path) -> Result<Model, String> {
    splats::read(file, true).map_err(|e| e.to_string())
}

#[track_caller]
fn refused(file: &Path, words: &str) {
    let begun = Instant::now();
    let error = read(file).expect_err(words);
    assert!(error.contains(words) && names_the_place(&error, file), "{error}");
    assert!(begun.elapsed() < SOON, "{error}");
}

#[test]
fn files_of_viewers_that_are_cut_off_or_damaged_are_told() {
    let root = tempfile::tempdir().expect("temporary folder");
    for (name, format, degree) in [
        ("a.compressed.ply", Format::CompressedPly, 1),
        ("two.spz", Format::Spz(Version::Two), 1),
        ("four.spz", Format::Spz(Version::Four), 1),
        ("a.glb", Format::Glb, 0),
    ] {
        let file = root.path().join(name);
        written(&file, format, 3, degree);
        truncated_everywhere(&file, || read(&file));
        foreign(&file, || read(&file));
        assert!(damaged_everywhere(&file, || read(&file)) > 0, "{name}");
        assert_eq!(read(&file).expect("read").gaussians.len(), 3);
    }
    let file = root.path().join("a.sog");
    written(&file, Format::Sog, 3, 1);
    let whole = fs::read(&file).expect("file");
    for length in (0..whole.len()).step_by(97).chain([whole.len() - 1]) {
        replace(&file, &whole[..length]);
        let error = read(&file).expect_err("cut off");
        assert!(names_the_place(&error, &file), "{length} bytes: {error}");
    }
    replace(&file, &whole);
    foreign(&file, || read(&file));
    assert!(damaged_everywhere(&file, || read(&file)) > 0);
    let file = root.path().join("a.splat");
    written(&file, Format::Splat, 3, 0);
    let whole = fs::read(&file).expect("file");
    for length in (1..whole.len()).filter(|length| length % 32 != 0) {
        replace(&file, &whole[..length]);
        refused(&file, "no whole number of splats");
    }
}

#[test]
fn counts_beyond_the_file_are_refused_before_memory_is_taken() {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("a.spz");
    written(&file, Format::Spz(Version::Four), 3, 3);
    let whole = fs::read(&file).expect("file");
    for count in [u32::MAX, 1 << 31, 1_000_000] {
        replace(&file, [&whole[..8], &count.to_le_bytes(), &whole[12..]].concat());
        refused(&file, "number of splats at byte 8");
    }
    // A stream of another length than its splats need.
    replace(&file, [&whole[..8], &4_u32.to_le_bytes(), &whole[12..]].concat());
    refused(&file, "27 bytes are told, 36 belong to the number of splats");
    let file = root.path().join("a.glb");
    written(&file, Format::Glb, 3, 0);
    let whole = fs::read(&file).expect("file");
    let text = String::from_utf8_lossy(&whole).into_owned();
    let at = text.find("\"count\":3").expect("a count") + 8;
    let mut bytes = fs::read(&file).expect("file");
    bytes[at] = b'9';
    replace(&file, bytes);
    assert!(read(&file).is_err());
}

/// A gzip stream of a few bytes unpacks to a thousand times as many.
#[test]
fn packed_zeros_without_end_are_not_unpacked() {
    let root = tempfile::tempdir().expect("temporary folder");
    let zeros = vec![0; 1 << 24];
    let file = root.path().join("a.spz");
    written(&file, Format::Spz(Version::Three), 3, 0);
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(b"NGSP\x03\0\0\0\x03\0\0\0\0\x0c\0\0").expect("packed");
    (0..16).for_each(|_| packed.write_all(&zeros).expect("packed"));
    replace(&file, packed.finish().expect("packed"));
    assert_eq!(read(&file).expect("three splats before the zeros").gaussians.len(), 3);
    let file = root.path().join("a.sog");
    for (name, words) in [("meta.json", "has more than 1048576 bytes"), ("means_l.webp", "has more than")] {
        written(&file, Format::Sog, 3, 0);
        let mut old = zip::ZipArchive::new(Cursor::new(fs::read(&file).expect("file"))).expect("an archive");
        let mut new = zip::ZipWriter::new(Cursor::new(Vec::new()));
        let packed = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
        for at in 0..old.len() {
            let mut entry = old.by_index(at).expect("an entry");
            let own = entry.name().expect("a name").into_owned();
            new.start_file(own.as_str(), packed).expect("begun");
            match own == name {
                true => new.write_all(&zeros).expect("written"),
                false => drop(std::io::copy(&mut entry, &mut new).expect("copied")),
            }
        }
        replace(&file, new.finish().expect("an archive").into_inner());
        refused(&file, words);
    }
}

#[test]
fn a_sog_file_is_refused_by_the_field_that_is_wrong() {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("a.sog");
    written(&file, Format::Sog, 3, 1);
    let whole = fs::read(&file).expect("file");
    let mut old = zip::ZipArchive::new(Cursor::new(whole)).expect("an archive");
    let mut entries = Vec::new();
    for at in 0..old.len() {
        let mut entry = old.by_index(at).expect("an entry");
        let mut bytes = Vec::new();
        std::io::copy(&mut entry, &mut bytes).expect("copied");
        entries.push((entry.name().expect("a name").into_owned(), bytes));
    }
    let meta = entries.iter().find(|(name, _)| name == "meta.json").expect("meta").1.clone();
    let meta: serde_json::Value = serde_json::from_slice(&meta).expect("JSON");
    let with = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut changed = meta.clone();
        change(&mut changed);
        let mut new = zip::ZipWriter::new(Cursor::new(Vec::new()));
        for (name, bytes) in &entries {
            new.start_file(name.as_str(), zip::write::SimpleFileOptions::default()).expect("begun");
            match name == "meta.json" {
                true => new.write_all(changed.to_string().as_bytes()).expect("written"),
                false => new.write_all(bytes).expect("written"),
            }
        }
        replace(&file, new.finish().expect("an archive").into_inner());
    };
    with(&|_| ());
    assert_eq!(read(&file).expect("read").sh_degree, 1);
    let cases: [(&str, serde_json::Value, &str); 9] = [
        ("/version", 1.into(), "version of meta.json at byte 0: is not 2"),
        ("/count", 4_000_000_000_u64.into(), "number of splats"),
        ("/count", 17.into(), "pixels where 17 are needed"),
        ("/scales/codebook", serde_json::json!([1.0]), "scales of meta.json at byte 0: the codebook has 1 numbers"),
        ("/shN/bands", 4.into(), "shN of meta.json"),
        ("/shN/bands", 3.into(), "shN_centroids.webp"),
        ("/shN/count", 2.into(), "entry 2 is not in the palette"),
        ("/quats/files/0", "../quats.webp".into(), "../quats.webp"),
        ("/means/mins", serde_json::json!([1e30, 0, 0]), "splat 0"),
    ];
    for (field, value, words) in cases {
        with(&|meta| *meta.pointer_mut(field).expect("a field") = value.clone());
        refused(&file, words);
    }
    // A single bad splat among many others is left out, and told.
    let file = root.path().join("b.splat");
    written(&file, Format::Splat, 30, 0);
    let mut bytes = fs::read(&file).expect("file");
    bytes[..4].copy_from_slice(&f32::NAN.to_le_bytes());
    replace(&file, bytes);
    refused(&file, "splat 0");
    let model = splats::read(&file, false).expect("read");
    assert_eq!((model.gaussians.len(), model.left_out.map(|left_out| left_out.count)), (29, Some(1)));
}
