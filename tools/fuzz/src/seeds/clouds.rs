//! Models, meshes and clouds in PLY files, and laser scans.

use std::io::Cursor;

use las::point::Format;
use las::{Builder, Color, Point, Vector, Version};
use psrgs_vk::format::ply;
use psrgs_vk::scene::{Frame, Gaussians};

use crate::Scratch;

/// Points on a small terrace.
fn positions(count: usize) -> impl Iterator<Item = [f64; 3]> {
    (0..count).map(|i| [(i % 5) as f64 * 0.75, (i / 5) as f64 * 1.25, (i % 3) as f64 * 0.5 + 10.0])
}

/// A model, a cloud and a mesh as this program writes them, as text, and with variations of other programs.
pub fn ply() -> Vec<Vec<u8>> {
    let scratch = Scratch::new();
    let file = scratch.path().join("seed.ply");
    let read = || std::fs::read(&file).expect("what was written");
    let frame = Frame { offset: [5e5, 4.6e6, 100.0], scale: 1.0 };
    ply::save_staged(&file, &Gaussians::zeros(2), &frame, true, Some(1)).expect("a model");
    let mut seeds = vec![read()];
    let model = String::from_utf8_lossy(&seeds[0]).into_owned();
    let header = &model[..model.find("end_header").expect("an end of the header")];
    let row = vec!["0.5"; 62].join(" ");
    seeds.push(format!("{}end_header\n{row}\n{row}\n", header.replace("binary_little_endian", "ascii")).into_bytes());
    let cloud = ply::Cloud {
        positions: positions(6).collect(),
        normals: vec![[0.0, 0.0, 1.0]; 6],
        colours: vec![[200, 100, 50]; 6],
        unknown: Vec::new(),
    };
    cloud.write(&file).expect("a cloud");
    seeds.push(read());
    let mesh = ply::Mesh { vertices: positions(6).collect(), triangles: vec![[0, 1, 2], [3, 4, 5]] };
    mesh.write(&file).expect("a mesh");
    seeds.push(read());
    seeds.push(ply::encode_compressed(&super::splats::model(3, 1), 3).expect("a model"));
    let text = "ply\nformat ascii 1.0\ncomment psrgs-vk offset 1 2 3\nelement before 1\nproperty list uchar int \
                indices\n\
                element vertex 3\nproperty float x\nproperty float y\nproperty double z\nproperty uchar red\n\
                property uchar green\nproperty uchar blue\nelement between 1\nproperty list int float values\n\
                element face 1\nproperty uchar flags\nproperty list uchar int vertex_index\nend_header\n\
                2 5 6\n0 0 0 1 2 3\n1 0 0 4 5 6\n0 1 0.5 7 8 9\n2 0.5 0.25\n0 3 0 1 2\n";
    seeds.push(text.as_bytes().to_vec());
    let mut big =
        b"ply\nformat binary_big_endian 1.0\nelement camera 1\nproperty short id\nelement vertex 2\nproperty float x\n\
                    property int y\nproperty ushort z\nproperty char red\nend_header\n"
            .to_vec();
    big.extend([0, 1]);
    for k in 0..2_u8 {
        big.extend(1.5_f32.to_be_bytes());
        big.extend([0, 0, 0, k, 0, 9, k]);
    }
    seeds.push(big);
    seeds
}

/// Scans in formats that differ, each as LAS and as LAZ.
pub fn scans() -> Vec<Vec<u8>> {
    let scan = |format: u8, compressed: bool, extra: u16| {
        let mut builder = Builder::from(if format < 6 { Version::new(1, 2) } else { Version::new(1, 4) });
        builder.point_format = Format::new(format).expect("a format");
        builder.point_format.is_compressed = compressed;
        builder.point_format.extra_bytes = extra;
        let scaled = |offset| las::Transform { scale: 0.001, offset };
        builder.transforms = Vector { x: scaled(5.0), y: scaled(0.0), z: scaled(0.0) };
        let known = builder.point_format;
        let mut writer =
            las::Writer::new(Cursor::new(Vec::new()), builder.into_header().expect("a header")).expect("a writer");
        for (i, [x, y, z]) in positions(20).enumerate() {
            let point = Point {
                x,
                y,
                z,
                return_number: 1,
                number_of_returns: 1,
                gps_time: known.has_gps_time.then_some(i as f64),
                color: known.has_color.then_some(Color::new(i as u16 * 256, 0, 99)),
                nir: known.has_nir.then_some(7),
                extra_bytes: vec![i as u8; usize::from(extra)],
                ..Point::default()
            };
            writer.write_point(point).expect("a point");
        }
        writer.into_inner().expect("a whole file").into_inner()
    };
    let plain = [(0, 0), (1, 0), (3, 2), (6, 0), (8, 3)].map(|(format, extra)| scan(format, false, extra));
    let small = [(0, 0), (1, 0), (3, 2), (6, 0), (7, 0), (8, 3)].map(|(format, extra)| scan(format, true, extra));
    plain.into_iter().chain(small).collect()
}
