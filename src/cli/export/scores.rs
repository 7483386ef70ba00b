//! What formats cost: bytes, seconds, and what held-out photographs lose.

use std::path::{Path, PathBuf};

use psrgs_vk::dataset::{Dataset, LoadOptions, Role};
use psrgs_vk::eval::mean;
use psrgs_vk::format::atomic;
use psrgs_vk::format::splats::Format;
use psrgs_vk::numbers::{fraction, grouped};
use psrgs_vk::train::settings::Photographs;
use psrgs_vk::train::{View, prepare, score};
use psrgs_vk::vk::Gpu;

use super::Args;
use crate::cli::console::{self, Console};
use crate::cli::exit::Failure;
use crate::cli::model_file::{DrawingArgs, ModelFile};
use crate::cli::{output_guard, progress};

/// A written file.
#[derive(Debug, serde::Serialize)]
pub(super) struct Row {
    format: String,
    pub(super) file: PathBuf,
    splats: usize,
    sh_degree: u32,
    bytes: u64,
    pub(super) bytes_per_splat: f64,
    seconds_write: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) seconds_read: Option<f64>,
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    lost: Option<Lost>,
}

/// Means over the held-out photographs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scores {
    psnr: f64,
    ssim: f64,
}

/// Scores of the model in the file, and how much less they are than those of the model.
#[derive(Clone, Copy, Debug, serde::Serialize)]
struct Lost {
    psnr: f64,
    psnr_lost: f64,
    ssim: f64,
    ssim_lost: f64,
}

impl Row {
    pub(super) fn new(format: Format, file: &Path, splats: usize, bytes: u64, degree: u32, seconds: f64) -> Self {
        let name = match format {
            Format::Spz(version) => format!("spz {}", version.number()),
            other => other.extension().to_owned(),
        };
        Self {
            format: name,
            file: file.to_owned(),
            splats,
            sh_degree: degree,
            bytes,
            bytes_per_splat: bytes as f64 / splats.max(1) as f64,
            seconds_write: seconds,
            seconds_read: None,
            lost: None,
        }
    }

    /// Takes in the scores of the model and of the file.
    pub(super) fn lost(&mut self, model: &Scores, file: &Scores) {
        let (psnr_lost, ssim_lost) = (model.psnr - file.psnr, model.ssim - file.ssim);
        self.lost = Some(Lost { psnr: file.psnr, psnr_lost, ssim: file.ssim, ssim_lost });
    }
}

/// The dataset whose held-out photographs are compared.
pub(super) fn dataset(args: &Args, folder: &Path) -> anyhow::Result<Dataset> {
    let photographs = Photographs { max_side: args.max_side, strict: args.files.strict, ..Photographs::default() };
    let options = prepare::load_options(&photographs, args.scene.background.rgb);
    let options = LoadOptions { host_memory: args.host.host_memory.map(|bytes| bytes.0), ..options };
    let dataset = Dataset::load(folder, &options)?;
    if args.format == Some(super::Kind::All) {
        output_guard::check(&args.out, &dataset)?;
    }
    Ok(dataset)
}

/// Renders models from the cameras of held-out photographs.
pub(super) struct Scorer<'a> {
    args: &'a Args,
    console: &'a Console,
    dataset: Dataset,
    views: Vec<View>,
    gpu: Gpu,
}

impl<'a> Scorer<'a> {
    pub(super) fn new(args: &'a Args, mut dataset: Dataset, console: &'a Console) -> anyhow::Result<Self> {
        let mut share = prepare::host_share(&dataset, Role::HeldOut, &args.host);
        let (views, undecoded) = prepare::views(&dataset, Role::HeldOut, &mut share)?;
        dataset.leave_out(&undecoded);
        undecoded.warning.iter().for_each(|warning| console.warn(warning));
        if views.is_empty() {
            let text = format!("{}: no photograph is held out, so no loss can be told", dataset.path.display());
            return Err(Failure::Input(text).into());
        }
        let gpu = args.scene.open(console)?;
        Ok(Self { args, console, dataset, views, gpu })
    }

    /// The mean scores of a model.
    pub(super) fn score(&mut self, model: &ModelFile) -> anyhow::Result<Scores> {
        let args = self.args;
        let drawing = DrawingArgs::exact();
        let frame = &self.dataset.frame;
        let mut drawn = args.scene.upload((&self.gpu, model), &drawing, frame)?;
        let bar = progress::counter(self.console, self.views.len(), "photographs");
        let (mut psnr, mut ssim) = (Vec::new(), Vec::new());
        for view in &self.views {
            let rgb = drawn.picture(&view.camera, false)?.rgb8();
            let scores = score(view, &*view.photograph.pixels()?, &rgb);
            psnr.push(scores.psnr);
            ssim.push(scores.ssim);
            bar.inc(1);
        }
        bar.finish_and_clear();
        drawn.warn_if_unseen(&args.model, &self.dataset.path, self.console);
        let of = |values: Vec<f64>| mean(values.into_iter()).unwrap_or(f64::INFINITY);
        Ok(Scores { psnr: of(psnr), ssim: of(ssim) })
    }
}

/// The files as a table.
pub(super) fn table(rows: &[Row]) -> String {
    let with_scores = rows.iter().any(|row| row.lost.is_some());
    let head = ["format", "bytes", "bytes a splat", "degree", "written, s"].map(str::to_owned).to_vec();
    let mut table = vec![head];
    if with_scores {
        table[0].extend(["read, s", "PSNR lost, dB", "SSIM lost"].map(str::to_owned));
    }
    for row in rows {
        let mut cells = vec![
            row.format.clone(),
            grouped(row.bytes),
            fraction(row.bytes_per_splat, 1),
            row.sh_degree.to_string(),
            fraction(row.seconds_write, 2),
        ];
        if let Some(lost) = &row.lost {
            let read = fraction(row.seconds_read.unwrap_or(0.0), 2);
            cells.extend([read, fraction(lost.psnr_lost, 3), fraction(lost.ssim_lost, 4)]);
        }
        table.push(cells);
    }
    console::table(&table)
}

/// What `--json` writes.
#[derive(serde::Serialize)]
struct Exported<'a> {
    model: &'a Path,
    files: &'a [Row],
}

pub(super) fn write_json(file: &Path, model: &Path, rows: &[Row]) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(&Exported { model, files: rows })?;
    Ok(atomic::write(file, |out| writeln!(out, "{text}"))?)
}
