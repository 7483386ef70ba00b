//! The files of a finished training.

use std::fs;
use std::path::Path;
use std::time::Instant;

use anyhow::Context as _;
use image::RgbImage;
use psrgs_vk::dataset::{Dataset, Role};
use psrgs_vk::eval::{self, Curve, DepthMap, ImageScore, Metrics, ReportData, ViewPanel};
use psrgs_vk::format::{FRAME_FILE, FrameFile, image_out, ply};
use psrgs_vk::raster::Picture;
use psrgs_vk::train::{History, Trainer, View, score};
use psrgs_vk::vk::Gpu;

use super::console::Console;
use super::exit::Failure;
use super::run_folder::{METRICS, MODEL, REPORT, RunFolder};
use super::train::Plan;

/// Folder of the held-out renders.
const RENDERS: &str = "renders";
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
}

/// Writes the model, the renders, the metrics and the report.
pub(crate) fn write(run: &Finished<'_>, trainer: &mut Trainer, console: &Console) -> anyhow::Result<()> {
    let settings = &run.plan.settings;
    let seconds = run.started.elapsed().as_secs_f64().max(run.training_seconds);
    let model = trainer.model()?;
    let frame = run.dataset.frame;
    let file = run.folder.file(MODEL);
    ply::save(&file, &model, &frame, settings.model.antialias)?;
    FrameFile::new(frame).write(&run.folder.file(FRAME_FILE))?;
    let bytes = fs::metadata(&file).map(|m| m.len()).unwrap_or(0);

    let renders = run.folder.file(RENDERS);
    fs::create_dir_all(&renders).with_context(|| Failure::Output(renders.display().to_string()))?;
    let (mut scores, mut panels) = (Vec::new(), Vec::new());
    let views = trainer.held_out().to_vec();
    for view in &views {
        let picture = trainer.picture(&view.camera)?;
        let panel = held_out(&renders, view, &picture, frame.scale)?;
        scores.push(ImageScore { name: view.name.clone(), psnr: panel.psnr, ssim: panel.ssim });
        panels.push(panel);
    }

    let sized = views.first().map(|v| v.camera).or_else(|| run.dataset.views.first().map(|v| v.camera));
    let metrics = Metrics {
        method: settings.run.method.to_string(),
        iterations: settings.run.iterations,
        scene: run.dataset.path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
        train_images: run.dataset.views_of(Role::Train).count(),
        test_images: 0,
        width: sized.map_or(0, |c| c.width),
        height: sized.map_or(0, |c| c.height),
        seed: settings.run.seed,
        device: run.gpu.caps().device.clone(),
        psnr: None,
        ssim: None,
        splats: model.len(),
        bytes,
        seconds,
        seconds_per_iteration: run.training_seconds / f64::from(settings.run.iterations.max(1)),
        peak_device_bytes: run.gpu.memory_use().peak,
        peak_host_bytes: eval::peak_host_bytes(),
        images: Vec::new(),
    }
    .with_images(scores);
    metrics.write(&run.folder.file(METRICS))?;
    let report = run.folder.file(REPORT);
    let data = ReportData {
        title: format!("{} on {}", metrics.method, metrics.scene),
        settings: named_settings(&settings.to_toml()?),
        curves: curves(trainer.history()),
        files: files(),
        notes: run.dataset.warnings.iter().map(ToString::to_string).collect(),
        views: panels,
        metrics,
    };
    eval::write_report(&data, &report)?;
    if let (Some(psnr), Some(ssim)) = (data.metrics.psnr, data.metrics.ssim) {
        console.say(format_args!("held out: PSNR {psnr:.2} dB, SSIM {ssim:.4}"));
    }
    console.say(format_args!("{} splats in {}; report: {}", model.len(), file.display(), report.display()));
    Ok(())
}

/// Writes one held-out view's pictures and compares it with its photograph.
fn held_out(folder: &Path, view: &View, picture: &Picture, scale: f64) -> anyhow::Result<ViewPanel> {
    let (width, height) = (picture.width, picture.height);
    let rgb = picture.rgb8();
    let stem = view.name.replace(['/', '\\'], "_");
    let truth: Vec<u8> = view.rgba.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
    image_out::write_png(&folder.join(format!("{stem}.render.png")), width, height, &rgb)?;
    image_out::write_png(&folder.join(format!("{stem}.photograph.png")), width, height, &truth)?;
    let mut depth = None;
    if let (Some(z), Some(normals)) = (picture.depth(), picture.normals()) {
        // Depth in the units of the dataset.
        let values: Vec<f32> = z.iter().map(|z| (f64::from(*z) / scale) as f32).collect();
        image_out::write_depth(&folder.join(format!("{stem}.depth.exr")), width, height, &values)?;
        image_out::write_normals(&folder.join(format!("{stem}.normal.exr")), width, height, &normals)?;
        depth = Some(DepthMap { width, height, values });
    }
    let ImageScore { name, psnr, ssim } = score(view, &rgb);
    let image = |pixels: Vec<u8>| RgbImage::from_raw(width, height, pixels).context("picture size");
    Ok(ViewPanel { name, photograph: image(truth)?, render: image(rgb)?, depth, psnr, ssim })
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
        ((i * stretch) as f64 + 0.5 * (part.len() as f64 + 1.0), mean)
    });
    let curve =
        |name: &str, unit: &str, points: Vec<(f64, f64)>| Curve { name: name.into(), unit: unit.into(), points };
    let mut splats: Vec<(f64, f64)> = history.splats.iter().map(|s| (f64::from(s.0), f64::from(s.1))).collect();
    // The number holds from the last change to the end.
    if let Some(&(_, last)) = splats.last() {
        splats.push((history.loss.len() as f64, last));
    }
    vec![
        curve("Loss", "", loss.collect()),
        curve("Held-out PSNR", "dB", history.quality.iter().map(|q| (f64::from(q.0), q.1)).collect()),
        curve("Splats", "", splats),
    ]
}

fn files() -> Vec<(String, String)> {
    [
        (MODEL, "the model, for any viewer of Gaussian splats"),
        (METRICS, "the numbers of this page"),
        ("settings.toml", "repeats this run: psrgs-vk train --config settings.toml"),
        (RENDERS, "held-out views: renders, photographs, depth and normals"),
    ]
    .map(|(file, what)| (file.to_owned(), what.to_owned()))
    .to_vec()
}
