//! Writes the files of a finished training.

mod report;

use std::fs;
use std::path::{Path, PathBuf};

use psrgs_vk::dataset::{Dataset, Role, Warning};
use psrgs_vk::eval::{
    self, ExposureScores, Geometry, GeometryError, Metrics, SeenPixels, TrainingPhotograph, TrainingScores, geometry,
    median_loss, misfits,
};
use psrgs_vk::format::{EXPOSURE_FILE, ExposureFile, FRAME_FILE, FrameFile, ply};
use psrgs_vk::numbers::{counted, grouped, of_count, percent};
use psrgs_vk::scene::Gaussians;
use psrgs_vk::train::{Trainer, View, prepare};

use super::console::Console;
use super::exit::Failure;
use super::exposure_args;
use super::finished::Finished;
use super::geo_args::GeoArgs;
use super::held_out::{Compared, Comparison};
use super::lpips::Lpips;
use super::pictures::Pictures;
use super::run_folder::{METRICS, MODEL, RENDERS, REPORT};
use super::stages;

/// The saved model of a finished training.
struct Saved {
    model: Gaussians,
    file: PathBuf,
    /// Size of the file.
    bytes: u64,
    /// Number of splats at the end of the low-frequency stage, where the method has one. These splats come first.
    constrained: Option<usize>,
    /// Whether the training learned exposures, which lie beside the model.
    exposures: bool,
    /// Seconds from the start of the process to the saved model, earlier stretches of training included.
    seconds: f64,
}

/// Writes the model, the renders, the metrics and the report.
pub(crate) fn write(
    run: &Finished<'_>,
    trainer: &mut Trainer,
    lpips: &mut Lpips,
    console: &Console,
) -> anyhow::Result<()> {
    let saved = save_model(run, trainer, console)?;
    let views = trainer.held_out().to_vec();
    let Compared { images, mut panels, exposures } = compare(run, trainer, &views, lpips, console)?;
    // Peak memory of the training, before the report takes memory of its own.
    let peak_device_bytes = run.gpu.memory_use().peak;
    // A photograph that is gone by now must not cost the results of a training.
    let of_training = trainer.training_scores().unwrap_or_else(|problem| {
        console.warn(format_args!("photographs trained on are not scored: {problem}"));
        TrainingScores::default()
    });
    if let Some(first) = saved.constrained {
        // Renders of the stages need memory for a second copy of the model.
        if let Err(problem) = stages::add(run, trainer, &saved.model, first, &views, &mut panels) {
            console.warn(format_args!("the report has no pictures of the stages: {problem:#}"));
        }
    }
    let sigmas = stages::sigmas(trainer, run.folder)?;
    // Damaged ground truth must not cost the results of a training.
    let geometry = known_geometry(run, &saved.model, trainer).unwrap_or_else(|problem| {
        console.warn(format_args!("the geometry is not judged: {problem:#}"));
        Geometry::default()
    });
    let metrics = metrics(run, trainer, &saved, exposures, geometry, peak_device_bytes);
    let metrics = metrics.with_images(images).with_training(of_training);
    metrics.write(&run.folder.file(METRICS))?;
    tell_misfits(&metrics.training_photographs, console);
    if !run.whole {
        // A part is looked at when the parts are put together.
        tell(&metrics, &saved.file, None, console);
        return Ok(());
    }
    let report = run.folder.file(REPORT);
    let data = report::data(run, trainer.history(), metrics, panels, &saved, sigmas)?;
    eval::write_report(&data, &report)?;
    tell(&data.metrics, &saved.file, Some(&report), console);
    Ok(())
}

/// Writes the model, its place in the dataset's coordinates, and the learned exposures.
fn save_model(run: &Finished<'_>, trainer: &mut Trainer, console: &Console) -> anyhow::Result<Saved> {
    let seconds = run.earlier_seconds + run.started.elapsed().as_secs_f64();
    let mut model = trainer.model()?;
    if let Some(rows) = model.finite_rows() {
        let (all, file) = (model.len(), run.folder.file(MODEL));
        if rows.is_empty() {
            let text = format!("{}: none of {} has only finite values", file.display(), counted(all, "splat"));
            return Err(Failure::Output(text).into());
        }
        let lost = all - rows.len();
        console.warn(format_args!(
            "{} of {} {} values that are not finite: {} is written without them",
            grouped(lost),
            counted(all, "splat"),
            of_count(lost, "has", "have"),
            file.display()
        ));
        model = model.rows(&rows);
    }
    let constrained = trainer.constrained_below()?.map(|bound| {
        model = model.in_order_of_birth();
        model.ids.partition_point(|id| *id < bound)
    });
    let frame = run.dataset.frame;
    let file = run.folder.file(MODEL);
    ply::save_staged(&file, &model, &frame, run.settings.model.antialias, constrained)?;
    let placed = GeoArgs::default().placed(run.dataset)?;
    let map = placed.georeference.record(frame.offset);
    FrameFile::new(frame, run.dataset.coordinates.clone()).with_map(map).write(&run.folder.file(FRAME_FILE))?;
    let exposures = trainer.exposures()?;
    if let Some(exposures) = &exposures {
        ExposureFile { photographs: exposures.iter().cloned().collect() }.write(&run.folder.file(EXPOSURE_FILE))?;
    }
    let bytes = fs::metadata(&file).map(|m| m.len()).unwrap_or(0);
    Ok(Saved { model, file, bytes, constrained, exposures: exposures.is_some(), seconds })
}

/// Compares the held-out photographs with renders of the model, and writes both.
fn compare(
    run: &Finished<'_>,
    trainer: &mut Trainer,
    views: &[View],
    lpips: &mut Lpips,
    console: &Console,
) -> anyhow::Result<Compared> {
    let (folder, scale) = (run.folder.file(RENDERS), run.dataset.frame.scale);
    let pictures = Pictures::new(&folder, views.iter().map(|v| v.name.as_str()), scale)?;
    let exposures = trainer.expected_exposures()?;
    let seen = seen_pixels(run)
        .inspect_err(|problem| console.warn(format_args!("what training photographs see is not known: {problem:#}")));
    let mut comparison =
        Comparison::new(run.gpu, lpips, exposures, Some(pictures), views.len(), console).with_seen(seen.ok());
    for view in views {
        comparison.add(view, trainer.picture(&view.camera)?)?;
    }
    Ok(comparison.end())
}

/// The pixels of held-out photographs that photographs see which were trained on.
fn seen_pixels(run: &Finished<'_>) -> Result<SeenPixels, GeometryError> {
    let share = prepare::host_share(run.dataset, Role::Train, &run.settings.host);
    let left_out = |name: &str| {
        let wrong =
            |warning: &Warning| matches!(warning, Warning::PoseWrong { name: of, left_out: true, .. } if of == name);
        run.left_out.iter().any(wrong)
    };
    SeenPixels::of(run.dataset, &share, |name| !left_out(name))
}

/// Compares the model with the dataset's ground truth and reconstructed points, as far as there are any.
fn known_geometry(run: &Finished<'_>, model: &Gaussians, trainer: &mut Trainer) -> anyhow::Result<Geometry> {
    if !run.whole {
        return Ok(Geometry::default());
    }
    let options = prepare::load_options_of(run.settings);
    geometry::measure_by(run.dataset, &options, model, |camera, known| {
        Ok((trainer.picture(camera)?, trainer.probe(camera, known)?))
    })
}

/// The numbers of the run except those of its images.
fn metrics(
    run: &Finished<'_>,
    trainer: &Trainer,
    saved: &Saved,
    exposures: Option<ExposureScores>,
    geometry: Geometry,
    peak_device_bytes: u64,
) -> Metrics {
    let settings = run.settings;
    let sized = trainer.held_out().first().map(|v| v.camera).or_else(|| run.dataset.views.first().map(|v| v.camera));
    Metrics {
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
        psnr_seen: None,
        seen: None,
        psnr_cc: None,
        ssim: None,
        lpips_squeeze: None,
        gmsd: None,
        psnr_high_frequency: None,
        psnr_training: None,
        ssim_training: None,
        first_splats: trainer.history().splats.first().map(|(_, splats)| *splats as usize),
        splats: saved.model.len(),
        bytes: saved.bytes,
        seconds: saved.seconds,
        seconds_stereo: run.stereo_seconds,
        seconds_saliency: trainer.saliency_seconds(),
        seconds_per_iteration: run.training_seconds / f64::from(settings.run.iterations.max(1)),
        peak_device_bytes,
        peak_host_bytes: eval::peak_host_bytes(),
        streaming: trainer.streaming(),
        exposures,
        geometry,
        images: Vec::new(),
        training_photographs: training_photographs(run, trainer),
    }
}

/// The training photographs, the worst fitted first, followed by photographs that were left out.
fn training_photographs(run: &Finished<'_>, trainer: &Trainer) -> Vec<TrainingPhotograph> {
    let left_out = run.dataset.warnings.iter().chain(run.left_out).filter_map(|warning| match warning {
        Warning::PoseWrong { name, fault, left_out: true } => Some(TrainingPhotograph {
            name: name.clone(),
            loss: None,
            steps: 0,
            left_out: Some(format!("wrong pose: {fault}")),
        }),
        _ => None,
    });
    let undecodable = run.undecoded.photographs.iter().filter(|photograph| photograph.role == Role::Train);
    let undecodable = undecodable.map(|photograph| TrainingPhotograph {
        name: photograph.name.clone(),
        loss: None,
        steps: 0,
        left_out: Some(format!("cannot be decoded: {}", photograph.problem)),
    });
    trainer.training_photographs().into_iter().chain(left_out).chain(undecodable).collect()
}

/// Warns of photographs that are fitted far worse than the others.
fn tell_misfits(photographs: &[TrainingPhotograph], console: &Console) {
    let found = misfits(photographs);
    let (Some(worst), Some(usual)) = (found.first(), median_loss(photographs)) else { return };
    let more = match found.len() {
        1 => String::new(),
        n => format!(" and {} more", n - 1),
    };
    console.warn(format_args!(
        "'{}'{more} fitted far worse than the others (loss {:.3}, half of all have {usual:.3} at most): a wrong pose, \
         a blurred photograph, or one of something that moved. The report lists the photographs trained on, worst \
         first",
        worst.name,
        worst.loss.unwrap_or(f64::NAN),
    ));
}

/// Prints the scores, the times and the paths of the results.
fn tell(metrics: &Metrics, model: &Path, report: Option<&Path>, console: &Console) {
    if let (Some(psnr), Some(ssim)) = (metrics.psnr, metrics.ssim) {
        let fitted = metrics.psnr_cc.map(|p| format!(" ({p:.2} with colours fitted)")).unwrap_or_default();
        let lpips = metrics.lpips_squeeze.map_or_else(String::new, |v| format!(", LPIPS {v:.4}"));
        let seen = match (metrics.psnr_seen, metrics.seen) {
            (Some(psnr), Some(seen)) => format!("; {psnr:.2} dB of what is seen, {} of the pixels", percent(seen, 1)),
            _ => String::new(),
        };
        console.say(format_args!("held out: PSNR {psnr:.2} dB{fitted}, SSIM {ssim:.4}{lpips}{seen}"));
        if let Some(scores) = &metrics.exposures {
            console.say(exposure_args::line(scores));
        }
    }
    if let (Some(psnr), Some(ssim)) = (metrics.psnr_training, metrics.ssim_training) {
        let more = metrics.fitted_by_heart().filter(|more| *more > 0.0);
        let more = more.map_or_else(String::new, |more| format!("; {more:.2} dB are fitted by heart"));
        console.say(format_args!("photographs trained on: PSNR {psnr:.2} dB, SSIM {ssim:.4}{more}"));
    }
    let seconds = metrics.seconds;
    let shares: Vec<String> = [("stereo", metrics.seconds_stereo), ("masks", metrics.seconds_saliency)]
        .into_iter()
        .filter(|(_, part)| *part > 0.0)
        .map(|(what, part)| format!("{what} {part:.1} s ({})", percent(part / seconds, 1)))
        .collect();
    if !shares.is_empty() {
        console.say(format_args!("{seconds:.0} s in all, of which {}", shares.join(", ")));
    }
    let known: Vec<String> =
        metrics.geometry.rows_in_short().into_iter().map(|(name, value)| format!("{name} {value}")).collect();
    if !known.is_empty() {
        console.say(format_args!("geometry: {}", known.join("; ")));
    }
    console.say(format_args!(
        "{} in {}{}",
        counted(metrics.splats, "splat"),
        model.display(),
        report.map_or_else(String::new, |report| format!("; report: {}", report.display()))
    ));
}

/// The name of a dataset: its folder's name.
pub(crate) fn scene_name(dataset: &Dataset) -> String {
    let path = std::path::absolute(&dataset.path).unwrap_or_else(|_| dataset.path.clone());
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}
