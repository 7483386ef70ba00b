//! Recognises files of other kinds by their first bytes, and says what each is and what to do about it.

use std::path::Path;

/// Bytes at a file's beginning that are compared.
pub(crate) const LOOKED_AT: usize = 512;
/// Bytes of a splat in a `.splat` file.
const SPLAT_BYTES: u64 = 32;
/// Extensions of camera raw files. Most are TIFF files with a small preview at the beginning.
const RAW: [&str; 12] = ["dng", "nef", "nrw", "arw", "sr2", "cr2", "cr3", "raf", "orf", "rw2", "pef", "srw"];

const CONVERT_PICTURE: &str = "convert it to JPEG or PNG";
const CONVERT_MODEL: &str = "convert it to a PLY file, with splat-transform or the program that wrote it";

/// The kind of a file that begins with `begin`, and the remedy, worded to follow a subject; `None` for an unknown
/// beginning.
pub(crate) fn described(file: &Path, bytes: u64, begin: &[u8]) -> Option<String> {
    if bytes == 0 {
        return Some("the file is empty: copy or download it again".to_owned());
    }
    let (what, remedy) = named(&extension(file), bytes, begin)?;
    Some(format!("this is {what}: {remedy}"))
}

/// Whether a text that is sent in place of files begins so.
pub(crate) fn is_text(begin: &[u8]) -> bool {
    text(begin).is_some()
}

/// Describes a camera raw file. Decoders would return the small preview at its beginning.
pub(crate) fn described_raw(file: &Path) -> Option<String> {
    let raw = RAW.contains(&extension(file).as_str());
    raw.then(|| "this is a camera's raw file: develop it to JPEG, PNG or TIFF".to_owned())
}

fn extension(file: &Path) -> String {
    file.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

fn named(extension: &str, bytes: u64, begin: &[u8]) -> Option<(&'static str, &'static str)> {
    text(begin).or_else(|| picture(begin)).or_else(|| model(extension, bytes, begin)).or_else(|| other(begin))
}

/// Texts in place of a file: pointers of Git LFS, and web pages.
fn text(begin: &[u8]) -> Option<(&'static str, &'static str)> {
    if begin.starts_with(b"version https://git-lfs") {
        return Some(("a pointer of Git LFS and not the file itself", "fetch the file with 'git lfs pull'"));
    }
    let trimmed = begin.strip_prefix(b"\xef\xbb\xbf").unwrap_or(begin).trim_ascii_start();
    let starts = |tag: &[u8]| trimmed.get(..tag.len()).is_some_and(|word| word.eq_ignore_ascii_case(tag));
    let xml_page = starts(b"<?xml") && trimmed.windows(5).any(|word| word.eq_ignore_ascii_case(b"<html"));
    if starts(b"<!doctype html") || starts(b"<html") || starts(b"<head") || xml_page {
        return Some((
            "a web page (HTML), as servers send in place of a file",
            "download the file itself; the page says why it was not sent",
        ));
    }
    None
}

/// Pictures and videos.
fn picture(begin: &[u8]) -> Option<(&'static str, &'static str)> {
    let what = match begin {
        [0xff, 0xd8, 0xff, ..] => "a JPEG picture",
        [0x89, b'P', b'N', b'G', ..] => "a PNG picture",
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => "a WebP picture",
        [0x76, 0x2f, 0x31, 0x01, ..] => "an OpenEXR picture",
        [0xff, 0x0a, ..] | [0, 0, 0, 0x0c, b'J', b'X', b'L', b' ', ..] => "a picture of the format JPEG XL",
        [0, 0, 0, 0x0c, b'j', b'P', b' ', b' ', ..] => "a picture of the format JPEG 2000",
        [b'8', b'B', b'P', b'S', ..] => "a file of Photoshop",
        [b'F', b'U', b'J', b'I', b'F', b'I', b'L', b'M', ..] => {
            return Some(("a camera's raw file", "develop it to JPEG, PNG or TIFF"));
        }
        [_, _, _, _, b'f', b't', b'y', b'p', brand @ ..] => return Some(boxed(brand)),
        _ => return None,
    };
    Some((what, CONVERT_PICTURE))
}

/// Files in ISO's base media format, by their brand.
fn boxed(brand: &[u8]) -> (&'static str, &'static str) {
    match brand.get(..4).unwrap_or_default() {
        b"avif" | b"avis" => ("a picture of the format AVIF", CONVERT_PICTURE),
        b"heic" | b"heix" | b"hevc" | b"hevx" | b"heim" | b"heis" | b"hevm" | b"hevs" | b"mif1" | b"msf1" => {
            ("a picture of the format HEIC (HEIF)", CONVERT_PICTURE)
        }
        b"crx " => ("a camera's raw file", "develop it to JPEG, PNG or TIFF"),
        _ => ("a film", "take single pictures out of it, with ffmpeg for one"),
    }
}

/// Models and point clouds.
fn model(extension: &str, bytes: u64, begin: &[u8]) -> Option<(&'static str, &'static str)> {
    let what = match (begin, extension) {
        ([b'p', b'l', b'y', b'\n' | b'\r', ..], _) => {
            return Some(("a PLY file", "name it where a model is asked for"));
        }
        ([b'N', b'G', b'S', b'P', ..], _) | ([0x1f, 0x8b, ..], "spz") => "a model of the format SPZ",
        ([b'P', b'K', ..], "sog") => "a model of the format SOG",
        (_, "ksplat") => "a model of the format KSPLAT",
        (_, "splat") if bytes.is_multiple_of(SPLAT_BYTES) => "a model of the format SPLAT",
        ([b'g', b'l', b'T', b'F', ..], _) => "a file of the format glTF",
        ([b'L', b'A', b'S', b'F', ..], _) => {
            return Some(("a laser scan (LAS or LAZ)", "give it as the `lidar` of a training"));
        }
        ([b'A', b'S', b'T', b'M', b'-', b'E', b'5', b'7', ..], _) => {
            return Some(("a laser scan of the format E57", "convert it to PLY, LAS or LAZ"));
        }
        _ => return None,
    };
    Some((what, CONVERT_MODEL))
}

/// Containers whose content is not inspected.
fn other(begin: &[u8]) -> Option<(&'static str, &'static str)> {
    match begin {
        [b'%', b'P', b'D', b'F', ..] => Some(("a PDF document", "take the pictures out of it")),
        [b'P', b'K', 3 | 5, ..] => Some(("a ZIP archive", "unpack it")),
        [0x1f, 0x8b, ..] => Some(("a file compressed with gzip", "unpack it with gunzip")),
        [0x28, 0xb5, 0x2f, 0xfd, ..] => Some(("a file compressed with zstd", "unpack it with unzstd")),
        [0xfd, b'7', b'z', b'X', b'Z', ..] => Some(("a file compressed with xz", "unpack it with unxz")),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(name: &str, begin: &[u8]) -> String {
        described(Path::new(name), begin.len() as u64, begin).unwrap_or_default()
    }

    #[test]
    fn files_of_other_kinds_are_told_as_what_they_are() {
        for (name, begin, what) in [
            ("a.jpg", &b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n"[..], "Git LFS"),
            ("a.jpg", b"\xef\xbb\xbf \n<!DOCTYPE html><html>", "web page"),
            ("a.jpg", b"<?xml version=\"1.0\"?><!DOCTYPE html PUBLIC><HTML>", "web page"),
            ("a.jpg", b"\0\0\0\x18ftypheic\0\0\0\0", "HEIC"),
            ("a.jpg", b"\0\0\0\x18ftypmif1\0\0\0\0", "HEIC"),
            ("a.jpg", b"\0\0\0\x1cftypavif\0\0\0\0", "AVIF"),
            ("a.jpg", b"\0\0\0\x1cftypisom\0\0\0\0", "film"),
            ("a.ply", b"\xff\xd8\xff\xe0", "JPEG"),
            ("x.spz", b"\x1f\x8b\x08", "SPZ"),
            ("x.ply", b"NGSP\x03", "SPZ"),
            ("x.sog", b"PK\x03\x04", "SOG"),
            ("x.splat", &[7; 64], "SPLAT"),
            ("x.zip", b"PK\x03\x04", "ZIP"),
            ("x.ply", b"", "empty"),
        ] {
            let told = told(name, begin);
            assert!(told.contains(what) && told.contains(": "), "{name}: {told}");
        }
        assert_eq!(told("a.splat", &[7; 63]), "", "no whole number of splats");
        assert_eq!(told("a.jpg", b"hello"), "");
        assert!(described_raw(Path::new("a.NEF")).is_some() && described_raw(Path::new("a.tif")).is_none());
    }
}
