//! Faults from outside a training, except those of disks: photographs that vanish, a device that is lost or too small,
//! a second run in the folder.
#![cfg(unix)]

use std::fs;
use std::path::{Path, PathBuf};

use psrgs_vk::format::checkpoint;

use crate::run::{Running, command, content, copy_folder, copy_of, fails, psrgs, shared, stderr, strs, text, works};
use crate::training::same_model;

/// Options of a run that saves often and logs each checkpoint.
const SAVES: [&str; 3] = ["--checkpoint-every", "15", "-v"];

fn with(mut args: Vec<String>, more: &[&str]) -> Vec<String> {
    args.extend(more.iter().map(|arg| (*arg).to_owned()));
    args
}

/// The step of the newest checkpoint. Panics where that checkpoint is damaged.
#[track_caller]
fn saved(out: &Path) -> u64 {
    let found = checkpoint::latest(&out.join("checkpoints")).expect("readable").expect("a checkpoint");
    assert!(found.damaged.is_empty());
    found.step
}

/// Optimised builds have no option to keep no photographs in memory.
#[cfg(debug_assertions)]
#[test]
fn missing_photographs_end_a_training_that_reads_them_again() {
    let Some(shared) = shared() else { return };
    type Damage = fn(&Path);
    let cases: [(Damage, &str); 2] = [
        (|images| fs::rename(images, images.with_extension("away")).expect("moved"), "No such file"),
        (
            |images| {
                copy_folder(images, &images.with_extension("away"));
                for name in (0..9).map(|i| images.join(format!("view_{i:04}.jpg"))) {
                    let bytes = fs::read(&name).expect("a photograph");
                    // Replaced by renaming, so that the file is never missing.
                    let cut = images.join("cut");
                    fs::write(&cut, &bytes[..bytes.len() / 2]).expect("written");
                    fs::rename(cut, name).expect("moved");
                }
            },
            "pixels at byte",
        ),
    ];
    for (damage, words) in cases {
        let data = copy_of(&shared.data());
        let (images, out) = (data.path().join("images"), data.path().join("run"));
        let mut args = with(shared.train(&out), &SAVES);
        args[1] = text(data.path()).to_owned();
        let mut running = Running::new(&strs(&with(args, &["--keep-no-photographs"])));
        running.until("step 15: saved");
        damage(&images);
        let (code, said) = running.end();
        assert_eq!(code, Some(3), "{said}");
        let told =
            said.lines().rev().take(2).any(|line| line.contains("saved up to step") && line.contains("--resume"));
        assert!(told && said.contains("images/view_") && said.contains(words), "{said}");
        assert!(saved(&out) >= 15 && !out.join("point_cloud.ply").exists(), "{said}");

        // A resumption without the photographs fails and changes no file. With them the run ends with the same model.
        let before = content(&out);
        let output = psrgs(&["train", "--resume", text(&out)]);
        assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
        assert!(content(&out) == before, "a failed resumption has changed a file");
        fs::remove_dir_all(&images).ok();
        fs::rename(images.with_extension("away"), &images).expect("moved back");
        works(&["train", "--resume", text(&out), "-q"]);
        same_model(shared, &out, "resumed with the photographs");
    }
}

#[test]
fn photographs_that_go_away_do_no_harm_where_they_are_held() {
    let Some(shared) = shared() else { return };
    let data = copy_of(&shared.data());
    let out = data.path().join("run");
    let mut args = with(shared.train(&out), &SAVES);
    args[1] = text(data.path()).to_owned();
    let mut running = Running::new(&strs(&args));
    running.until("step 15: saved");
    fs::remove_dir_all(data.path().join("images")).expect("removed");
    let (code, said) = running.end();
    assert_eq!(code, Some(0), "{said}");
    same_model(shared, &out, "trained on without the files");
    assert!(out.join("report.html").exists());
}

/// Optimised builds have no option to lose a device.
#[cfg(debug_assertions)]
#[test]
fn a_lost_device_ends_the_training_and_it_goes_on() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    let args = with(shared.train(&out), &[&SAVES[..], &["--lose-device-at", "40"]].concat());
    fails(&strs(&args), 6, &["device lost in vk", "recordings", "saved up to step 30", "--resume"]);
    assert!(saved(&out) == 30 && !out.join("point_cloud.ply").exists());
    // The device is lost at the first step, before anything is saved.
    let none = folder.path().join("none");
    let args = with(shared.train(&none), &["--lose-device-at", "1"]);
    fails(&strs(&args), 6, &["device lost", "no checkpoint"]);
    works(&["train", "--resume", text(&out), "-q"]);
    same_model(shared, &out, "resumed with the device back");
}

#[test]
fn a_second_run_in_the_same_folder_touches_nothing() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    let args = with(shared.train(&out), &SAVES);
    let mut running = Running::new(&strs(&args));
    running.until("step 15: saved");
    // The first run is stopped, so that only the second run could change files.
    running.signal("-STOP");
    let before = content(&out);
    let words = [text(&out), "another run is writing here", "another --out"];
    fails(&strs(&args), 2, &words);
    fails(&strs(&with(args.clone(), &["--overwrite"])), 2, &words);
    fails(&["train", "--resume", text(&out)], 2, &[text(&out), "another run is writing here", "wait for its end"]);
    assert!(content(&out) == before, "the second run has changed a file");
    running.signal("-CONT");
    let (code, said) = running.end();
    assert_eq!(code, Some(0), "{said}");
    same_model(shared, &out, "with others that wanted the folder");
}

#[test]
fn a_run_that_fails_to_start_leaves_the_earlier_run_whole() {
    let Some(shared) = shared() else { return };
    let data = copy_of(&shared.data());
    let out = data.path().join("run");
    copy_folder(&shared.run(), &out);
    let before = content(&out);
    let again = |more: &[&str]| with(vec!["train".into(), text(data.path()).into()], more);
    let over = ["--out", text(&out), "--iterations", "3", "--overwrite"];
    fails(&strs(&again(&[&over[..], &["--max-device-memory", "100K"]].concat())), 5, &["out of device memory"]);
    fails(&strs(&again(&[&over[..], &["--init", "none.ply"]].concat())), 3, &["none.ply"]);
    fails(&strs(&again(&[&over[..], &["--device", "no such device"]].concat())), 4, &["no such device"]);
    fs::write(data.path().join("images/view_0001.jpg"), "no picture").expect("written");
    fails(&strs(&again(&over)), 3, &["view_0001.jpg"]);
    assert!(content(&out) == before, "a run that failed has changed a file");
}

/// A resumed run takes its splats from the checkpoint.
#[test]
fn a_run_goes_on_without_the_file_that_it_began_with() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (init, out) = (folder.path().join("first.ply"), folder.path().join("run"));
    fs::copy(shared.run().join("point_cloud.ply"), &init).expect("copied");
    works(&[
        "train",
        text(&shared.data()),
        "--init",
        text(&init),
        "--iterations",
        "2",
        "--scale-schedule=false",
        "--out",
        text(&out),
    ]);
    fs::remove_file(&init).expect("removed");
    let said = works(&["train", "--resume", text(&out), "--iterations", "3"]);
    assert!(said.contains("going on after step 2"), "{said}");
}

/// Splats that swell until their pairs no longer fit.
#[test]
fn running_out_of_device_memory_ends_training_with_a_checkpoint() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    let data = shared.data();
    let swelling = ["--method", "3dgs", "--deterministic", "--no-densify", "--lr-scales", "0.3", "--iterations", "60"];
    let run = |limit: u64| {
        let limit = limit.to_string();
        let ends = ["train", text(&data), "--out", text(&out), "--overwrite", "-q", "--max-device-memory", &limit];
        psrgs(&[&ends[..], &swelling].concat())
    };
    // The message has the bytes that the start needs. The further bytes of the pairs before splats swell are found by
    // trying.
    let said = stderr(&run(1 << 16));
    let needs = said.split("the training needs ").nth(1).and_then(|rest| rest.split(',').next()).unwrap_or_default();
    let (number, unit) = needs.split_once(' ').unwrap_or_else(|| panic!("no size: {said}"));
    let unit = ["KiB", "MiB"].iter().position(|u| *u == unit).map(|k| 1024_f64.powi(k as i32 + 1)).expect("a unit");
    let least = (number.parse::<f64>().expect("a number") * unit) as u64;
    let tried = (1..16).map(|more| least + more * (64 << 10)).map(|limit| (limit, run(limit)));
    let late = tried.into_iter().find(|(_, output)| stderr(output).contains("is saved in"));
    let (limit, output) = late.expect("a limit that is reached during training");
    let said = stderr(&output);
    println!("{limit} bytes: {said}");
    assert_eq!(output.status.code(), Some(5), "{said}");
    for word in ["no room for", "(splat, tile) pairs", "--max-device-memory", "is saved in", "--resume"] {
        assert!(said.contains(word), "does not say `{word}`: {said}");
    }
    let step = saved(&out);
    assert!((1..60).contains(&step) && !out.join("point_cloud.ply").exists());
    let said = works(&["train", "--resume", text(&out), "--max-device-memory", "1G"]);
    assert!(said.contains(&format!("going on after step {step}")), "{said}");
    assert!(out.join("point_cloud.ply").exists());
}

/// The newest checkpoint is damaged, then both are.
#[test]
fn a_damaged_checkpoint_is_told_and_the_one_before_it_taken() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    let mut running = Running::new(&strs(&with(shared.train(&out), &SAVES)));
    running.until("step 30: saved");
    running.signal("-KILL");
    running.end();
    let files: Vec<PathBuf> = content(&out.join("checkpoints")).into_keys().filter(|f| is_checkpoint(f)).collect();
    let [more @ .., older, newest] = files.as_slice() else { panic!("{files:?}") };
    // As after a kill before the oldest checkpoint was removed.
    more.iter().for_each(|file| fs::remove_file(file).expect("removed"));
    let cut = |file: &Path| {
        let whole = fs::read(file).expect("a checkpoint");
        fs::write(file, &whole[..whole.len() / 2]).expect("written");
        whole
    };
    cut(newest);
    let kept = cut(older);
    let names = [older, newest].map(|file| file.file_name().and_then(|name| name.to_str()).expect("a name"));
    let before = content(&out);
    fails(&["train", "--resume", text(&out)], 3, &["none of the checkpoints can be read", names[0], names[1]]);
    assert!(content(&out) == before, "a failed resumption has changed a file");
    fs::write(older, kept).expect("written");
    let said = works(&["train", "--resume", text(&out)]);
    assert!(said.contains(&format!("warning: {}", newest.display())), "{said}");
    assert!(said.contains("going on after step") && said.contains(names[0]), "{said}");
    same_model(shared, &out, "resumed from the older checkpoint");
}

fn is_checkpoint(file: &Path) -> bool {
    file.extension().is_some_and(|e| e == "ckpt")
}

/// Compiled pipelines and timings are cached between runs where the cache can be written.
#[test]
fn a_cache_that_cannot_be_written_does_not_stop_a_training() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, out, file) = (shared.data(), folder.path().join("run"), folder.path().join("file"));
    fs::write(&file, "").expect("written");
    let args = ["train", text(&data), "--out", text(&out), "--iterations", "3", "-q", "--tune", "again"];
    let output = command(&args).env("PSRGS_CACHE", file.join("cache")).output().expect("the command starts");
    let said = stderr(&output);
    assert!(output.status.success() && said.contains("could not be kept") && said.contains("file/cache"), "{said}");
    assert!(out.join("point_cloud.ply").exists());
}

/// A changed setting that no step depends on is used and logged. Any other change is refused with both values, and
/// the files of the run stay.
#[test]
fn an_edited_settings_file_is_compared_with_the_checkpoint() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    let mut running = Running::new(&strs(&with(shared.train(&out), &SAVES)));
    running.until("step 30: saved");
    running.signal("-KILL");
    running.end();
    let file = out.join("settings.toml");
    let settings = fs::read_to_string(&file).expect("settings");
    let edit = |from: &str, to: &str| {
        assert!(settings.contains(from), "{settings}");
        fs::write(&file, settings.replace(from, to)).expect("written");
    };
    let resume = ["train", "--resume", text(&out)];
    for (from, to, words) in [
        ("seed = 3", "seed = 4", ["seed is 4 and was 3", ".ckpt"]),
        ("densify-until = 120", "densify-until = 110", ["densify-until is 110 and was 120", ".ckpt"]),
        // Fewer steps than were trained.
        ("iterations = 150", "iterations = 20", ["--iterations 20", "at step"]),
    ] {
        edit(from, to);
        let before = content(&out);
        fails(&resume, 2, &words);
        assert!(content(&out) == before, "a refused resumption has changed a file");
    }
    edit("eval-every = ", "eval-every = 1");
    let said = works(&resume);
    assert!(said.contains("eval-every is 1") && said.contains("from here on, and was"), "{said}");
    same_model(shared, &out, "resumed with another setting that no step depends on");
}

/// From a learning rate that is too high, and from a checkpoint with changed values.
#[test]
fn splats_that_are_not_finite_do_not_reach_the_model() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    copy_folder(&shared.run(), &out);
    let spoil = |values: &mut dyn FnMut(&mut Vec<f32>)| {
        let mut found = checkpoint::latest(&out.join("checkpoints")).expect("readable").expect("a checkpoint");
        let mut means: Vec<f32> = found.checkpoint.values("means").expect("means");
        values(&mut means);
        found.checkpoint.put_values("means", &means);
        found.checkpoint.write(&found.file).expect("written");
        means.len() / 3
    };
    let all = spoil(&mut |means| (means[4], means[30]) = (f32::NAN, f32::INFINITY));
    let said = works(&["train", "--resume", text(&out)]);
    let all = psrgs_vk::numbers::grouped(all);
    assert!(said.contains(&format!("2 of {all} splats have values that are not finite")), "{said}");
    let (model, data, pictures) = (out.join("point_cloud.ply"), shared.data(), folder.path().join("pictures"));
    works(&["render", text(&model), "--cameras", text(&data), "--out", text(&pictures), "--strict"]);
    // The earlier model stays where the new one cannot be written.
    let before = fs::read(&model).expect("a model");
    spoil(&mut |means| means.fill(f32::NAN));
    fails(&["train", "--resume", text(&out)], 8, &["point_cloud.ply", "none of", "finite"]);
    assert!(fs::read(&model).expect("a model") == before);
}
