//! The lens of the photographs: the ray of each point of a photograph.

use glam::DVec2;
use rayon::prelude::*;

use super::pixel_ray;
use super::{CameraKind, Ray, WorldError, WorldParams};
use crate::dataset::lens::{Distortion, Lens};
use crate::scene::Camera;

/// A lens with distortion, and the rays of its pixels' centres, which all photographs share.
#[derive(Clone, Debug)]
pub(super) struct Optics {
    pub(super) lens: Lens,
    centres: Vec<Option<[f64; 2]>>,
}

impl Optics {
    /// The lens whose undistorted image is the whole image of `pinhole`; `None` without distortion.
    pub(super) fn new(params: &WorldParams, pinhole: &Camera) -> Result<Option<Self>, WorldError> {
        if params.camera == CameraKind::Pinhole {
            return Ok(None);
        }
        let lens = lens_over(pinhole, params.distortion).ok_or(WorldError::Lens)?;
        let [width, height] = lens.size;
        let centre = |k: u32| lens.ray([f64::from(k % width) + 0.5, f64::from(k / width) + 0.5]);
        let centres = (0..width * height).into_par_iter().map(centre).collect();
        Ok(Some(Self { lens, centres }))
    }

    /// The ray through a point (x, y) of pixel (column, row) of a photograph by `camera` through this lens; the ray's
    /// parameter is the depth. `None` where the lens gives no image.
    pub(super) fn ray(&self, camera: &Camera, (column, row): (u32, u32), x: f64, y: f64) -> Option<Ray> {
        let centre = self.centres.get((row * self.lens.size[0] + column) as usize).copied().flatten()?;
        let mut ray = DVec2::from_array(centre);
        // Newton's method from at most half a pixel away: the first step leaves about 1e-4 pixels, the second only
        // rounding.
        for _ in 0..2 {
            let (at, [[a, b], [c, d]]) = self.lens.project(ray.to_array())?;
            let miss = DVec2::new(x, y) - DVec2::from_array(at);
            ray += DVec2::new(d * miss.x - b * miss.y, a * miss.y - c * miss.x) / (a * d - b * c);
        }
        Some(pixel_ray(camera, camera.fx * ray.x + camera.cx, camera.fy * ray.y + camera.cy))
    }

    /// The position in the photograph of a point of the undistorted image.
    pub(super) fn bend(&self, camera: &Camera, p: DVec2) -> Option<DVec2> {
        let ray = [(p.x - camera.cx) / camera.fx, (p.y - camera.cy) / camera.fy];
        self.lens.project(ray).map(|(at, _)| DVec2::from_array(at))
    }

    /// The position in the undistorted image of a point of the photograph.
    pub(super) fn straighten(&self, camera: &Camera, p: DVec2) -> Option<DVec2> {
        let [x, y] = self.lens.ray(p.to_array())?;
        Some(DVec2::new(camera.fx * x + camera.cx, camera.fy * y + camera.cy))
    }
}

/// A lens whose photographs have the pinhole camera's width and end, in the middle of each side, where the pinhole
/// image ends, so that [`Lens::pinhole`] gives the pinhole camera again. The height is rounded from the height for
/// square pixels.
fn lens_over(camera: &Camera, [k1, k2, p1, p2]: [f64; 4]) -> Option<Lens> {
    let distortion = Distortion::brown([k1, k2, 0.0], [p1, p2]);
    let unit = Lens::new([1.0; 2], [0.0; 2], [1; 2], distortion);
    // Where the lens maps a side of the pinhole image, on the row or column of the principal point.
    let side = |axis: usize, at: f64| {
        let (mut ray, other) = ([0.0; 2], 1 - axis);
        ray[axis] = at;
        for _ in 0..20 {
            let (bent, jacobian) = unit.project(ray)?;
            ray[other] -= bent[other] / jacobian[other][other];
        }
        unit.project(ray).map(|(bent, _)| bent[axis])
    };
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let (x0, x1) = (side(0, -camera.cx / camera.fx)?, side(0, (width - camera.cx) / camera.fx)?);
    let (y0, y1) = (side(1, -camera.cy / camera.fy)?, side(1, (height - camera.cy) / camera.fy)?);
    let fx = width / (x1 - x0);
    let rows = (fx * (y1 - y0)).round();
    let fy = rows / (y1 - y0);
    let lens = Lens::new([fx, fy], [-fx * x0, -fy * y0], [camera.width, rows as u32], distortion);
    let undone = lens.pinhole();
    let corners = [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)];
    let whole =
        corners.iter().all(|(x, y)| lens.project([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy]).is_some());
    (whole && (undone.width, undone.height) == (camera.width, camera.height)).then_some(lens)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::flight::aim;
    use super::*;

    fn params() -> WorldParams {
        WorldParams { camera: CameraKind::Opencv, ..WorldParams::default() }
    }

    /// A pinhole camera at the origin that looks along z.
    fn pinhole(params: &WorldParams) -> Camera {
        aim(params, DVec3::ZERO, DVec3::Z, DVec3::X)
    }

    #[test]
    fn the_undistorted_picture_is_the_pinhole_cameras() {
        for side in [96, 101, 320, 1000, 4000] {
            let params = WorldParams { max_side: side, ..params() };
            let camera = pinhole(&params);
            let lens = lens_over(&camera, params.distortion).expect("a lens");
            let got = lens.pinhole();
            assert_eq!((got.width, got.height), (camera.width, camera.height));
            for (a, b) in [(got.fx, camera.fx), (got.fy, camera.fy), (got.cx, camera.cx), (got.cy, camera.cy)] {
                assert!((a - b).abs() < 1e-9 * camera.fx, "{got:?} {camera:?}");
            }
            assert!((lens.focal[1] / lens.focal[0] - 1.0).abs() < 0.51 / f64::from(camera.height));
            assert!(lens.size[1] > camera.height, "barrel distortion makes the photograph higher: {:?}", lens.size);
        }
    }

    #[test]
    fn rays_reach_the_point_they_are_asked_for() {
        let params = params();
        let camera = pinhole(&params);
        let optics = Optics::new(&params, &camera).expect("a lens").expect("distortion");
        let [width, height] = optics.lens.size;
        for (column, row) in [(0, 0), (width - 1, 0), (17, height - 1), (width / 2, height / 3)] {
            for (dx, dy) in [(0.0, 0.0), (0.5, 0.5), (0.99, 0.02)] {
                let at = DVec2::new(f64::from(column) + dx, f64::from(row) + dy);
                let ray = optics.ray(&camera, (column, row), at.x, at.y).expect("a ray");
                let back = optics.lens.project([ray.direction.x, ray.direction.y]).expect("in the picture").0;
                assert!(DVec2::from_array(back).distance(at) < 1e-6, "{back:?} {at:?}");
                let straight = optics.straighten(&camera, at).expect("straight");
                assert!(optics.bend(&camera, straight).expect("bent").distance(at) < 1e-6);
            }
        }
    }

    #[test]
    fn a_lens_that_folds_inside_the_picture_is_refused() {
        let params = WorldParams { focal: 0.5, distortion: [-0.3, 0.0, 0.0, 0.0], ..params() };
        assert!(matches!(Optics::new(&params, &pinhole(&params)), Err(WorldError::Lens)));
    }
}
