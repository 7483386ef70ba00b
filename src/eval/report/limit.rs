//! Pictures of a report that would not all fit the memory at their full size.

use image::imageops::{FilterType, resize};

use super::{DepthMap, ViewPanel};

/// Bytes that the pictures of all views of a report may take, with the differences that are drawn of them.
pub const REPORT_BYTES: u64 = 160 << 20;
/// Bytes of a pixel: photograph, render, depth, difference.
const PER_PIXEL: f64 = 14.0;

impl ViewPanel {
    /// Reduces the pictures to their share of the memory among `views` views; depth takes the nearest values. Scores do
    /// not change.
    pub fn among(self, views: usize) -> Self {
        let (width, height) = self.photograph.dimensions();
        let factor =
            (REPORT_BYTES as f64 / PER_PIXEL / views.max(1) as f64 / (f64::from(width) * f64::from(height)).max(1.0))
                .sqrt();
        if factor >= 1.0 {
            return self;
        }
        let side = |of: u32| ((f64::from(of) * factor) as u32).max(1);
        let (w, h) = (side(width), side(height));
        let small = |picture| resize(picture, w, h, FilterType::Triangle);
        let at = |k: u32, to: u32, of: u32| (u64::from(2 * k + 1) * u64::from(of) / u64::from(2 * to)) as usize;
        let pixel = |k: u32, (width, height): (u32, u32)| at(k / w, h, height) * width as usize + at(k % w, w, width);
        let nearest = |depth: DepthMap| {
            let of = |k: u32| depth.values.get(pixel(k, (depth.width, depth.height))).copied().unwrap_or(0.0);
            DepthMap { width: w, height: h, values: (0..w * h).map(of).collect() }
        };
        let counting = match self.counting.as_slice() {
            [] => Vec::new(),
            all => (0..w * h).map(|k| all.get(pixel(k, (width, height))).copied().unwrap_or(true)).collect(),
        };
        Self {
            photograph: small(&self.photograph),
            render: small(&self.render),
            depth: self.depth.map(nearest),
            counting,
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;

    #[test]
    fn many_views_are_reduced_together_and_few_are_not() {
        let (width, height) = (400, 200);
        let picture = RgbImage::from_fn(width, height, |x, _| Rgb([(x / 2) as u8; 3]));
        let depth = DepthMap { width, height, values: (0..width * height).map(|k| (k % width) as f32).collect() };
        let panel = ViewPanel {
            name: "a".into(),
            photograph: picture.clone(),
            render: picture.clone(),
            depth: Some(depth),
            counting: (0..width * height).map(|k| k % width >= 100).collect(),
            stages: None,
            psnr: 1.0,
            psnr_cc: 1.0,
            ssim: 0.5,
            lpips_squeeze: None,
            gmsd: None,
            psnr_high_frequency: None,
        };
        assert!(panel.clone().among(100).photograph == picture, "all of a hundred fit");
        let many = 10_000;
        let small = panel.among(many);
        let (w, h) = small.photograph.dimensions();
        assert!(f64::from(w * h) * PER_PIXEL * many as f64 <= REPORT_BYTES as f64 && w > 40, "{w}x{h}");
        assert_eq!(small.render.dimensions(), (w, h));
        let counting: Vec<bool> = (0..w * h).map(|k| k % w >= w / 4).collect();
        let wrong = small.counting.iter().zip(&counting).filter(|(a, b)| a != b).count();
        assert!(small.counting.len() == counting.len() && wrong <= h as usize, "{wrong} of {}", counting.len());
        let depth = small.depth.unwrap();
        assert_eq!((depth.width, depth.height, depth.values.len()), (w, h, (w * h) as usize));
        let middle = 400.0 / f64::from(w) * (f64::from(w / 2) + 0.5);
        assert!((f64::from(depth.values[(w / 2) as usize]) - middle).abs() <= 1.0);
        assert!((f64::from(small.render.get_pixel(w / 2, 0).0[0]) - middle / 2.0).abs() < 3.0);
    }
}
