//! The scores as tables.

use psrgs_vk::eval::{Geometry, ImageScore, mean, mean_if_all};

use crate::cli::console;

/// The scores of each photograph, and the means.
pub(super) fn scores(images: &[ImageScore]) -> String {
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

/// The scores of the geometry.
pub(super) fn geometry(geometry: &Geometry) -> String {
    let mut rows = vec![["geometry", "against the truth"].map(str::to_owned).to_vec()];
    rows.extend(geometry.rows().into_iter().map(|(name, value)| vec![name.to_owned(), value]));
    console::table(&rows)
}
