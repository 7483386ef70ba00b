//! PSNR where a photograph has high frequencies.

use super::psnr_where;
use crate::dataset::Pixels;
use crate::saliency::{Gate, Plane, Settings};

/// Share of the pixels that counts.
const SHARE: f64 = 0.3;

/// PSNR of an RGB picture (interleaved bytes) against `truth` in the `SHARE` of the photograph's pixels whose blurred
/// squared gradient is largest: a region that the photograph alone decides, so that it is the same for whatever is
/// compared with it. Pixels that are masked have no part. `None` where sizes do not agree, or no pixel has a gradient.
pub fn psnr_high_frequency(rgb: &[u8], photograph: &Pixels, width: u32, height: u32) -> Option<f64> {
    let region = region(photograph, width, height)?;
    psnr_where(rgb, &photograph.rgb8(), &region)
}

fn region(photograph: &Pixels, width: u32, height: u32) -> Option<Vec<bool>> {
    let settings = Settings::default();
    let luma = Plane::luma(width, height, photograph).ok()?.reduced(settings.side);
    let energy = Gate::Gradient.mask(&luma, 0.0, 0, &settings).ok()?.map.resized(width, height);
    let counts = photograph.counting();
    let mut values: Vec<f32> = energy.values().iter().zip(&counts).filter(|(_, c)| **c).map(|(v, _)| *v).collect();
    let rank = ((1.0 - SHARE) * values.len() as f64) as usize;
    if rank >= values.len() {
        return None;
    }
    let level = *values.select_nth_unstable_by(rank, f32::total_cmp).1;
    // Of a picture without a gradient everything would be the largest.
    (level > 0.0).then(|| energy.values().iter().zip(counts).map(|(v, c)| c && *v >= level).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stripes on the left third, nothing on the right.
    fn photograph(masked: bool) -> Pixels {
        let pixel = |k: usize| {
            let (x, y) = (k % 60, k / 60);
            let value = if x < 20 { 255 * (y / 2 % 2) as u8 } else { 100 };
            [value, value, value, if masked && x < 20 { 0 } else { 255 }]
        };
        Pixels::Rgba8((0..60 * 40).flat_map(pixel).collect())
    }

    #[test]
    fn only_errors_where_there_is_texture_count() {
        let truth = photograph(false);
        let mut flat_wrong = truth.rgb8();
        let mut texture_wrong = flat_wrong.clone();
        for (k, (a, b)) in flat_wrong.chunks_exact_mut(3).zip(texture_wrong.chunks_exact_mut(3)).enumerate() {
            if k % 60 >= 40 {
                a.fill(130);
            }
            if k % 60 < 10 {
                b.fill(128);
            }
        }
        let of = |rgb: &[u8]| psnr_high_frequency(rgb, &truth, 60, 40);
        assert_eq!(of(&flat_wrong), Some(f64::INFINITY));
        assert!(of(&texture_wrong).is_some_and(|p| p < 15.0));
        let region = region(&truth, 60, 40).unwrap();
        let share = region.iter().filter(|r| **r).count() as f64 / region.len() as f64;
        assert!((share - SHARE).abs() < 0.02, "{share}");
    }

    #[test]
    fn what_is_masked_or_flat_has_no_part() {
        assert_eq!(psnr_high_frequency(&photograph(true).rgb8(), &photograph(true), 60, 40), None);
        assert_eq!(psnr_high_frequency(&[], &photograph(false), 61, 40), None);
    }
}
