//! `eval` of other trainers' models: frames, layouts, sizes and splits.

use std::fs;
use std::path::Path;

use psrgs_vk::format::ply;
use psrgs_vk::scene::{Gaussians, Similarity};

use crate::common;
use crate::run::{fails, shared, text, works};
use crate::viewing::{json, moved, psnr_bound, rgb};

/// A similarity with an oblique axis of rotation, a smaller scale and a translation.
fn to_model() -> Similarity {
    let (a, b) = (0.7_f64, -1.9_f64);
    let (sa, ca, sb, cb) = (a.sin(), a.cos(), b.sin(), b.cos());
    let rotation = [[ca, 0.0, sa], [sa * sb, cb, -ca * sb], [-sa * cb, sb, ca * cb]];
    Similarity { rotation, scale: 0.037, translation: [1.25, -0.5, 3.0] }
}

fn rows(s: &Similarity) -> Vec<Vec<f64>> {
    (0..3)
        .map(|i| (0..4).map(|j| if j < 3 { s.scale * s.rotation[i][j] } else { s.translation[i] }).collect())
        .collect()
}

/// A PLY that this program does not write: big endian, doubles, no normals, another order, an unknown property.
fn foreign(g: &Gaussians) -> Vec<u8> {
    let mut names: Vec<String> = ["opacity", "z", "y", "x", "filter_3D"].map(str::to_owned).to_vec();
    names.extend((0..45).map(|k| format!("f_rest_{k}")));
    names.extend((0..4).map(|k| format!("rot_{k}")).chain((0..3).map(|k| format!("scale_{k}"))));
    names.extend((0..3).map(|k| format!("f_dc_{k}")));
    let mut out = format!("ply\nformat binary_big_endian 1.0\nelement vertex {}\n", g.len());
    names.iter().for_each(|name| out += &format!("property double {name}\n"));
    let mut out = (out + "end_header\n").into_bytes();
    for i in 0..g.len() {
        for name in &names {
            let number = |prefix: &str| name.strip_prefix(prefix).and_then(|k| k.parse::<usize>().ok());
            let value = match name.as_str() {
                "x" => g.means[3 * i],
                "y" => g.means[3 * i + 1],
                "z" => g.means[3 * i + 2],
                "opacity" => g.opacities[i],
                _ => match (number("f_rest_"), number("f_dc_"), number("rot_"), number("scale_")) {
                    (Some(k), ..) => g.sh[(1 + k % 15) / 4][12 * i + 3 * ((1 + k % 15) % 4) + k / 15],
                    (_, Some(c), ..) => g.sh[0][12 * i + c],
                    (_, _, Some(k), _) => g.quats[4 * i + k],
                    (_, _, _, Some(k)) => g.scales[3 * i + k],
                    _ => 1e-3,
                },
            };
            out.extend(f64::from(value).to_be_bytes());
        }
    }
    out
}

/// Scores and pictures of a model.
fn scored(model: &Path, data: &Path, folder: &Path, options: &[&str]) -> (serde_json::Value, String) {
    let (scores, out) = (folder.join("scores.json"), folder.join("out"));
    let args = ["eval", text(model), text(data), "--json", text(&scores), "--out", text(&out)];
    let said = works(&[&args[..], options].concat());
    (json(&scores), said)
}

#[test]
fn a_model_in_another_frame_and_layout_has_the_scores_it_had() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    // View-dependent colours, of which a short training makes few.
    let mut ours = ply::read(&shared.model()).expect("a model");
    for (k, group) in ours.gaussians.sh.iter_mut().enumerate() {
        for (at, v) in group.iter_mut().enumerate().filter(|(at, _)| k > 0 || at % 12 > 2) {
            *v = 0.2 * ((at + 7 * k) as f32 * 0.731).sin();
        }
    }
    ply::write(&path("ours.ply"), &ours).expect("written");
    let theirs = Similarity::after_shift(&to_model(), ours.shift).gaussians(&ours.gaussians);
    fs::write(path("theirs.ply"), foreign(&theirs)).expect("written");
    let named = serde_json::json!({ "transform": rows(&Similarity { scale: 1.0, ..to_model() }), "scale": 1.0 });
    // nerfstudio's form: the scale also applies to the translation.
    let mut named = named;
    for row in named["transform"].as_array_mut().expect("rows") {
        row[3] = (row[3].as_f64().expect("a number") / 0.037).into();
    }
    named["scale"] = 0.037.into();
    fs::write(path("dataparser_transforms.json"), named.to_string()).expect("written");
    let mut matrix = rows(&to_model().inverse());
    matrix.push(vec![0.0, 0.0, 0.0, 1.0]);
    fs::write(path("normalisation.json"), serde_json::json!(matrix).to_string()).expect("written");

    let data = shared.data();
    let want_folder = path("want");
    fs::create_dir(&want_folder).expect("a folder");
    let (want, said) = scored(&path("ours.ply"), &data, &want_folder, &[]);
    assert!(said.contains("written by psrgs-vk"), "{said}");
    let psnr = |of: &serde_json::Value| of["psnr"].as_f64().expect("a number");
    for (file, direction) in
        [("dataparser_transforms.json", "dataset-to-model"), ("normalisation.json", "model-to-dataset")]
    {
        let got_folder = path(direction);
        fs::create_dir(&got_folder).expect("a folder");
        let file = path(file);
        let options = ["--frame", text(&file), "--frame-maps", direction];
        let (got, said) = scored(&path("theirs.ply"), &data, &got_folder, &options);
        assert!(said.contains("coordinates: its own") && said.contains("27.027"), "{said}");
        let frame = got["frame"].as_str().expect("the frame");
        assert!(frame.contains("turned by"), "{frame}");
        for (got, want) in
            got["images"].as_array().expect("images").iter().zip(want["images"].as_array().expect("images"))
        {
            let name = format!("out/{}.render.png", got["name"].as_str().expect("a name").trim_end_matches(".jpg"));
            let (a, b) = (rgb(&got_folder.join(&name)), rgb(&want_folder.join(&name)));
            let moved = moved(&a, &b);
            let (off, bound) = ((psnr(got) - psnr(want)).abs(), psnr_bound(psnr(want), moved, a.len()));
            println!("{name}: {moved} of {} colours moved, PSNR off by {off:e} dB", a.len());
            assert!(off <= bound, "{name}: PSNR off by {off:e} > {bound:e}");
        }
    }
    // With the inverse, or without a transform, the scores differ: the test above can fail.
    let said = works(&["eval", text(&path("theirs.ply")), text(&data)]);
    assert!(said.contains("the dataset's axes and units (assumed"), "{said}");
    let wrong = path("wrong");
    fs::create_dir(&wrong).expect("a folder");
    let file = path("normalisation.json");
    let (got, _) = scored(&path("theirs.ply"), &data, &wrong, &["--frame", text(&file)]);
    assert!((psnr(&got) - psnr(&want)).abs() > 1.0);
    fs::write(path("mirror.json"), "[[1,0,0,0],[0,1,0,0],[0,0,-1,0]]").expect("written");
    let mirror = path("mirror.json");
    fails(&["eval", text(&path("theirs.ply")), text(&data), "--frame", text(&mirror)], 3, &["mirror.json", "mirrors"]);
    fails(&["eval", text(&path("theirs.ply")), text(&data), "--frame-maps", "model-to-dataset"], 2, &["--frame"]);
}

#[test]
fn sizes_splits_and_backgrounds_of_other_trainers_are_met() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, file) = (shared.data(), folder.path().join("scores.json"));
    let scores = |options: &[&str]| {
        works(&[&["eval", text(&shared.model()), text(&data), "--json", text(&file), "-q"], options].concat());
        json(&file)
    };
    // Photographs are 64 x 48.
    let same = |a: &serde_json::Value, b: &serde_json::Value| a["images"] == b["images"];
    let half = scores(&["--max-side", "32"]);
    assert_eq!((&half["width"], &half["height"]), (&32.into(), &24.into()));
    assert!(same(&half, &scores(&["--downscale", "2"])) && same(&half, &scores(&["--width", "32", "--height", "24"])));
    for (rounding, size) in [("nearest", (21, 16)), ("down", (21, 16)), ("up", (22, 16))] {
        let got = scores(&["--downscale", "3", "--rounding", rounding]);
        assert_eq!((&got["width"], &got["height"]), (&size.0.into(), &size.1.into()), "{rounding}");
    }
    let (test, every) = (scores(&[]), scores(&["--split", "every:8"]));
    assert!(same(&test, &every) && test["test_images"] == 2);
    let thirds = scores(&["--split", "every:3:1"]);
    let names: Vec<&str> =
        thirds["images"].as_array().expect("images").iter().filter_map(|i| i["name"].as_str()).collect();
    assert_eq!(names, ["view_0001.jpg", "view_0004.jpg", "view_0007.jpg"]);
    let white = scores(&["--background", "white"]);
    assert!(same(&white, &scores(&["--background", "#ffffff"])) && same(&white, &scores(&["--background", "1,1,1"])));
    assert!(!same(&white, &test));

    let model = shared.model();
    let eval = |options: &[&'static str]| [&["eval", text(&model), text(&data)], options].concat();
    fails(&eval(&["--width", "65", "--height", "49"]), 3, &["64x48", "65x49", "only reduced"]);
    fails(&eval(&["--width", "32", "--height", "32"]), 3, &["32x32", "same factor"]);
    fails(&eval(&["--downscale", "0.5"]), 2, &["--downscale"]);
    fails(&eval(&["--downscale", "2", "--max-side", "64"]), 2, &["--max-side"]);
    fails(&eval(&["--width", "32"]), 2, &["--height"]);
    fails(&eval(&["--split", "every:1"]), 2, &["every:N"]);
    fails(&eval(&["--background", "grey"]), 2, &["#rrggbb"]);
}

/// The comparison script with this program in place of a peer: the same training has the same scores. A peer that gets
/// only the training photographs is scored on the held-out ones.
#[cfg(unix)]
#[test]
fn the_comparison_script_alternates_scores_and_writes_a_table() {
    let Some(shared) = shared() else { return };
    let have = |program: &str| std::process::Command::new(program).arg("--version").output().is_ok();
    if !have("bash") || !have("python3") {
        common::skipped("bash or python3 is not there");
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/bench/against");
    let compare = |peer: &str, name: &str| {
        let output = std::process::Command::new("bash")
            .args([text(&script), name, text(&shared.data()), peer, "--deterministic"])
            .env("PSRGS_VK", env!("CARGO_BIN_EXE_psrgs-vk"))
            .env("AGAINST_WORK", folder.path().join("work"))
            .env("AGAINST_RESULTS", folder.path())
            .envs([("ROUNDS", "2"), ("STEPS", "4"), ("SIZE", "32"), ("PEER_EVAL", "--split every:8")])
            .output()
            .expect("bash starts");
        let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), crate::run::stderr(&output));
        (output.status.success(), said)
    };
    let program = env!("CARGO_BIN_EXE_psrgs-vk");
    let common =
        "--method 3dgs --out {out}/run --iterations {steps} --max-side {size} --seed {seed} --deterministic -q";
    let copy = "cp {out}/run/point_cloud.ply {ply}";

    let (ok, said) = compare(&format!("{program} train {{data}} {common} && {copy}"), "same");
    assert!(ok, "{said}");
    let order: Vec<&str> = said.lines().filter_map(|line| line.strip_prefix("round ")).collect();
    assert_eq!(order, ["1 of 2: ours", "1 of 2: theirs", "2 of 2: theirs", "2 of 2: ours"], "{said}");
    let table = fs::read_to_string(folder.path().join("against-same.md")).expect("a table");
    assert!(table.contains("| ours |") && table.contains("| peer |") && table.contains("round by round"), "{table}");
    let runs = json(&folder.path().join("against-same.json"));
    let runs = runs["runs"].as_array().expect("runs");
    assert_eq!(runs.len(), 4);
    for (ours, peer) in runs[..2].iter().zip(&runs[2..]) {
        assert_eq!((&ours["psnr"], &ours["splats"]), (&peer["psnr"], &peer["splats"]));
        assert!(ours["wall_s"].as_f64() > Some(0.0) && peer["cpu_s"].as_f64() > Some(0.0));
    }

    let (ok, said) = compare(&format!("{program} train {{train_data}} {common} --split none && {copy}"), "blind");
    assert!(ok, "{said}");
    let runs = json(&folder.path().join("against-blind.json"));
    assert_eq!(runs["runs"][2]["test_images"], 2, "not scored on the held-out photographs");
    let kept = fs::read_dir(folder.path().join("work/blind/train-data/images")).expect("a folder").count();
    assert_eq!(kept, 7);

    for (peer, words) in [("true", "left no {ply}"), ("exit 9", "failed:")] {
        let (ok, said) = compare(peer, "bad");
        assert!(!ok && said.contains(words), "{said}");
    }
}
