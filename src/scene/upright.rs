//! Which way is up, as far as cameras tell.

use glam::{DMat3, DVec3};

use super::Camera;

/// Weights of what else speaks for an up where the horizons of the cameras leave a choice, as those of a single flight
/// line do: photographs are taken from about one height, and with the sky at the top.
const FROM_ONE_HEIGHT: f64 = 0.05;
const SKY_AT_THE_TOP: f64 = 1e-4;

/// The direction, a unit vector in the cameras' coordinates, that is up: the rows of photographs lie level, so up is
/// what the cameras' x axes have least of. `None` without cameras.
pub fn up_of(cameras: &[Camera]) -> Option<[f64; 3]> {
    let axis = |camera: &Camera, k: usize| DVec3::from_array(camera.rotation[k]);
    let count = cameras.len() as f64;
    // Photographs of walks have the sky at their top, photographs of flights look down.
    let sky: DVec3 = cameras.iter().map(|camera| -axis(camera, 1) - 0.5 * axis(camera, 2)).sum();
    let sky = sky.try_normalize().or_else(|| cameras.first().map(|camera| -axis(camera, 1)))?;
    let mean = cameras.iter().map(|camera| DVec3::from_array(camera.center())).sum::<DVec3>() / count;
    let outer = |v: DVec3| DMat3::from_cols(v * v.x, v * v.y, v * v.z);
    let (mut level, mut places, mut spread) = (DMat3::ZERO, DMat3::ZERO, 0.0);
    for camera in cameras {
        let away = DVec3::from_array(camera.center()) - mean;
        level += outer(axis(camera, 0)) * (1.0 / count);
        places += outer(away);
        spread += away.length_squared();
    }
    if spread > 0.0 {
        level += places * (FROM_ONE_HEIGHT / spread);
    }
    level += (DMat3::IDENTITY - outer(sky)) * SKY_AT_THE_TOP;
    // Inverse iteration ends at the direction of the least sum; the shift keeps the inverse within numbers.
    let inverse = (level + DMat3::IDENTITY * 1e-9).inverse();
    let mut up = sky;
    for _ in 0..100 {
        up = (inverse * up).try_normalize().unwrap_or(sky);
    }
    Some((if up.dot(sky) < 0.0 { -up } else { up }).to_array())
}

/// The least rotation, row-major, that turns the direction `from` to the direction `to`.
pub fn turn(from: [f64; 3], to: [f64; 3]) -> [[f64; 3]; 3] {
    let of = |v: [f64; 3]| DVec3::from_array(v).try_normalize().unwrap_or(DVec3::Y);
    let rows = DMat3::from_quat(glam::DQuat::from_rotation_arc(of(from), of(to))).transpose();
    [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row.to_array())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera at `place` that looks along `forward` without roll, where up is `up`.
    fn looking(place: [f64; 3], forward: [f64; 3], up: [f64; 3]) -> Camera {
        let forward = DVec3::from_array(forward).normalize();
        let right = forward.cross(DVec3::from_array(up)).normalize();
        let rows = [right, forward.cross(right), forward];
        let translation = rows.map(|row| -row.dot(DVec3::from_array(place)));
        let rotation = rows.map(|row| row.to_array());
        Camera { rotation, translation, fx: 90.0, fy: 90.0, cx: 50.0, cy: 40.0, width: 100, height: 80 }
    }

    fn close(found: [f64; 3], want: [f64; 3]) -> bool {
        DVec3::from_array(found).dot(DVec3::from_array(want).normalize()) > 2.0_f64.to_radians().cos()
    }

    #[test]
    fn up_is_found_in_a_walk_and_in_flights() {
        let up = DVec3::new(0.3, -0.8, 0.5).normalize();
        let east = up.any_orthonormal_vector();
        let north = up.cross(east);
        let around = |angle: f64| east * angle.cos() + north * angle.sin();
        let walk: Vec<Camera> = (0..9)
            .map(|k| around(f64::from(k)))
            .map(|out| looking((3.0 * out).to_array(), (-out - 0.4 * up).to_array(), up.to_array()))
            .collect();
        assert!(close(up_of(&walk).unwrap(), up.to_array()), "walk");
        // Straight down, the tops of photographs are where the flight goes: to and fro, and along one line.
        let line = |lines: i32| -> Vec<Camera> {
            (0..12)
                .map(|k| (f64::from(k % lines), f64::from(k / lines), if k % lines % 2 == 0 { 1.0 } else { -1.0 }))
                .map(|(x, y, way)| {
                    let place = 2.0 * up + x * east + y * north;
                    looking(place.to_array(), (-up).to_array(), (way * north).to_array())
                })
                .collect()
        };
        for (what, flight) in [("to and fro", line(3)), ("one line", line(1))] {
            assert!(close(up_of(&flight).unwrap(), up.to_array()), "{what}: {:?}", up_of(&flight));
        }
        assert_eq!(up_of(&[]), None);
    }

    #[test]
    fn a_turn_takes_one_direction_to_another() {
        for from in [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [1.0, -2.0, 0.5]] {
            let rows = turn(from, [0.0, 1.0, 0.0]);
            let v = DVec3::from_array(from).normalize();
            let turned = rows.map(|row| DVec3::from_array(row).dot(v));
            assert!((turned[1] - 1.0).abs() < 1e-9, "{from:?} {turned:?}");
            let [a, b, c] = rows.map(DVec3::from_array);
            assert!((a.cross(b).dot(c) - 1.0).abs() < 1e-9, "{from:?} is mirrored");
        }
    }
}
