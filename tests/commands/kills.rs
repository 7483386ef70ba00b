//! Runs that are killed at random moments, also while writing a checkpoint, and resumed until they end. Their files
//! equal those of an undisturbed run.
#![cfg(unix)]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant, SystemTime};

use psrgs_vk::scene::random::Random;
use psrgs_vk::world::{WorldParams, generate};

use crate::common;
use crate::common::splats::seeded;
use crate::run::{command, stderr, text};

/// All parts of the method that have a state (stereo, growth, learned widths of the filter, the constrained set,
/// perceptual distance, exposures), and a checkpoint every few steps.
pub(crate) const OPTIONS: &str = "--method psrgs-paper --deterministic --iterations 40 --densify-from 5 \
                       --densify-interval 6 --densify-until 32 --set low-grad-threshold=2e-3 --grad-threshold 1e-3 \
                       --prune-opacity 0.02 --exposure affine --set stereo-side=32 --start stereo --set stereo-splats=200 --set \
                       sigma-every=3 --set perceptual-every=4 --eval-every 0 --checkpoint-every 3 --seed 5";

/// When a run is killed.
#[derive(Debug)]
enum Moment {
    /// This long after the start of the run.
    After(Duration),
    /// This long after the n-th write of a file began.
    Writing(u32, Duration),
}

impl Moment {
    fn random(random: &mut Random, whole: Duration) -> Self {
        if random.bits().is_multiple_of(2) {
            Self::After(whole.mul_f64(random.unit()))
        } else {
            Self::Writing((random.bits() % 4) as u32, Duration::from_micros(random.bits() % 4000))
        }
    }

    /// Waits for the moment; `false` where the process ends earlier. `before` holds the half-written files of earlier
    /// runs.
    fn comes(&self, child: &mut Child, out: &Path, mut before: BTreeSet<PathBuf>) -> bool {
        let started = Instant::now();
        let mut times = 0;
        loop {
            if child.try_wait().expect("a state").is_some() {
                return false;
            }
            match self {
                Self::After(time) if started.elapsed() >= *time => return true,
                Self::After(_) => sleep(Duration::from_millis(2)),
                Self::Writing(nth, more) => {
                    let now = unfinished(out);
                    times += u32::from(!now.is_subset(&before));
                    before = now;
                    if times > *nth {
                        sleep(*more);
                        return true;
                    }
                    sleep(Duration::from_micros(300));
                }
            }
        }
    }
}

/// Files that are being written, or that a killed run left half written.
fn unfinished(out: &Path) -> BTreeSet<PathBuf> {
    let entries =
        [out.to_owned(), out.join("checkpoints")].map(|folder| fs::read_dir(folder).into_iter().flatten().flatten());
    let files = entries.into_iter().flatten().map(|entry| entry.path());
    files.filter(|file| file.extension().is_some_and(|e| e == "tmp")).collect()
}

/// The results, without times and memory use.
#[derive(PartialEq)]
struct Results {
    files: Vec<(&'static str, Vec<u8>)>,
    metrics: serde_json::Value,
}

impl Results {
    fn of(out: &Path) -> Self {
        let read = |name: &'static str| (name, fs::read(out.join(name)).unwrap_or_else(|e| panic!("{name}: {e}")));
        let mut metrics: serde_json::Value = serde_json::from_slice(&read("metrics.json").1).expect("JSON");
        for key in
            "seconds seconds_stereo seconds_saliency seconds_per_iteration peak_device_bytes peak_host_bytes".split(' ')
        {
            metrics.as_object_mut().expect("an object").remove(key).unwrap_or_else(|| panic!("no {key}"));
        }
        Self { files: ["point_cloud.ply", "sigma.json", "exposures.json", "frame.json"].map(read).into(), metrics }
    }

    #[track_caller]
    fn assert_same(&self, other: &Self, what: &str) {
        for ((name, one), (_, two)) in self.files.iter().zip(&other.files) {
            assert!(one == two, "{what}: {name} differs");
        }
        assert_eq!(self.metrics, other.metrics, "{what}: the metrics differ");
    }
}

/// Kills runs `kills` times in all, and resumes each until it ends.
fn killed_and_resumed(kills: u32) {
    if common::gpu().is_none() {
        return;
    }
    let given = std::env::var("PSRGS_KILL_SEED").ok().and_then(|seed| seed.parse().ok());
    let clock = || SystemTime::UNIX_EPOCH.elapsed().map_or(1, |time| time.as_nanos() as u64);
    let seed = given.unwrap_or_else(clock);
    println!("moments of seed {seed}: PSRGS_KILL_SEED={seed} draws them again");
    let mut random = seeded(seed);

    let folder = tempfile::tempdir().expect("a temporary folder");
    let data = folder.path().join("scene");
    let params = WorldParams { images: 9, max_side: 64, pixels_per_point: 16, offpath: 0, ..WorldParams::default() };
    generate(&params, &data, &mut |_| ()).expect("a scene");
    let weights = common::weights("lpips_squeeze_v0.1.pth").and_then(|file| Some(file.parent()?.to_owned()));
    let run = |out: &Path| {
        let begun = out.join("settings.toml").exists();
        let ends =
            if begun { vec!["train", "--resume", text(out)] } else { vec!["train", text(&data), "--out", text(out)] };
        let mut command = command(&ends);
        if !begun {
            command.args(OPTIONS.split_whitespace());
            if let Some(weights) = &weights {
                command.arg("--perceptual-weights").arg(weights);
            }
        }
        command.arg("-v").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        command.spawn().expect("the command starts")
    };
    let ends = |child: Child, what: &str| {
        let output = child.wait_with_output().expect("an end");
        assert!(output.status.success(), "{what}: {}", stderr(&output));
        stderr(&output)
    };

    let whole = folder.path().join("undisturbed");
    let started = Instant::now();
    let said = ends(run(&whole), "undisturbed");
    let time = started.elapsed();
    // All parts were active.
    let changes: Vec<&str> = said.lines().filter(|line| line.contains(" cloned, ")).collect();
    let (grown, pruned) = (|line: &&str| !line.contains(" 0 split"), |line: &&str| !line.contains(" 0 pruned"));
    assert!(changes.iter().any(grown) && changes.iter().any(pruned), "{said}");
    assert!(said.contains("depths from stereo") && said.contains(": sigma "), "{said}");
    let expected = Results::of(&whole);

    let (mut done, mut writing, mut runs) = (0, 0, 0);
    while done < kills {
        runs += 1;
        let out = folder.path().join(format!("killed-{runs}"));
        loop {
            let before = unfinished(&out);
            let mut child = run(&out);
            let moment = Moment::random(&mut random, time);
            if done == kills || !moment.comes(&mut child, &out, before.clone()) {
                ends(child, &format!("run {runs} after {done} kills"));
                break;
            }
            child.kill().expect("killed");
            // The run may have ended just before the signal.
            let killed = child.wait_with_output().expect("an end").status.code().is_none();
            let half = killed && !unfinished(&out).is_subset(&before);
            done += u32::from(killed);
            writing += u32::from(half);
            println!("kill {done}, run {runs}: {moment:?}{}", if half { ", a file half written" } else { "" });
        }
        assert!(unfinished(&out).is_empty(), "seed {seed}, run {runs}: a half written file is left");
        expected.assert_same(&Results::of(&out), &format!("seed {seed}, run {runs}"));
        // The next run begins in an empty folder.
        fs::remove_dir_all(&out).expect("removed");
    }
    println!(
        "{done} kills in {runs} runs, {writing} with a file half written; a whole run takes {:.1} s",
        time.as_secs_f64()
    );
    assert_eq!(done, kills);
}

#[test]
fn runs_killed_at_5_random_moments_end_with_the_same_bits() {
    killed_and_resumed(5);
}

/// Takes minutes.
#[test]
#[ignore = "the long form of the test with 5"]
fn runs_killed_at_50_random_moments_end_with_the_same_bits() {
    killed_and_resumed(50);
}
