//! Plans of blocks: on a made-up flight, and on datasets with next to nothing in them.

mod colmap_folder;
mod common;

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use colmap_folder::{CameraRow, Folder, ImageRow, PINHOLE, PointRow};
use psrgs_vk::blocks::{self, Count, Error, Limit, PlanFile, PlanRequest, Planned};
use psrgs_vk::dataset::{Dataset, HostShare, LoadOptions, Role, Split};
use psrgs_vk::scene::random::Random;
use psrgs_vk::train::Settings;
use psrgs_vk::vk::Gpu;

/// Pixels of the sides of a photograph.
const SIZE: [u64; 2] = [48, 32];

/// Cameras at `centers` that look down onto `points`; each point has a track of the photographs that see it.
fn flight(centers: &[[f64; 3]], points: &[[f64; 3]]) -> Folder {
    let focal = 40.0;
    let sees = |center: &[f64; 3], point: &[f64; 3]| {
        let depth = center[2] - point[2];
        let at = |k: usize, side: u64| (point[k] - center[k]).abs() * focal / depth < 0.5 * side as f64 - 0.01;
        depth > 0.0 && at(0, SIZE[0]) && at(1, SIZE[1])
    };
    let image = |(i, c): (usize, &[f64; 3])| ImageRow {
        id: i as u32 + 1,
        quaternion: [0.0, 1.0, 0.0, 0.0],
        translation: [-c[0], c[1], c[2]],
        camera: 1,
        name: format!("p{i:04}.png"),
        keypoints: Vec::new(),
    };
    let point = |(i, p): (usize, &[f64; 3])| {
        let seen = centers.iter().enumerate().filter(|(_, center)| sees(center, p));
        let track = seen.map(|(k, _)| (k as u32 + 1, 0)).collect();
        let colour = [i % 250, i * 7 % 250, 90].map(|v| v as u8);
        PointRow { id: i as u64 + 1, position: *p, colour, error: 0.3, track }
    };
    let params = vec![focal, focal, 0.5 * SIZE[0] as f64, 0.5 * SIZE[1] as f64];
    Folder {
        cameras: vec![CameraRow { id: 1, model: PINHOLE, size: SIZE, params }],
        images: centers.iter().enumerate().map(image).collect(),
        points: points.iter().enumerate().map(point).collect(),
    }
}

/// Cameras in rows `step` apart over a site of `sides`, 10 above the ground.
fn rows(sides: [f64; 2], step: f64) -> Vec<[f64; 3]> {
    let [columns, lines] = sides.map(|side| (side / step) as usize + 1);
    (0..columns * lines).map(|k| [step * (k % columns) as f64, step * (k / columns) as f64, 10.0]).collect()
}

fn ground(count: usize, sides: [f64; 2]) -> Vec<[f64; 3]> {
    let mut random = Random::new(3);
    (0..count).map(|_| [sides[0] * random.unit(), sides[1] * random.unit(), 0.2 * random.unit()]).collect()
}

struct Scene {
    folder: tempfile::TempDir,
    dataset: Dataset,
}

fn scene(folder: &Folder) -> Scene {
    let folder = folder.dataset(false);
    let dataset = Dataset::load(folder.path(), &LoadOptions::default()).expect("a dataset");
    Scene { folder, dataset }
}

fn settings() -> Settings {
    let mut settings = Settings::of_method(psrgs_vk::train::settings::Method::Psrgs);
    settings.run.iterations = 1000;
    settings
}

fn plan(gpu: &Gpu, dataset: &Dataset, count: Count) -> Result<Planned, Error> {
    let settings = settings();
    let share = HostShare::unlimited();
    let request = PlanRequest { dataset, settings: &settings, count, margin: 0.1, share, timed: false };
    blocks::plan(gpu, &request)
}

fn planned(gpu: &Gpu, folder: &Folder, blocks: usize) -> Planned {
    let planned = plan(gpu, &scene(folder).dataset, Count::Blocks(blocks)).expect("a plan");
    let written = tempfile::tempdir().expect("a folder");
    let file = written.path().join("blocks.json");
    planned.file.write(&file).expect("written");
    assert_eq!(PlanFile::read(&file).expect("read"), planned.file);
    let svg = blocks::picture(&planned);
    assert!(svg.starts_with("<svg") && !svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    planned
}

fn names(plan: &PlanFile) -> BTreeSet<&str> {
    plan.blocks.iter().flat_map(|block| &block.photographs).map(|photograph| photograph.name.as_str()).collect()
}

#[test]
fn blocks_of_a_flight_have_equal_work_and_their_own_photographs() {
    let Some(gpu) = common::gpu() else { return };
    let sides = [60.0, 40.0];
    let scene = scene(&flight(&rows(sides, 4.0), &ground(3000, sides)));
    let planned = plan(&gpu, &scene.dataset, Count::Blocks(4)).expect("a plan");
    let blocks = &planned.file.blocks;
    assert_eq!(blocks.iter().map(|block| block.id.as_str()).collect::<Vec<_>>(), ["b00", "b01", "b02", "b03"]);
    let mean = blocks.iter().map(|block| block.predicted_splats as f64).sum::<f64>() / 4.0;
    assert!(blocks.iter().all(|block| (block.predicted_splats as f64 / mean - 1.0).abs() < 0.25));
    // Each photograph to train on is in one block at least, none held out in any; few are in more than two.
    let train: BTreeSet<&str> = scene.dataset.views_of(Role::Train).map(|(_, view)| view.name.as_str()).collect();
    assert_eq!(names(&planned.file), train);
    assert!(train.len() < scene.dataset.views.len(), "nothing is held out");
    let looks: usize = blocks.iter().map(|block| block.photographs.len()).sum();
    assert!(looks < train.len() * 2, "{looks} of {}", train.len());
    for block in blocks {
        let wanted = 1000.0 * block.photographs.len() as f64 / train.len() as f64;
        assert!((f64::from(block.steps) - wanted).abs() <= 1.0, "{} steps, {wanted} wanted", block.steps);
        let best = block.photographs.iter().map(|photograph| photograph.share).fold(0.0, f64::max);
        assert!(best > 0.9, "{best}");
    }
    let (sha256, bytes) = blocks::sha256_of(&scene.folder.path().join("images/p0001.png")).expect("a file");
    let records = blocks.iter().flat_map(|block| &block.photographs);
    let record = records.clone().find(|record| record.name == "p0001.png").expect("in a block");
    assert_eq!((&record.sha256, record.bytes), (&sha256, bytes));
    assert_eq!(record.file.as_deref(), Some("images/p0001.png"));
    let files: Vec<&str> = planned.file.dataset.files.iter().map(|file| file.name.as_str()).collect();
    assert_eq!(files, ["sparse/0/cameras.bin", "sparse/0/images.bin", "sparse/0/points3D.bin"]);
    assert_eq!(blocks::model_sha256(&scene.dataset).expect("files"), planned.file.dataset.model_sha256);
}

/// The plan has the records of photographs in its blocks, so the coarse model has none but those.
#[test]
fn photographs_that_see_no_point_are_in_no_part_of_a_plan() {
    let Some(gpu) = common::gpu() else { return };
    let sides = [60.0, 40.0];
    let mut centers = rows(sides, 4.0);
    // Beside the site; the first one is held out.
    centers.extend([[67.0, 20.0, 10.0], [67.0, 22.0, 10.0]]);
    let planned = planned(&gpu, &flight(&centers, &ground(3000, sides)), 4);
    let global: BTreeSet<&str> = planned.file.global.photographs.iter().map(String::as_str).collect();
    assert_eq!(planned.blind, 1);
    assert!(!global.contains("p0177.png") && global.contains("p0175.png"), "{global:?}");
    assert_eq!(global, names(&planned.file));
}

#[test]
fn a_photograph_or_mask_that_has_changed_is_found() {
    let Some(gpu) = common::gpu() else { return };
    let folder = flight(&rows([20.0, 10.0], 5.0), &ground(200, [20.0, 10.0])).dataset(false);
    let file = |name: &str| folder.path().join(name);
    std::fs::create_dir(file("masks")).expect("a folder");
    let [photograph, mask, new] = ["images/p0001.png", "masks/p0001.png.png", "masks/p0002.png.png"].map(file);
    image::GrayImage::from_pixel(48, 32, image::Luma([255])).save(&mask).expect("written");
    let load = || Dataset::load(folder.path(), &LoadOptions::default()).expect("a dataset");
    let planned = plan(&gpu, &load(), Count::Blocks(1)).expect("a plan").file.blocks.remove(0).photographs;
    assert!(planned.iter().any(|one| one.mask.is_some()), "the mask is not in the plan");
    let changed = || blocks::changed_photograph(&load(), &planned).expect("files");
    let with = |of: &Path, bytes: &[u8]| {
        let before = std::fs::read(of).ok();
        std::fs::write(of, bytes).expect("written");
        let found = changed();
        match before {
            Some(before) => std::fs::write(of, before).expect("written"),
            None => std::fs::remove_file(of).expect("removed"),
        }
        found
    };
    assert_eq!(changed(), None);
    // Of equal length, so only the content tells.
    for of in [&photograph, &mask] {
        let mut bytes = std::fs::read(of).expect("a file");
        *bytes.last_mut().expect("a byte") ^= 1;
        assert_eq!(with(of, &bytes).as_ref(), Some(of));
    }
    assert_eq!(with(&new, &std::fs::read(&mask).expect("a mask")).as_ref(), Some(&new));
    std::fs::remove_file(&mask).expect("removed");
    assert_eq!(changed(), Some(mask));
    assert_eq!(blocks::changed_photograph(&load(), &[]).expect("files"), None);
}

#[test]
fn the_same_dataset_gives_the_same_plan() {
    let Some(gpu) = common::gpu() else { return };
    let sides = [30.0, 20.0];
    let scene = scene(&flight(&rows(sides, 5.0), &ground(400, sides)));
    let of = || plan(&gpu, &scene.dataset, Count::Blocks(3)).expect("a plan").file;
    assert_eq!(of(), of());
}

#[test]
fn a_limit_gives_the_fewest_blocks_that_keep_to_it() {
    let Some(gpu) = common::gpu() else { return };
    let sides = [60.0, 40.0];
    let scene = scene(&flight(&rows(sides, 5.0), &ground(1500, sides)));
    let of = |count| plan(&gpu, &scene.dataset, count);
    let four = of(Count::Blocks(4)).expect("a plan").file;
    let most = four.blocks.iter().map(|block| block.predicted_splats).max().expect("blocks");
    let splats = of(Count::Within(Limit::Splats(most))).expect("a plan").file;
    assert!((2..=4).contains(&splats.blocks.len()));
    assert!(splats.blocks.iter().all(|block| block.predicted_splats <= most));
    let bytes = four.blocks.iter().map(|block| block.predicted_memory).max().expect("blocks");
    let memory = of(Count::Within(Limit::Memory(bytes))).expect("a plan").file;
    assert!((2..=4).contains(&memory.blocks.len()));
    assert!(memory.blocks.iter().all(|block| block.predicted_memory <= bytes));
    for tiny in [Limit::Splats(1), Limit::Memory(4096)] {
        let error = of(Count::Within(tiny)).expect_err("too small").to_string();
        assert!(error.contains("too few for any number of blocks") && error.contains("1"), "{error}");
    }
}

#[test]
fn fewer_photographs_than_blocks_are_planned() {
    let Some(gpu) = common::gpu() else { return };
    let one = planned(&gpu, &flight(&[[0.0, 0.0, 10.0], [0.5, 0.0, 10.0]], &ground(60, [2.0, 2.0])), 4);
    assert_eq!(names(&one.file).len(), 1, "one of two is held out");
    assert!(one.file.blocks.iter().all(|block| block.photographs.len() == 1));
    let all = Split::None;
    let folder = flight(&[[0.0, 0.0, 10.0]], &ground(60, [2.0, 2.0])).dataset(false);
    let options = LoadOptions { split: all, ..LoadOptions::default() };
    let dataset = Dataset::load(folder.path(), &options).expect("a dataset");
    assert_eq!(plan(&gpu, &dataset, Count::Blocks(2)).expect("a plan").file.blocks.len(), 2);
}

#[test]
fn collinear_cameras_and_points_make_strips() {
    let Some(gpu) = common::gpu() else { return };
    let centers: Vec<[f64; 3]> = (0..20).map(|k| [2.0 * f64::from(k), 2.0 * f64::from(k), 10.0]).collect();
    let points: Vec<[f64; 3]> = (0..400).map(|k| [0.1 * f64::from(k), 0.1 * f64::from(k), 0.0]).collect();
    let plan = planned(&gpu, &flight(&centers, &points), 4).file;
    assert_eq!(plan.blocks.len(), 4);
    assert!(plan.blocks.iter().all(|block| !block.photographs.is_empty() && block.margin > 0.0));
}

#[test]
fn cameras_in_one_place_and_points_in_one_place_are_planned() {
    let Some(gpu) = common::gpu() else { return };
    let here = planned(&gpu, &flight(&[[1.0, 1.0, 10.0]; 9], &ground(200, [3.0, 3.0])), 3).file;
    assert_eq!(here.blocks.len(), 3);
    // Points in two places alone are none to begin on: the plan goes by random ones, as a training would.
    let two: Vec<[f64; 3]> = (0..60).map(|k| [f64::from(k % 2), 0.0, 0.0]).collect();
    let few = plan(&gpu, &scene(&flight(&rows([3.0, 3.0], 1.0), &two)).dataset, Count::Blocks(9)).expect("a plan").file;
    assert!(few.blocks.len() == 9 && few.blocks.iter().all(|block| !block.photographs.is_empty()), "{few:?}");
}

#[test]
fn a_dataset_without_points_is_cut_by_its_common_view() {
    let Some(gpu) = common::gpu() else { return };
    let mut folder = flight(&rows([20.0, 10.0], 2.5), &[]);
    let plan = planned(&gpu, &folder, 2).file;
    assert_eq!(plan.blocks.len(), 2);
    folder.images.truncate(1);
    let alone = folder.dataset(false);
    let options = LoadOptions { split: Split::None, ..LoadOptions::default() };
    let dataset = Dataset::load(alone.path(), &options).expect("a dataset");
    let error = plan_error(&gpu, &dataset);
    assert!(error.contains("nothing says how to cut the ground"), "{error}");
}

fn plan_error(gpu: &Gpu, dataset: &Dataset) -> String {
    plan(gpu, dataset, Count::Blocks(2)).expect_err("there is nothing to cut by").to_string()
}

/// As in a map's grid: UTM coordinates, and coordinates in which a metre is the last digit of a number.
#[test]
fn huge_coordinates_are_cut_as_small_ones_are() {
    let Some(gpu) = common::gpu() else { return };
    let sides = [40.0, 30.0];
    let (centers, points) = (rows(sides, 4.0), ground(800, sides));
    let at = |offset: [f64; 3]| {
        let moved = |all: &[[f64; 3]]| -> Vec<[f64; 3]> {
            all.iter().map(|p| std::array::from_fn(|k| p[k] + offset[k])).collect()
        };
        let mut folder = flight(&centers, &points);
        let there = flight(&moved(&centers), &moved(&points));
        for (row, moved) in folder.points.iter_mut().zip(there.points) {
            row.position = moved.position;
        }
        folder.images = there.images;
        planned(&gpu, &folder, 4).file
    };
    let near = at([0.0; 3]);
    let far = at([5e5, 4.6e6, 100.0]);
    assert_eq!(near.blocks.len(), far.blocks.len());
    for (a, b) in near.blocks.iter().zip(&far.blocks) {
        assert!((a.predicted_splats as f64 / b.predicted_splats as f64 - 1.0).abs() < 0.02, "{a:?}\n{b:?}");
        assert!((a.photographs.len() as i64 - b.photographs.len() as i64).abs() <= 2);
    }
    assert_eq!(at([1e9, -3e9, 0.0]).blocks.len(), 4);
}

#[test]
fn a_cell_that_few_photographs_see_gets_them_all_the_same() {
    let Some(gpu) = common::gpu() else { return };
    // Far photographs of everything, and one near one of a corner.
    let mut centers: Vec<[f64; 3]> = (0..8).map(|k| [20.0 + 0.5 * f64::from(k), 15.0, 60.0]).collect();
    // Not the first or the ninth, which are held out.
    centers.insert(3, [2.0, 2.0, 3.0]);
    let plan = planned(&gpu, &flight(&centers, &ground(1200, [40.0, 30.0])), 9).file;
    assert_eq!(plan.blocks.len(), 9);
    let near = |block: &&blocks::Block| block.photographs.iter().any(|one| one.name == "p0003.png");
    assert_eq!(plan.blocks.iter().filter(near).count(), 1, "{plan:?}");
    assert!(plan.blocks.iter().all(|block| block.photographs.len() >= 3), "{plan:?}");
}

/// Runs `blocks plan`: exit code and what it says.
fn command(data: &Path, out: &Path, more: &[&str]) -> (Option<i32>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_psrgs-vk"));
    command.args(["blocks", "plan"]).arg(data).arg("--out").arg(out).args(["--iterations", "100"]).args(more);
    let output = command.output().expect("started");
    let text = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    (output.status.code(), text)
}

#[test]
fn the_command_writes_a_plan_once_and_names_its_blocks() {
    if common::gpu().is_none() {
        return;
    }
    let sides = [30.0, 20.0];
    let data = flight(&rows(sides, 5.0), &ground(300, sides)).dataset(false);
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("plan");
    let (code, text) = command(data.path(), &out, &["--blocks", "2", "--margin", "0.2", "--set", "sample-rate=0.3"]);
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("b00 ") && text.contains("b01 ") && text.contains("share of work"), "{text}");
    let plan = PlanFile::read(&out.join("blocks.json")).expect("a plan");
    let settings = plan.settings().expect("settings");
    assert_eq!((settings.run.iterations, settings.density.sample_rate), (100, 0.3));
    assert!(settings.data.is_some_and(|data| data.is_absolute()));
    assert!(std::fs::read_to_string(out.join("plan.svg")).expect("a drawing").contains("b01"));
    let (code, text) = command(data.path(), &out, &["--blocks", "3"]);
    assert!(code == Some(2) && text.contains("--overwrite"), "{code:?} {text}");
    let (code, text) = command(data.path(), &out, &["--blocks", "2", "--overwrite"]);
    let default = PlanFile::read(&out.join("blocks.json")).expect("a plan").blocks;
    // Cells are not quite the same with another margin.
    let wider = plan.blocks[0].margin / default[0].margin;
    assert!(code == Some(0) && (1.5..2.5).contains(&wider), "{wider} {code:?} {text}");
    let (code, text) = command(data.path(), &out, &["--blocks", "3", "--overwrite"]);
    assert_eq!((code, PlanFile::read(&out.join("blocks.json")).expect("a plan").blocks.len()), (Some(0), 3), "{text}");
    // A file of somebody else stays.
    std::fs::write(out.join("blocks.json"), "{\"blocks\": 7}").expect("written");
    let (code, text) = command(data.path(), &out, &["--blocks", "3", "--overwrite"]);
    assert!(code == Some(2) && text.contains("blocks.json"), "{code:?} {text}");
    let (code, text) = command(data.path(), &folder.path().join("other"), &[]);
    assert!(code == Some(2) && text.contains("how many blocks"), "{code:?} {text}");
    assert!(!folder.path().join("other").exists(), "a folder was left behind");
}
