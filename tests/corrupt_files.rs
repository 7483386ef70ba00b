//! Truncated, damaged and foreign files for every reader: an error with file and place, never a panic.

#[path = "corrupt_files/claims.rs"]
mod claims;
mod colmap_folder;
#[path = "corrupt_files/decoders.rs"]
mod decoders;
#[path = "corrupt_files/range.rs"]
mod range;
#[path = "corrupt_files/viewers.rs"]
mod viewers;

use std::fs;
use std::path::Path;

use colmap_folder::Folder;
use psrgs_vk::dataset::{Dataset, LoadOptions, Role, Warning};
use psrgs_vk::format::checkpoint::Checkpoint;
use psrgs_vk::format::{FrameFile, image_out, ply};
use psrgs_vk::scene::{Frame, Gaussians};
use psrgs_vk::train::cloud;
use psrgs_vk::world::{self, LidarParams, World, WorldParams};

/// Whether the message has the file's name and a place in the file.
fn names_the_place(message: &str, file: &Path) -> bool {
    let name = file.file_name().and_then(|n| n.to_str()).expect("name");
    message.contains(name) && (message.contains(" at byte ") || message.contains(" at line "))
}

/// Writes a file anew. (Truncating it in place would make some file systems wait for the disk each time.)
fn replace(file: &Path, bytes: impl AsRef<[u8]>) {
    fs::remove_file(file).expect("removed");
    fs::write(file, bytes).expect("written");
}

/// Every proper beginning of a file: `read` must fail and name the place.
fn truncated_everywhere<T>(file: &Path, read: impl Fn() -> Result<T, String>) {
    let whole = fs::read(file).expect("file");
    for length in 0..whole.len() {
        replace(file, &whole[..length]);
        match read() {
            Ok(_) => panic!("{}: the first {length} bytes of {} were read", file.display(), whole.len()),
            Err(message) => assert!(names_the_place(&message, file), "{length} bytes: {message}"),
        }
    }
    replace(file, whole);
}

/// Each byte replaced by several values in turn: no panic. Gives the number of damaged files that were refused.
fn damaged_everywhere<T>(file: &Path, read: impl Fn() -> Result<T, String>) -> usize {
    let whole = fs::read(file).expect("file");
    let step = (whole.len() / 500).max(1);
    let mut refused = 0;
    for at in (0..whole.len()).step_by(step) {
        for value in [whole[at] ^ 1, whole[at] ^ 0x80, 0, 0xff, b'9'] {
            let mut bytes = whole.clone();
            bytes[at] = value;
            replace(file, bytes);
            refused += usize::from(read().is_err());
        }
    }
    replace(file, whole);
    refused
}

/// Files of other kinds.
fn foreign<T>(file: &Path, read: impl Fn() -> Result<T, String>) {
    let whole = fs::read(file).expect("file");
    let noise: Vec<u8> = (0..4000_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let others: [&[u8]; 6] =
        [b"hello\n", b"\x89PNG\r\n\x1a\n\0\0", &[0xff; 300], &noise, b"1 2 3 4\n5 6 7 8\n", b"ply\n"];
    for other in others {
        replace(file, other);
        match read() {
            Ok(_) => panic!("{}: {other:?} was read", file.display()),
            Err(message) => assert!(names_the_place(&message, file), "{message}"),
        }
    }
    replace(file, whole);
}

fn load(root: &Path) -> Result<Dataset, String> {
    load_as(root, false)
}

fn load_as(root: &Path, strict: bool) -> Result<Dataset, String> {
    let options = LoadOptions { photographs: false, strict, ..LoadOptions::default() };
    Dataset::load(root, &options).map_err(|e| e.to_string())
}

#[test]
fn colmap_binary() {
    let folder = Folder::ring(&["a.png", "b/c.png", "d.png"], [1.0, 2.0, 3.0]);
    let root = tempfile::tempdir().expect("temporary folder");
    folder.write(root.path(), &folder.binary());
    for name in ["cameras.bin", "images.bin", "points3D.bin"] {
        let file = root.path().join("sparse/0").join(name);
        truncated_everywhere(&file, || load(root.path()));
        foreign(&file, || load(root.path()));
        assert!(damaged_everywhere(&file, || load(root.path())) > 0);
        // Counts far beyond the file: refused before any memory is asked for.
        let whole = fs::read(&file).expect("file");
        for count in [u64::MAX, u64::MAX / 8, 1 << 40, 1 << 31, 100] {
            let mut bytes = whole.clone();
            bytes[..8].copy_from_slice(&count.to_le_bytes());
            replace(&file, bytes);
            let error = load(root.path()).expect_err("a count");
            assert!(error.contains(name) && error.contains("at byte 0"), "{error}");
        }
        let mut longer = whole.clone();
        longer.push(0);
        replace(&file, longer);
        let error = load(root.path()).expect_err("more than the format has");
        assert!(error.contains(&format!("at byte {}: 1 bytes follow", whole.len())), "{error}");
        replace(&file, whole);
    }
    load(root.path()).expect("the restored files load");
}

#[test]
fn colmap_text() {
    let folder = Folder::ring(&["a.png", "b/c.png", "d e.png"], [1.0, 2.0, 3.0]);
    let root = tempfile::tempdir().expect("temporary folder");
    folder.write(root.path(), &folder.text());
    let whole = load(root.path()).expect("loads");
    let seen = |dataset: &Dataset| dataset.points.iter().map(|p| (p.position, p.colour)).collect::<Vec<_>>();
    let same = |dataset: &Dataset| dataset.views == whole.views && seen(dataset) == seen(&whole);
    for (name, bytes) in folder.text() {
        let file = root.path().join("sparse/0").join(name);
        let last = bytes.trim_ascii_end().iter().rposition(|b| b.is_ascii_whitespace()).expect("words") + 2;
        for length in 0..bytes.len() {
            replace(&file, &bytes[..length]);
            match load(root.path()) {
                // A text is whole without its last line end, a digit of its last number, or unused fields.
                Ok(dataset) if length >= last || same(&dataset) => {}
                // A cut last name is noticed as a missing photograph.
                Ok(dataset) if dataset.views.len() == 3 && dataset.views[2].name != "d e.png" => {}
                // No points are left, or the comment at the top counts more points: a warning.
                Ok(dataset) => {
                    let empty = Warning::NoPoints { file: Some(file.clone()) };
                    let fewer = |w: &Warning| matches!(w, Warning::CountDiffers { file: cut, .. } if *cut == file);
                    let told = dataset.warnings.iter().any(|warning| *warning == empty || fewer(warning));
                    assert!(told, "{name}: the first {length} bytes were read: {:?}", dataset.warnings);
                }
                Err(message) => assert!(message.contains(name), "{length} bytes of {name}: {message}"),
            }
        }
        replace(&file, &bytes);
        damaged_everywhere(&file, || load(root.path()));
    }
    // Not as COLMAP writes them: no comments, no end of the last line, no last line of keypoints.
    for (name, bytes) in folder.text() {
        let text = String::from_utf8(bytes).expect("text");
        let lines: Vec<&str> = text.lines().filter(|l| !l.starts_with('#')).collect();
        let lines = if name == "images.txt" { &lines[..5] } else { &lines[..] };
        fs::write(root.path().join("sparse/0").join(name), lines.join("\r\n")).expect("written");
    }
    let by_hand = load(root.path()).expect("loads");
    assert_eq!((by_hand.views, by_hand.points), (whole.views, whole.points));
}

#[test]
fn colmap_text_names_the_line_and_the_field() {
    let folder = Folder::ring(&["a.png", "b.png"], [0.0; 3]);
    let root = tempfile::tempdir().expect("temporary folder");
    for (name, from, to, place) in [
        ("cameras.txt", "PINHOLE", "PINHOLES", "model of camera 1 at line 4: 'PINHOLES' is unknown"),
        ("cameras.txt", "24 16", "24 0", "size of camera 1 at line 4: is 24x0"),
        ("cameras.txt", "20.5", "-20.5", "focal length of camera 1 at line 4: is -20.5"),
        ("cameras.txt", "8.75", "inf", "parameter 3 of camera 1 at line 4: is inf"),
        ("cameras.txt", " 8.75", "", "parameters of camera 1 at line 4: 3 where PINHOLE has 4"),
        ("cameras.txt", "PINHOLE", "EUCLID", "'EUCLID' is unknown; supported are SIMPLE_PINHOLE, PINHOLE,"),
        ("cameras.txt", "8.75", "8.75 1", "parameters of camera 1 at line 4: 1 more than PINHOLE has"),
        ("images.txt", "0 1 0 0 -2", "0 0 0 0 -2", "rotation of image 'a.png' at line 3: the quaternion is zero"),
        ("images.txt", "0 1 0 0 -2", "0 1 0 zero -2", "qz of image 'a.png' at line 3: 'zero' is not a number"),
        ("images.txt", "1 a.png", "77 a.png", "camera of image 'a.png' at line 3: there is no camera 77"),
        ("images.txt", " 1 a.png", " 1", "name of image 0 at line 3: is missing"),
        ("points3D.txt", "98 ", "98 NaN ", "x of point 98 at line 5: is NaN"),
        ("points3D.txt", "100 -1 -1 0.1 0 255 128", "100 -1 -1 0.1 0 256 128", "colour of point 100 at line 3: '256'"),
    ] {
        folder.write(root.path(), &folder.text());
        let file = root.path().join("sparse/0").join(name);
        let text = fs::read_to_string(&file).expect("text");
        assert!(text.contains(from), "{name} has {from}: {text}");
        replace(&file, text.replacen(from, to, 1));
        let error = load_as(root.path(), true).expect_err(to);
        assert!(error.contains(name) && error.contains(place), "{error}");
    }
}

#[test]
fn photographs() {
    let folder = Folder::ring(&["a.png", "b.png"], [0.0; 3]);
    let root = folder.dataset(false);
    let file = root.path().join("images/b.png");
    let read = || {
        let dataset = Dataset::load(root.path(), &LoadOptions::default()).map_err(|e| e.to_string())?;
        dataset.photographs(Role::Train).map_err(|e| e.to_string())
    };
    // A PNG ends in an empty chunk, which decoders may ignore.
    let whole = fs::read(&file).expect("photograph");
    let end = whole.windows(4).position(|w| w == b"IEND").expect("end") - 4;
    for length in 0..end {
        replace(&file, &whole[..length]);
        match read() {
            Ok(photographs) => panic!("{length} bytes gave {} photographs", photographs.len()),
            Err(message) => assert!(names_the_place(&message, &file), "{length} bytes: {message}"),
        }
    }
    replace(&file, whole);
    damaged_everywhere(&file, read);
    foreign(&file, read);
}

#[test]
fn jpeg_photographs() {
    let folder = Folder::ring(&["a.jpg", "b.jpg"], [0.0; 3]);
    let root = folder.dataset(false);
    let file = root.path().join("images/b.jpg");
    let read = || {
        let dataset = Dataset::load(root.path(), &LoadOptions::default()).map_err(|e| e.to_string())?;
        dataset.photographs(Role::Train).map_err(|e| e.to_string())
    };
    let (whole, picture) = (fs::read(&file).expect("file"), read().expect("whole"));
    for length in 0..whole.len() {
        replace(&file, &whole[..length]);
        match read() {
            // Only the end marker is missing.
            Ok(found) => assert!(found == picture && length >= whole.len() - 2, "the first {length} bytes were read"),
            Err(message) => {
                assert!(names_the_place(&message, &file), "{length} bytes: {message}");
                assert!(length < whole.len() - 2, "{length} bytes: {message}");
            }
        }
    }
    replace(&file, whole);
    damaged_everywhere(&file, read);
    foreign(&file, read);
}

#[test]
fn models() {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("point_cloud.ply");
    let read = || ply::read(&file).map_err(|e| e.to_string());
    let frame = Frame { offset: [5e5, 4.6e6, 100.0], scale: 1.0 };
    ply::save(&file, &Gaussians::zeros(3), &frame, true).expect("written");
    truncated_everywhere(&file, read);
    foreign(&file, read);
    assert!(damaged_everywhere(&file, read) > 0);
    let whole = fs::read(&file).expect("file");
    let text = String::from_utf8_lossy(&whole[..whole.len() - 3 * 248]).into_owned();
    let tail = &whole[text.len()..];
    for (from, to, place) in [
        ("element vertex 3", "element vertex 4", "element vertex at byte"),
        ("element vertex 3", "element vertex 18446744073709551615", "element vertex at byte"),
        ("element vertex 3", "element vertex 4000000000", "element vertex at byte"),
        ("element vertex 3", "element vortex 3", "there is no element 'vertex'"),
        ("property float opacity\n", "", "the property 'opacity' is missing"),
        ("property float f_rest_44\n", "", "44 properties f_rest_N"),
        ("f_rest_44", "f_rest_45", "45 properties f_rest_N"),
        ("property float x", "property list uchar float x", "lists are not supported"),
        ("property float nx", "property list uchar float nx", "lists are not supported"),
        ("property float x", "property quad x", "the type 'quad' of 'x' is unknown"),
        ("property float y", "property float x", "'x' occurs twice"),
        ("property float nx", "property uint packed_position", "there is no element 'chunk'"),
        ("format binary_little_endian", "format binary_middle_endian", "'binary_middle_endian' is unknown"),
        ("format binary_little_endian 1.0\n", "", "it names no format"),
        ("offset 500000", "offset north", "comment at byte"),
        ("SplatRenderMode: mip", "psrgs-vk antialias maybe", "comment at byte"),
        ("end_header\n", "", "point_cloud.ply: header at byte"),
    ] {
        assert!(text.contains(from), "{from}");
        replace(&file, [text.replacen(from, to, 1).as_bytes(), tail].concat());
        let error = read().expect_err(to);
        assert!(error.contains(place) && names_the_place(&error, &file), "{to}: {error}");
    }
    // The same as text, where places are lines.
    let zeros = vec!["0"; 62].join(" ");
    let ascii = text.replace("binary_little_endian", "ascii") + &format!("{zeros}\n{zeros}\n");
    replace(&file, format!("{ascii}{zeros} \n"));
    assert_eq!(ply::read(&file).expect("read").gaussians.len(), 3);
    let lines = ascii.lines().count() + 1;
    replace(&file, format!("{ascii}{}x\n", &zeros[..zeros.len() - 1]));
    let error = read().expect_err("a letter");
    assert!(error.contains(&format!("rot_3 of vertex 2 at line {lines}: is not a number")), "{error}");
    replace(&file, format!("{ascii}{}  \n", &zeros[..zeros.len() - 2]));
    let error = read().expect_err("a number less");
    assert!(error.contains(&format!("rot_3 of vertex 2 at line {lines}: is missing")), "{error}");
}

#[test]
fn checkpoints() {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("checkpoint-000500.ckpt");
    let read = || Checkpoint::read(&file).map_err(|e| e.to_string());
    let mut checkpoint = Checkpoint::new();
    checkpoint.put_values("means", &[1.0_f32, 2.0, 3.0]);
    checkpoint.put_text("settings", "iterations = 500");
    checkpoint.write(&file).expect("written");
    truncated_everywhere(&file, read);
    foreign(&file, read);
    // The checksums detect every changed byte.
    let whole = fs::read(&file).expect("file");
    for at in 0..whole.len() {
        for flip in [1, 0x80, 0xff] {
            let mut bytes = whole.clone();
            bytes[at] ^= flip;
            replace(&file, bytes);
            match read() {
                Ok(_) => panic!("the change of byte {at} was not detected"),
                Err(message) => assert!(names_the_place(&message, &file), "{message}"),
            }
        }
    }
    let mut other = whole.clone();
    other[8] = 2;
    replace(&file, other);
    assert!(read().expect_err("another version").contains("version at byte 8: is 2, this program reads 1"));
}

#[test]
fn depth_maps() {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("depth.exr");
    let read = || image_out::read_depth(&file).map_err(|e| e.to_string());
    image_out::write_depth(&file, 5, 40, &(0..200).map(|i| i as f32 * 0.37).collect::<Vec<_>>()).expect("written");
    truncated_everywhere(&file, read);
    foreign(&file, read);
    assert!(damaged_everywhere(&file, read) > 0);
}

#[test]
fn frames() {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("frame.json");
    FrameFile::new(Frame::IDENTITY, None).write(&file).expect("written");
    let whole = fs::read(&file).expect("file");
    for length in 0..whole.len() - 2 {
        replace(&file, &whole[..length]);
        let error = FrameFile::read(&file).expect_err("truncated").to_string();
        assert!(names_the_place(&error, &file), "{error}");
    }
}

/// A laser scan as the test world writes it, and the same compressed: whole, truncated, damaged, foreign, and with
/// sizes in the header that the file does not have.
#[test]
fn laser_scans() {
    let root = tempfile::tempdir().expect("temporary folder");
    let (las, laz) = (root.path().join("scan.las"), root.path().join("scan.laz"));
    let echoes = scan(&las, &laz);
    for file in [&las, &laz] {
        let read = || cloud::read(file).map_err(|e| e.to_string());
        let positions = read().expect("a scan");
        assert_eq!(positions.len(), echoes.len());
        for (got, want) in positions.iter().zip(&echoes) {
            assert!((0..3).all(|k| (got[k] - want[k]).abs() <= 0.0005 + 1e-9), "{got:?}, {want:?}");
        }
        let whole = fs::read(file).expect("file");
        // Some lengths of every part. The last bytes of the compressed file are a table that decoding does not need.
        let lengths = (0..380).chain((380..whole.len() - 60).step_by(173));
        for length in lengths {
            replace(file, &whole[..length]);
            match read() {
                Ok(points) => panic!("{length} bytes of {}: {} points were read", whole.len(), points.len()),
                Err(message) => assert!(names_the_place(&message, file), "{length} bytes: {message}"),
            }
        }
        replace(file, &whole);
        damaged_everywhere(file, read);
        foreign(file, || cloud::read(file).map_err(|e| e.to_string()));
        // LAS 1.4 counts points in 8 bytes (where the older 4 bytes are 0) and extended records in 4. No memory is
        // allocated for the claimed number.
        let none = (107, [0; 4].as_slice());
        let (all, many, one) = ([0xff; 8], (1_u64 << 40).to_le_bytes(), 1_u32.to_le_bytes());
        for edits in [[none, (247, &all)], [none, (247, &many)], [(235, &all), (243, &one)], [none, (243, &all)]] {
            let mut bytes = whole.clone();
            for (at, value) in edits {
                bytes[at..at + value.len()].copy_from_slice(value);
            }
            replace(file, bytes);
            match read() {
                Ok(points) => panic!("{edits:?}: {} points were read", points.len()),
                Err(message) => assert!(names_the_place(&message, file), "{edits:?}: {message}"),
            }
        }
        replace(file, &whole);
    }
    // The table of chunks has their number, and each chunk the lengths of its layers.
    let whole = fs::read(&laz).expect("file");
    let data = u32::from_le_bytes(whole[96..100].try_into().expect("four bytes")) as usize;
    let table = u64::from_le_bytes(whole[data..data + 8].try_into().expect("eight bytes")) as usize;
    for (at, field) in [(table + 4, "number of chunks"), (data + 8 + 36 + 4, "layers of a chunk")] {
        let mut bytes = whole.clone();
        bytes[at..at + 4].fill(0xff);
        replace(&laz, bytes);
        let message = cloud::read(&laz).map(|points| points.len()).expect_err("a size beyond the file").to_string();
        assert!(message.contains(field) && message.contains(" at byte "), "{message}");
    }
}

/// Writes the scan of a small world, uncompressed and compressed; gives its positions.
fn scan(las: &Path, laz: &Path) -> Vec<[f64; 3]> {
    let lidar = LidarParams { density: 0.4, ..LidarParams::default() };
    let params = WorldParams { images: 1, offpath: 0, max_side: 32, lidar, ..WorldParams::default() };
    let folder = tempfile::tempdir().expect("temporary folder");
    world::generate(&params, folder.path(), &mut |_| ()).expect("a world");
    fs::copy(folder.path().join("lidar.las"), las).expect("copied");
    let mut reader = ::las::Reader::from_path(las).expect("a LAS file");
    let raw = reader.header().clone().into_raw().expect("a header");
    let mut header = ::las::Builder::new(raw).expect("a header");
    header.point_format.is_compressed = true;
    let mut writer = ::las::Writer::from_path(laz, header.into_header().expect("a header")).expect("a LAZ file");
    for point in reader.points() {
        writer.write_point(point.expect("a point")).expect("written");
    }
    writer.close().expect("closed");
    World::new(&params).expect("a world").lidar().into_iter().map(|echo| echo.position).collect()
}
