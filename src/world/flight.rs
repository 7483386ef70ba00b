//! Where photographs are taken from.

use glam::{DMat3, DVec2, DVec3};

use super::WorldParams;
use super::random::Random;
use crate::scene::Camera;

/// A photograph's name and camera.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// File name within `images/`.
    pub name: String,
    /// Camera in world coordinates (metres, z up).
    pub camera: Camera,
}

/// A camera at `eye` that looks along `forward`, its image's right side towards `right` as far as possible.
fn aim(params: &WorldParams, eye: DVec3, forward: DVec3, right: DVec3) -> Camera {
    let z = forward.normalize();
    let x = (right - z * right.dot(z)).normalize();
    let y = z.cross(x);
    let r = DMat3::from_cols(x, y, z).transpose();
    let t = -(r * eye);
    let (width, height) = params.size();
    let side = f64::from(params.max_side);
    Camera {
        rotation: [x.to_array(), y.to_array(), z.to_array()],
        translation: t.to_array(),
        fx: params.focal * side,
        fy: params.focal * side,
        cx: 0.5 * f64::from(width) + params.principal_offset[0] * side,
        cy: 0.5 * f64::from(height) + params.principal_offset[1] * side,
        width,
        height,
    }
}

/// A serpentine of nadir views over the site, then oblique views from around it that look in. Positions, headings and tilts
/// vary a little, as in a real flight. `ground` gives the height to keep above.
pub(super) fn plan(params: &WorldParams, ground: impl Fn(f64, f64) -> f64) -> Vec<View> {
    let mut random = Random::new(params.seed, 9);
    let nadir = (f64::from(params.images) * params.nadir_share).round() as u32;
    let oblique = params.images - nadir.min(params.images);
    let extent = params.extent;
    let base = ground(0.0, 0.0);
    let mut cameras = Vec::new();

    let rows = (f64::from(nadir).sqrt() * 0.9).round().max(1.0) as u32;
    for row in 0..rows {
        // Stations are spread over the rows so that every row is full.
        let (from, to) = (nadir * row / rows, nadir * (row + 1) / rows);
        let share = |k: u32, n: u32| (f64::from(k) + 0.5) / f64::from(n) - 0.5;
        for k in 0..to - from {
            let west_to_east = row % 2 == 0;
            let u = share(k, to - from) * if west_to_east { 1.0 } else { -1.0 };
            let at = DVec2::new(u, share(row, rows)) * 0.92 * extent
                + DVec2::new(random.normal(), random.normal()) * 0.01 * extent;
            let eye = at.extend(base + params.altitude * extent * (1.0 + 0.015 * random.normal()));
            let tilt = DVec3::new(random.normal() * 0.03, random.normal() * 0.03, -1.0);
            let heading = random.normal() * 0.06;
            let right = DVec2::from_angle(heading).extend(0.0) * if west_to_east { 1.0 } else { -1.0 };
            cameras.push(aim(params, eye, tilt, right));
        }
    }
    for k in 0..oblique {
        let angle = std::f64::consts::TAU * (f64::from(k) + 0.3 * random.unit()) / f64::from(oblique.max(1));
        let radius = extent * if k % 2 == 0 { 0.62 } else { 0.42 };
        let at = DVec2::from_angle(angle) * radius;
        let eye = at.extend(base + extent * (0.5 + 0.02 * random.normal()));
        // Across the middle, to the side by turns, so that neighbours differ.
        let target = -at * random.range(0.0, 0.35) + at.perp() * random.range(-0.35, 0.35);
        // Never flatter than about 43 degrees, so that the ground fills the picture.
        let forward = (target - at).clamp_length_max(0.53 * extent).extend(base - eye.z);
        cameras.push(aim(params, eye, forward, forward.cross(DVec3::Z)));
    }
    cameras.into_iter().enumerate().map(|(k, camera)| View { name: format!("view_{k:04}.jpg"), camera }).collect()
}
