//! A scene in two blocks: trained, stopped, taken up again, merged; and folders of blocks that may not be used.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Duration;

use psrgs_vk::blocks::{
    Block, Cell, DatasetRecord, FORMAT, GlobalModel, Ground, PlanFile, PlannedPhotograph, VERSION, sha256_of,
};
use psrgs_vk::dataset::{Dataset, LoadOptions, Role};
use psrgs_vk::format::ply;
use psrgs_vk::world::{WorldParams, generate};

use crate::common;
use crate::run::{Running, command, copy_folder, copy_of, fails, psrgs, stderr, works};

/// Stereo, growth, a checkpoint every few steps, and exposures that the coarse model solves.
/// Steps of the schedule are those of 30,000: growth begins after step 5 of 40, and ends before step 32.
const OPTIONS: &str = "--method psrgs --deterministic --scale-schedule --densify-from 3750 --densify-interval 4500 \
                       --densify-until 24000 --grad-threshold 1e-3 --exposure affine --set stereo-side=32 \
                       --set stereo-splats=300 --set sigma-learning=off --eval-every 0 --checkpoint-every 10 \
                       --seed 5 --max-side 96";

/// Steps of a block.
const STEPS: u32 = 40;

/// A scene, and a plan of it of two blocks that nothing has been trained of.
struct Scene {
    _folder: tempfile::TempDir,
    data: PathBuf,
    plan: PlanFile,
}

fn scene() -> &'static Scene {
    static SCENE: OnceLock<Scene> = OnceLock::new();
    SCENE.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let data = folder.path().join("scene");
        let params =
            WorldParams { images: 12, max_side: 96, pixels_per_point: 16, offpath: 0, ..WorldParams::default() };
        generate(&params, &data, &mut |_| {}).expect("a scene");
        let plan = plan_of(&data);
        Scene { _folder: folder, data, plan }
    })
}

/// Two blocks side by side. The photographs near the edge belong to both.
fn plan_of(data: &Path) -> PlanFile {
    let mut asked = vec!["train", data.to_str().expect("a name"), "--print-settings"];
    asked.extend(OPTIONS.split_whitespace());
    let settings = String::from_utf8(psrgs(&asked).stdout).expect("text");
    let dataset = Dataset::load(data, &LoadOptions::default()).expect("a dataset");
    let trained_on: Vec<_> = dataset.views_of(Role::Train).map(|(_, view)| view).collect();
    let middle = trained_on.iter().map(|view| view.camera.center()[0]).sum::<f64>() / trained_on.len() as f64;
    let block = |id: &str, x: [Option<f64>; 2], sees: &dyn Fn(f64) -> bool| Block {
        id: id.to_owned(),
        cell: Cell { x, y: [None; 2] },
        margin: 5.0,
        photographs: trained_on
            .iter()
            .filter(|view| sees(view.camera.center()[0] - middle))
            .map(|view| PlannedPhotograph {
                name: view.name.clone(),
                file: None,
                sha256: sha256_of(&view.path).expect("a file").0,
                bytes: view.path.metadata().expect("a file").len(),
                share: 1.0,
                mask: None,
            })
            .collect(),
        steps: STEPS,
        predicted_splats: 500,
        predicted_memory: 1 << 20,
        predicted_seconds: None,
    };
    PlanFile {
        format: FORMAT.to_owned(),
        version: VERSION,
        program: env!("CARGO_PKG_VERSION").to_owned(),
        dataset: DatasetRecord {
            path: data.to_owned(),
            model_sha256: "0".repeat(64),
            photographs: dataset.views.len(),
            files: Vec::new(),
        },
        settings,
        seed: 5,
        ground: Ground {
            origin: [middle, 0.0, 0.0],
            east: [1.0, 0.0, 0.0],
            north: [0.0, 1.0, 0.0],
            up: [0.0, 0.0, 1.0],
        },
        global: GlobalModel {
            photographs: trained_on.iter().map(|view| view.name.clone()).collect(),
            max_side: 48,
            steps: 20,
            max_splats: 200,
        },
        blocks: vec![block("b00", [None, Some(0.0)], &|x| x < 20.0), block("b01", [Some(0.0), None], &|x| x > -20.0)],
    }
}

/// A folder with a plan alone.
fn planned(plan: &PlanFile) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    plan.write(&folder.path().join("blocks.json")).expect("a plan");
    fs::write(folder.path().join("plan.svg"), "<svg xmlns=\"http://www.w3.org/2000/svg\"/>").expect("a drawing");
    folder
}

/// The plan of [`scene`], trained: all tests share it and leave it as it is.
fn trained() -> &'static tempfile::TempDir {
    static TRAINED: OnceLock<tempfile::TempDir> = OnceLock::new();
    TRAINED.get_or_init(|| {
        let folder = planned(&scene().plan);
        works(&["blocks", "run", name(folder.path())]);
        folder
    })
}

/// A copy of [`trained`].
fn copy() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    copy_folder(trained().path(), folder.path());
    folder
}

fn name(path: &Path) -> &str {
    path.to_str().expect("a name")
}

fn json(file: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(file).unwrap_or_else(|e| panic!("{}: {e}", file.display()))).expect("JSON")
}

fn model(folder: &Path, block: &str) -> PathBuf {
    let at = if block == "global" { folder.join(block) } else { folder.join("blocks").join(block) };
    at.join("point_cloud.ply")
}

fn states(folder: &Path) -> Vec<String> {
    let said = psrgs(&["blocks", "status", name(folder), "--json"]);
    let rows: serde_json::Value = serde_json::from_slice(&said.stdout).expect("JSON");
    rows.as_array().expect("rows").iter().map(|row| row["state"].as_str().expect("a word").to_owned()).collect()
}

#[test]
fn blocks_are_trained_merged_and_scored() {
    if common::gpu().is_none() {
        return;
    }
    let folder = copy();
    let path = folder.path();
    assert_eq!(states(path), ["done"; 3]);
    let said = works(&["blocks", "run", name(path)]);
    assert!(said.contains("block b01: done") && !said.contains("looking for depths"), "{said}");
    works(&["blocks", "merge", name(path)]);

    let merged = ply::read(&path.join("point_cloud.ply")).expect("a model");
    let plan = &scene().plan;
    let mut owned = [0; 2];
    for (block, counted) in owned.iter_mut().enumerate() {
        let own = ply::read(&model(path, &plan.blocks[block].id)).expect("a model");
        let place = |mean: &[f32]| std::array::from_fn(|k| f64::from(mean[k]) + own.shift[k]);
        *counted = own.gaussians.means.chunks_exact(3).filter(|mean| plan.owner(place(mean)) == Some(block)).count();
        assert!(*counted > 100 && *counted < own.gaussians.len(), "block {block} keeps {counted}");
    }
    assert_eq!(merged.gaussians.len(), owned.iter().sum::<usize>());

    let metrics = json(&path.join("metrics.json"));
    let held_out = Dataset::load(&scene().data, &LoadOptions::default()).expect("a dataset");
    assert_eq!(metrics["test_images"], held_out.views_of(Role::HeldOut).count());
    assert!(metrics["psnr"].as_f64().expect("a number") > 12.0, "{}", metrics["psnr"]);
    assert_eq!(metrics["blocks"][1]["splats"], owned[1]);
    let report = fs::read_to_string(path.join("report.html")).expect("a report");
    assert!(report.contains("The plan: 2 blocks") && report.contains("data:image/svg+xml"));
    assert!(path.join("exposures.json").is_file() && path.join("frame.json").is_file());
}

#[test]
fn held_out_photographs_are_never_trained_on() {
    if common::gpu().is_none() {
        return;
    }
    let dataset = Dataset::load(&scene().data, &LoadOptions::default()).expect("a dataset");
    let held_out: BTreeSet<&str> = dataset.views_of(Role::HeldOut).map(|(_, view)| view.name.as_str()).collect();
    let mut plan = scene().plan.clone();
    // A plan that asks for them does not get them either.
    for photograph in &mut plan.blocks[0].photographs.iter_mut().take(1) {
        photograph.name = (*held_out.first().expect("one")).to_owned();
    }
    plan.blocks[0].steps = 2;
    plan.global.steps = 2;
    let folder = planned(&plan);
    works(&["blocks", "run", name(folder.path()), "--block", "b00"]);
    let trained_on = |folder: &Path| {
        let metrics = json(&folder.join("metrics.json"));
        let names = metrics["training_photographs"].as_array().expect("photographs").iter();
        names.map(|one| one["name"].as_str().expect("a name").to_owned()).collect::<Vec<_>>()
    };
    let at = |block: &str| model(folder.path(), block).parent().expect("a folder").to_owned();
    assert_eq!(trained_on(&at("b00")).len(), plan.blocks[0].photographs.len() - 1);
    for name in trained_on(&at("b00")).into_iter().chain(trained_on(&at("global"))) {
        assert!(!held_out.contains(name.as_str()), "{name} was trained on");
    }
    assert_eq!(states(folder.path()), ["done", "done", "waiting"]);
}

#[test]
fn exposures_of_blocks_stay_as_the_coarse_model_solved_them() {
    if common::gpu().is_none() {
        return;
    }
    let of = |block: &str| json(&model(trained().path(), block).with_file_name("exposures.json"));
    let (solved, kept) = (of("global"), of("b00"));
    for (name, matrix) in kept.as_object().expect("photographs") {
        for row in 0..3 {
            for column in 0..4 {
                let [a, b] = [&solved[name], matrix].map(|m| m[row][column].as_f64().expect("a number"));
                assert!((a - b).abs() < 1e-6, "{name}: {a} and {b}");
            }
        }
    }
    assert_ne!(solved.as_object().expect("photographs").len(), 0);
}

#[test]
fn outside_of_cell_and_margin_are_coarse_splats_alone() {
    if common::gpu().is_none() {
        return;
    }
    let folder = trained().path();
    // Cell and margin of the first block end at 5 m.
    let beyond = |block: &str, least: f64| -> Vec<[f64; 3]> {
        let of = ply::read(&model(folder, block)).expect("a model");
        let places = of.gaussians.means.chunks_exact(3).map(|m| [0, 1, 2].map(|k| f64::from(m[k]) + of.shift[k]));
        places.filter(|place| place[0] - middle() > least).collect()
    };
    // Coarse splats are trained in the block too: each moves less than this, in metres.
    let moved = 0.5;
    let (coarse, block) = (beyond("global", 7.0 - moved), beyond("b00", 7.0));
    assert!(!block.is_empty() && block.len() <= coarse.len(), "{} of {}", block.len(), coarse.len());
    for place in block {
        let distance = |other: &[f64; 3]| (0..3).map(|k| (place[k] - other[k]).powi(2)).sum::<f64>().sqrt();
        let nearest = coarse.iter().map(distance).fold(f64::INFINITY, f64::min);
        assert!(nearest < moved, "{place:?} is {nearest} from every coarse splat");
    }
}

fn middle() -> f64 {
    scene().plan.ground.origin[0]
}

#[cfg(unix)]
#[test]
fn a_killed_block_goes_on_to_the_same_model() {
    if common::gpu().is_none() {
        return;
    }
    let folder = copy();
    let block = folder.path().join("blocks/b01");
    let bytes = fs::read(block.join("point_cloud.ply")).expect("a model");
    fs::write(block.join("point_cloud.ply"), &bytes[..bytes.len() / 2]).expect("written");
    let args = ["blocks", "run", name(folder.path()), "--block", "b01", "-v", "--overwrite"];
    let mut running = Running::new(&args);
    running.until("saved");
    running.signal("-KILL");
    running.end();
    // What was done before counts no more, and what is begun needs no --overwrite.
    assert_eq!(states(folder.path()), ["done", "done", "stopped"]);
    let said = works(&args[..6]);
    assert!(said.contains("going on after step"), "{said}");
    let read = |of: &Path| fs::read(model(of, "b01")).expect("a model");
    assert!(read(folder.path()) == read(trained().path()), "the model differs from the undisturbed one");
}

#[test]
fn of_two_writers_of_a_block_one_is_refused() {
    if common::gpu().is_none() {
        return;
    }
    let folder = copy();
    fs::remove_dir_all(folder.path().join("blocks/b00")).expect("a folder");
    let args = ["blocks", "run", name(folder.path()), "--block", "b00"];
    let mut first = Running::new(&args);
    while !folder.path().join("blocks/b00/settings.toml").exists() {
        assert!(first.child.try_wait().expect("a state").is_none(), "the first writer has ended");
        std::thread::sleep(Duration::from_millis(5));
    }
    fails(&args, 2, &["another run is writing", "wait for its end"]);
    assert_eq!(first.end().0, Some(0));
    assert_eq!(states(folder.path()), ["done"; 3]);
}

#[test]
fn foreign_stale_and_truncated_blocks_are_refused() {
    if common::gpu().is_none() {
        return;
    }
    let merge = |folder: &Path, words: &[&str]| fails(&["blocks", "merge", name(folder), "--no-scores"], 3, words);
    let run = |folder: &Path, words: &[&str]| fails(&["blocks", "run", name(folder), "--block", "b01"], 3, words);
    let done = |folder: &Path, block: &str| model(folder, block).with_file_name("done.json");

    let folder = copy();
    let path = folder.path();
    fs::copy(done(path, "b00"), done(path, "b01")).expect("a copy");
    merge(path, &["block b01", "of another block, b00"]);
    run(path, &["b01", "of another block, b00", "--overwrite"]);
    assert_eq!(states(path), ["done", "done", "stale"]);

    let whole = fs::read_to_string(done(path, "b00")).expect("text");
    fs::write(done(path, "b01"), &whole[..whole.len() / 2]).expect("a file");
    merge(path, &["block b01", "done.json"]);
    run(path, &["done.json", "--overwrite"]);
    fs::write(done(path, "b01"), "{\"accuracy\": 0.9}").expect("a file");
    merge(path, &["block b01", "done.json", "format"]);
    assert_eq!(states(path), ["done", "done", "damaged"]);

    let folder = copy();
    let path = folder.path();
    let bytes = fs::read(model(path, "b00")).expect("a model");
    fs::write(model(path, "b00"), &bytes[..bytes.len() - 100]).expect("a model");
    fs::remove_dir_all(path.join("blocks/b01")).expect("a folder");
    merge(path, &["2 blocks cannot be merged", "block b00", "not copied whole", "block b01: not trained"]);
    assert!(!path.join("point_cloud.ply").exists(), "nothing is written of blocks that may not be used");

    let folder = copy();
    let path = folder.path();
    let mut plan = scene().plan.clone();
    plan.blocks[0].margin = 4.0;
    plan.write(&path.join("blocks.json")).expect("a plan");
    merge(path, &["block b00: it was trained for another plan", "block b01: it was trained for another plan"]);
    fails(&["blocks", "run", name(path)], 3, &["another plan", "--overwrite"]);
    assert_eq!(states(path), ["stale"; 3]);
}

#[test]
fn a_stale_block_is_trained_again_when_asked() {
    if common::gpu().is_none() {
        return;
    }
    let folder = copy();
    let path = folder.path();
    let bytes = fs::read(model(path, "b01")).expect("a model");
    fs::write(model(path, "b01"), &bytes[..bytes.len() / 2]).expect("a file");
    fails(&["blocks", "run", name(path)], 3, &["has changed", "--overwrite"]);
    works(&["blocks", "run", name(path), "--overwrite"]);
    let read = |of: &Path| fs::read(model(of, "b01")).expect("a model");
    assert!(read(path) == read(trained().path()), "the model differs from the first one");
}

#[test]
fn a_share_begins_with_a_common_coarse_model() {
    if common::gpu().is_none() {
        return;
    }
    let folder = planned(&scene().plan);
    let path = folder.path();
    fails(&["blocks", "run", name(path), "--share", "1/2"], 2, &["coarse model", "--block global"]);
    fails(&["blocks", "run", name(path), "--share", "3/2"], 2, &["1/2"]);
    fails(&["blocks", "run", name(path), "--block", "b07"], 2, &["b00, b01 and global"]);
    let folder = copy();
    fs::remove_dir_all(folder.path().join("blocks")).expect("a folder");
    let output = command(&["blocks", "run", name(folder.path()), "--share", "2/2"]).output().expect("an end");
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(states(folder.path()), ["done", "waiting", "done"]);
}

#[test]
fn a_block_needs_the_files_of_its_own_photographs_only() {
    if common::gpu().is_none() {
        return;
    }
    let folder = copy();
    fs::remove_dir_all(folder.path().join("blocks/b00")).expect("a folder");
    let data = tempfile::tempdir().expect("a temporary folder");
    let own: BTreeSet<&str> = scene().plan.blocks[0].photographs.iter().map(|one| one.name.as_str()).collect();
    for entry in ["images", "sparse/0"] {
        fs::create_dir_all(data.path().join(entry)).expect("a folder");
        for file in fs::read_dir(scene().data.join(entry)).expect("a folder").flatten() {
            let name = file.file_name();
            if entry != "images" || own.contains(name.to_str().expect("a name")) {
                fs::copy(file.path(), data.path().join(entry).join(name)).expect("a copy");
            }
        }
    }
    works(&["blocks", "run", name(folder.path()), "--block", "b00", "--data", name(data.path())]);
    let read = |of: &Path| fs::read(model(of, "b00")).expect("a model");
    assert!(read(folder.path()) == read(trained().path()), "the model differs from that of the whole dataset's folder");
}

#[test]
fn a_photograph_that_has_changed_since_the_plan_is_refused() {
    if common::gpu().is_none() {
        return;
    }
    let folder = copy();
    let path = folder.path();
    fs::remove_dir_all(path.join("blocks/b00")).expect("a folder");
    let data = copy_of(&scene().data);
    let file = data.path().join("images").join(&scene().plan.blocks[0].photographs[1].name);
    let bytes = fs::read(&file).expect("a photograph");
    let mut other = bytes.clone();
    other[bytes.len() / 2] ^= 1;
    for changed in [other, [bytes.as_slice(), b" "].concat()] {
        fs::write(&file, changed).expect("written");
        let run = |block: &str, words: &[&str]| {
            fails(&["blocks", "run", name(path), "--block", block, "--data", name(data.path())], 3, words);
        };
        run("b00", &[name(&file), "has changed since the plan was made", "plan anew", "--data"]);
        assert_eq!(states(path), ["done", "waiting", "done"]);
        let begun = planned(&scene().plan);
        fails(&["blocks", "run", name(begun.path()), "--data", name(data.path())], 3, &[name(&file), "has changed"]);
    }
}

#[test]
fn a_merged_model_that_memory_cannot_hold_is_not_scored() {
    if common::gpu().is_none() {
        return;
    }
    let folder = copy();
    let path = folder.path();
    // That much host memory would hold the photographs.
    for (option, bytes, memory) in
        [("--max-device-memory", "100KB", "device memory"), ("--host-memory", "130MB", "host memory")]
    {
        fs::write(path.join("metrics.json"), "{}").expect("written");
        let said = works(&["blocks", "merge", name(path), option, bytes]);
        for word in ["warning: the merged model is whole, and is not scored", memory, "psrgs-vk eval", option] {
            assert!(said.contains(word), "no `{word}` in {said}");
        }
        assert!(ply::read(&path.join("point_cloud.ply")).expect("a model").gaussians.len() > 200);
        assert!(!path.join("metrics.json").exists(), "scores of an earlier merge are left");
    }
}
