//! The positions that photographs are taken from.

use glam::{DMat3, DVec2, DVec3};

use super::WorldParams;
use crate::scene::Camera;
use crate::scene::random::Random;

/// A photograph's name and camera.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldView {
    /// File name within `images/`.
    pub name: String,
    /// True camera of the undistorted image in world coordinates (metres, z up).
    pub camera: Camera,
    /// The camera with the pose that structure from motion gives it.
    pub reconstructed: Camera,
}

impl WorldView {
    /// The name of the view's file with another extension.
    pub fn file(&self, extension: &str) -> String {
        let stem = self.name.rsplit_once('.').map_or(self.name.as_str(), |(stem, _)| stem);
        format!("{stem}.{extension}")
    }

    fn new(name: String, camera: Camera) -> Self {
        Self { name, camera, reconstructed: camera }
    }
}

/// A camera at `eye` that looks along `forward`, its image's right side towards `right` as far as possible.
pub(super) fn aim(params: &WorldParams, eye: DVec3, forward: DVec3, right: DVec3) -> Camera {
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

/// A serpentine of nadir views over the site, then oblique views from around the site that look inwards. Positions,
/// headings and tilts vary a little, as in a real flight. `ground` gives the height to keep above.
pub(super) fn plan(params: &WorldParams, ground: impl Fn(f64, f64) -> f64) -> Vec<WorldView> {
    let mut random = Random::stream(params.seed, 9);
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
        // Across the middle and to a random side, so that neighbours differ.
        let target = -at * random.range(0.0, 0.35) + at.perp() * random.range(-0.35, 0.35);
        // Never flatter than about 43 degrees, so that the ground fills the photograph.
        let forward = (target - at).clamp_length_max(0.53 * extent).extend(base - eye.z);
        cameras.push(aim(params, eye, forward, forward.cross(DVec3::Z)));
    }
    let extension = if params.effects.jpeg_quality == 0 { "png" } else { "jpg" };
    cameras
        .into_iter()
        .enumerate()
        .map(|(k, camera)| WorldView::new(format!("view_{k:04}.{extension}"), camera))
        .collect()
}

/// Views from positions without a photograph, at half the height of the flight: alternately straight down, and at 45
/// degrees over the middle of the site. `nearest` gives the smallest depth that a camera sees; a camera close to a
/// surface is moved, because nobody would look from there.
pub(super) fn plan_offpath(
    params: &WorldParams,
    ground: impl Fn(f64, f64) -> f64,
    nearest: impl Fn(&Camera) -> f64,
) -> Vec<WorldView> {
    const TRIES: u32 = 40;
    let height = 0.5 * params.altitude * params.extent;
    let view = |k: u32| {
        let mut random = Random::stream(params.seed ^ (u64::from(k) << 24), 10);
        let mut best: Option<(f64, Camera)> = None;
        for _ in 0..TRIES {
            let heading = DVec2::from_angle(random.range(0.0, std::f64::consts::TAU));
            let (reach, forward) = if k.is_multiple_of(2) { (0.36, DVec2::ZERO) } else { (0.2, heading) };
            let target = DVec2::new(random.range(-reach, reach), random.range(-reach, reach)) * params.extent;
            let eye = (target - forward * height).extend(ground(target.x, target.y) + height);
            let camera = aim(params, eye, forward.extend(-1.0), heading.perp().extend(0.0) * -1.0);
            let depth = nearest(&camera);
            if best.is_none_or(|(d, _)| depth > d) {
                best = Some((depth, camera));
            }
            if depth > 0.35 * height {
                break;
            }
        }
        best.map(|(_, camera)| WorldView::new(format!("off_{k:04}.png"), camera))
    };
    (0..params.offpath).filter_map(view).collect()
}

/// The camera as structure from motion gives it: turned and moved, so that a point `distance` away at the photograph's
/// centre shifts by `pose_noise` pixels along each axis (standard deviation). Half of the variance comes from the turn,
/// half from the move.
pub(super) fn reconstructed(params: &WorldParams, camera: &Camera, number: u32, distance: f64) -> Camera {
    let noise = params.effects.pose_noise;
    if noise == 0.0 {
        return *camera;
    }
    let mut random = Random::stream(params.seed ^ (u64::from(number) << 20), 14);
    let angle = noise / camera.fx * std::f64::consts::FRAC_1_SQRT_2;
    let mut normal = || random.normal();
    // The roll shifts the middle of the upper edge by as many pixels.
    let roll = 2.0 * camera.fx / f64::from(camera.height);
    let turn = DVec3::new(normal(), normal(), normal() * roll) * angle;
    let shift = DVec3::new(normal(), normal(), normal()) * angle * distance;
    let rows = camera.rotation.map(DVec3::from_array);
    let rotation = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
    let turned = DMat3::from_rotation_x(turn.x) * DMat3::from_rotation_y(turn.y) * DMat3::from_rotation_z(turn.z);
    let moved = turned * rotation;
    let eye = DVec3::from_array(camera.center()) + rotation.transpose() * shift;
    let columns = moved.transpose();
    Camera {
        rotation: [columns.x_axis.to_array(), columns.y_axis.to_array(), columns.z_axis.to_array()],
        translation: (-(moved * eye)).to_array(),
        ..*camera
    }
}

/// Gains of the photographs' exposures, whose geometric mean is 1.
pub(super) fn exposures(params: &WorldParams) -> Vec<f64> {
    let change = |k: u32| {
        let mut random = Random::stream(params.seed ^ (u64::from(k) << 20), 11);
        (params.effects.exposure * random.range(-1.0, 1.0)).ln_1p()
    };
    let logarithms: Vec<f64> = (0..params.images).map(change).collect();
    let mean = logarithms.iter().sum::<f64>() / f64::from(params.images.max(1));
    logarithms.into_iter().map(|l| (l - mean).exp()).collect()
}
