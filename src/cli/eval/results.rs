//! Files and tables about a scored model: JSON, and the report beside its renders.

use std::path::Path;
use std::time::Instant;

use psrgs_vk::dataset::{Dataset, Role};
use psrgs_vk::eval::{
    self, ExposureScores, Geometry, ImageScore, Metrics, ReportData, ReportError, mean, mean_if_all, mean_seen,
};
use psrgs_vk::format::atomic;
use psrgs_vk::numbers::percent;
use psrgs_vk::train::settings::Split;
use psrgs_vk::vk::Gpu;

use super::{Args, Beside, warnings};
use crate::cli::console;
use crate::cli::held_out::Compared;
use crate::cli::model_file::ModelFile;
use crate::cli::model_page::InReport;
use crate::cli::outputs;

/// A scored model.
pub(super) struct Scored<'a> {
    pub(super) args: &'a Args,
    pub(super) beside: &'a Beside,
    pub(super) model: &'a ModelFile,
    pub(super) dataset: &'a Dataset,
    pub(super) gpu: &'a Gpu,
    /// Size of the first held-out view.
    pub(super) size: (u32, u32),
    /// Scores of the held-out photographs.
    pub(super) compared: Compared,
    /// Scores of the geometry, as far as there is ground truth.
    pub(super) geometry: Geometry,
}

/// What `--json` writes.
#[derive(Debug, serde::Serialize)]
struct Scores<'a> {
    model: &'a Path,
    scene: String,
    split: Split,
    /// Coordinates that the model was read in.
    frame: String,
    background: String,
    /// Treatment of the transparent pixels of photographs.
    transparent: String,
    antialias: bool,
    test_images: usize,
    /// Size of the first held-out view.
    width: u32,
    height: u32,
    device: &'a str,
    splats: usize,
    bytes: u64,
    /// Means, as in `metrics.json`.
    psnr: Option<f64>,
    psnr_seen: Option<f64>,
    seen: Option<f64>,
    psnr_cc: Option<f64>,
    ssim: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    lpips_squeeze: Option<f64>,
    gmsd: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    psnr_high_frequency: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    exposures: Option<ExposureScores>,
    #[serde(flatten)]
    geometry: Geometry,
    #[serde(flatten)]
    more: &'a serde_json::Map<String, serde_json::Value>,
    images: &'a [ImageScore],
}

impl Scored<'_> {
    /// Writes the scores as JSON.
    pub(super) fn write_json(&self, file: &Path) -> anyhow::Result<()> {
        let text = serde_json::to_string_pretty(&self.scores())?;
        Ok(atomic::write(file, |out| writeln!(out, "{text}"))?)
    }

    /// Writes the report. Its seconds count from `started`.
    pub(super) fn write_report(self, file: &Path, started: Instant) -> Result<(), ReportError> {
        let metrics = self.metrics(started).with_images(self.compared.images);
        let title = format!("{} on {}", metrics.method, metrics.scene);
        let (gaussians, antialias) = (&self.model.in_scene(&self.dataset.frame), self.model.antialias);
        let background = self.args.look.scene.background.rgb;
        let model = InReport { title: &title, gaussians, dataset: self.dataset, background, antialias }.interactive();
        let data = ReportData {
            title,
            settings: settings(self.args, self.model, &metrics),
            curves: Vec::new(),
            files: Vec::new(),
            drawing: self.beside.drawing.clone(),
            notes: warnings(self.dataset).map(ToString::to_string).collect(),
            views: self.compared.panels,
            metrics,
            model: Some(model),
        };
        eval::write_report(&data, file)
    }

    /// The scores for `--json`.
    fn scores(&self) -> Scores<'_> {
        let (args, images) = (self.args, &self.compared.images);
        Scores {
            model: &args.model,
            scene: outputs::scene_name(self.dataset),
            split: args.photographs.split,
            frame: self.model.frame.to_string(),
            background: args.look.scene.background.to_string(),
            transparent: args.photographs.transparent.to_string(),
            antialias: self.model.antialias,
            test_images: images.len(),
            width: self.size.0,
            height: self.size.1,
            device: &self.gpu.caps().device,
            splats: self.model.splats(),
            bytes: self.model.bytes,
            psnr: mean(images.iter().map(|i| i.psnr)),
            psnr_seen: mean_seen(images),
            seen: mean_if_all(images.iter().map(|i| i.seen)),
            psnr_cc: mean(images.iter().map(|i| i.psnr_cc)),
            ssim: mean(images.iter().map(|i| i.ssim)),
            lpips_squeeze: mean_if_all(images.iter().map(|i| i.lpips_squeeze)),
            gmsd: mean_if_all(images.iter().map(|i| i.gmsd)),
            psnr_high_frequency: mean_if_all(images.iter().map(|i| i.psnr_high_frequency)),
            exposures: self.compared.exposures,
            geometry: self.geometry,
            more: &self.beside.values,
            images,
        }
    }

    /// The numbers of the report except those of its images. There are no steps because nothing was trained.
    fn metrics(&self, started: Instant) -> Metrics {
        Metrics {
            method: file_name(&self.args.model),
            iterations: 0,
            scene: outputs::scene_name(self.dataset),
            train_images: self.dataset.views_of(Role::Train).count(),
            test_images: 0,
            width: self.size.0,
            height: self.size.1,
            seed: 0,
            device: self.gpu.caps().device.clone(),
            forms: None,
            psnr: None,
            psnr_seen: None,
            seen: None,
            psnr_cc: None,
            ssim: None,
            lpips_squeeze: None,
            gmsd: None,
            psnr_high_frequency: None,
            psnr_training: None,
            ssim_training: None,
            first_splats: None,
            splats: self.model.splats(),
            bytes: self.model.bytes,
            seconds: started.elapsed().as_secs_f64(),
            seconds_stereo: 0.0,
            seconds_saliency: 0.0,
            seconds_per_iteration: 0.0,
            peak_device_bytes: self.gpu.memory_use().peak,
            peak_host_bytes: eval::peak_host_bytes(),
            streaming: None,
            exposures: self.compared.exposures,
            geometry: self.geometry,
            images: Vec::new(),
            training_photographs: Vec::new(),
        }
    }
}

/// The options of the command as the report names them.
fn settings(args: &Args, model: &ModelFile, metrics: &Metrics) -> Vec<(String, String)> {
    let setting = |name: &str, value: String| (name.to_owned(), value);
    vec![
        setting("model", args.model.display().to_string()),
        setting("data", args.data.display().to_string()),
        setting("size", format!("{}x{}", metrics.width, metrics.height)),
        setting("split", args.photographs.split.to_string()),
        setting("background", args.look.scene.background.to_string()),
        setting("transparent pixels", args.photographs.transparent.to_string()),
        setting("coordinates", model.frame.to_string()),
    ]
}

/// The name of a model in the report: its file's name.
fn file_name(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}

/// The scores of each photograph, and the means.
pub(super) fn scores_table(images: &[ImageScore]) -> String {
    let decibels = |v: f64| if v.is_finite() { format!("{v:.3}") } else { "equal".to_owned() };
    let with_lpips = images.iter().any(|i| i.lpips_squeeze.is_some());
    let row = |name: &str, psnr, (of_seen, seen): (Option<f64>, Option<f64>), fitted, ssim, lpips: Option<f64>| {
        let [of_seen, seen] =
            [of_seen.map(decibels), seen.map(|share| percent(share, 1))].map(Option::unwrap_or_default);
        let mut row = vec![name.to_owned(), decibels(psnr), of_seen, seen, decibels(fitted), format!("{ssim:.4}")];
        row.extend(with_lpips.then(|| lpips.map_or_else(String::new, |v| format!("{v:.4}"))));
        row
    };
    let mut rows = vec![
        ["photograph", "PSNR, dB", "of what is seen", "seen", "colours fitted", "SSIM"].map(str::to_owned).to_vec(),
    ];
    rows[0].extend(with_lpips.then(|| "LPIPS".to_owned()));
    rows.extend(images.iter().map(|i| row(&i.name, i.psnr, (i.psnr_seen, i.seen), i.psnr_cc, i.ssim, i.lpips_squeeze)));
    let mean_of = |value: fn(&ImageScore) -> f64| mean(images.iter().map(value));
    if let (Some(psnr), Some(ssim)) = (mean_of(|i| i.psnr), mean_of(|i| i.ssim)) {
        let lpips = mean_if_all(images.iter().map(|i| i.lpips_squeeze));
        let seen = (mean_seen(images), mean_if_all(images.iter().map(|i| i.seen)));
        rows.push(row("mean", psnr, seen, mean_of(|i| i.psnr_cc).unwrap_or(f64::INFINITY), ssim, lpips));
    }
    console::table(&rows)
}

/// The scores of the geometry.
pub(super) fn geometry_table(geometry: &Geometry) -> String {
    let mut rows = vec![["geometry", "value"].map(str::to_owned).to_vec()];
    rows.extend(geometry.rows().into_iter().map(|(name, value)| vec![name.to_owned(), value]));
    console::table(&rows)
}
