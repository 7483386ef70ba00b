//! Files that claim more than they hold: rows, properties, points, pixels, tensors. Each is refused or read, in time
//! and memory in proportion to its bytes. A reader that trusts the claim would run out of either.

use std::fs;
use std::path::Path;

use psrgs_vk::dataset::{Dataset, LoadOptions, Photograph, Role};
use psrgs_vk::format::{las, ply};
use psrgs_vk::perceptual::read_tensors;

use super::colmap_folder::{Folder, write_photograph};
use super::{names_the_place, replace, scan};

const MESH: &str = "element vertex 3\nproperty double x\nproperty double y\nproperty double z\nAGAINelement face 1\n\
                    property list uchar int vertex_indices\nend_header\n";

#[test]
fn rows_without_properties_are_no_bytes_however_many() {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("surface.ply");
    let many = "element nothing 18446744073709551615\n";
    let binary = |between: &str| {
        let mut bytes =
            format!("ply\nformat binary_little_endian 1.0\n{}", MESH.replace("AGAIN", between)).into_bytes();
        [0.0_f64, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        bytes.push(3);
        [0_i32, 1, 2].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        bytes
    };
    fs::write(&file, binary(many)).expect("written");
    assert_eq!(ply::Mesh::read(&file).expect("a mesh").triangles, [[0, 1, 2]]);
    // Before the vertices the count of each element has to fit the file. All 40,000 elements together have far more
    // rows than the file has bytes.
    let before = "element nothing 400\n".repeat(40_000);
    let mut bytes = binary("");
    let at = bytes.windows(7).position(|w| w == b"element").expect("an element");
    bytes.splice(at..at, before.into_bytes());
    bytes.extend(vec![0; 400]);
    replace(&file, &bytes);
    assert_eq!(ply::Mesh::read(&file).expect("a mesh").vertices.len(), 3);
    // In text each row is a line, even an empty one.
    let text = format!("ply\nformat ascii 1.0\n{}0 0 0\n1 0 0\n0 1 0\n\n3 0 1 2\n", MESH.replace("AGAIN", many));
    replace(&file, &text);
    let error = ply::Mesh::read(&file).expect_err("the end of the file").to_string();
    assert!(error.contains("the file ends here") && names_the_place(&error, &file), "{error}");
    replace(&file, text.replace("18446744073709551615", "1"));
    assert_eq!(ply::Mesh::read(&file).expect("a mesh").triangles, [[0, 1, 2]]);
}

#[test]
fn properties_of_a_ply_file_are_as_few_as_any_has() {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("wide.ply");
    let header = |count: usize| {
        let names: String = (0..count).map(|k| format!("property char p{k}\n")).collect();
        format!(
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float \
             z\n{names}end_header\n"
        )
    };
    fs::write(&file, header(40_000)).expect("written");
    let error = ply::Cloud::read(&file).expect_err("too many").to_string();
    assert!(error.contains("'vertex' has more than 1024") && names_the_place(&error, &file), "{error}");
    replace(&file, header(1021) + &"0 ".repeat(1024) + "\n");
    assert_eq!(ply::Cloud::read(&file).expect("as many as may be").positions, [[0.0; 3]]);
}

#[test]
fn a_wrong_polygon_makes_a_short_message() {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("surface.ply");
    let polygon = "7 ".repeat(100_000);
    let header = format!("ply\nformat ascii 1.0\n{}", MESH.replace("AGAIN", ""));
    fs::write(&file, format!("{header}0 0 0\n1 0 0\n0 1 0\n100000 {polygon}\n")).expect("written");
    let error = ply::Mesh::read(&file).expect_err("there are three vertices").to_string();
    assert!(error.contains("100000 numbers") && error.len() < 1000, "{} bytes", error.len());
}

#[test]
fn a_long_line_of_a_network_is_walked_once() {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("net.param");
    let parameters = "0=1 1=1 ".repeat(200_000);
    fs::write(&file, format!("7767517\n1 1\nConvolution features.0 1 1 x y {parameters}\n")).expect("written");
    fs::write(root.path().join("net.bin"), []).expect("written");
    let error = read_tensors(&file).expect_err("one layer of many").to_string();
    assert!(error.contains("net.param") && error.contains("convolutions"), "{error}");
}

/// A pickle of a dictionary in which each of `names` is the same tensor of this shape, its storage having one number.
fn pickle_of_one_tensor(names: usize, shape: &[u8]) -> Vec<u8> {
    pickle_of_stored(names, shape, 1)
}

/// As above, with `stored` numbers in the storage.
fn pickle_of_stored(names: usize, shape: &[u8], stored: u8) -> Vec<u8> {
    let mut out =
        b"\x80\x02}(X\x01\0\0\0actorch._utils\n_rebuild_tensor_v2\n((X\x07\0\0\0storagectorch\nFloatStorage\n".to_vec();
    out.extend(b"X\x01\0\0\x000X\x03\0\0\0cpuK");
    out.push(stored);
    out.extend(b"tQK\0(");
    shape.iter().for_each(|size| out.extend([b'K', *size]));
    out.extend(b"t(");
    shape.iter().for_each(|_| out.extend(b"K\x01"));
    out.extend(b"ttRq\0");
    for name in 1..names {
        let name = format!("{name:06}");
        out.extend(b"X\x06\0\0\0");
        out.extend(name.as_bytes());
        out.extend(b"h\0");
    }
    out.extend(b"u.");
    out
}

/// One tensor under many names: each name would get a copy of the shape.
#[test]
fn tensors_have_as_few_axes_as_any_weights() {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("net.pth");
    let old = |pickle: Vec<u8>| {
        let head: &[u8] = b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.\x80\x02M\xe9\x03.\x80\x02}.";
        [head, &pickle, b"\x80\x02](X\x01\0\0\x000e.", &1_u64.to_le_bytes(), &1.5_f32.to_le_bytes()].concat()
    };
    fs::write(&file, old(pickle_of_one_tensor(100_000, &[1; 8]))).expect("written");
    let read = read_tensors(&file).expect("100,000 names of a number");
    assert_eq!(read.get("099999", &[1; 8], "test").expect("a tensor"), [1.5]);
    replace(&file, old(pickle_of_one_tensor(100_000, &[1; 60_000])));
    let error = read_tensors(&file).expect_err("60,000 axes").to_string();
    assert!(error.contains("has more axes than any weights have") && names_the_place(&error, &file), "{error}");
}

/// A thousand bytes under many names: each name would get a copy of the bytes.
#[test]
fn tensors_take_no_more_memory_than_their_file_is_worth() {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("net.pth");
    let old = |names: usize| {
        let head: &[u8] = b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.\x80\x02M\xe9\x03.\x80\x02}.";
        let storage = [&b"\x80\x02](X\x01\0\0\x000e."[..], &250_u64.to_le_bytes(), &[0; 1000]].concat();
        [head, &pickle_of_stored(names, &[250], 250), &storage].concat()
    };
    fs::write(&file, old(100)).expect("written");
    assert_eq!(read_tensors(&file).expect("a few").get("000099", &[250], "test").expect("a tensor"), [0.0; 250]);
    replace(&file, old(20_000));
    let error = read_tensors(&file).expect_err("20 MB of 300 KB").to_string();
    assert!(
        error.contains("20000000 bytes are more than any weights have") && names_the_place(&error, &file),
        "{error}"
    );
}

#[test]
fn compressed_points_are_not_more_than_their_bytes_can_say() {
    let root = tempfile::tempdir().expect("temporary folder");
    let (plain, file) = (root.path().join("scan.las"), root.path().join("scan.laz"));
    scan(&plain, &file);
    let mut bytes = fs::read(&file).expect("file");
    assert_eq!(bytes[25], 4, "the scan's version");
    let count = 16 * bytes.len() as u64 + 16;
    bytes[107..111].fill(0);
    bytes[247..255].copy_from_slice(&count.to_le_bytes());
    replace(&file, bytes);
    let error = las::read(&file).map(|points| points.len()).expect_err("too many points").to_string();
    assert!(error.contains("number of points") && error.contains("cannot be in the"), "{error}");
}

/// A PNG file whose header says another size, its checksum being right.
fn claims_size(file: &Path, width: u32, height: u32) {
    let mut bytes = fs::read(file).expect("file");
    bytes[16..20].copy_from_slice(&width.to_be_bytes());
    bytes[20..24].copy_from_slice(&height.to_be_bytes());
    let sum = crc32fast::hash(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&sum.to_be_bytes());
    replace(file, bytes);
}

#[test]
fn pictures_are_not_larger_than_their_files_can_be() {
    let folder = Folder::ring(&["a.png"], [0.0; 3]);
    let root = folder.dataset(false);
    let read = || {
        let dataset = Dataset::load(root.path(), &LoadOptions::default()).map_err(|e| e.to_string())?;
        dataset.photographs(Role::Train).map_err(|e| e.to_string())
    };
    read().expect("a photograph");
    for name in ["images/a.png", "masks/a.png"] {
        let file = root.path().join(name);
        write_photograph(&file, 24, 16, 5);
        claims_size(&file, 24_000, 16_000);
        for error in
            [read().map(|_| ()).expect_err("a claim"), Photograph::read(&file).expect_err("a claim").to_string()]
        {
            assert!(error.contains("24000x16000 pixels cannot be in a file of"), "{error}");
            assert!(names_the_place(&error, &file), "{error}");
        }
        write_photograph(&file, 24, 16, 5);
        read().expect("put back");
    }
}

/// The decoder keeps some thousand bytes for each extra byte that the compressor's record names,
/// whatever the header says of a point.
#[test]
fn compressed_points_are_no_longer_than_the_header_says() {
    let root = tempfile::tempdir().expect("temporary folder");
    let (plain, file) = (root.path().join("scan.las"), root.path().join("scan.laz"));
    scan(&plain, &file);
    let bytes = fs::read(&file).expect("a scan");
    let points = las::read(&file).expect("points").len();
    let refused = |bytes: &[u8]| {
        replace(&file, bytes);
        let error = las::read(&file).map(|points| points.len()).expect_err("no point is so long").to_string();
        assert!(names_the_place(&error, &file), "{error}");
        error
    };
    let at = bytes.windows(14).position(|w| w == b"laszip encoded").expect("the compressor's record") + 52 + 32;
    let items = usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
    let size = at + 2 + 6 * (items - 1) + 2;
    let mut long = bytes.clone();
    long[size..size + 2].copy_from_slice(&63_489_u16.to_le_bytes());
    let error = refused(&long);
    assert!(error.contains("63489") && error.contains(&format!("size of item {}", items - 1)), "{error}");
    // The size in the header has a limit, too.
    let mut wide = bytes.clone();
    wide[105..107].copy_from_slice(&9216_u16.to_le_bytes());
    let error = refused(&wide);
    assert!(error.contains("9216") && error.contains("decompress"), "{error}");
    let mut other = bytes.clone();
    other[at - 52 - 32] = b'L';
    assert!(refused(&other).contains("compressor"));
    replace(&file, &bytes);
    assert_eq!(las::read(&file).expect("points").len(), points);
}

/// An instruction of one byte makes an object of a hundred bytes.
#[test]
fn a_pickle_takes_no_more_memory_than_its_bytes_are_worth() {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("net.pth");
    let many = 1 << 20;
    for (first, again) in [("", "]"), ("", ")"), ("", "}"), ("N", "\u{85}"), ("]", "]a"), ("N", "\u{94}")] {
        let bytes = |text: &str| text.chars().map(|c| c as u8).collect::<Vec<u8>>();
        let bomb = [b"\x80\x02", &bytes(first)[..], &bytes(again).repeat(many), b"."].concat();
        fs::write(&file, bomb).expect("written");
        let error = read_tensors(&file).expect_err("a bomb").to_string();
        assert!(error.contains("too much for its size") && names_the_place(&error, &file), "{again}: {error}");
    }
}
