//! Results of the stages of a training: renders for the report, and the learned widths of the saliency filter.

use anyhow::Context as _;
use image::RgbImage;
use image::imageops::{FilterType, resize};
use psrgs_vk::eval::{StagePanel, ViewPanel};
use psrgs_vk::format::atomic;
use psrgs_vk::numbers::{counted, of_count, percent};
use psrgs_vk::pass::camera::Projection;
use psrgs_vk::raster::{RenderView, Variants, Viewer};
use psrgs_vk::saliency::{Plane, Settings as SaliencySettings};
use psrgs_vk::scene::Gaussians;
use psrgs_vk::train::{Trainer, View};
use serde::Serialize;

use super::finished::Finished;
use super::run_folder::RunFolder;

/// File of the learned widths.
pub(crate) const SIGMA_FILE: &str = "sigma.json";
/// Most photographs whose loss is plotted over sigma.
const CURVES: usize = 8;
/// A curve whose loss rises by a smaller share from its best to its worst sigma is flat.
const FLAT: f64 = 0.02;

/// Adds to each panel the view's texture mask, and renders of the first `constrained` splats of the model and of the
/// other splats.
pub(crate) fn add(
    run: &Finished<'_>,
    trainer: &Trainer,
    model: &Gaussians,
    constrained: usize,
    views: &[View],
    panels: &mut [ViewPanel],
) -> anyhow::Result<()> {
    let settings = run.settings;
    let (first, all) = (constrained as u32, model.len() as u32);
    let mut viewer = Viewer::with_variants(run.gpu, Variants::choose(run.gpu, false));
    let sets = [0..first, first..all].map(|rows| model.rows(&rows.collect::<Vec<_>>()));
    let mut pictures = [Vec::new(), Vec::new()];
    for (set, pictures) in sets.iter().zip(&mut pictures) {
        let planes = viewer.upload(set)?;
        let sh_degree = trainer.schedule().step(settings.run.iterations).sh_degree;
        let projection = Projection { sh_degree, antialias: settings.model.antialias, ..Projection::default() };
        for view in views {
            let shot =
                RenderView { camera: view.camera, projection, background: settings.model.background.evaluated() };
            let picture = viewer.render(&planes, set.len() as u32, &shot, false)?;
            pictures.push(RgbImage::from_raw(picture.width, picture.height, picture.rgb8()).context("picture size")?);
        }
    }
    let [low, high] = pictures;
    for (((view, panel), low), high) in views.iter().zip(panels).zip(low).zip(high) {
        // With many large views the report gets smaller images.
        let (width, height) = panel.photograph.dimensions();
        let fitted = |picture: RgbImage| {
            let fits = picture.dimensions() == (width, height);
            if fits { picture } else { resize(&picture, width, height, FilterType::Triangle) }
        };
        panel.stages = Some(StagePanel { mask: fitted(mask(run, view)?), low: fitted(low), high: fitted(high) });
    }
    Ok(())
}

/// The texture mask that training would give a photograph, in grey.
fn mask(run: &Finished<'_>, view: &View) -> anyhow::Result<RgbImage> {
    let frequencies = &run.settings.frequencies;
    let (width, height) = (view.camera.width, view.camera.height);
    let settings = SaliencySettings::default();
    let luma = Plane::luma(width, height, view.photograph.pixels()?.as_ref())?.reduced(settings.side);
    let found = frequencies.gate.mask(&luma, frequencies.sigma, run.settings.run.seed, &settings)?;
    let whole = found.mask.resized(width, height);
    let grey = whole.values().iter().flat_map(|v| [(255.0 * v.clamp(0.0, 1.0)).round() as u8; 3]).collect();
    RgbImage::from_raw(width, height, grey).context("picture size")
}

/// The learned width of a photograph.
#[derive(Serialize)]
struct Learned<'a> {
    name: &'a str,
    sigma: f64,
    updates: usize,
}

/// The loss of a photograph over sigma at the end of the training.
#[derive(Serialize)]
struct Drawn {
    name: String,
    /// (sigma, loss).
    points: Vec<(f64, f64)>,
    best: Option<(f64, f64)>,
    /// Rise from the smallest loss to the largest, as a share of the smallest.
    rise: Option<f64>,
    flat: bool,
}

/// Writes the learned widths of the saliency filter into the run's folder. Returns a sentence about them, `None` where
/// none were learned.
pub(crate) fn sigmas(trainer: &mut Trainer, folder: &RunFolder) -> anyhow::Result<Option<String>> {
    let updates = trainer.history().sigmas.clone();
    if updates.is_empty() {
        return Ok(None);
    }
    let curves: Vec<Drawn> = trainer
        .sigma_curves(CURVES)?
        .into_iter()
        .map(|(name, curve)| {
            let points = curve.points().to_vec();
            let (low, high) = (points.first().map_or(0.0, |p| p.0), points.last().map_or(0.0, |p| p.0));
            let rise = curve.rise(low, high);
            Drawn { name, best: curve.best(), rise, flat: rise.is_some_and(|rise| rise <= FLAT), points }
        })
        .collect();
    let names = trainer.names();
    let learned: Vec<Learned<'_>> = names
        .iter()
        .enumerate()
        .filter_map(|(view, name)| {
            let mut own = updates.iter().filter(|(_, v, ..)| *v == view).peekable();
            own.peek()?;
            let (count, last) = own.fold((0, 0.0), |(count, _), (_, _, sigma, _)| (count + 1, *sigma));
            Some(Learned { name, sigma: last, updates: count })
        })
        .collect();
    let (least, most) = learned.iter().fold((f64::MAX, f64::MIN), |(a, b), l| (a.min(l.sigma), b.max(l.sigma)));
    let flat = curves.iter().filter(|curve| curve.flat).count();
    let rises: Vec<String> = curves.iter().filter_map(|c| c.rise.map(|rise| percent(rise, 1))).collect();
    let mut sentence = format!(
        "The width of the saliency filter was learned in {} of {}: {least:.2} to {most:.2} bins of 256.",
        counted(updates.len(), "update"),
        counted(learned.len(), "photograph")
    );
    if !rises.is_empty() {
        sentence += &format!(
            " From the best to the worst width the loss of {} rises by {}; {flat} of them {} flat (less than {}).",
            counted(rises.len(), "photograph"),
            rises.join(", "),
            of_count(flat, "is", "are"),
            percent(FLAT, 0)
        );
    }
    let text = serde_json::to_string_pretty(&serde_json::json!({ "photographs": learned, "curves": curves }))?;
    atomic::write(&folder.file(SIGMA_FILE), |out| out.write_all(text.as_bytes()))?;
    Ok(Some(sentence))
}
