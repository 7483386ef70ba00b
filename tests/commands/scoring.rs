//! Scores of held-out photographs: renders do not depend on the pixels of held-out photographs.

use std::fs;
use std::path::Path;

use crate::common;
use crate::run::{copy_of, shared, text, works};

/// A short training: its standard error and its metrics.
fn trained(data: &Path, out: &Path, exposure: &str) -> (String, serde_json::Value) {
    let said = works(&[
        "train",
        text(data),
        "--out",
        text(out),
        "--method",
        "3dgs",
        "--iterations",
        "60",
        "--eval-every",
        "20",
        "--deterministic",
        "--exposure",
        exposure,
    ]);
    let metrics = fs::read_to_string(out.join("metrics.json")).expect("metrics");
    (said, serde_json::from_str(&metrics).expect("JSON"))
}

/// PSNR of a render against its photograph, computed from the files in a run's folder.
fn psnr_of_files(out: &Path, view: &str) -> f64 {
    let read = |kind: &str| {
        let file = out.join("renders").join(format!("{view}.{kind}.png"));
        image::open(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display())).into_rgb8().into_raw()
    };
    let (render, photograph) = (read("render"), read("photograph"));
    let squares = render.iter().zip(&photograph).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2));
    10.0 * (255.0 * 255.0 * render.len() as f64 / squares.sum::<f64>()).log10()
}

/// The exposure of a held-out render follows from other photographs alone: a held-out photograph of noise changes
/// neither model nor exposures nor render, and its own score is low. The training's last evaluation equals the score
/// in the metrics.
#[test]
fn held_out_noise_changes_only_its_score_with_affine_exposures() {
    noise_changes_a_score_alone("affine");
}

/// As above, without exposures.
#[test]
fn held_out_noise_changes_only_its_score_with_exposures_off() {
    noise_changes_a_score_alone("off");
}

fn noise_changes_a_score_alone(exposure: &str) {
    let Some(shared) = shared() else { return };
    let data = copy_of(&shared.data());
    let (plain, noisy) = (data.path().join("plain"), data.path().join("noisy"));
    let (said, metrics) = trained(data.path(), &plain, exposure);
    let photograph = data.path().join("images/view_0000.jpg");
    common::noise(7, 64, 48).save(&photograph).expect("written");
    let (said_of_noise, metrics_of_noise) = trained(data.path(), &noisy, exposure);

    let same = |file: &str| {
        let read = |out: &Path| fs::read(out.join(file)).unwrap_or_else(|error| panic!("{file}: {error}"));
        assert!(read(&plain) == read(&noisy), "{file} depends on the pixels of a held-out photograph");
    };
    let learned = (exposure != "off").then_some("exposures.json");
    let always = ["point_cloud.ply", "renders/view_0000.render.png", "renders/view_0008.render.png"];
    always.into_iter().chain(learned).for_each(same);
    let psnr = |metrics: &serde_json::Value, k: usize| metrics["images"][k]["psnr"].as_f64().expect("a number");
    assert_eq!(metrics["images"][0]["name"], "view_0000.jpg");
    let (of_noise, of_photograph) = (psnr(&metrics_of_noise, 0), psnr(&metrics, 0));
    assert!(of_noise < 10.0 && of_photograph > of_noise + 1.0, "{of_noise} and {of_photograph} dB");
    assert_eq!(psnr(&metrics, 1), psnr(&metrics_of_noise, 1));
    for (out, metrics, said) in [(&plain, &metrics, &said), (&noisy, &metrics_of_noise, &said_of_noise)] {
        for (k, view) in ["view_0000", "view_0008"].into_iter().enumerate() {
            let (found, want) = (psnr(metrics, k), psnr_of_files(out, view));
            assert!((found - want).abs() < 1e-6, "{view}: {found} dB in the metrics, {want} dB of its files");
        }
        let last = said.lines().rfind(|line| line.contains("held-out PSNR")).expect("an evaluation");
        let want = format!("step 60: held-out PSNR {:.2} dB", metrics["psnr"].as_f64().expect("a number"));
        assert!(last.contains(&want), "the last evaluation is `{last}`, and not `{want}`");
    }
}
