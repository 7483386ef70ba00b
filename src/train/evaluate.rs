//! Held-out views, rendered and compared.

use super::Error;
use super::engine::Engine;
use super::input::View;
use crate::eval::{ImageScore, Quality, psnr, psnr_cc, psnr_cc_where, psnr_where, ssim, ssim_where};

/// Renders every view and compares it with its photograph, both rounded to 8 bits.
pub(super) fn quality(
    engine: &mut Engine,
    views: &[View],
    sh_degree: u32,
    background: [f32; 3],
) -> Result<Quality, Error> {
    let mut images = Vec::with_capacity(views.len());
    for view in views {
        let picture = engine.picture(&view.camera, sh_degree, background, false)?;
        images.push(score(view, &picture.rgb8()));
    }
    Ok(Quality::of(images))
}

/// Compares 8-bit RGB with a view's photograph, where that is not masked.
pub fn score(view: &View, rgb: &[u8]) -> ImageScore {
    let truth: Vec<u8> = view.rgba.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
    let (width, height) = (view.camera.width as usize, view.camera.height as usize);
    let (psnr, fitted, ssim) = if view.masked() == 0 {
        (psnr(rgb, &truth), psnr_cc(rgb, &truth), ssim(rgb, &truth, width, height))
    } else {
        let counts: Vec<bool> = view.rgba.chunks_exact(4).map(|p| p[3] != 0).collect();
        let fitted = psnr_cc_where(rgb, &truth, &counts);
        (psnr_where(rgb, &truth, &counts), fitted, ssim_where(rgb, &truth, &counts, width, height))
    };
    let [psnr, psnr_cc, ssim] = [psnr, fitted, ssim].map(|value| value.unwrap_or(f64::NAN));
    ImageScore { name: view.name.clone(), psnr, psnr_cc, ssim }
}
