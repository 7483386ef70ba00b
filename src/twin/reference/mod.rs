//! A brute-force renderer in f64: every splat at every pixel, one plain sort, no tiles, and only the method's own
//! cut-offs.
//!
//! Written from the formulas of `docs/CONVENTIONS.md` alone. The renderer shares no arithmetic with the passes or their
//! twins (covariances are plain matrix products, determinants plain `ac - b^2`), so it can check both. It also reports
//! how close every pixel comes to a decision that rounding to f32 may reverse.

mod matrix;
mod pixels;
mod splats;

pub use pixels::{backward, backward_at, render, render_at, render_with_slopes_of};

use super::splat::Splat;
use crate::raster::PLANES;

/// Settings of a render.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Highest degree of spherical harmonics, 0 to 3.
    pub sh_degree: u32,
    /// Splats at this depth or nearer are not seen.
    pub near: f64,
    /// Whether opacities carry the anti-aliasing factor.
    pub antialias: bool,
    /// Whether rays are parallel to the camera's z axis: for [`render`] alone.
    pub orthographic: bool,
    /// Whether a colour at its lower bound has a gradient where a descent step would raise it.
    pub black_learns: bool,
    /// Colour behind everything.
    pub background: [f64; 3],
    /// A splat is skipped at a pixel where its alpha is below this.
    pub alpha_min: f64,
    /// A pixel stops before the splat that would take its transmittance below this.
    pub transmittance_min: f64,
}

impl Default for Settings {
    /// The method's cut-offs (Kerbl et al. 2023), all degrees, a black background.
    fn default() -> Self {
        Self {
            sh_degree: 3,
            near: 0.2,
            antialias: false,
            orthographic: false,
            black_learns: false,
            background: [0.0; 3],
            alpha_min: 1.0 / 255.0,
            transmittance_min: 1e-4,
        }
    }
}

/// A rendered image, row-major, one entry per pixel.
#[derive(Clone, Debug, Default)]
pub struct Image {
    /// Colour with the background.
    pub colour: Vec<[f64; 3]>,
    /// Final transmittance.
    pub transmittance: Vec<f64>,
    /// Sum of weight times depth: the mean of z under the splat's Gaussian along the pixel's ray.
    pub depth: Vec<f64>,
    /// Sum of weight times camera-frame normal.
    pub normal: Vec<[f64; 3]>,
    /// Splats blended.
    pub blended: Vec<u32>,
    /// Distance to the nearest decision that rounding may reverse (the cut-offs, 0.99, power > 0, the order of two
    /// depths), in units of the decision's condition: rounding to f32 changes the distance by a small multiple of f32's
    /// epsilon. Tests exclude pixels below such a multiple, and count them.
    pub margin: Vec<f64>,
}

/// dL/d(image), laid out like [`Image`].
#[derive(Clone, Debug, Default)]
pub struct ImageGradient {
    /// dL/d(colour).
    pub colour: Vec<[f64; 3]>,
    /// dL/d(final transmittance), without the path through the background's colour.
    pub transmittance: Vec<f64>,
    /// dL/d(sum of weight times depth).
    pub depth: Vec<f64>,
    /// dL/d(sum of weight times normal).
    pub normal: Vec<[f64; 3]>,
}

impl ImageGradient {
    /// Zeros for an image of `pixels` pixels.
    pub fn zeros(pixels: usize) -> Self {
        Self {
            colour: vec![[0.0; 3]; pixels],
            transmittance: vec![0.0; pixels],
            depth: vec![0.0; pixels],
            normal: vec![[0.0; 3]; pixels],
        }
    }
}

/// Gradients with respect to splats.
#[derive(Clone, Debug)]
pub struct Gradients {
    /// The 59 parameters of each splat.
    pub splats: Vec<Splat<f64>>,
    /// Rows of `grad2d`: mean x, mean y, A, B, C, opacity, r, g, b, depth, and the sums of the absolute per-pixel
    /// gradients of mean x and mean y.
    pub grad2d: Vec<[f64; 12]>,
    /// Camera-frame normals.
    pub normals: Vec<[f64; 3]>,
}

impl Gradients {
    /// The gradients of the parameters in the layout of [`PLANES`].
    pub fn planes(&self) -> [Vec<f64>; 8] {
        let mut out: [Vec<f64>; 8] = Default::default();
        for splat in &self.splats {
            let values = splat.to_array();
            let mut rest = values.as_slice();
            for (plane, (_, row)) in out.iter_mut().zip(PLANES) {
                let (own, others) = rest.split_at(row as usize);
                plane.extend(own);
                rest = others;
            }
        }
        out
    }
}
