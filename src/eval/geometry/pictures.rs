//! Depth and normals of pictures against the truth, pixel by pixel.

use super::truth::Known;
use crate::raster::Picture;

/// A pixel counts as covered above this opacity.
const COVERED: f32 = 0.5;

/// Errors collected over pictures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Agreement {
    /// Relative errors of the depth of covered pixels.
    depth: Vec<f32>,
    /// Angles between normals in degrees, of covered pixels.
    degrees: Vec<f32>,
    /// Pixels with a true depth.
    pixels: usize,
}

impl Agreement {
    /// Adds a picture of the same size, whose depths are `scale` times as large as the true ones.
    pub fn add(&mut self, picture: &Picture, known: &Known, scale: f64) {
        let Some(aux) = &picture.aux else { return };
        let pixels = picture.rgbt.chunks_exact(4).zip(aux.chunks_exact(4)).zip(&known.depth);
        let mut covered = Vec::with_capacity(known.depth.len());
        for ((colour, aux), &truth) in pixels {
            let opacity = 1.0 - colour[3];
            let counts = truth > 0.0 && truth.is_finite();
            self.pixels += usize::from(counts);
            covered.push(counts && opacity > COVERED);
            if counts && opacity > COVERED {
                let depth = f64::from(aux[0]) / f64::from(opacity) / scale;
                self.depth.push(((depth - f64::from(truth)).abs() / f64::from(truth)) as f32);
            }
        }
        let (Some(truth), Some(got)) = (&known.normals, picture.normals()) else { return };
        for ((truth, got), _) in truth.iter().zip(&got).zip(covered).filter(|(_, covered)| *covered) {
            let dot = |a: &[f32; 3], b: &[f32; 3]| (0..3).map(|k| f64::from(a[k]) * f64::from(b[k])).sum::<f64>();
            let (a, b) = (dot(truth, truth).sqrt(), dot(got, got).sqrt());
            // Without a normal of its own the picture is as wrong as can be;
            // without a true one there is nothing to compare.
            if a > 0.5 {
                let cosine = if b > 0.0 { dot(truth, got) / (a * b) } else { -1.0 };
                self.degrees.push(cosine.clamp(-1.0, 1.0).acos().to_degrees() as f32);
            }
        }
    }

    /// Median of the relative errors of the depth; none without a covered pixel.
    pub fn median_error(&self) -> Option<f64> {
        median(&self.depth)
    }

    /// Share of all pixels with a true depth that are covered and off by at most `share` of the depth.
    pub fn within(&self, share: f64) -> Option<f64> {
        let good = self.depth.iter().filter(|e| f64::from(**e) <= share).count();
        (self.pixels > 0).then(|| good as f64 / self.pixels as f64)
    }

    /// Share of all pixels with a true depth that are covered.
    pub fn coverage(&self) -> Option<f64> {
        (self.pixels > 0).then(|| self.depth.len() as f64 / self.pixels as f64)
    }

    /// Median of the angles between normals, degrees.
    pub fn median_degrees(&self) -> Option<f64> {
        median(&self.degrees)
    }
}

/// The middle of the sorted values; of an even number, the upper one of the two.
fn median(values: &[f32]) -> Option<f64> {
    let mut values = values.to_vec();
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| f64::from(*values.select_nth_unstable_by(middle, f32::total_cmp).1))
}
