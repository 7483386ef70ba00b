//! A render on the host.

use crate::scene::ExposureMatrix;

/// A render, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// (r, g, b, final transmittance) per pixel, shape [height, width, 4]. Blended colours, neither clamped nor
    /// rounded.
    pub rgbt: Vec<f32>,
    /// (sum w z, sum w n) per pixel, shape [height, width, 4], with depth z in scene units and normal n in the camera
    /// frame; `None` unless requested.
    pub aux: Option<Vec<f32>>,
}

/// Depths of a view and what hides or backs known ones, row-major; in scene units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DepthProbe {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Median depth per pixel: that of the splat at which the transmittance falls to one half or below; 0 where it
    /// never does.
    pub median: Vec<f32>,
    /// Sum of the blend weights of splats nearer than 0.98 times the known depth; 0 where none is known.
    pub front: Vec<f32>,
    /// The same of splats farther than 1.02 times the known depth.
    pub behind: Vec<f32>,
}

impl DepthProbe {
    /// From rows of (median depth, front, behind, final transmittance).
    pub(super) fn new(width: u32, height: u32, rows: &[f32]) -> Self {
        let column = |k: usize| rows.chunks_exact(4).map(|row| row[k]).collect();
        Self { width, height, median: column(0), front: column(1), behind: column(2) }
    }
}

impl Picture {
    /// 8-bit RGB, rounded to nearest.
    pub fn rgb8(&self) -> Vec<u8> {
        crate::format::image_out::to_rgb8(&self.rgbt, 4)
    }

    /// The render under an exposure: an affine map of the colours, background included.
    #[must_use]
    pub fn exposed(mut self, exposure: &ExposureMatrix) -> Self {
        let rows = exposure.map(|row| row.map(|v| v as f32));
        for pixel in self.rgbt.chunks_exact_mut(4) {
            let [r, g, b] = [pixel[0], pixel[1], pixel[2]];
            let colour = rows.map(|row| row[0] * r + row[1] * g + row[2] * b + row[3]);
            pixel[..3].copy_from_slice(&colour);
        }
        self
    }

    /// Expected depth per pixel in scene units: sum w z / sum w, or 0 for a nearly empty pixel (sum w <= 0.01).
    pub fn depth(&self) -> Option<Vec<f32>> {
        let aux = self.aux.as_ref()?;
        let pixels = self.rgbt.chunks_exact(4).zip(aux.chunks_exact(4));
        Some(pixels.map(|(c, a)| if c[3] < 0.99 { a[0] / (1.0 - c[3]) } else { 0.0 }).collect())
    }

    /// Unit normal per pixel in the camera frame; zero for a nearly empty pixel.
    pub fn normals(&self) -> Option<Vec<[f32; 3]>> {
        let aux = self.aux.as_ref()?;
        let unit = |a: &[f32]| {
            let length = (a[1] * a[1] + a[2] * a[2] + a[3] * a[3]).sqrt();
            if length > 1e-3 { [a[1] / length, a[2] / length, a[3] / length] } else { [0.0; 3] }
        };
        Some(aux.chunks_exact(4).map(unit).collect())
    }
}
