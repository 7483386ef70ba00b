//! `psrgs-vk eval`: scores of a model on held-out photographs.

use std::path::{Path, PathBuf};
use std::time::Instant;

use psrgs_vk::dataset::{Dataset, Role, Warning};
use psrgs_vk::eval::{
    self, ExposureScores, Geometry, GeometryTruth, ImageScore, Metrics, ReportData, ReportError, ViewPanel, geometry,
    mean, mean_if_all,
};
use psrgs_vk::format::atomic;
use psrgs_vk::train::settings::{BlendingForms, DeviceChoice, HostChoice, Photographs, Scoring, Split};
use psrgs_vk::train::{View, prepare, score};

use super::colour::Colour;
use super::console::{self, Console};
use super::drawing::DrawingArgs;
use super::exit::Failure;
use super::exposed::{self, Exposed, ExposureArgs};
use super::lpips::Lpips;
use super::model_file::ModelFile;
use super::model_frame::{FrameArgs, ModelFrame};
use super::pictures::Pictures;
use super::run_folder::{REPORT, SETTINGS};
use super::score_size::SizeArgs;
use super::{device, out_folder, outputs, progress, trained_as};

/// Score a model on the held-out photographs of a dataset
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk eval fox-model/point_cloud.ply fox
  psrgs-vk eval other-trainer.ply fox --max-side 640 --json scores.json
  psrgs-vk eval splat.ply fox --frame dataparser_transforms.json --downscale 2 --rounding down
  psrgs-vk eval fox-model/point_cloud.ply fox --out scored      pictures and report.html")]
pub(crate) struct Args {
    /// Model, a PLY file in the INRIA layout, of this or another trainer
    pub(crate) model: PathBuf,
    /// Dataset
    pub(crate) data: PathBuf,
    /// Write the scores, for each photograph too, as JSON
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
    /// Write renders, photographs, depth and normals into this folder, and a report.html
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Colour behind the splats: black, white, #rrggbb, or R,G,B with numbers from 0 to 1
    #[arg(long, value_name = "COLOUR", default_value = "black")]
    pub(crate) background: Colour,
    /// Draw as a model trained with --antialias [default: what the model file says]
    #[arg(long)]
    pub(crate) antialias: bool,
    #[command(flatten)]
    pub(crate) exposure: ExposureArgs,
    #[command(flatten)]
    pub(crate) frame: FrameArgs,
    #[command(flatten)]
    pub(crate) photographs: Photographs,
    #[command(flatten)]
    pub(crate) size: SizeArgs,
    #[command(flatten)]
    pub(crate) scoring: Scoring,
    #[command(flatten)]
    pub(crate) drawing: DrawingArgs,
    #[command(flatten)]
    pub(crate) device: DeviceChoice,
    #[command(flatten)]
    pub(crate) host: HostChoice,
    #[command(flatten)]
    pub(crate) blending: BlendingForms,
}

/// What `--json` writes.
#[derive(Debug, serde::Serialize)]
struct Scores<'a> {
    model: &'a Path,
    scene: String,
    split: Split,
    /// The coordinates that the model was taken to be in.
    frame: String,
    background: String,
    /// What transparent pixels of photographs were taken to be.
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
    images: &'a [ImageScore],
}

pub(crate) fn run(args: &Args, console: &Console, started: Instant) -> anyhow::Result<()> {
    args.json.as_deref().map(atomic::check).transpose()?;
    if let Some(folder) = args.out.as_deref().filter(|folder| folder.join(SETTINGS).is_file()) {
        return Err(Failure::Usage(format!(
            "--out {}: that is the folder of a training, whose report and renders would be replaced; choose another folder",
            folder.display()
        ))
        .into());
    }
    let model = ModelFile::read(&args.model, args.antialias, &args.frame, console)?;
    if model.splats() == 0 {
        return Err(Failure::Input(format!(
            "{}: the model has no splats: there is nothing to score",
            args.model.display()
        ))
        .into());
    }
    let options = args.size.apply(prepare::load_options(&args.photographs, args.background.rgb));
    let dataset = Dataset::load(&args.data, &options)?;
    args.out.as_deref().map(|out| out_folder::check(out, &dataset)).transpose()?;
    if dataset.views_of(Role::HeldOut).next().is_none() {
        return Err(nothing_held_out(args, &dataset));
    }
    let exposures = args.exposure.read(&args.model, &dataset, console)?;
    let mut share = prepare::host_share(&dataset, Role::HeldOut, &args.host);
    let views = prepare::views(&dataset, Role::HeldOut, &mut share)?;
    prepare::left_out(&dataset, Role::HeldOut, &views).iter().for_each(|warning| console.warn(warning));
    tell(args, &dataset, &views, console);
    let by_side = options.sizing.is_none();
    for line in trained_as::differences(&args.model, &args.photographs, args.background.rgb, by_side) {
        console.warn(line);
    }
    let mut lpips = Lpips::find(&args.scoring, console)?;
    let gpu = device::open(&args.device, false, console)?;
    let mut drawn = model.upload(&gpu, &args.blending, &args.drawing, &dataset.frame, &args.background)?;
    let pictures = match &args.out {
        Some(folder) => Some(Pictures::new(folder, views.iter().map(|v| v.name.as_str()), dataset.frame.scale)?),
        None => None,
    };
    let mut exposed = Exposed::new(exposures);
    let (mut images, mut panels) = (Vec::new(), Vec::new());
    let bar = progress::counter(console, views.len(), "photographs");
    for (i, view) in views.iter().enumerate() {
        let picture = exposed.picture(view, drawn.picture(&view.camera, pictures.is_some())?)?;
        match &pictures {
            Some(pictures) => {
                let mut panel = pictures.held_out(i, view, &picture)?;
                panel.lpips_squeeze = lpips.measure(&gpu, view, panel.render.as_raw(), console);
                images.push(panel.score());
                panels.push(panel.among(views.len()));
            }
            None => {
                let rgb = picture.rgb8();
                let lpips_squeeze = lpips.measure(&gpu, view, &rgb, console);
                images.push(ImageScore { lpips_squeeze, ..score(view, &*view.photograph.pixels()?, &rgb) });
            }
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    drawn.warn_if_unseen(&args.model, &args.data, console);
    let truth = GeometryTruth::find(&dataset, &options)?;
    let geometry = match truth.is_empty() {
        true => Geometry::default(),
        false => geometry::measure(&truth, &model.in_scene(&dataset.frame), |camera| {
            anyhow::Ok(drawn.picture(camera, true)?)
        })?,
    };
    console::print(&table(&images))?;
    if let Some(scores) = exposed.scores() {
        console.say(exposed::line(&scores));
    }
    if geometry != Geometry::default() {
        console::print(&geometry_table(&geometry))?;
    }

    let size = views.first().map_or((0, 0), |v| (v.camera.width, v.camera.height));
    let scene = outputs::scene_name(&dataset);
    if let Some(file) = &args.json {
        let scores = Scores {
            model: &args.model,
            scene: scene.clone(),
            split: args.photographs.split,
            frame: model.frame.to_string(),
            background: args.background.to_string(),
            transparent: args.photographs.transparent.to_string(),
            antialias: model.antialias,
            test_images: images.len(),
            width: size.0,
            height: size.1,
            device: &gpu.caps().device,
            splats: model.splats(),
            bytes: model.bytes,
            psnr: mean(images.iter().map(|i| i.psnr)),
            psnr_cc: mean(images.iter().map(|i| i.psnr_cc)),
            ssim: mean(images.iter().map(|i| i.ssim)),
            lpips_squeeze: mean_if_all(images.iter().map(|i| i.lpips_squeeze)),
            gmsd: mean_if_all(images.iter().map(|i| i.gmsd)),
            psnr_high_frequency: mean_if_all(images.iter().map(|i| i.psnr_high_frequency)),
            exposures: exposed.scores(),
            geometry,
            images: &images,
        };
        let text = serde_json::to_string_pretty(&scores)?;
        atomic::write(file, |out| writeln!(out, "{text}"))?;
    }
    if let Some(folder) = &args.out {
        let metrics = Metrics {
            method: file_name(&args.model),
            iterations: 0,
            scene,
            train_images: dataset.views_of(Role::Train).count(),
            test_images: 0,
            width: size.0,
            height: size.1,
            seed: 0,
            device: gpu.caps().device.clone(),
            forms: None,
            psnr: None,
            psnr_cc: None,
            ssim: None,
            lpips_squeeze: None,
            gmsd: None,
            psnr_high_frequency: None,
            splats: model.splats(),
            bytes: model.bytes,
            seconds: started.elapsed().as_secs_f64(),
            seconds_stereo: 0.0,
            seconds_saliency: 0.0,
            seconds_per_iteration: 0.0,
            peak_device_bytes: gpu.memory_use().peak,
            peak_host_bytes: eval::peak_host_bytes(),
            streaming: None,
            exposures: exposed.scores(),
            geometry,
            images: Vec::new(),
        }
        .with_images(images);
        report(args, &model.frame, &dataset, metrics, panels, &folder.join(REPORT))?;
        console.say(format_args!("pictures and report in {}", folder.display()));
    }
    Ok(())
}

/// Which photographs the model is compared with.
fn tell(args: &Args, dataset: &Dataset, views: &[View], console: &Console) {
    let images = dataset.images.as_ref().map(|f| f.path.display().to_string()).unwrap_or_default();
    let mut sizes: Vec<String> = views.iter().map(|v| format!("{}x{}", v.camera.width, v.camera.height)).collect();
    sizes.sort();
    sizes.dedup();
    let sizes = if sizes.len() > 3 { format!("{} sizes", sizes.len()) } else { sizes.join(", ") };
    console.say(format_args!(
        "{} of {} photographs of {images} are scored (--split {}), at {sizes}, background {}",
        views.len(),
        dataset.views.len(),
        args.photographs.split,
        args.background
    ));
    for line in dataset.deep_photographs() {
        console.say(format_args!("{line}; scores are those of 8 bits"));
    }
    for warning in warnings(dataset) {
        console.warn(warning);
    }
}

/// What should be known of the dataset where nothing is trained.
fn warnings(dataset: &Dataset) -> impl Iterator<Item = &Warning> {
    dataset.warnings.iter().filter(|warning| !warning.is_of_training())
}

fn nothing_held_out(args: &Args, dataset: &Dataset) -> anyhow::Error {
    if args.photographs.split == Split::None {
        return Failure::Usage("--split none holds no photograph out: there is nothing to score".into()).into();
    }
    let views = dataset.views.len();
    Failure::Input(format!("{}: with {views} photographs none is held out to be scored", args.data.display())).into()
}

/// Each photograph and the means.
fn table(images: &[ImageScore]) -> String {
    let decibels = |v: f64| if v.is_finite() { format!("{v:.3}") } else { "equal".to_owned() };
    let with_lpips = images.iter().any(|i| i.lpips_squeeze.is_some());
    let row = |name: &str, psnr, fitted, ssim, lpips: Option<f64>| {
        let mut row = vec![name.to_owned(), decibels(psnr), decibels(fitted), format!("{ssim:.4}")];
        row.extend(with_lpips.then(|| lpips.map_or_else(String::new, |v| format!("{v:.4}"))));
        row
    };
    let mut rows = vec![["photograph", "PSNR, dB", "colours fitted", "SSIM"].map(str::to_owned).to_vec()];
    rows[0].extend(with_lpips.then(|| "LPIPS".to_owned()));
    rows.extend(images.iter().map(|i| row(&i.name, i.psnr, i.psnr_cc, i.ssim, i.lpips_squeeze)));
    let mean_of = |value: fn(&ImageScore) -> f64| mean(images.iter().map(value));
    if let (Some(psnr), Some(ssim)) = (mean_of(|i| i.psnr), mean_of(|i| i.ssim)) {
        let lpips = mean_if_all(images.iter().map(|i| i.lpips_squeeze));
        rows.push(row("mean", psnr, mean_of(|i| i.psnr_cc).unwrap_or(f64::INFINITY), ssim, lpips));
    }
    console::table(&rows)
}

/// What is known of the geometry.
fn geometry_table(geometry: &Geometry) -> String {
    let mut rows = vec![["geometry", "against the truth"].map(str::to_owned).to_vec()];
    rows.extend(geometry.rows().into_iter().map(|(name, value)| vec![name.to_owned(), value]));
    console::table(&rows)
}

fn report(
    args: &Args,
    frame: &ModelFrame,
    dataset: &Dataset,
    metrics: Metrics,
    views: Vec<ViewPanel>,
    file: &Path,
) -> Result<(), ReportError> {
    let setting = |name: &str, value: String| (name.to_owned(), value);
    let data = ReportData {
        title: format!("{} on {}", metrics.method, metrics.scene),
        settings: vec![
            setting("model", args.model.display().to_string()),
            setting("data", args.data.display().to_string()),
            setting("size", format!("{}x{}", metrics.width, metrics.height)),
            setting("split", args.photographs.split.to_string()),
            setting("background", args.background.to_string()),
            setting("transparent pixels", args.photographs.transparent.to_string()),
            setting("coordinates", frame.to_string()),
        ],
        curves: Vec::new(),
        files: Vec::new(),
        notes: warnings(dataset).map(ToString::to_string).collect(),
        views,
        metrics,
    };
    eval::write_report(&data, file)
}

fn file_name(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}
