//! Renders held-out views, and some of those trained on, and compares the renders with the photographs.

use super::Trainer;
use crate::dataset::Pixels;
use crate::eval::{
    Exposures, ImageScore, Quality, TrainingScores, gmsd, psnr, psnr_cc, psnr_cc_where, psnr_high_frequency,
    psnr_where, ssim, ssim_where,
};
use crate::train::Error;
use crate::train::engine::Engine;
use crate::train::input::View;
use crate::train::photographs::Feed;

/// Held-out photographs, and how the model is rendered for them.
pub(super) struct HeldOut<'a> {
    pub(super) views: &'a [View],
    pub(super) photographs: &'a Feed,
    pub(super) sh_degree: u32,
    /// Colour behind the splats.
    pub(super) background: [f32; 3],
    /// Exposures of the training photographs, from which those of held-out photographs are expected.
    pub(super) exposures: Option<&'a Exposures>,
}

/// Renders every view with the exposure expected of its photograph, and compares the render with the photograph, both
/// rounded to 8 bits. `None` as soon as `given_up` returns true.
pub(super) fn quality(
    engine: &mut Engine,
    held_out: &HeldOut<'_>,
    given_up: &dyn Fn() -> bool,
) -> Result<Option<Quality>, Error> {
    let HeldOut { views, photographs, sh_degree, background, exposures } = *held_out;
    let mut images = Vec::with_capacity(views.len());
    for (i, view) in views.iter().enumerate() {
        if given_up() {
            photographs.look_ahead(&[]);
            return Ok(None);
        }
        photographs.look_ahead(&(i..views.len().min(i + photographs.ahead())).collect::<Vec<_>>());
        let picture = engine.picture(&view.camera, sh_degree, background, false)?;
        let picture = match exposures {
            Some(exposures) => picture.exposed(&exposures.of(&view.name, view.camera.center())),
            None => picture,
        };
        images.push(score(view, &*photographs.get(i)?, &picture.rgb8()));
    }
    // No photograph stays decoded until the next evaluation.
    photographs.look_ahead(&[]);
    Ok(Some(Quality::of(images)))
}

/// Compares an 8-bit RGB render with a view's photograph, also rounded to 8 bits, at the pixels that are not masked.
/// [`crate::eval::SeenPixels`] adds the score of the pixels that are seen.
pub fn score(view: &View, photograph: &Pixels, rgb: &[u8]) -> ImageScore {
    let truth = photograph.rgb8();
    let (width, height) = (view.camera.width as usize, view.camera.height as usize);
    let counts = (view.masked() > 0).then(|| photograph.counting());
    let (psnr, ssim) = similarity(rgb, &truth, counts.as_deref(), (width, height));
    let fitted = counts.as_ref().map_or_else(|| psnr_cc(rgb, &truth), |counts| psnr_cc_where(rgb, &truth, counts));
    let gmsd = gmsd(rgb, &truth, counts.as_deref(), width, height);
    let psnr_high_frequency = psnr_high_frequency(rgb, photograph, view.camera.width, view.camera.height);
    ImageScore {
        name: view.name.clone(),
        psnr,
        psnr_seen: None,
        seen: None,
        psnr_cc: fitted.unwrap_or(f64::NAN),
        ssim,
        lpips_squeeze: None,
        gmsd,
        psnr_high_frequency,
    }
}

/// PSNR and SSIM of two 8-bit RGB pictures, of the pixels that count if not all do. NaN where the sizes differ.
fn similarity(rgb: &[u8], truth: &[u8], counts: Option<&[bool]>, (width, height): (usize, usize)) -> (f64, f64) {
    let (psnr, ssim) = match counts {
        None => (psnr(rgb, truth), ssim(rgb, truth, width, height)),
        Some(counts) => (psnr_where(rgb, truth, counts), ssim_where(rgb, truth, counts, width, height)),
    };
    (psnr.unwrap_or(f64::NAN), ssim.unwrap_or(f64::NAN))
}

impl Trainer {
    /// Renders photographs that the current model was trained on, and compares as held-out photographs are compared:
    /// rounded to 8 bits, without what is masked, and each under its exposure where exposures are learned. The
    /// photographs are those of [`TrainingScores::sample`]. Changes nothing of the training.
    pub fn training_scores(&mut self) -> Result<TrainingScores, Error> {
        let step = self.drain_to_step()?;
        let sh_degree = self.schedule.step(step.max(1)).sh_degree;
        let background = self.settings.model.background.evaluated();
        let exposures = self.learned()?;
        let mut each = Vec::new();
        for view in TrainingScores::sample(self.trained_on.names.len()) {
            let camera = self.engine.cameras()[view];
            let picture = self.engine.picture(&camera, sh_degree, background, false)?;
            let picture = match &exposures {
                Some(exposures) => picture.exposed(&exposures.of(&self.trained_on.names[view], camera.center())),
                None => picture,
            };
            let photograph = self.engine.sampled_photograph(view)?;
            let counts = (photograph.masked() > 0).then(|| photograph.counting());
            let size = (camera.width as usize, camera.height as usize);
            each.push(similarity(&picture.rgb8(), &photograph.rgb8(), counts.as_deref(), size));
        }
        Ok(TrainingScores::of(&each))
    }
}
