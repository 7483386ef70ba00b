//! Colour maps whose lightness rises evenly, so that equal steps look equal and order survives grey print.
//!
//! Both are paths in OKLab (Björn Ottosson, "A perceptual colour space for image processing", 2020), brought into sRGB
//! by lowering the chroma where needed.

/// A map from [0, 1] to sRGB.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Colormap {
    table: Vec<[u8; 3]>,
}

const STEPS: usize = 256;

impl Colormap {
    /// Dark violet over blue and green to yellow: for depth.
    pub fn depth() -> Self {
        Self::from_path(|t| (0.24 + 0.68 * t, 0.15 - 0.02 * t, 302.0 - 195.0 * t))
    }

    /// Black over red and orange to pale yellow: for errors.
    pub fn error() -> Self {
        Self::from_path(|t| (0.06 + 0.91 * t, 0.19 * (1.0 - (1.9 * t - 0.95).powi(2)).max(0.0).sqrt(), 8.0 + 97.0 * t))
    }

    /// From a path of lightness, chroma and hue in degrees.
    fn from_path(path: impl Fn(f64) -> (f64, f64, f64)) -> Self {
        let table = (0..STEPS)
            .map(|k| {
                let (lightness, chroma, hue) = path(k as f64 / (STEPS - 1) as f64);
                in_gamut(lightness, chroma, hue.to_radians()).map(|c| (encode(c) * 255.0).round() as u8)
            })
            .collect();
        Self { table }
    }

    /// The colour at t; values outside [0, 1] count as the nearer end, not-a-number as 0.
    pub fn colour(&self, t: f32) -> [u8; 3] {
        let t = if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) };
        self.table[(t * (STEPS - 1) as f32).round() as usize]
    }
}

/// Linear sRGB of the most colourful colour of this lightness and hue with at most this chroma.
fn in_gamut(lightness: f64, chroma: f64, hue: f64) -> [f64; 3] {
    let at = |c: f64| linear_srgb(lightness, c * hue.cos(), c * hue.sin());
    let fits = |rgb: [f64; 3]| rgb.iter().all(|v| (-1e-4..=1.0001).contains(v));
    let (mut low, mut high) = (0.0, chroma);
    if !fits(at(high)) {
        for _ in 0..30 {
            let middle = 0.5 * (low + high);
            if fits(at(middle)) { low = middle } else { high = middle }
        }
        high = low;
    }
    at(high).map(|v| v.clamp(0.0, 1.0))
}

/// OKLab to linear sRGB with the matrices of its definition.
fn linear_srgb(l: f64, a: f64, b: f64) -> [f64; 3] {
    let cube = |x: f64| x * x * x;
    let lms = [
        cube(l + 0.396_337_777_4 * a + 0.215_803_757_3 * b),
        cube(l - 0.105_561_345_8 * a - 0.063_854_172_8 * b),
        cube(l - 0.089_484_177_5 * a - 1.291_485_548_0 * b),
    ];
    [
        4.076_741_662_1 * lms[0] - 3.307_711_591_3 * lms[1] + 0.230_969_929_2 * lms[2],
        -1.268_438_004_6 * lms[0] + 2.609_757_401_1 * lms[1] - 0.341_319_396_5 * lms[2],
        -0.004_196_086_3 * lms[0] - 0.703_418_614_7 * lms[1] + 1.707_614_701_0 * lms[2],
    ]
}

fn encode(c: f64) -> f64 {
    if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn luminance(c: [u8; 3]) -> f64 {
        let linear = c.map(|v| {
            let v = f64::from(v) / 255.0;
            if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        });
        0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    }

    #[test]
    fn brightness_rises() {
        for map in [Colormap::depth(), Colormap::error()] {
            for k in 0..16 {
                let (a, b) = (map.colour(k as f32 / 16.0), map.colour((k + 1) as f32 / 16.0));
                assert!(luminance(a) < luminance(b), "{k}: {a:?} {b:?}");
            }
            assert_eq!(map.colour(-3.0), map.colour(0.0));
            assert_eq!(map.colour(f32::INFINITY), map.colour(1.0));
            assert_eq!(map.colour(f32::NAN), map.colour(0.0));
        }
        // White and a primary from the definition of the space.
        for v in linear_srgb(1.0, 0.0, 0.0) {
            assert!((v - 1.0).abs() < 1e-4);
        }
        let red = linear_srgb(0.627_955, 0.224_863, 0.125_846);
        assert!((red[0] - 1.0).abs() < 1e-3 && red[1].abs() < 1e-3 && red[2].abs() < 1e-3, "{red:?}");
    }
}
