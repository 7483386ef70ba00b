//! Files out and back: models, frames, checkpoints, pictures.

use std::fs;
use std::io::Write as _;

use ply_rs::ply::{DefaultElement, Property};
use psrgs_vk::format::checkpoint::{self, Checkpoint};
use psrgs_vk::format::{FrameFile, atomic, image_out, ply};
use psrgs_vk::scene::{Frame, Gaussians};

/// Splats whose every value is different and whose bits are not all those of round numbers.
fn splats(n: usize) -> Gaussians {
    let mut g = Gaussians::zeros(n);
    let mut state = 7_u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / 8_388_608.0 - 1.0
    };
    let [a, b, c, d] = &mut g.sh;
    for plane in [&mut g.means, &mut g.quats, &mut g.scales, &mut g.opacities, a, b, c, d] {
        plane.iter_mut().for_each(|v| *v = next() * 3.0);
    }
    if n > 1 {
        g.means[1] = -0.0;
        g.scales[2] = 0.0;
        g.scales[3] = -0.0;
        g.means[4] = f32::MIN_POSITIVE / 4.0;
    }
    g
}

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

/// INRIA's layout, as its own files begin, read by a reader that is not ours.
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
        // In the dataset's own units, added up in f64 by whoever reads the file.
        let dataset = f64::from(model.gaussians.means[i]) + model.shift[i % 3];
        let truth = f64::from(*want) / frame.scale + frame.offset[i % 3];
        assert!((dataset - truth).abs() < 40.0 * 1e-6, "{dataset} {truth}");
    }
    for (got, want) in back.scales.iter().zip(&g.scales) {
        assert!((got - want).abs() < 1e-6);
    }
    assert!((model.gaussians.scales[0] - (g.scales[0] + 8_f32.ln())).abs() < 1e-5, "scales are in the dataset's units");
    assert_eq!((&back.sh, &back.quats, &back.opacities), (&g.sh, &g.quats, &g.opacities));

    // Whoever keeps the model in a near frame finds no offset.
    let near = Frame { offset: [70.0, -80.0, 9.0], scale: 5.0 };
    ply::save(&file, &g, &near, false).expect("written");
    assert_eq!(ply::read(&file).expect("read").shift, [0.0; 3]);
    let limit = |x: f64| Frame { offset: [x, 0.0, 0.0], scale: 5.0 }.shift();
    assert_eq!((limit(98.9), limit(99.1)), ([0.0; 3], [99.1, 0.0, 0.0]));
}

#[test]
fn frame_file_keeps_every_bit() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let model = folder.path().join("point_cloud.ply");
    assert_eq!(FrameFile::beside(&model).expect("no file is no error"), None);
    let frame = Frame { offset: [0.1 + 0.2, 4.6e6 / 3.0, -1e-300], scale: 5.0 / 17.3 };
    FrameFile::new(frame).write(&folder.path().join("frame.json")).expect("written");
    let read = FrameFile::beside(&model).expect("read").expect("there");
    assert_eq!((read.frame, read.shift), (frame, frame.offset));
    for broken in [
        "",
        "{",
        "{}",
        r#"{"offset":[0,0,0],"scale":0,"shift":[0,0,0]}"#,
        r#"{"offset":[0,0],"scale":1,"shift":[0,0,0]}"#,
    ] {
        fs::write(folder.path().join("frame.json"), broken).expect("written");
        let error = FrameFile::beside(&model).expect_err(broken).to_string();
        assert!(error.contains("frame.json: frame at line 1"), "{error}");
    }
}

/// A file as another program may write it.
fn foreign(format: &str, degree: usize) -> Vec<u8> {
    let rest = [0, 9, 24, 45][degree];
    let mut header = format!(
        "ply\nformat {format} 1.0\ncomment Generated by another program\nobj_info nothing\nelement chunk 2\nproperty uchar a\nproperty double b\nelement vertex 3\n"
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
fn infinite_opacities_of_a_file_are_made_finite_and_other_infinities_refused() {
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

fn checkpoint(seed: u64) -> Checkpoint {
    let mut out = Checkpoint::new();
    let g = splats(20);
    out.put_values("means", &g.means);
    out.put_values("ids", &g.ids);
    out.put_values("seed", &[seed, u64::MAX]);
    out.put_values("best", &[seed as f64 / 3.0]);
    out.put_text("settings", "iterations = 7\n");
    out.put("empty", Vec::new());
    out
}

#[test]
fn checkpoint_comes_back_bit_for_bit() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("a.ckpt");
    let written = checkpoint(5);
    written.write(&file).expect("written");
    let read = Checkpoint::read(&file).expect("read");
    assert!(read.names().eq(["best", "empty", "ids", "means", "seed", "settings"]));
    let means: Vec<f32> = read.values("means").expect("means");
    assert!(means.iter().zip(&splats(20).means).all(|(a, b)| a.to_bits() == b.to_bits()) && means.len() == 60);
    assert_eq!(read.values::<u32>("ids").expect("ids"), splats(20).ids);
    assert_eq!(read.values::<u64>("seed").expect("seed"), [5, u64::MAX]);
    assert_eq!(read.value::<f64>("best").expect("best"), 5.0 / 3.0);
    assert_eq!(
        (read.text("settings").expect("text"), read.bytes("empty").expect("bytes").len()),
        ("iterations = 7\n", 0)
    );

    let message = |e: psrgs_vk::format::Error| e.to_string();
    assert!(message(read.bytes("moments").expect_err("absent")).contains("a.ckpt: there is no section 'moments'"));
    assert!(message(read.value::<u64>("seed").expect_err("two")).contains("2 values where there should be one"));
    let wrong = message(read.values::<u32>("settings").expect_err("15 bytes"));
    let bytes = fs::read(&file).expect("file");
    let at = bytes.windows(8).position(|w| w == b"settings").expect("name") - 4;
    assert!(wrong.contains(&format!("section 'settings' at byte {at}")), "{wrong}");
}

#[test]
fn the_last_two_checkpoints_are_kept_and_the_newest_whole_one_is_taken() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path();
    let files = || {
        let mut names: Vec<String> = fs::read_dir(path)
            .expect("folder")
            .map(|e| e.expect("entry").file_name().into_string().expect("name"))
            .collect();
        names.sort();
        names
    };
    assert!(checkpoint::latest(path).expect("empty").is_none());
    fs::write(path.join("settings.toml"), "kept").expect("written");
    fs::write(path.join(".checkpoint-000900.ckpt.abc.tmp"), "left by a crash").expect("written");
    for step in [500, 1000, 1500, 1_000_000] {
        checkpoint::save(path, step, &checkpoint(step)).expect("saved");
    }
    assert_eq!(files(), ["checkpoint-001500.ckpt", "checkpoint-1000000.ckpt", "settings.toml"]);
    let newest = checkpoint::latest(path).expect("found").expect("there");
    assert_eq!((newest.step, newest.checkpoint.values::<u64>("seed").expect("seed")[0]), (1_000_000, 1_000_000));
    assert!(newest.damaged.is_empty());

    let damaged = path.join("checkpoint-1000000.ckpt");
    let mut bytes = fs::read(&damaged).expect("file");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&damaged, bytes).expect("damaged");
    let older = checkpoint::latest(path).expect("found").expect("there");
    assert_eq!((older.step, older.damaged.len()), (1500, 1));
    assert!(older.damaged[0].to_string().contains("checkpoint-1000000.ckpt: section"), "{}", older.damaged[0]);

    // The run goes on from there: the damaged one, of a later step, does not push out the whole one.
    checkpoint::save(path, 2000, &checkpoint(2000)).expect("saved");
    assert_eq!(files(), ["checkpoint-001500.ckpt", "checkpoint-002000.ckpt", "settings.toml"]);
    for name in ["checkpoint-001500.ckpt", "checkpoint-002000.ckpt"] {
        fs::write(path.join(name), b"PSRGS-V").expect("damaged");
    }
    let error = checkpoint::latest(path).expect_err("none is whole").to_string();
    assert!(
        error.contains("001500.ckpt: magic at byte 0") && error.contains("002000.ckpt: magic at byte 0"),
        "{error}"
    );
}

#[test]
fn a_failed_write_leaves_the_old_file_and_no_other() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("checkpoint-000500.ckpt");
    checkpoint(500).write(&file).expect("written");
    let before = fs::read(&file).expect("file");
    let full = |out: &mut dyn std::io::Write| {
        out.write_all(&[0; 300_000])?;
        Err(std::io::ErrorKind::StorageFull.into())
    };
    let error = atomic::write(&file, full).expect_err("no room").to_string();
    assert!(error.contains("checkpoint-000500.ckpt: cannot write"), "{error}");
    assert_eq!(fs::read(&file).expect("file"), before);
    assert_eq!(fs::read_dir(folder.path()).expect("folder").count(), 1);

    let nowhere = folder.path().join("no").join("such").join("folder.ply");
    let error = ply::save(&nowhere, &splats(1), &Frame::IDENTITY, false).expect_err("no folder").to_string();
    assert!(error.contains("folder.ply: cannot create a temporary file beside it"), "{error}");
    let error = checkpoint::save(&file, 1, &checkpoint(1)).expect_err("a file is no folder").to_string();
    assert!(error.contains("checkpoint-000001.ckpt: cannot create a temporary file"), "{error}");
}

/// The operating system itself refuses: a child process may write files of a few blocks only.
#[cfg(unix)]
#[test]
fn a_refused_write_leaves_the_last_checkpoint() {
    const FOLDER: &str = "PSRGS_TEST_CHECKPOINTS";
    if let Some(folder) = std::env::var_os(FOLDER) {
        let mut large = checkpoint(1000);
        large.put("large", vec![7; 1 << 20]);
        let error = checkpoint::save(folder.as_ref(), 1000, &large).expect_err("over the limit").to_string();
        assert!(error.contains("checkpoint-001000.ckpt: cannot write"), "{error}");
        return;
    }
    let folder = tempfile::tempdir().expect("temporary folder");
    checkpoint::save(folder.path(), 500, &checkpoint(500)).expect("saved");
    let child = std::process::Command::new("sh")
        .args(["-c", "trap '' XFSZ; ulimit -f 64 && exec \"$0\" --exact a_refused_write_leaves_the_last_checkpoint"])
        .arg(std::env::current_exe().expect("this program"))
        .env(FOLDER, folder.path())
        .output()
        .expect("a shell");
    assert!(child.status.success(), "{}", String::from_utf8_lossy(&child.stdout));
    assert!(String::from_utf8_lossy(&child.stdout).contains("1 passed"), "the child ran the test");
    assert_eq!(fs::read_dir(folder.path()).expect("folder").count(), 1, "no temporary file is left");
    assert_eq!(checkpoint::latest(folder.path()).expect("found").expect("there").step, 500);
}

#[cfg(unix)]
#[test]
fn files_have_ordinary_permissions() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().expect("temporary folder");
    let (ours, ordinary) = (folder.path().join("a.ply"), folder.path().join("b"));
    ply::save(&ours, &splats(1), &Frame::IDENTITY, false).expect("written");
    fs::write(&ordinary, "").expect("written");
    let mode = |file: &std::path::Path| fs::metadata(file).expect("file").permissions().mode();
    assert_eq!(mode(&ours), mode(&ordinary));
}

#[test]
fn png_rounds_to_the_nearest_of_8_bits() {
    for (value, want) in [
        (0.0, 0),
        (1.0, 255),
        (0.5 / 255.0, 1),
        (0.499 / 255.0, 0),
        (254.5 / 255.0, 255),
        (-3.0, 0),
        (7.0, 255),
        (f32::NAN, 0),
        (f32::INFINITY, 255),
        (100.4 / 255.0, 100),
        (100.6 / 255.0, 101),
    ] {
        assert_eq!(image_out::to_u8(value), want, "{value}");
    }
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("a.png");
    let rgb = image_out::to_rgb8(&[0.0, 0.5, 1.0, 0.25, 1.0, 0.1, 0.2, 9.0], 4);
    image_out::write_png(&file, 1, 2, &rgb).expect("written");
    let read = image::open(&file).expect("read").into_rgb8();
    assert_eq!((read.dimensions(), read.into_raw()), ((1, 2), vec![0, 128, 255, 255, 26, 51]));
    assert!(image_out::write_png(&file, 2, 2, &rgb).expect_err("a size").to_string().contains("2 pixels are not 2x2"));
}

#[test]
fn exr_keeps_depths_and_normals_bit_for_bit() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("depth.exr");
    let depths: Vec<f32> = (0..37 * 23).map(|i| 1.0 / (i as f32 - 300.5) * 1e4).collect();
    image_out::write_depth(&file, 37, 23, &depths).expect("written");
    let read = image_out::read_depth(&file).expect("read");
    assert_eq!((read.width, read.height), (37, 23));
    assert!(read.values.iter().zip(&depths).all(|(a, b)| a.to_bits() == b.to_bits()));

    let normals: Vec<[f32; 3]> = depths.iter().map(|d| [d.sin(), d.cos(), -0.0]).collect();
    image_out::write_normals(&file, 37, 23, &normals).expect("written");
    let error = image_out::read_depth(&file).expect_err("no depth").to_string();
    assert!(error.contains("no channel 'Z' among N.X, N.Y, N.Z"), "{error}");
    let image = exr::prelude::read_first_flat_layer_from_file(&file).expect("read");
    for (k, channel) in image.layer_data.channel_data.list.iter().enumerate() {
        assert!(channel.sample_data.values_as_f32().zip(&normals).all(|(a, n)| a.to_bits() == n[k].to_bits()));
    }
}
