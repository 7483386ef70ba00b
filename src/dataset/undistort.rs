//! Undistorts photographs into images of a pinhole camera.

use rayon::prelude::*;

use super::lens::Lens;
use super::pixels::ChannelValue;
use crate::scene::Camera;

/// Radius of the Catmull-Rom kernel, in pixels of the coarser image.
const REACH: f64 = 2.0;

/// Resamples a photograph (RGBA, rows from the top, of the lens's size) for a pinhole camera whose axis is the lens's.
///
/// Each output pixel is the photograph around the point where the ray of the pixel's centre lands, weighted by the
/// Catmull-Rom bicubic kernel. The kernel is widened along rows and columns where neighbouring rays land more than a
/// pixel apart: undistortion and reduction are one interpolation. Colours are weighted with their alpha, so that masked
/// colours do not bleed. Alpha is 0 where the ray lands outside the photograph.
pub(super) fn resample<T: ChannelValue>(photograph: &[T], lens: &Lens, camera: &Camera) -> Vec<T> {
    let width = camera.width as usize;
    let mut out = vec![T::default(); 4 * width * camera.height as usize];
    out.par_chunks_exact_mut(4 * width).enumerate().for_each(|(j, row)| {
        let (mut columns, mut rows) = (Taps::default(), Taps::default());
        for (i, pixel) in row.chunks_exact_mut(4).enumerate() {
            let ray = [(i as f64 + 0.5 - camera.cx) / camera.fx, (j as f64 + 0.5 - camera.cy) / camera.fy];
            let Some((at, jacobian)) = lens.project(ray) else { continue };
            let inside = (0..2).all(|axis| at[axis] >= 0.0 && at[axis] <= f64::from(lens.size[axis]));
            if !inside {
                continue;
            }
            let apart = |axis: usize| (jacobian[axis][0] / camera.fx).hypot(jacobian[axis][1] / camera.fy);
            columns.around(at[0], apart(0).max(1.0), lens.size[0]);
            rows.around(at[1], apart(1).max(1.0), lens.size[1]);
            pixel.copy_from_slice(&weighted(photograph, lens.size[0] as usize, &columns, &rows));
        }
    });
    out
}

/// Pixels along a row or column, and their weights.
#[derive(Default)]
struct Taps {
    first: usize,
    weights: Vec<f32>,
}

impl Taps {
    /// The pixels around `at` in an image of `size`, with the kernel widened by `by`. The kernel is cut off at the
    /// image's edge.
    fn around(&mut self, at: f64, by: f64, size: u32) {
        let (from, to) = (at - REACH * by - 0.5, at + REACH * by - 0.5);
        self.first = from.ceil().max(0.0) as usize;
        let last = to.floor().min(f64::from(size) - 1.0).max(0.0) as usize;
        self.weights.clear();
        self.weights.extend((self.first..=last).map(|k| catmull_rom((k as f64 + 0.5 - at) / by) as f32));
    }
}

/// The cubic kernel with a slope of -1/2 at 1 (Keys 1981).
fn catmull_rom(x: f64) -> f64 {
    let x = x.abs();
    if x < 1.0 {
        (1.5 * x - 2.5) * x * x + 1.0
    } else if x < 2.0 {
        ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0
    } else {
        0.0
    }
}

fn weighted<T: ChannelValue>(photograph: &[T], width: usize, columns: &Taps, rows: &Taps) -> [T; 4] {
    // Sums of the weights, of weight times alpha, and of colours with either.
    let (mut whole, mut opaque, mut colours, mut all_colours) = (0.0_f32, 0.0_f32, [0.0_f32; 3], [0.0_f32; 3]);
    for (k, down) in rows.weights.iter().enumerate() {
        let start = 4 * ((rows.first + k) * width + columns.first);
        let line = photograph.get(start..).unwrap_or_default();
        for (pixel, across) in line.chunks_exact(4).zip(&columns.weights) {
            let weight = down * across;
            let alpha = weight * pixel[3].number() * (1.0 / T::WHITE);
            whole += weight;
            opaque += alpha;
            for c in 0..3 {
                colours[c] += alpha * pixel[c].number();
                all_colours[c] += weight * pixel[c].number();
            }
        }
    }
    // For almost no opacity, a quotient of two small numbers would not be a colour.
    let (sums, by) = if opaque > 0.01 * whole { (colours, opaque) } else { (all_colours, whole) };
    let [r, g, b] = sums.map(|sum| T::rounded(sum / by));
    [r, g, b, T::rounded(T::WHITE * opaque / whole)]
}
