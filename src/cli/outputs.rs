//! The files of a finished training.

use std::fs;
use std::time::Instant;

use psrgs_vk::dataset::{Dataset, Role};
use psrgs_vk::eval::{self, Curve, CurveForm, Geometry, GeometryTruth, Metrics, ReportData, geometry};
use psrgs_vk::format::{EXPOSURE_FILE, ExposureFile, FRAME_FILE, FrameFile, ply};
use psrgs_vk::scene::Gaussians;
use psrgs_vk::train::{History, Trainer, prepare};
use psrgs_vk::vk::Gpu;

use super::console::Console;
use super::exposed::{self, Exposed};
use super::lpips::Lpips;
use super::pictures::Pictures;
use super::run_folder::{METRICS, MODEL, RENDERS, REPORT, RunFolder};
use super::stages;
use super::train::Plan;

/// Points of a curve at most.
const CURVE_POINTS: usize = 400;

/// A training that came to its end.
pub(crate) struct Finished<'a> {
    pub(crate) plan: &'a Plan,
    pub(crate) folder: &'a RunFolder,
    pub(crate) dataset: &'a Dataset,
    pub(crate) gpu: &'a Gpu,
    /// When the process started.
    pub(crate) started: Instant,
    /// Seconds of training, earlier stretches of a resumed run included.
    pub(crate) training_seconds: f64,
    /// Seconds of training in earlier stretches of a resumed run.
    pub(crate) earlier_seconds: f64,
    /// Seconds of multi-view stereo.
    pub(crate) stereo_seconds: f64,
}

/// Writes the model, the renders, the metrics and the report.
pub(crate) fn write(
    run: &Finished<'_>,
    trainer: &mut Trainer,
    lpips: &mut Lpips,
    console: &Console,
) -> anyhow::Result<()> {
    let settings = &run.plan.settings;
    let seconds = run.earlier_seconds + run.started.elapsed().as_secs_f64();
    let mut model = trainer.model()?;
    let constrained = trainer.constrained_below()?.map(|bound| {
        model = model.in_order_of_birth();
        model.ids.partition_point(|id| *id < bound)
    });
    let frame = run.dataset.frame;
    let file = run.folder.file(MODEL);
    ply::save_staged(&file, &model, &frame, settings.model.antialias, constrained)?;
    FrameFile::new(frame).write(&run.folder.file(FRAME_FILE))?;
    let exposures = trainer.exposures()?;
    if let Some(exposures) = &exposures {
        ExposureFile { photographs: exposures.iter().cloned().collect() }.write(&run.folder.file(EXPOSURE_FILE))?;
    }
    let bytes = fs::metadata(&file).map(|m| m.len()).unwrap_or(0);

    let views = trainer.held_out().to_vec();
    let pictures = Pictures::new(&run.folder.file(RENDERS), views.iter().map(|v| v.name.as_str()), frame.scale)?;
    let (mut scores, mut panels) = (Vec::new(), Vec::new());
    let mut exposed = Exposed::new(trainer.expected_exposures()?);
    for (i, view) in views.iter().enumerate() {
        let picture = exposed.picture(view, trainer.picture(&view.camera)?)?;
        let mut panel = pictures.held_out(i, view, &picture)?;
        panel.lpips_squeeze = lpips.measure(run.gpu, view, panel.render.as_raw(), console);
        scores.push(panel.score());
        panels.push(panel.among(views.len()));
    }

    // What a training took, before what only its report takes.
    let peak_device_bytes = run.gpu.memory_use().peak;
    if let Some(first) = constrained {
        // Pictures of the stages need room for the model once more.
        if let Err(problem) = stages::add(run, trainer, &model, first, &views, &mut panels) {
            console.warn(format_args!("the report has no pictures of the stages: {problem:#}"));
        }
    }
    let sigmas = stages::sigmas(trainer, run.folder)?;

    // What is wrong with the ground truth must not cost the results of a training.
    let geometry = known_geometry(run, &model, trainer).unwrap_or_else(|problem| {
        console.warn(format_args!("the geometry is not compared with the ground truth: {problem:#}"));
        Geometry::default()
    });
    let sized = views.first().map(|v| v.camera).or_else(|| run.dataset.views.first().map(|v| v.camera));
    let metrics = Metrics {
        method: settings.method_name(),
        iterations: settings.run.iterations,
        scene: scene_name(run.dataset),
        train_images: run.dataset.views_of(Role::Train).count(),
        test_images: 0,
        width: sized.map_or(0, |c| c.width),
        height: sized.map_or(0, |c| c.height),
        seed: settings.run.seed,
        device: run.gpu.caps().device.clone(),
        forms: Some(trainer.variants().to_string()),
        psnr: None,
        psnr_cc: None,
        ssim: None,
        lpips_squeeze: None,
        gmsd: None,
        psnr_high_frequency: None,
        splats: model.len(),
        bytes,
        seconds,
        seconds_stereo: run.stereo_seconds,
        seconds_saliency: trainer.saliency_seconds(),
        seconds_per_iteration: run.training_seconds / f64::from(settings.run.iterations.max(1)),
        peak_device_bytes,
        peak_host_bytes: eval::peak_host_bytes(),
        streaming: trainer.streaming(),
        exposures: exposed.scores(),
        geometry,
        images: Vec::new(),
    }
    .with_images(scores);
    metrics.write(&run.folder.file(METRICS))?;
    let report = run.folder.file(REPORT);
    let data = ReportData {
        title: format!("{} on {}", metrics.method, metrics.scene),
        settings: named_settings(&settings.to_toml()?),
        curves: curves(trainer.history()),
        files: files(exposures.is_some(), sigmas.is_some()),
        notes: run.dataset.warnings.iter().map(ToString::to_string).chain(sigmas).collect(),
        views: panels,
        metrics,
    };
    eval::write_report(&data, &report)?;
    if let (Some(psnr), Some(ssim)) = (data.metrics.psnr, data.metrics.ssim) {
        let fitted = data.metrics.psnr_cc.map(|p| format!(" ({p:.2} with colours fitted)")).unwrap_or_default();
        let lpips = data.metrics.lpips_squeeze.map_or_else(String::new, |v| format!(", LPIPS {v:.4}"));
        console.say(format_args!("held out: PSNR {psnr:.2} dB{fitted}, SSIM {ssim:.4}{lpips}"));
        if let Some(scores) = &data.metrics.exposures {
            console.say(exposed::line(scores));
        }
    }
    let shares: Vec<String> = [("stereo", run.stereo_seconds), ("masks", trainer.saliency_seconds())]
        .into_iter()
        .filter(|(_, part)| *part > 0.0)
        .map(|(what, part)| format!("{what} {part:.1} s ({:.1} %)", 100.0 * part / seconds))
        .collect();
    if !shares.is_empty() {
        console.say(format_args!("{seconds:.0} s in all, of which {}", shares.join(", ")));
    }
    let known: Vec<String> = geometry.rows().into_iter().map(|(name, value)| format!("{name} {value}")).collect();
    if !known.is_empty() {
        console.say(format_args!("against the ground truth: {}", known.join("; ")));
    }
    console.say(format_args!("{} splats in {}; report: {}", model.len(), file.display(), report.display()));
    Ok(())
}

/// Compares the model with the ground truth beside the dataset, if there is any.
fn known_geometry(run: &Finished<'_>, model: &Gaussians, trainer: &mut Trainer) -> anyhow::Result<Geometry> {
    let options = prepare::load_options(&run.plan.settings.photographs, run.plan.settings.model.background.evaluated());
    let truth = GeometryTruth::find(run.dataset, &options)?;
    if truth.is_empty() {
        return Ok(Geometry::default());
    }
    geometry::measure(&truth, model, |camera| Ok(trainer.picture(camera)?))
}

/// What a dataset is called: its folder's name.
pub(crate) fn scene_name(dataset: &Dataset) -> String {
    let path = std::path::absolute(&dataset.path).unwrap_or_else(|_| dataset.path.clone());
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}

fn named_settings(toml: &str) -> Vec<(String, String)> {
    toml.lines()
        .filter_map(|line| line.split_once(" = "))
        .map(|(key, value)| (key.to_owned(), value.trim_matches('"').to_owned()))
        .collect()
}

fn curves(history: &History) -> Vec<Curve> {
    // Means over stretches: a curve of single photographs' losses shows the photographs, not the training.
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
    // The number holds from the last change to the end.
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
        // Each is of the photograph of its step.
        curves.push(Curve { form: CurveForm::Dots, ..curve("Sigma", "bins of 256", sigmas.collect()) });
    }
    curves
}

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
