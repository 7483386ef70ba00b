//! The data of a training's report.

use psrgs_vk::eval::{Curve, CurveForm, Metrics, ReportData, ViewPanel};
use psrgs_vk::format::EXPOSURE_FILE;
use psrgs_vk::train::History;

use super::{Finished, Saved};
use crate::cli::model_page::InReport;
use crate::cli::run_folder::{METRICS, MODEL, RENDERS};
use crate::cli::stages;

/// Most points of a curve.
const CURVE_POINTS: usize = 400;

/// The data of the report. `sigmas`, a sentence about the learned widths of the saliency filter, is there where the
/// training learned them.
pub(super) fn data(
    run: &Finished<'_>,
    history: &History,
    metrics: Metrics,
    views: Vec<ViewPanel>,
    saved: &Saved,
    sigmas: Option<String>,
) -> anyhow::Result<ReportData> {
    let title = format!("{} on {}", metrics.method, metrics.scene);
    let model = InReport {
        title: &title,
        gaussians: &saved.model,
        dataset: run.dataset,
        background: run.settings.model.background.evaluated(),
        antialias: run.settings.model.antialias,
    };
    let model = Some(model.interactive());
    Ok(ReportData {
        title,
        settings: named_settings(&run.settings.to_toml()?),
        curves: curves(history),
        files: files(saved.exposures, sigmas.is_some()),
        notes: run.dataset.warnings.iter().chain(run.left_out).map(ToString::to_string).chain(sigmas).collect(),
        views,
        drawing: None,
        metrics,
        model,
    })
}

/// The lines of a settings file as key and value.
fn named_settings(toml: &str) -> Vec<(String, String)> {
    toml.lines()
        .filter_map(|line| line.split_once(" = "))
        .map(|(key, value)| (key.to_owned(), value.trim_matches('"').to_owned()))
        .collect()
}

/// Curves of loss, scores, the number of splats, and the learned widths of the saliency filter.
fn curves(history: &History) -> Vec<Curve> {
    // Means over stretches of steps. Losses of single steps would show differences between photographs.
    let stretch = history.loss.len().div_ceil(CURVE_POINTS).max(1);
    let loss = history.loss.chunks(stretch).enumerate().map(|(i, part)| {
        let mean = part.iter().map(|l| f64::from(*l)).sum::<f64>() / part.len() as f64;
        ((i * stretch + part.len().div_ceil(2)) as f64, mean)
    });
    let curve = |name: &str, unit: &str, points: Vec<(f64, f64)>| Curve {
        name: name.into(),
        unit: unit.into(),
        points,
        form: CurveForm::Line,
    };
    let mut splats: Vec<(f64, f64)> = history.splats.iter().map(|s| (f64::from(s.0), f64::from(s.1))).collect();
    // The number of splats stays the same from the last change to the end.
    if let Some(&(_, last)) = splats.last() {
        splats.push((history.loss.len() as f64, last));
    }
    let mut curves = vec![
        curve("Loss", "", loss.collect()),
        curve("Held-out PSNR", "dB", history.quality.iter().map(|q| (f64::from(q.0), q.1)).collect()),
        Curve { form: CurveForm::Steps, ..curve("Splats", "", splats) },
    ];
    if !history.sigmas.is_empty() {
        let sigmas = history.sigmas.iter().map(|(step, _, sigma, _)| (f64::from(*step), *sigma));
        // Each value belongs to the photograph of its step.
        curves.push(Curve { form: CurveForm::Dots, ..curve("Sigma", "bins of 256", sigmas.collect()) });
    }
    curves
}

/// The files beside the report, each with a description.
fn files(exposures: bool, sigmas: bool) -> Vec<(String, String)> {
    let mut files = vec![
        (MODEL, "the model, for any viewer of Gaussian splats"),
        (METRICS, "the numbers of this page"),
        ("settings.toml", "repeats this run: psrgs-vk train --config settings.toml"),
        (RENDERS, "held-out views: renders, photographs, depth and normals"),
    ];
    if exposures {
        files.push((EXPOSURE_FILE, "how each photograph that was trained on differs in colour from the model"));
    }
    if sigmas {
        files.push((stages::SIGMA_FILE, "the width of the saliency filter that was learned for each photograph"));
    }
    files.into_iter().map(|(file, what)| (file.to_owned(), what.to_owned())).collect()
}
