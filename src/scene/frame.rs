//! The similarity between a dataset's coordinates and the scene's.

use super::{Camera, Gaussians};

/// Scene coordinates are `(dataset - offset) * scale`. Offset and scale are kept in f64 because geo-referenced
/// coordinates (UTM: 5e5, 4.6e6) do not fit f32; the scene itself is small and centred.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Frame {
    /// Dataset coordinates of the scene's origin.
    pub offset: [f64; 3],
    /// Scene units per dataset unit.
    pub scale: f64,
}

impl Frame {
    /// The extent of every scene, in scene units: 1.1 x the largest distance of a training camera from their mean.
    pub const EXTENT: f64 = 5.0;

    /// Scene and dataset coordinates are the same.
    pub const IDENTITY: Self = Self { offset: [0.0; 3], scale: 1.0 };

    /// What to subtract from dataset coordinates in files of f32: zero, or the offset where the largest coordinate
    /// exceeds 100 extents, as geo-referenced coordinates do (at 4.6e6 f32 has steps of half a metre).
    pub fn shift(&self) -> [f64; 3] {
        let extent = Self::EXTENT / self.scale;
        let largest = self.offset.iter().fold(0.0, |m: f64, v| m.max(v.abs())) + extent;
        if largest > 100.0 * extent { self.offset } else { [0.0; 3] }
    }

    /// A dataset point in the scene.
    pub fn to_scene(&self, p: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|i| (p[i] - self.offset[i]) * self.scale)
    }

    /// A scene point in the dataset.
    pub fn to_dataset(&self, p: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|i| p[i] / self.scale + self.offset[i])
    }

    /// A camera given in dataset coordinates, for points in scene coordinates: depths scale with the scene.
    pub fn camera_to_scene(&self, camera: &Camera) -> Camera {
        let r = &camera.rotation;
        let translation = std::array::from_fn(|i| {
            let moved: f64 = (0..3).map(|j| r[i][j] * self.offset[j]).sum();
            (camera.translation[i] + moved) * self.scale
        });
        Camera { translation, ..*camera }
    }

    /// Splats given in scene coordinates as splats at `dataset - shift`, with shift chosen by the caller (zero, or the
    /// offset where f32 cannot hold the coordinates).
    pub fn gaussians_to_dataset(&self, gaussians: &Gaussians, shift: [f64; 3]) -> Gaussians {
        let mut out = gaussians.clone();
        if *self == Self::IDENTITY && shift == [0.0; 3] {
            // Adding zero would lose the sign of a negative zero: files must come back bit for bit.
            return out;
        }
        let ln = self.scale.ln();
        for p in out.means.chunks_exact_mut(3) {
            for k in 0..3 {
                // The difference first: it is exact where the shift is the offset.
                p[k] = (f64::from(p[k]) / self.scale + (self.offset[k] - shift[k])) as f32;
            }
        }
        out.scales.iter_mut().for_each(|s| *s = (f64::from(*s) - ln) as f32);
        out
    }

    /// Splats read from a file, at `dataset - shift`, in scene coordinates.
    pub fn gaussians_to_scene(&self, gaussians: &Gaussians, shift: [f64; 3]) -> Gaussians {
        let mut out = gaussians.clone();
        if *self == Self::IDENTITY && shift == [0.0; 3] {
            return out;
        }
        let ln = self.scale.ln();
        for p in out.means.chunks_exact_mut(3) {
            for k in 0..3 {
                p[k] = ((f64::from(p[k]) - (self.offset[k] - shift[k])) * self.scale) as f32;
            }
        }
        out.scales.iter_mut().for_each(|s| *s = (f64::from(*s) + ln) as f32);
        out
    }
}
