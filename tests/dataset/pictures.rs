//! Picture files: every valid kind is read, sizes beyond the memory are refused, and errors name the kind of other
//! files.

use std::fs;
use std::path::{Path, PathBuf};

use image::RgbImage;
use psrgs_vk::dataset::{Dataset, Error, LoadOptions, Photograph};

use crate::colmap_folder::Folder;

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/dataset/pictures").join(name)
}

/// The colour of the pictures at a pixel.
fn colour(x: u32, y: u32) -> [u8; 3] {
    [40 + 6 * x, 30 + 9 * y, 200 - 4 * x - 3 * y].map(|v| v as u8)
}

/// The brightness of the grey pictures.
fn grey(x: u32) -> u8 {
    40 + 6 * x as u8
}

/// Reads a picture of 24x16 pixels, alone and as the photograph of a dataset, and compares its pixels within `within`
/// steps of 255.
fn reads(name: &str, within: u8, want: impl Fn(u32, u32) -> [u8; 3]) {
    let alone = Photograph::read(&file(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
    let folder = Folder::ring(&[name], [0.0; 3]);
    let root = tempfile::tempdir().expect("temporary folder");
    folder.write(root.path(), &folder.binary());
    fs::create_dir_all(root.path().join("images")).expect("a folder");
    fs::copy(file(name), root.path().join("images").join(name)).expect("copied");
    let dataset = Dataset::load(root.path(), &LoadOptions::default()).unwrap_or_else(|error| panic!("{name}: {error}"));
    let placed = dataset.views[0].photograph().unwrap_or_else(|error| panic!("{name}: {error}"));
    for photograph in [alone, placed] {
        assert_eq!((photograph.width, photograph.height), (24, 16), "{name}");
        let picture = RgbImage::from_raw(24, 16, photograph.pixels.rgb8()).expect("a picture");
        for (x, y, pixel) in picture.enumerate_pixels() {
            let far = pixel.0.iter().zip(want(x, y)).map(|(a, b)| a.abs_diff(b)).max();
            assert!(far <= Some(within), "{name}: {pixel:?} at {x}, {y}, which is {:?}", want(x, y));
        }
    }
}

#[test]
fn pictures_of_every_valid_kind_are_read() {
    for (name, within) in [
        ("progressive_small.jpg", 40),
        ("cmyk.jpg", 40),
        ("cmyk.tif", 2),
        ("palette.png", 40),
        ("lossless.webp", 0),
        ("lossy.webp", 60),
    ] {
        reads(name, within, colour);
    }
    reads("grey_small.jpg", 20, |x, y| {
        let [r, g, b] = colour(x, y).map(f64::from);
        [(0.299 * r + 0.587 * g + 0.114 * b) as u8; 3]
    });
    for (name, within) in [("grey16.png", 0), ("grey_alpha.png", 0)] {
        reads(name, within, |x, _| [grey(x); 3]);
    }
    for name in ["bits.png", "group4.tif", "bits_deflate.tif", "bits_packbits.tif"] {
        reads(name, 0, |x, _| [if x >= 12 { 255 } else { 0 }; 3]);
    }
    for (name, size) in [("flat.webp", (2000, 1500)), ("blank_group4.tif", (4000, 3000))] {
        let photograph = Photograph::read(&file(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!((photograph.width, photograph.height), size, "a wrong size of a small file");
    }
}

/// A photograph of a large camera in one strip, beyond the decoder's own limits.
#[test]
fn a_large_uncompressed_picture_of_16_bits_is_read() {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("large.tif");
    let (width, height) = (9000_u32, 6000_u32);
    let data = u64::from(width) * u64::from(height) * 6;
    // The header, a directory of one strip, and pixels as a hole in the file.
    let mut bytes = b"II\x2a\0\x08\0\0\0".to_vec();
    let entries: [(u16, u16, u32, u32); 9] = [
        (256, 4, 1, width),
        (257, 4, 1, height),
        (258, 3, 3, 126),
        (259, 3, 1, 1),
        (262, 3, 1, 2),
        (273, 4, 1, 132),
        (277, 3, 1, 3),
        (278, 4, 1, height),
        (279, 4, 1, data as u32),
    ];
    bytes.extend((entries.len() as u16).to_le_bytes());
    for (tag, kind, count, value) in entries {
        bytes.extend(tag.to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(count.to_le_bytes());
        bytes.extend(value.to_le_bytes());
    }
    bytes.extend([0; 4]);
    assert!(bytes.len() <= 126);
    bytes.resize(126, 0);
    [16_u16; 3].iter().for_each(|bits| bytes.extend(bits.to_le_bytes()));
    fs::write(&file, bytes).expect("written");
    fs::OpenOptions::new().write(true).open(&file).expect("opened").set_len(132 + data).expect("a hole");
    match Photograph::read(&file) {
        Ok(photograph) => assert_eq!((photograph.width, photograph.height), (width, height)),
        // A machine without a free gigabyte.
        Err(Error::PictureTooLarge { .. } | Error::NoMemoryForPicture { .. }) => {}
        Err(error) => panic!("{error}"),
    }
}

#[test]
fn a_kind_of_picture_that_is_not_read_is_told_with_a_remedy() {
    let error = Photograph::read(&file("palette.tif")).map(|_| ()).expect_err("a palette").to_string();
    assert!(error.contains("palette.tif") && error.contains("convert it to PNG or JPEG"), "{error}");
}

/// A dataset with these bytes as a photograph: loading or decoding must fail, with the file in the message.
fn refused(name: &str, bytes: &[u8], host_memory: Option<u64>) -> Error {
    let folder = Folder::ring(&[name], [0.0; 3]);
    let root = tempfile::tempdir().expect("temporary folder");
    folder.write(root.path(), &folder.binary());
    let photograph = root.path().join("images").join(name);
    fs::create_dir_all(root.path().join("images")).expect("a folder");
    fs::write(&photograph, bytes).expect("written");
    assert!(Photograph::read(&photograph).is_err() || host_memory.is_some(), "{name}, alone");
    let options = LoadOptions { host_memory, ..LoadOptions::default() };
    let found = Dataset::load(root.path(), &options).and_then(|dataset| dataset.views[0].photograph());
    let error = found.map(|_| ()).expect_err(name);
    assert!(error.to_string().contains(name), "{error}");
    error
}

#[test]
fn a_file_of_another_kind_is_told_as_what_it_is() {
    for (bytes, what) in [
        (&b""[..], "empty"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:12\nsize 3\n", "git lfs pull"),
        (b"<!DOCTYPE html>\n<html><body>404</body></html>", "web page"),
        (b"\0\0\0\x18ftypheic\0\0\0\0mif1heic", "HEIC"),
        (b"\0\0\0\x1cftypavif\0\0\0\0avifmif1", "AVIF"),
        (b"\xff\x0a\xff\x07", "JPEG XL"),
        (b"ply\nformat ascii 1.0\n", "PLY"),
    ] {
        let error = refused("a.jpg", bytes, None).to_string();
        assert!(error.contains(what) && error.contains(": header at byte 0: "), "{error}");
    }
    let tiff = fs::read(file("group4.tif")).expect("a file");
    let error = refused("a.NEF", &tiff, None).to_string();
    assert!(error.contains("raw file"), "a preview was taken for the photograph: {error}");
}

/// A PNG file that claims a size, with a correct checksum.
fn png_of(width: u32, height: u32, bytes: u32) -> Vec<u8> {
    let mut png = fs::read(file("bits.png")).expect("a file");
    png[16..20].copy_from_slice(&width.to_be_bytes());
    png[20..24].copy_from_slice(&height.to_be_bytes());
    let sum = crc32fast::hash(&png[12..29]);
    png[29..33].copy_from_slice(&sum.to_be_bytes());
    png.resize(bytes as usize, 0);
    png
}

/// A JPEG file that claims a size.
fn jpeg_of(name: &str, width: u16, height: u16, bytes: usize) -> Vec<u8> {
    let mut jpeg = fs::read(file(name)).expect("a file");
    let frame = jpeg.windows(2).position(|w| w[0] == 0xff && matches!(w[1], 0xc0 | 0xc2)).expect("a frame");
    jpeg[frame + 5..frame + 7].copy_from_slice(&height.to_be_bytes());
    jpeg[frame + 7..frame + 9].copy_from_slice(&width.to_be_bytes());
    jpeg.resize(bytes.max(jpeg.len()), 0);
    jpeg
}

/// A TIFF file that claims a size.
fn tiff_of(name: &str, side: u32) -> Vec<u8> {
    let mut tiff = fs::read(file(name)).expect("a file");
    let word = |at: usize| u16::from_le_bytes([tiff[at], tiff[at + 1]]);
    let begin = u32::from_le_bytes([tiff[4], tiff[5], tiff[6], tiff[7]]) as usize;
    for at in (0..usize::from(word(begin))).map(|k| begin + 2 + 12 * k).collect::<Vec<_>>() {
        if matches!(u16::from_le_bytes([tiff[at], tiff[at + 1]]), 256 | 257 | 278) {
            tiff[at + 2..at + 4].copy_from_slice(&4_u16.to_le_bytes());
            tiff[at + 8..at + 12].copy_from_slice(&side.to_le_bytes());
        }
    }
    tiff
}

/// An OpenEXR file of 3.4 MB whose windows claim a size.
fn exr_of(side: i32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let picture = image::Rgb32FImage::from_pixel(24, 16, image::Rgb([0.5; 3]));
    picture.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::OpenExr).expect("encoded");
    for name in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
        let at = bytes.windows(name.len()).position(|w| w == name).expect("a window") + name.len() + 4;
        for corner in [8, 12] {
            bytes[at + corner..at + corner + 4].copy_from_slice(&(side - 1).to_le_bytes());
        }
    }
    // Without this attribute, the decoder computes the number of chunks.
    if let Some(at) = bytes.windows(10).position(|w| w == b"chunkCount") {
        bytes[at] = b'k';
    }
    bytes.resize(3_400_000, 0);
    bytes
}

/// Decoding pictures of these sizes would end the process.
#[test]
fn a_size_beyond_the_memory_is_refused_before_it_is_decoded() {
    let limit = Some(1 << 30);
    for (name, bytes) in [
        ("a.exr", exr_of(60_000)),
        ("a.png", png_of(60_000, 60_000, 3_400_000)),
        ("a.jpg", jpeg_of("grey_small.jpg", 60_000, 60_000, 3_400_000)),
        ("b.jpg", jpeg_of("progressive_small.jpg", 60_000, 60_000, 10_000_000)),
        ("a.tif", tiff_of("group4.tif", 60_000)),
        ("b.tif", tiff_of("bits_deflate.tif", 200_000)),
    ] {
        let error = refused(name, &bytes, limit);
        let Error::PictureTooLarge { needed, limit, .. } = &error else { panic!("{name}: {error}") };
        assert!(*needed > limit.most && limit.asked, "{error}");
        assert!(error.to_string().contains("may be used; store a smaller picture, or allow more"), "{error}");
        // Without a limit by the user, the machine's memory is the limit: an error on every machine.
        refused(name, &bytes, None);
    }
}

#[test]
fn masks_and_further_windows_are_held_against_the_limit_too() {
    let folder = Folder::ring(&["a.png"], [0.0; 3]);
    let root = folder.dataset(false);
    fs::create_dir_all(root.path().join("masks")).expect("a folder");
    fs::write(root.path().join("masks/a.png"), tiff_of("group4.tif", 60_000)).expect("written");
    let options = LoadOptions { host_memory: Some(1 << 30), ..LoadOptions::default() };
    let error = Dataset::load(root.path(), &options).map(|_| ()).expect_err("a mask");
    assert!(matches!(error, Error::PictureTooLarge { .. }) && error.to_string().contains("masks/a.png"), "{error}");
    // The display window has 24x16 pixels, the data window far more.
    let mut bytes = exr_of(60_000);
    let name = b"displayWindow\0box2i\0";
    let at = bytes.windows(name.len()).position(|w| w == name).expect("a window") + name.len() + 4;
    bytes[at + 8..at + 12].copy_from_slice(&23_i32.to_le_bytes());
    bytes[at + 12..at + 16].copy_from_slice(&15_i32.to_le_bytes());
    let error = refused("a.exr", &bytes, Some(1 << 20));
    assert!(matches!(error, Error::PictureTooLarge { .. }), "{error}");
}
