//! `psrgs-vk stereo`, and trainings that begin with its cloud.

use std::path::Path;
use std::process::{Command, Output};

use psrgs_vk::dataset::{Dataset, LoadOptions};
use psrgs_vk::format::image_out::{read_depth, read_normals, write_png};
use psrgs_vk::format::ply::Cloud;
use psrgs_vk::world::{LidarParams, WorldParams, generate};

use super::common;

fn psrgs(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_psrgs-vk")).args(arguments).output().unwrap()
}

fn text(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

fn world(folder: &Path) {
    let lidar = LidarParams { density: 0.1, ..LidarParams::default() };
    let params = WorldParams {
        images: 9,
        max_side: 96,
        seed: 5,
        pixels_per_point: 40,
        offpath: 0,
        lidar,
        ..WorldParams::default()
    };
    generate(&params, folder, &mut |_| ()).unwrap();
}

#[test]
fn maps_and_a_cloud_are_written_and_training_begins_with_it() {
    if common::gpu().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("world"), folder.path().join("stereo"));
    world(&data);
    let (data_text, out_text) = (data.to_str().unwrap(), out.to_str().unwrap());
    let done = psrgs(&["stereo", data_text, "--out", out_text, "--max-side", "96", "--split", "none"]);
    assert!(done.status.success(), "{}", text(&done));
    let said = text(&done);
    assert!(said.contains("against the true depth: median error"), "{said}");
    assert!(said.contains("9 photographs matched"), "{said}");

    let dataset = Dataset::load(&data, &LoadOptions { max_side: Some(96), ..LoadOptions::default() }).unwrap();
    let (mut known, mut off) = (0, Vec::new());
    for view in &dataset.views {
        let name = Path::new(&view.name).with_extension("exr");
        let (found, truth) = (read_depth(&out.join("depth").join(&name)), read_depth(&data.join("depth").join(&name)));
        let (found, truth) = (found.unwrap(), truth.unwrap());
        assert_eq!((found.width, found.height), (truth.width, truth.height));
        let normals = read_normals(&out.join("normal").join(&name)).unwrap();
        let confidence = read_depth(&out.join("confidence").join(&name)).unwrap();
        for (p, z) in found.values.iter().enumerate() {
            let length = normals.values[p].iter().map(|v| v * v).sum::<f32>().sqrt();
            assert_eq!(*z > 0.0, confidence.values[p] > 0.0);
            assert!(if *z > 0.0 { (length - 1.0).abs() < 1e-5 } else { length == 0.0 });
            if *z > 0.0 && truth.values[p] > 0.0 {
                known += 1;
                off.push((z / truth.values[p] - 1.0).abs());
            }
        }
    }
    // Few and small photographs: most pixels have a depth, in the dataset's units.
    off.sort_by(f32::total_cmp);
    assert!(known > 9 * 96 * 72 / 10, "{known} depths; {said}");
    assert!(off[off.len() / 2] < 0.02, "{}", off[off.len() / 2]);

    let cloud = Cloud::read(&out.join("fused.ply")).unwrap();
    assert_eq!((cloud.normals.len(), cloud.colours.len()), (cloud.positions.len(), cloud.positions.len()));
    let ply = out.join("fused.ply");
    let model = folder.path().join("model");
    let trained = psrgs(&[
        "train",
        data_text,
        "--out",
        model.to_str().unwrap(),
        "--init",
        ply.to_str().unwrap(),
        "--iterations",
        "2",
        "--max-side",
        "48",
    ]);
    let said = text(&trained);
    assert!(trained.status.success(), "{said}");
    let digits: String = said.chars().filter(|c| *c != ',').collect();
    assert!(digits.contains(&format!("{} splats to begin with", cloud.positions.len())), "{said}");
}

/// Photographs from one place have no depth: the command reports it and succeeds.
#[test]
fn photographs_from_one_place_are_named_and_left_out() {
    if common::gpu().is_none() {
        return;
    }
    for (names, angle) in [(&["a", "b", "c"][..], 0.0_f64), (&["a", "b", "c"], 0.05), (&["a"], 0.0)] {
        let folder = tempfile::tempdir().unwrap();
        let images = folder.path().join("images");
        std::fs::create_dir(&images).unwrap();
        let mut frames = Vec::new();
        for (k, name) in (0..).zip(names) {
            let pixels: Vec<u8> = (0..3 * 32 * 24_u32).map(|p| (p.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
            write_png(&images.join(format!("{name}.png")), 32, 24, &pixels).unwrap();
            let (s, c) = (angle * f64::from(k)).sin_cos();
            frames.push(format!(
                r#"{{"file_path":"images/{name}.png","transform_matrix":[[{c},0,{s},1],[0,1,0,2],[{},0,{c},3],[0,0,0,1]]}}"#,
                -s
            ));
        }
        let camera = r#""camera_model":"PINHOLE","fl_x":30,"fl_y":30,"cx":16,"cy":12,"w":32,"h":24"#;
        let json = format!(r#"{{{camera},"frames":[{}]}}"#, frames.join(","));
        std::fs::write(folder.path().join("transforms.json"), json).unwrap();
        let out = folder.path().join("out");
        let done =
            psrgs(&["stereo", folder.path().to_str().unwrap(), "--out", out.to_str().unwrap(), "--split", "none"]);
        let said = text(&done);
        assert!(done.status.success(), "{said}");
        assert!(said.contains("no depth is known of 'a.png'") && said.contains("no other photograph sees"), "{said}");
        assert!(said.contains("0 photographs matched"), "{said}");
        assert!(Cloud::read(&out.join("fused.ply")).unwrap().positions.is_empty());
        assert!(!out.join("depth").exists());
    }
}

#[test]
fn wrong_options_and_missing_data_have_their_exit_codes() {
    let code = |arguments: &[&str]| {
        let output = psrgs(arguments);
        (output.status.code(), text(&output))
    };
    let (missing, said) = code(&["stereo", "/nowhere/at/all"]);
    assert_eq!(missing, Some(3), "{said}");
    let (usage, said) = code(&["stereo", "/nowhere/at/all", "--window", "9"]);
    assert_eq!(usage, Some(2), "{said}");
    assert!(said.contains("taps"), "{said}");
    // More views must agree than are checked: a usage error.
    let (usage, said) = code(&["stereo", "/nowhere/at/all", "--agree", "5", "--checks", "4"]);
    assert_eq!(usage, Some(2), "{said}");
    assert!(said.contains("--agree") && said.contains("--checks"), "{said}");
}
