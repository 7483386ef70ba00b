//! Triangle meshes in PLY files, of this program and of others.

use std::fs;
use std::path::PathBuf;

use psrgs_vk::format::ply::Mesh;

fn file(folder: &tempfile::TempDir, bytes: &[u8]) -> PathBuf {
    let file = folder.path().join("mesh.ply");
    fs::write(&file, bytes).expect("written");
    file
}

#[test]
fn meshes_come_back_bit_for_bit() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("mesh.ply");
    let mesh = Mesh {
        vertices: vec![[5e5 + 0.1, 4.6e6 / 3.0, -0.0], [1.0, 2.0, 3.0], [0.1, 0.2, 0.3], [1e-300, 7.0, 8.0]],
        triangles: vec![[0, 1, 2], [2, 1, 3]],
    };
    mesh.write(&file).expect("written");
    assert_eq!(Mesh::read(&file).expect("read"), mesh);
    Mesh::default().write(&file).expect("written");
    assert_eq!(Mesh::read(&file).expect("read"), Mesh::default());
}

/// Meshes of other programs: text, polygons, further properties before and after, elements in between.
#[test]
fn foreign_meshes_are_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float z\nproperty float x\nproperty float y\n\
        property uchar red\nelement material 1\nproperty list uchar float rgb\nelement face 2\nproperty uchar flag\n\
        property list uchar uint vertex_index\nproperty list int float uv\nend_header\n\
        3 1 2 9\n3 4 5 9\n3 7 8 9\n0 0 0 9\n2 0.5 0.5\n1 3 0 1 2 0\n0 4 0 1 2 3 2 0.5 0.25\n";
    let mesh = Mesh::read(&file(&folder, text.as_bytes())).expect("read");
    assert_eq!(mesh.vertices[0], [1.0, 2.0, 3.0]);
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 1, 2], [0, 2, 3]]);

    let mut big = b"ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nelement face 1\nproperty list ushort int vertex_indices\nproperty short group\nend_header\n"
        .to_vec();
    for v in [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.5] {
        big.extend(v.to_be_bytes());
    }
    big.extend(3u16.to_be_bytes());
    [0i32, 1, 2].iter().for_each(|k| big.extend(k.to_be_bytes()));
    big.extend(7i16.to_be_bytes());
    let mesh = Mesh::read(&file(&folder, &big)).expect("read");
    assert_eq!((mesh.vertices[2], mesh.triangles.as_slice()), ([0.0, 1.0, 0.5], &[[0, 1, 2]][..]));
    // A file that is cut at any byte is an error and no panic.
    for end in 0..big.len() {
        assert!(Mesh::read(&file(&folder, &big[..end])).is_err(), "cut at {end}");
    }
}

#[test]
fn what_is_no_mesh_says_why() {
    let folder = tempfile::tempdir().expect("a folder");
    let head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    let faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n";
    for (text, problem) in [
        (format!("{head}end_header\n0 0 0\n1 0 0\n0 1 0\n"), "element 'face'"),
        (head.replace("property float y\n", "") + faces, "no y"),
        (format!("{head}element face 1\nproperty list uchar int corners\nend_header\n"), "list 'vertex_indices'"),
        (format!("{head}{faces}3 0 1 3\n"), "face 0"),
        (format!("{head}{faces}3 0 1 -1\n"), "face 0"),
        (format!("{head}{faces}2 0 1\n"), "face 0"),
        (format!("{head}{faces}3 0 1\n"), "face 0"),
        (format!("{head}{}", faces.replace("1 0 0", "nan 0 0")), "vertex 1"),
        (
            format!(
                "{head}element face 9999999999\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 \
                 0\n"
            ),
            "face 0",
        ),
    ] {
        let error = Mesh::read(&file(&folder, text.as_bytes())).expect_err(problem).to_string();
        assert!(error.contains("mesh.ply") && error.contains(problem), "{problem}: {error}");
    }
}
