//! The pictures of a held-out view: error and depth in colour, all as data addresses.

use std::io::Cursor;

use image::codecs::jpeg::JpegEncoder;
use image::imageops::{self, FilterType};
use image::{ImageFormat, Rgb, RgbImage};

use super::{DepthMap, ReportError};
use crate::eval::colormap::Colormap;
use crate::format::markup::base64;

/// How pictures are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Storage {
    /// Longest side in pixels; larger pictures are reduced.
    pub(super) side: u32,
    /// JPEG quality, or PNG.
    pub(super) jpeg: Option<u8>,
}

/// From lossless to small: the first with which all pictures fit the page is used.
pub(super) const STORAGES: [Storage; 6] = [
    Storage { side: 1600, jpeg: None },
    Storage { side: 1600, jpeg: Some(92) },
    Storage { side: 1200, jpeg: Some(88) },
    Storage { side: 800, jpeg: Some(85) },
    Storage { side: 480, jpeg: Some(80) },
    Storage { side: 256, jpeg: Some(75) },
];

/// A picture as a data address.
pub(super) fn address(picture: &RgbImage, storage: Storage) -> Result<String, ReportError> {
    let longest = picture.width().max(picture.height()).max(1);
    let reduced = (longest > storage.side).then(|| {
        let scale = |v: u32| ((u64::from(v) * u64::from(storage.side) / u64::from(longest)) as u32).max(1);
        imageops::resize(picture, scale(picture.width()), scale(picture.height()), FilterType::Triangle)
    });
    let picture = reduced.as_ref().unwrap_or(picture);
    let mut data = Cursor::new(Vec::new());
    let kind = match storage.jpeg {
        None => {
            picture.write_to(&mut data, ImageFormat::Png)?;
            "png"
        }
        Some(quality) => {
            picture.write_with_encoder(JpegEncoder::new_with_quality(&mut data, quality))?;
            "jpeg"
        }
    };
    Ok(format!("data:image/{kind};base64,{}", base64(data.get_ref())))
}

/// Mean absolute difference of the channels per pixel, 8-bit steps; not a number where a pixel does not count.
pub(super) fn differences(photograph: &RgbImage, render: &RgbImage, counting: &[bool]) -> Vec<f32> {
    let steps =
        |(a, b): (&Rgb<u8>, &Rgb<u8>)| a.0.iter().zip(b.0).map(|(&x, y)| f32::from(x.abs_diff(y))).sum::<f32>() / 3.0;
    let mut all: Vec<f32> = photograph.pixels().zip(render.pixels()).map(steps).collect();
    all.iter_mut().zip(counting).filter(|(_, counts)| !**counts).for_each(|(difference, _)| *difference = f32::NAN);
    all
}

/// Stripes across a picture's longer side.
const STRIPES: u32 = 60;
/// The greys of stripes, and the share of the picture below that stays to be seen.
const STRIPE_GREYS: [f32; 2] = [196.0, 128.0];
const SEEN_BELOW: f32 = 0.2;

/// A picture with stripes over the pixels that do not count.
pub(super) fn hatched(picture: &RgbImage, counting: &[bool]) -> RgbImage {
    let mut marked = picture.clone();
    let width = (picture.width().max(picture.height()) / STRIPES).max(2);
    for ((x, y, pixel), _) in marked.enumerate_pixels_mut().zip(counting).filter(|(_, counts)| !**counts) {
        let grey = STRIPE_GREYS[((x + y) / width % 2) as usize];
        let below = pixel.0.map(f32::from).iter().sum::<f32>() / 3.0;
        *pixel = Rgb([(SEEN_BELOW * below + (1.0 - SEEN_BELOW) * grey).round() as u8; 3]);
    }
    marked
}

/// The value below which `share` of the finite values lie; 0 when there are none.
pub(super) fn quantile(values: impl Iterator<Item = f32>, share: f64) -> f32 {
    let mut sorted: Vec<f32> = values.filter(|v| v.is_finite()).collect();
    if sorted.is_empty() {
        return 0.0;
    }
    let at = ((sorted.len() - 1) as f64 * share).round() as usize;
    *sorted.select_nth_unstable_by(at, f32::total_cmp).1
}

/// Values as colours between `low` and `high`; grey where there is none.
pub(super) fn paint(values: &[f32], size: (u32, u32), low: f32, high: f32, map: &Colormap) -> RgbImage {
    let span = (high - low).max(f32::MIN_POSITIVE);
    RgbImage::from_fn(size.0, size.1, |x, y| {
        let at = y as usize * size.0 as usize + x as usize;
        match values.get(at) {
            Some(v) if v.is_finite() => Rgb(map.colour((v - low) / span)),
            _ => Rgb([128; 3]),
        }
    })
}

/// Depth as colours between its 1st and 99th percentile: the picture and the range. Pixels without surface (depth 0 or
/// not finite) are grey.
pub(crate) fn depth(map: &DepthMap) -> (RgbImage, (f32, f32)) {
    let values: Vec<f32> = map.values.iter().map(|&z| if z > 0.0 { z } else { f32::NAN }).collect();
    let low = quantile(values.iter().copied(), 0.01);
    let high = quantile(values.iter().copied(), 0.99).max(low);
    (paint(&values, (map.width, map.height), low, high, &Colormap::depth()), (low, high))
}

/// A colour map as a CSS gradient from left to right.
pub(super) fn gradient(map: &Colormap) -> String {
    let stops: Vec<String> = (0..=16)
        .map(|k| {
            let [r, g, b] = map.colour(k as f32 / 16.0);
            format!("#{r:02x}{g:02x}{b:02x}")
        })
        .collect();
    format!("linear-gradient(90deg,{})", stops.join(","))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_and_quantiles() {
        let a = RgbImage::from_pixel(2, 1, Rgb([10, 20, 30]));
        let mut b = a.clone();
        b.put_pixel(1, 0, Rgb([13, 14, 30]));
        assert_eq!(differences(&a, &b, &[]), [0.0, 3.0]);
        let some = differences(&a, &b, &[true, false]);
        assert!(some[0] == 0.0 && some[1].is_nan(), "{some:?}");
        assert_eq!(quantile([4.0, f32::NAN, 1.0, 3.0, 2.0, 5.0].into_iter(), 0.5), 3.0);
        assert_eq!(quantile([].into_iter(), 0.5), 0.0);
    }

    #[test]
    fn depth_without_surface_is_grey() {
        let map = DepthMap { width: 2, height: 2, values: vec![0.0, 2.0, f32::INFINITY, 4.0] };
        let (picture, range) = depth(&map);
        assert_eq!(range, (2.0, 4.0));
        assert_eq!(picture.get_pixel(0, 0).0, [128; 3]);
        assert_eq!(picture.get_pixel(0, 1).0, [128; 3]);
        assert_eq!(picture.get_pixel(1, 0).0, Colormap::depth().colour(0.0));
        assert_eq!(picture.get_pixel(1, 1).0, Colormap::depth().colour(1.0));
    }
}
