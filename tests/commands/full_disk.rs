//! Disks that are full or read-only, and folders that vanish: exit code 8 and a message with file and reason. Saved
//! checkpoints stay, and with room on the disk the training resumes to the same bits.
#![cfg(unix)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use psrgs_vk::format::checkpoint;

use crate::common;
use crate::run::{Running, command, content, copy_folder, fails, psrgs, shared, stderr, strs, text, works};
use crate::small_disk::{Disk, PAGE, on_disk};
use crate::training::same_model;

const FULL: &str = "No space left on device";

/// Checks that `out` has no half-written file under any name.
#[track_caller]
fn nothing_half_written(out: &Path) {
    let left: Vec<PathBuf> = content(out).into_keys().filter(|f| f.extension().is_some_and(|e| e == "tmp")).collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn a_disk_that_fills_up_while_saving_costs_no_checkpoint() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let first = folder.path().join("first");
    works(&strs(&shared.train_for(15, &first, &["-q"])));
    let bytes = fs::metadata(first.join("checkpoints").join(checkpoint::file_name(15))).expect("the last step").len();

    // Room for two checkpoints; the third is written before the oldest is removed.
    const BALLAST: u64 = 24 << 20;
    let Some(disk) = Disk::of(BALLAST + on_disk(5 * bytes / 2) + 4 * PAGE) else { return };
    let ballast = disk.ballast(BALLAST);
    let out = disk.path().join("run");
    let mut args = shared.train(&out);
    args.extend(["--checkpoint-every", "15", "-v"].map(str::to_owned));
    fails(&strs(&args), 8, &["checkpoint-0000", FULL, "make room", "saved up to step", "--resume"]);
    nothing_half_written(&out);
    let saved = checkpoint::latest(&out.join("checkpoints")).expect("readable").expect("a checkpoint");
    assert!(saved.damaged.is_empty() && [15, 30].contains(&saved.step), "{}", saved.step);
    let before = content(&out.join("checkpoints"));

    // A resumption on the full disk changes no file.
    fails(&["train", "--resume", text(&out), "-q"], 8, &[FULL, "--resume"]);
    assert!(content(&out.join("checkpoints")) == before, "a checkpoint has changed");
    fs::remove_file(ballast).expect("removed");
    let said = works(&["train", "--resume", text(&out)]);
    assert!(said.contains(&format!("going on after step {}", saved.step)), "{said}");
    same_model(shared, &out, "resumed when there was room");
}

#[test]
fn results_that_find_no_room_are_written_when_there_is_some() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let whole = folder.path().join("whole");
    works(&strs(&shared.train_for(3, &whole, &["-q"])));
    // In the order of writing.
    let (model, metrics, report) = ("point_cloud.ply", "metrics.json", "report.html");
    let saved = format!("checkpoints/{}", checkpoint::file_name(3));
    let mut order = vec![whole.join("settings.toml"), whole.join(&saved), whole.join(model), whole.join("frame.json")];
    order.extend(content(&whole.join("renders")).into_keys());
    order.extend([whole.join(metrics), whole.join(report)]);
    let length = |file: &Path| fs::metadata(file).expect("a file").len();
    let ballast: u64 = 2 * order.iter().map(|file| on_disk(length(file))).sum::<u64>();

    for name in [saved.as_str(), model, metrics, report] {
        let at = order.iter().position(|file| file.ends_with(name)).expect("one of them");
        let before: u64 = order[..at].iter().map(|file| on_disk(length(file))).sum();
        let half = on_disk(length(&order[at])) / 2 / PAGE * PAGE;
        let Some(disk) = Disk::of(ballast + before + half) else { return };
        let weight = disk.ballast(ballast);
        let out = disk.path().join("run");
        println!("no room for {name}");
        fails(&strs(&shared.train_for(3, &out, &["-q"])), 8, &[name, FULL, "make room"]);
        nothing_half_written(&out);
        for (k, file) in order.iter().enumerate() {
            let there = out.join(file.strip_prefix(&whole).expect("inside"));
            assert_eq!(there.exists(), k < at, "{}", there.display());
        }
        fs::remove_file(weight).expect("removed");
        works(&["train", "--resume", text(&out), "-q"]);
        let read = |run: &Path| fs::read(run.join(model)).expect("a model");
        assert!(read(&out) == read(&whole), "{name}: the models differ");
        assert!(order.iter().all(|file| out.join(file.strip_prefix(&whole).expect("inside")).exists()));
    }
}

/// For users who may not mount a file system: a limit on the size of files.
#[test]
fn a_file_that_may_not_grow_ends_the_training() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    let args = shared.train_for(3, &out, &["-q"]);
    // SIGXFSZ is ignored: its default action ends the process.
    let limited = |args: &[&str]| {
        let limit = ["-c", "trap '' XFSZ; ulimit -f 64; exec \"$@\"", "sh", env!("CARGO_BIN_EXE_psrgs-vk")];
        Command::new("sh").args(limit).args(args).output().expect("sh runs")
    };
    // A command that writes no file.
    if limited(&["eval", text(&shared.model()), text(&shared.data())]).status.code().is_none() {
        return common::left_out("the driver keeps its memory in files, and does not survive a limit on their size");
    }
    let output = limited(&strs(&args));
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(8), "{said}");
    let words = ["checkpoint-000003.ckpt", "File too large", "the same command begins anew"];
    assert!(words.iter().all(|word| said.contains(word)), "{said}");
    nothing_half_written(&out);
    works(&strs(&args));
}

#[test]
fn a_read_only_disk_is_told_and_left_as_it_is() {
    let Some(shared) = shared() else { return };
    let bytes: u64 = content(&shared.run()).values().map(|file| on_disk(file.len() as u64)).sum();
    let Some(mut disk) = Disk::of(2 * bytes) else { return };
    let out = disk.path().join("run");
    copy_folder(&shared.run(), &out);
    disk.make_read_only();
    let before = content(&out);
    let (data, model) = (shared.data(), shared.model());
    let (data, new) = (text(&data), disk.path().join("new"));
    let read_only = "Read-only file system";
    fails(&["train", data, "--out", text(&new), "--iterations", "3"], 8, &["new", read_only, "another --out"]);
    fails(&["train", data, "--out", text(&out), "--overwrite"], 8, &["run", read_only]);
    fails(&["train", "--resume", text(&out), "--iterations", "160"], 8, &["run", read_only]);
    fails(&["render", text(&model), "--cameras", data, "--out", text(&new)], 8, &["new", read_only]);
    let scores = new.with_extension("json");
    fails(&["eval", text(&model), data, "--json", text(&scores), "-q"], 8, &["new.json", read_only]);
    assert!(content(&out) == before && !new.exists());
}

#[test]
fn a_standard_output_that_takes_nothing_is_told() {
    let Ok(full) = fs::OpenOptions::new().write(true).open("/dev/full") else {
        common::left_out("there is no /dev/full");
        return;
    };
    let output = command(&["passes"]).stdout(full).output().expect("the command starts");
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(8), "{said}");
    assert!(said.contains("standard output") && said.contains(FULL), "{said}");
}

#[test]
fn a_folder_that_goes_away_while_training_ends_it() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (out, moved) = (folder.path().join("run"), folder.path().join("moved"));
    let mut args = shared.train(&out);
    args.extend(["--checkpoint-every", "15", "-v"].map(str::to_owned));
    let mut running = Running::new(&strs(&args));
    running.until("step 15: saved");
    fs::rename(&out, &moved).expect("moved");
    let (code, said) = running.end();
    assert_eq!(code, Some(8), "{said}");
    assert!(said.contains("checkpoint-0000") && said.contains("No such file"), "{said}");
    assert!(!out.exists(), "the folder is made once");
    assert!(psrgs(&["train", "--resume", text(&moved), "-q"]).status.success());
    same_model(shared, &moved, "resumed where it was moved");
}
