//! The similarity between a dataset's coordinates and the scene's.

use super::{Camera, Gaussians};

/// Scene coordinates are `(dataset - offset) * scale`. Offset and scale are kept in f64 because geo-referenced coordinates
/// (UTM: 5e5, 4.6e6) do not fit f32; the scene itself is small and centred.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Frame {
    /// Dataset coordinates of the scene's origin.
    pub offset: [f64; 3],
    /// Scene units per dataset unit.
    pub scale: f64,
}

impl Frame {
    /// Scene and dataset coordinates are the same.
    pub const IDENTITY: Self = Self { offset: [0.0; 3], scale: 1.0 };

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
    /// offset when f32 could not hold the coordinates).
    pub fn gaussians_to_dataset(&self, gaussians: &Gaussians, shift: [f64; 3]) -> Gaussians {
        let mut out = gaussians.clone();
        let ln = self.scale.ln();
        for p in out.means.chunks_exact_mut(3) {
            let d = self.to_dataset([f64::from(p[0]), f64::from(p[1]), f64::from(p[2])]);
            for k in 0..3 {
                p[k] = (d[k] - shift[k]) as f32;
            }
        }
        out.scales.iter_mut().for_each(|s| *s = (f64::from(*s) - ln) as f32);
        out
    }

    /// Splats read from a file, at `dataset - shift`, in scene coordinates.
    pub fn gaussians_to_scene(&self, gaussians: &Gaussians, shift: [f64; 3]) -> Gaussians {
        let mut out = gaussians.clone();
        let ln = self.scale.ln();
        for p in out.means.chunks_exact_mut(3) {
            let s = self.to_scene(std::array::from_fn(|k| f64::from(p[k]) + shift[k]));
            for k in 0..3 {
                p[k] = s[k] as f32;
            }
        }
        out.scales.iter_mut().for_each(|s| *s = (f64::from(*s) + ln) as f32);
        out
    }
}
