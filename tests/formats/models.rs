//! Models in PLY files.

use std::fs;
use std::io::Write as _;

use ply_rs::ply::{DefaultElement, Property};
use psrgs_vk::format::ply;
use psrgs_vk::scene::{Frame, Gaussians};

use super::splats;

fn bits(g: &Gaussians) -> Vec<u32> {
    let planes = [&g.means, &g.quats, &g.scales, &g.opacities];
    planes.into_iter().chain(&g.sh).flatten().map(|v| v.to_bits()).chain(g.ids.iter().copied()).collect()
}

#[test]
fn ply_comes_back_bit_for_bit_in_the_identity_frame() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("point_cloud.ply");
    for n in [0, 1, 1000] {
        let g = splats(n);
        ply::save(&file, &g, &Frame::IDENTITY, true).expect("written");
        let model = ply::read(&file).expect("read");
        assert_eq!(bits(&model.in_scene(&Frame::IDENTITY)), bits(&g));
        assert_eq!((model.sh_degree, model.shift, model.antialias), (3, [0.0; 3], Some(true)));
        assert_eq!(model.version.as_deref(), Some(env!("CARGO_PKG_VERSION")));
        assert_eq!(fs::read_dir(folder.path()).expect("folder").count(), 1, "no temporary file is left");
    }
}

#[test]
fn quaternions_of_any_length_are_written_with_unit_length() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("point_cloud.ply");
    let mut g = splats(4);
    g.quats = vec![0.3, 0.4, 0.0, 0.0, 2e3, 0.0, 0.0, -2e3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-19, 0.0];
    ply::save(&file, &g, &Frame::IDENTITY, false).expect("written");
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let want = [[0.6, 0.8, 0.0, 0.0], [half, 0.0, 0.0, -half], [1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]];
    assert_eq!(ply::read(&file).expect("read").gaussians.quats, want.concat());
}

/// The comment lines of other programs.
#[test]
fn comments_on_antialiasing_agree_with_those_of_other_programs() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("point_cloud.ply");
    for (antialias, line) in [(true, "comment SplatRenderMode: mip\n"), (false, "comment SplatRenderMode: default\n")] {
        ply::save(&file, &splats(1), &Frame::IDENTITY, antialias).expect("written");
        let bytes = fs::read(&file).expect("read");
        assert!(String::from_utf8_lossy(&bytes).contains(line));
        for (comment, expected) in [
            ("SplatRenderMode: mip", Some(true)),
            ("SplatRenderMode: default", Some(false)),
            ("SplatRenderMode: 2dgs", None),
            ("antialiased 1", Some(true)),
            ("antialiased 0", Some(false)),
            ("antialiased 0\ncomment SplatRenderMode: mip", Some(true)),
            ("psrgs-vk antialias 1", Some(true)),
            ("not antialiased 1", None),
        ] {
            let at = bytes.windows(line.len()).position(|part| part == line.as_bytes()).expect("the line");
            let other = [&bytes[..at], format!("comment {comment}\n").as_bytes(), &bytes[at + line.len()..]].concat();
            fs::write(&file, other).expect("written");
            assert_eq!(ply::read(&file).expect("read").antialias, expected, "{comment}");
        }
    }
}

#[test]
fn the_first_splats_are_told_to_be_the_constrained_set() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("point_cloud.ply");
    for constrained in [None, Some(0), Some(3), Some(5)] {
        ply::save_staged(&file, &splats(5), &Frame::IDENTITY, false, constrained).expect("written");
        assert_eq!(ply::read(&file).expect("read").constrained, constrained);
    }
    ply::save_staged(&file, &splats(5), &Frame::IDENTITY, false, Some(6)).expect("written");
    let error = ply::read(&file).expect_err("more than there are").to_string();
    assert!(error.contains("constrained 6") && error.contains("point_cloud.ply"), "{error}");
}

/// The layout of INRIA's own files, checked by an independent reader.
#[test]
fn ply_has_the_layout_of_inria_for_an_independent_reader() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("point_cloud.ply");
    let g = splats(5);
    ply::save(&file, &g, &Frame::IDENTITY, false).expect("written");
    let mut bytes = fs::File::open(&file).expect("opened");
    let parsed = ply_rs::parser::Parser::<DefaultElement>::new().read_ply(&mut bytes).expect("independent reader");
    let names: Vec<&String> = parsed.header.elements["vertex"].properties.keys().collect();
    assert_eq!(names.len(), 62);
    assert_eq!(names[..7], ["x", "y", "z", "nx", "ny", "nz", "f_dc_0"]);
    assert_eq!(
        names[52..],
        ["f_rest_43", "f_rest_44", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    );
    let rows = &parsed.payload["vertex"];
    assert_eq!(rows.len(), 5);
    for (i, row) in rows.iter().enumerate() {
        let value = |name: &str| match row[name] {
            Property::Float(v) => v,
            ref other => panic!("{name} is {other:?}"),
        };
        assert_eq!((value("x"), value("nz")), (g.means[3 * i], 0.0));
        assert_eq!(
            (value("opacity"), value("scale_2"), value("rot_0")),
            (g.opacities[i], g.scales[3 * i + 2], g.quats[4 * i])
        );
        for channel in 0..3 {
            assert_eq!(value(&format!("f_dc_{channel}")), g.sh[0][12 * i + channel]);
            for k in 1..16 {
                // Channel-major: all of red, then of green, then of blue.
                let name = format!("f_rest_{}", 15 * channel + k - 1);
                assert_eq!(value(&name), g.sh[k / 4][12 * i + 3 * (k % 4) + channel], "{name}");
            }
        }
    }
}

#[test]
fn ply_of_a_geo_referenced_scene_keeps_its_coordinates() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("point_cloud.ply");
    let frame = Frame { offset: [500_123.456_789, 4_600_987.654_321, 100.25], scale: 5.0 / 40.0 };
    let g = splats(200);
    ply::save(&file, &g, &frame, false).expect("written");
    let model = ply::read(&file).expect("read");
    assert_eq!(model.shift, frame.offset, "the offset of the comment is exact");
    let back = model.in_scene(&frame);
    for (i, (got, want)) in back.means.iter().zip(&g.means).enumerate() {
        assert!((got - want).abs() < 5.0 * 1e-6, "{got} {want}");
        // In the dataset's units: the reader adds the offset in f64.
        let dataset = f64::from(model.gaussians.means[i]) + model.shift[i % 3];
        let truth = f64::from(*want) / frame.scale + frame.offset[i % 3];
        assert!((dataset - truth).abs() < 40.0 * 1e-6, "{dataset} {truth}");
    }
    for (got, want) in back.scales.iter().zip(&g.scales) {
        assert!((got - want).abs() < 1e-6);
    }
    assert!((model.gaussians.scales[0] - (g.scales[0] + 8_f32.ln())).abs() < 1e-5, "scales are in the dataset's units");
    assert_eq!((&back.sh, &back.quats, &back.opacities), (&g.sh, &g.quats, &g.opacities));

    // A model in a near frame has no offset.
    let near = Frame { offset: [70.0, -80.0, 9.0], scale: 5.0 };
    ply::save(&file, &g, &near, false).expect("written");
    assert_eq!(ply::read(&file).expect("read").shift, [0.0; 3]);
    let limit = |x: f64| Frame { offset: [x, 0.0, 0.0], scale: 5.0 }.shift();
    assert_eq!((limit(98.9), limit(99.1)), ([0.0; 3], [99.1, 0.0, 0.0]));
}

/// A file as another program may write it.
fn foreign(format: &str, degree: usize) -> Vec<u8> {
    let rest = [0, 9, 24, 45][degree];
    let mut header = format!(
        "ply\nformat {format} 1.0\ncomment Generated by another program\nobj_info nothing\nelement chunk 2\nproperty \
         uchar a\nproperty double b\nelement vertex 3\n"
    );
    let mut columns: Vec<(String, &str)> =
        vec![("opacity".into(), "double"), ("red".into(), "uchar"), ("z".into(), "float32")];
    columns.extend((0..rest).rev().map(|k| (format!("f_rest_{k}"), "float")));
    for name in
        ["x", "y", "rot_3", "rot_2", "rot_1", "rot_0", "scale_0", "scale_1", "scale_2", "f_dc_2", "f_dc_1", "f_dc_0"]
    {
        columns.push((name.into(), "float"));
    }
    for (name, kind) in &columns {
        header += &format!("property {kind} {name}\n");
    }
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let mut out = header.into_bytes();
    let put = |out: &mut Vec<u8>, kind: &str, value: f64| match (format, kind) {
        ("ascii", _) => write!(out, "{value} ").expect("to memory"),
        (_, "uchar") => out.push(value as u8),
        ("binary_little_endian", "double") => out.extend(value.to_le_bytes()),
        ("binary_big_endian", "double") => out.extend(value.to_be_bytes()),
        ("binary_little_endian", _) => out.extend((value as f32).to_le_bytes()),
        _ => out.extend((value as f32).to_be_bytes()),
    };
    for row in 0..2 {
        put(&mut out, "uchar", f64::from(row));
        put(&mut out, "double", 0.5);
        if format == "ascii" {
            out.push(b'\n');
        }
    }
    for row in 0..3 {
        for (name, kind) in &columns {
            put(&mut out, kind, if *kind == "uchar" { 9.0 } else { expected(name, row) });
        }
        if format == "ascii" {
            out.push(b'\n');
        }
    }
    if format == "ascii" {
        out.extend(b"3 0 1 2\n");
    } else {
        out.extend([3, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    }
    out
}

/// A value that tells its name and its row, exact in f32.
fn expected(name: &str, row: usize) -> f64 {
    let hash = name.bytes().fold(0_u32, |h, b| (h * 31 + u32::from(b)) % 4093);
    f64::from(hash) / 16.0 + row as f64 / 4.0
}

#[test]
fn foreign_ply_is_read_in_any_order_type_and_degree() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("foreign.ply");
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for degree in 0..4 {
            fs::write(&file, foreign(format, degree)).expect("written");
            let model = ply::read(&file).expect(format);
            let g = &model.gaussians;
            assert_eq!((g.len(), model.sh_degree as usize, model.antialias, model.shift), (3, degree, None, [0.0; 3]));
            for i in 0..3 {
                let want = |name: &str| expected(name, i) as f32;
                assert_eq!(g.means[3 * i..][..3], [want("x"), want("y"), want("z")]);
                assert_eq!(g.quats[4 * i..][..4], [want("rot_0"), want("rot_1"), want("rot_2"), want("rot_3")]);
                assert_eq!(g.scales[3 * i..][..3], [want("scale_0"), want("scale_1"), want("scale_2")]);
                assert_eq!(g.opacities[i], want("opacity"));
                let per_channel = [0, 3, 8, 15][degree];
                for k in 0..16 {
                    for c in 0..3 {
                        let want = match k {
                            0 => want(&format!("f_dc_{c}")),
                            k if k <= per_channel => want(&format!("f_rest_{}", c * per_channel + k - 1)),
                            _ => 0.0,
                        };
                        assert_eq!(g.sh[k / 4][12 * i + 3 * (k % 4) + c], want, "degree {degree}, coefficient {k}");
                    }
                }
            }
        }
    }
}

#[test]
fn infinite_opacities_become_finite_and_other_values_refused() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("point_cloud.ply");
    let mut g = splats(3);
    (g.opacities[0], g.opacities[2]) = (f32::INFINITY, f32::NEG_INFINITY);
    ply::save(&file, &g, &Frame::IDENTITY, false).expect("written");
    let read = ply::read(&file).expect("read").gaussians;
    assert_eq!((read.opacities[0], read.opacities[1], read.opacities[2]), (16.0, g.opacities[1], -16.0));
    g.means[4] = f32::NAN;
    ply::save(&file, &g, &Frame::IDENTITY, false).expect("written");
    let header = fs::read(&file).expect("read").windows(11).position(|w| w == b"end_header\n").expect("end") + 11;
    let error = ply::read(&file).expect_err("not a number").to_string();
    assert!(
        error.ends_with(&format!("point_cloud.ply: y of vertex 1 at byte {}: is NaN", header + 248 + 4)),
        "{error}"
    );
    g.quats.pop();
    let error = ply::save(&file, &g, &Frame::IDENTITY, false).expect_err("a plane is short").to_string();
    assert!(error.contains("'quats' has 11 floats for 3 splats of 4"), "{error}");
}
