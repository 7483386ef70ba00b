//! Renders held-out views and compares the renders with the photographs.

use crate::dataset::Pixels;
use crate::eval::{
    Exposures, ImageScore, Quality, gmsd, psnr, psnr_cc, psnr_cc_where, psnr_high_frequency, psnr_where, ssim,
    ssim_where,
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
    let (psnr, fitted, ssim) = if view.masked() == 0 {
        (psnr(rgb, &truth), psnr_cc(rgb, &truth), ssim(rgb, &truth, width, height))
    } else {
        let counts = photograph.counting();
        let fitted = psnr_cc_where(rgb, &truth, &counts);
        (psnr_where(rgb, &truth, &counts), fitted, ssim_where(rgb, &truth, &counts, width, height))
    };
    let [psnr, psnr_cc, ssim] = [psnr, fitted, ssim].map(|value| value.unwrap_or(f64::NAN));
    let counts = (view.masked() > 0).then(|| photograph.counting());
    let gmsd = gmsd(rgb, &truth, counts.as_deref(), width, height);
    let psnr_high_frequency = psnr_high_frequency(rgb, photograph, view.camera.width, view.camera.height);
    ImageScore {
        name: view.name.clone(),
        psnr,
        psnr_seen: None,
        seen: None,
        psnr_cc,
        ssim,
        lpips_squeeze: None,
        gmsd,
        psnr_high_frequency,
    }
}
