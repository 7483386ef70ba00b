//! Checkpoints, and what a write that fails leaves.

use std::fs;

use psrgs_vk::format::checkpoint::{self, Checkpoint};
use psrgs_vk::format::{atomic, ply};
use psrgs_vk::scene::Frame;

use super::splats;

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
fn two_checkpoints_are_kept_and_the_newest_whole_one_is_read() {
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
    fs::write(path.join(".psrgs-vk-abcdef012345.tmp"), "left by a crash").expect("written");
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
fn a_file_that_only_has_the_name_of_a_checkpoint_stays() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path();
    let others = ["checkpoint-000100.ckpt", "checkpoint-9999999.ckpt", "model.ckpt", ".checkpoint-1.ckpt.a1b2c3.tmp"];
    others.iter().for_each(|name| fs::write(path.join(name), "of another program").expect("written"));
    for step in [500, 1000, 1500] {
        checkpoint::save(path, step, &checkpoint(step)).expect("saved");
    }
    for name in others {
        assert_eq!(fs::read(path.join(name)).expect("there"), b"of another program", "{name}");
    }
    let (ours, names_alone) = checkpoint::told_apart(path).expect("listed");
    assert_eq!((ours.len(), names_alone.len()), (2, 2));
    assert!(!path.join("checkpoint-000500.ckpt").exists());
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
        .args([
            "-c",
            "trap '' XFSZ; ulimit -f 64 && exec \"$0\" --exact checkpoints::a_refused_write_leaves_the_last_checkpoint",
        ])
        .arg(std::env::current_exe().expect("this program"))
        .env(FOLDER, folder.path())
        .output()
        .expect("a shell");
    assert!(child.status.success(), "{}", String::from_utf8_lossy(&child.stdout));
    assert!(String::from_utf8_lossy(&child.stdout).contains("1 passed"), "the child ran the test");
    assert_eq!(fs::read_dir(folder.path()).expect("folder").count(), 1, "no temporary file is left");
    assert_eq!(checkpoint::latest(folder.path()).expect("found").expect("there").step, 500);
}
