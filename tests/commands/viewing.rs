//! `render` and `eval`: the renders and scores of the training.

use std::fs;
use std::path::Path;

use psrgs_vk::dataset::{Dataset, LoadOptions};
use psrgs_vk::format::{image_out, ply};
use psrgs_vk::scene::Gaussians;

use crate::run::{fails, psrgs, shared, stderr, text, works};

pub fn rgb(file: &Path) -> Vec<u8> {
    image::open(file).unwrap_or_else(|e| panic!("{}: {e}", file.display())).to_rgb8().into_raw()
}

pub fn json(file: &Path) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(file).expect("a file")).expect("JSON")
}

/// Training renders from scene coordinates, and a file holds dataset coordinates; both are rounded to f32. The rounding
/// can move a colour near the boundary of two 8-bit steps by one step. More than a handful of moved colours is an
/// error. Gives the number of moved colours.
#[track_caller]
pub fn moved(a: &[u8], b: &[u8]) -> usize {
    assert_eq!(a.len(), b.len());
    let differences: Vec<u8> = a.iter().zip(b).map(|(x, y)| x.abs_diff(*y)).collect();
    assert!(differences.iter().all(|d| *d <= 1), "a colour differs by {:?}", differences.iter().max());
    let moved = differences.iter().filter(|d| **d > 0).count();
    assert!(moved * 500 <= a.len(), "{moved} of {} colours differ", a.len());
    moved
}

/// How far `moved` of `n` colours by one step can move a PSNR: each changes the sum of squared errors by 2 * 255 + 1 at
/// most, and d(PSNR) = 10 / ln 10 * d(MSE) / MSE.
pub fn psnr_bound(psnr: f64, moved: usize, n: usize) -> f64 {
    let mse = 255.0 * 255.0 * 10f64.powf(-psnr / 10.0);
    1e-9 + 10.0 / std::f64::consts::LN_10 * (511 * moved) as f64 / (n as f64 * mse) * 1.01
}

#[test]
fn eval_of_a_trained_model_gives_the_numbers_of_training() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (scores, out) = (folder.path().join("scores.json"), folder.path().join("scored"));
    let output =
        psrgs(&["eval", text(&shared.model()), text(&shared.data()), "--json", text(&scores), "--out", text(&out)]);
    assert!(output.status.success(), "{}", stderr(&output));
    let (got, want) = (json(&scores), json(&shared.run().join("metrics.json")));
    for key in "scene test_images width height device splats bytes".split_whitespace() {
        assert_eq!(got[key], want[key], "{key}");
    }
    let table = String::from_utf8_lossy(&output.stdout).into_owned();
    for (got, want) in got["images"].as_array().expect("images").iter().zip(want["images"].as_array().expect("images"))
    {
        let name = got["name"].as_str().expect("a name");
        assert_eq!(got["name"], want["name"]);
        assert!(got["seen"].is_number() && got["seen"] == want["seen"], "{} and {}", got["seen"], want["seen"]);
        assert!(table.contains(name) && table.contains("mean"), "{table}");
        let picture = format!("{}.render.png", name.trim_end_matches(".jpg"));
        let (ours, theirs) = (rgb(&out.join(&picture)), rgb(&shared.run().join("renders").join(&picture)));
        let moved = moved(&ours, &theirs);
        let number = |of: &serde_json::Value, key: &str| of[key].as_f64().expect("a number");
        let off = |key: &str| (number(got, key) - number(want, key)).abs();
        let bound = psnr_bound(number(want, "psnr"), moved, ours.len());
        println!("{name}: {moved} colours moved, PSNR off by {:e} dB, SSIM by {:e}", off("psnr"), off("ssim"));
        assert!(off("psnr") <= bound, "{name}: PSNR off by {:e} > {bound:e}", off("psnr"));
        assert!(off("ssim") <= if moved == 0 { 1e-9 } else { 1e-4 }, "{name}: SSIM off by {:e}", off("ssim"));
    }
    let page = fs::read_to_string(out.join("report.html")).expect("a report");
    assert!(page.contains("point_cloud.ply on scene") && page.contains("data:image/") && !page.contains("steps on"));
}

#[test]
fn what_is_not_scored_says_why() {
    let Some(shared) = shared() else { return };
    fails(&["eval", text(&shared.model()), text(&shared.data()), "--split", "none"], 2, &["nothing to score"]);
}

#[test]
fn render_gives_training_pictures_and_depth_in_dataset_units() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("pictures");
    let (model, data) = (shared.model(), shared.data());
    let said = works(&["render", text(&model), "--cameras", text(&data), "--out", text(&out), "--depth"]);
    assert!(!said.contains("warning"), "{said}");
    assert_eq!(fs::read_dir(&out).expect("a folder").count(), 27);
    let renders = shared.run().join("renders");
    for view in ["view_0000", "view_0008"] {
        moved(&rgb(&out.join(format!("{view}.png"))), &rgb(&renders.join(format!("{view}.render.png"))));
        let depth =
            |folder: &Path| image_out::read_depth(&folder.join(format!("{view}.depth.exr"))).expect("a depth map");
        let (got, want) = (depth(&out), depth(&renders));
        assert_eq!((got.width, got.height), (64, 48));
        let close = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-3 * b.abs() + 1e-6;
        assert!(got.values.iter().zip(&want.values).filter(|pair| !close(*pair)).count() <= 6);
    }
    // The camera is tens of metres above the ground; in scene units, the scene is 10 wide.
    let truth = image_out::read_depth(&data.join("depth/view_0000.exr")).expect("true depth");
    let got = image_out::read_depth(&out.join("view_0000.depth.exr")).expect("a depth map");
    let middle = |values: &[f32]| {
        let mut seen: Vec<f32> = values.iter().copied().filter(|v| *v > 0.0).collect();
        seen.sort_by(f32::total_cmp);
        seen[seen.len() / 2]
    };
    let ratio = middle(&got.values) / middle(&truth.values);
    assert!((0.7..1.4).contains(&ratio), "median depth is {ratio} times the true one");
}

/// A training with stages and learned widths: the model tells the splats of the stages apart, and the report shows
/// each.
#[test]
fn the_sets_of_the_stages_are_rendered_apart() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (run, data) = (folder.path().join("run"), shared.data());
    let mut args = vec!["train", text(&data), "--out", text(&run), "--method", "psrgs-paper", "--depth-prior", "none"];
    args.extend(["--start", "sfm", "--iterations", "100", "--densify-from", "10", "--densify-interval", "20"]);
    args.extend([
        "--densify-until",
        "90",
        "--set",
        "sigma-every=5",
        "--set",
        "sigma-learning=errors",
        "--set",
        "low-stage=0.4",
        "--grad-threshold",
        "1e-4",
        "-v",
    ]);
    let said = works(&args);
    assert!(said.contains(": sigma "), "{said}");
    let file = run.join("point_cloud.ply");
    let model = ply::read(&file).expect("a model");
    let (low, all) = (model.constrained.expect("a constrained set"), model.gaussians.len());
    assert!(low > 100 && low < all, "{low} of {all}");
    let report = fs::read_to_string(run.join("report.html")).expect("a report");
    for title in ["Texture mask", "Low frequencies", "High frequencies", "bins of 256"] {
        assert!(report.contains(title), "{title}");
    }
    let sigmas = json(&run.join("sigma.json"));
    assert_eq!(sigmas["photographs"].as_array().expect("photographs").len(), 7);
    assert!(!sigmas["curves"].as_array().expect("curves").is_empty());

    let mut pictures = Vec::new();
    for set in ["low", "high", "full"] {
        let out = folder.path().join(set);
        works(&[
            "render",
            text(&file),
            "--cameras",
            text(&data),
            "--out",
            text(&out),
            "--part",
            set,
            "--views",
            "test",
        ]);
        pictures.push(rgb(&out.join("view_0008.png")));
    }
    moved(&pictures[2], &rgb(&run.join("renders/view_0008.render.png")));
    let apart = |a: &[u8], b: &[u8]| a.iter().zip(b).filter(|(x, y)| x.abs_diff(**y) > 8).count();
    assert!(apart(&pictures[0], &pictures[2]) > 100 && apart(&pictures[1], &pictures[2]) > 100);
    let without = shared.model();
    let args = ["render", text(&without), "--cameras", text(&data), "--part", "low", "--out", text(folder.path())];
    fails(&args, 3, &["point_cloud.ply", "constrained", "psrgs-paper"]);
}

#[test]
fn views_are_those_asked_for_and_photographs_are_not_needed() {
    let Some(shared) = shared() else { return };
    let data = crate::run::copy_of(&shared.data());
    fs::remove_dir_all(data.path().join("images")).expect("removed");
    let out = data.path().join("pictures");
    for (views, count) in [("test", 2), ("train", 7)] {
        let model = shared.model();
        let args = ["render", text(&model), "--cameras", text(data.path()), "--views", views];
        works(&[&args[..], &["--out", text(&out), "--max-side", "32", "-q"]].concat());
        assert_eq!(fs::read_dir(&out).expect("a folder").count(), count);
        fs::remove_dir_all(&out).expect("removed");
    }
}

#[test]
fn a_model_out_of_view_is_warned_of_and_an_empty_one_not_scored() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let read = ply::read(&shared.model()).expect("a model");
    let mut far = read.clone();
    far.gaussians.means.chunks_exact_mut(3).for_each(|p| p[0] += 1e6);
    let empty = ply::Model { gaussians: Gaussians::zeros(0), ..read };
    let data = shared.data();
    for (name, model) in [("far.ply", far), ("empty.ply", empty)] {
        let file = folder.path().join(name);
        ply::write(&file, &model).expect("written");
        let out = folder.path().join("pictures");
        let said = works(&["render", text(&file), "--cameras", text(&data), "--out", text(&out), "-q"]);
        assert!(said.contains("warning: no camera of") && said.contains(name), "{said}");
        assert!(rgb(&out.join("view_0003.png")).iter().all(|v| *v == 0));
        let eval = ["eval", text(&file), text(&data), "-q"];
        if name == "empty.ply" {
            fails(&eval, 3, &["empty.ply", "no splats"]);
        } else {
            let said = works(&eval);
            assert!(said.contains("warning: no camera of"), "{said}");
        }
    }
}

/// A geo-referenced model keeps its place when an editor drops the comments of the PLY.
#[test]
fn the_offset_beside_a_model_holds_where_its_comments_are_gone() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dataset = Dataset::load(&shared.data(), &LoadOptions::default()).expect("a dataset");
    let frame = dataset.frame;
    let shift = [1e5, -2e5, 300.0];
    let mut model = ply::read(&shared.model()).expect("a model");
    for p in model.gaussians.means.chunks_exact_mut(3) {
        (0..3).for_each(|k| p[k] = (f64::from(p[k]) - shift[k]) as f32);
    }
    model.version = None;
    let file = folder.path().join("edited.ply");
    ply::write(&file, &model).expect("written");
    let data = shared.data();
    let args = ["render", text(&file), "--cameras", text(&data), "--views", "test", "--out"];
    let out = folder.path().join("lost");
    assert!(works(&[&args[..], &[text(&out)]].concat()).contains("warning: no camera"));
    psrgs_vk::format::FrameFile { frame, shift, coordinates: None, map: None }
        .write(&folder.path().join("frame.json"))
        .expect("written");
    let out = folder.path().join("found");
    let said = works(&[&args[..], &[text(&out)]].concat());
    assert!(said.contains("frame.json") && !said.contains("warning"), "{said}");
}

/// Cheaper renders differ a little from exact ones.
#[test]
fn pictures_can_be_drawn_for_less() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (model, data) = (shared.model(), shared.data());
    let drawn = |name: &str, options: &[&str]| -> Vec<u8> {
        let out = folder.path().join(name);
        let ends = ["render", text(&model), "--cameras", text(&data), "--views", "test", "--out", text(&out)];
        works(&[&ends[..], options].concat());
        let mut files: Vec<_> = fs::read_dir(&out).expect("pictures").map(|f| f.expect("a file").path()).collect();
        files.sort();
        files.iter().filter(|f| f.extension().is_some_and(|e| e == "png")).flat_map(|f| rgb(f)).collect()
    };
    let exact = drawn("exact", &["--sh-bits", "32"]);
    assert_eq!(exact, drawn("plain", &[]));
    let halved = drawn("halved", &["--sh-bits", "16"]);
    let off = exact.iter().zip(&halved).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(exact.len() == halved.len() && exact != halved && off <= Some(1), "off by {off:?} steps of 255");
    let score = |options: &[&str]| -> f64 {
        let file = folder.path().join("scores.json");
        works(&[&["eval", text(&model), text(&data), "--json", text(&file)], options].concat());
        json(&file)["psnr"].as_f64().expect("a number")
    };
    let (exact, halved) = (score(&[]), score(&["--sh-bits", "16"]));
    assert!(exact != halved && (exact - halved).abs() < 0.02, "{exact} and {halved} dB");
    fails(&["eval", text(&model), text(&data), "--alpha-cutoff", "64"], 2, &["alpha-cutoff", "early-cutoff"]);
    fails(&["eval", text(&model), text(&data), "--sh-bits", "8"], 2, &["sh-bits", "16, 32"]);
}
