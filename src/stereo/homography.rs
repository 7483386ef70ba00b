//! The map from pixels of one view to pixels of another.

use glam::{DMat3, DVec3};

use crate::pass::stereo::LINK_ROWS;
use crate::scene::Camera;

/// From a pixel (u, v) at inverse depth d of one camera to homogeneous pixels of another: A (u, v, 1) + b d. The third
/// component, divided by d, is the depth in the other camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Homography {
    pub(super) a: DMat3,
    pub(super) b: DVec3,
}

/// Focal lengths and principal point as a matrix.
pub(super) fn intrinsics(camera: &Camera) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(camera.fx, 0.0, 0.0),
        DVec3::new(0.0, camera.fy, 0.0),
        DVec3::new(camera.cx, camera.cy, 1.0),
    )
}

/// From the scene's axes to the camera's.
pub(super) fn rotation(camera: &Camera) -> DMat3 {
    DMat3::from_cols_array_2d(&camera.rotation).transpose()
}

impl Homography {
    pub(super) fn new(from: &Camera, to: &Camera) -> Self {
        let turned = rotation(to);
        // The difference of the centres comes first: it keeps its digits where coordinates are large.
        let between = DVec3::from_array(from.center()) - DVec3::from_array(to.center());
        let k = intrinsics(to);
        Self { a: k * turned * rotation(from).transpose() * intrinsics(from).inverse(), b: k * (turned * between) }
    }

    /// Homogeneous pixel coordinates in the other view.
    pub(super) fn applied(&self, u: f64, v: f64, d: f64) -> DVec3 {
        self.a * DVec3::new(u, v, 1.0) + self.b * d
    }

    /// Pixels that the position in the other view moves per unit of inverse depth.
    pub(super) fn parallax(&self, u: f64, v: f64, d: f64) -> f64 {
        let h = self.applied(u, v, d);
        let along = |h: f64, b: f64, z: f64| (b * z - h * self.b.z) / (z * z);
        along(h.x, self.b.x, h.z).hypot(along(h.y, self.b.y, h.z))
    }

    fn rows(&self) -> [[f32; 4]; 3] {
        let row = |k: usize| {
            let a = self.a.row(k);
            [a.x as f32, a.y as f32, a.z as f32, self.b[k] as f32]
        };
        [row(0), row(1), row(2)]
    }
}

/// The rows of a source for the device: see [`LINK_ROWS`].
pub(super) fn rows(from: &Camera, to: &Camera) -> [[f32; 4]; LINK_ROWS] {
    let (there, back) = (Homography::new(from, to).rows(), Homography::new(to, from).rows());
    let size = [to.width as f32, to.height as f32, 0.0, 0.0];
    [there[0], there[1], there[2], size, back[0], back[1], back[2]]
}
