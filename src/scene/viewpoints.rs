//! The few of many cameras from which a viewer may first look at a model.

use glam::DVec3;

use super::{Camera, Gaussians};

/// Most splats that are looked for in each camera's picture.
const SAMPLES: usize = 2000;
/// Most cameras that are considered.
const CAMERAS: usize = 300;
/// Share of the best camera's worth that every viewpoint has at least.
const WORTH: f64 = 0.35;

/// A place to look from, without roll.
#[derive(Clone, Debug, PartialEq)]
pub struct Viewpoint {
    /// Name of the photograph.
    pub name: String,
    /// Centre of the camera.
    pub position: [f64; 3],
    /// The point of the model in the middle of the picture, in half of all cases: at the median depth of what is seen.
    pub target: [f64; 3],
    /// Angle of view in degrees along the longer side of a window of 4:3 in which the whole photograph has room.
    pub degrees: f64,
}

/// Up to `most` viewpoints, far from each other; the first one sees most of the model. `up` is a unit vector. Names and
/// cameras are those of photographs, in the coordinates of the model.
pub fn viewpoints(model: &Gaussians, cameras: &[(String, Camera)], up: [f64; 3], most: usize) -> Vec<Viewpoint> {
    let sample = sample(model);
    let step = cameras.len().div_ceil(CAMERAS).max(1);
    let seen: Vec<Seen<'_>> =
        cameras.iter().step_by(step).filter_map(|(name, camera)| Seen::of(name, camera, &sample, up)).collect();
    let Some(best) = seen.iter().max_by(|a, b| a.worth.total_cmp(&b.worth)) else { return Vec::new() };
    let mean = seen.iter().map(|view| view.center).sum::<DVec3>() / seen.len() as f64;
    let spread = seen.iter().map(|view| view.center.distance(mean)).sum::<f64>() / seen.len() as f64;
    let mut chosen = vec![best];
    while chosen.len() < most {
        let far = |view: &Seen<'_>| {
            let distances = chosen.iter().map(|other| view.distance(other, spread));
            distances.fold(f64::INFINITY, f64::min)
        };
        let next = seen.iter().filter(|view| view.worth >= WORTH * best.worth).map(|view| (far(view), view));
        match next.max_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((distance, view)) if distance > 0.05 => chosen.push(view),
            _ => break,
        }
    }
    chosen.truncate(most);
    chosen.into_iter().map(Seen::viewpoint).collect()
}

/// Centres of splats that are more opaque than not, or of all where none is.
fn sample(model: &Gaussians) -> Vec<[f64; 3]> {
    let mut rows: Vec<usize> = (0..model.len()).filter(|row| model.opacities[*row] > 0.0).collect();
    if rows.is_empty() {
        rows = (0..model.len()).collect();
    }
    let step = rows.len().div_ceil(SAMPLES).max(1);
    let center = |row: usize| std::array::from_fn(|k| f64::from(model.means[3 * row + k]));
    rows.into_iter().step_by(step).map(center).collect()
}

/// What a camera sees of the sample.
struct Seen<'a> {
    name: &'a str,
    camera: &'a Camera,
    center: DVec3,
    forward: DVec3,
    depth: f64,
    worth: f64,
}

impl<'a> Seen<'a> {
    fn of(name: &'a str, camera: &'a Camera, sample: &[[f64; 3]], up: [f64; 3]) -> Option<Self> {
        let mut depths: Vec<f64> = sample.iter().filter_map(|point| camera.placed(*point)).map(|[_, _, z]| z).collect();
        let middle = depths.len() / 2;
        let share = depths.len() as f64 / sample.len() as f64;
        let (_, depth, _) = (!depths.is_empty()).then(|| depths.select_nth_unstable_by(middle, f64::total_cmp))?;
        let depth = *depth;
        let [right, _, forward] = camera.rotation.map(DVec3::from_array);
        let up = DVec3::from_array(up);
        // A viewer does not roll, and straight down no direction is the top.
        let level = 1.0 - right.dot(up).abs().min(1.0);
        let slanted = (1.0 - forward.dot(up).powi(2)).max(0.0).sqrt();
        let worth = share * level * (0.3 + 0.7 * slanted);
        let center = DVec3::from_array(camera.center());
        Some(Self { name, camera, center, forward, depth, worth })
    }

    /// How different two views are: 1 for cameras as far from each other as cameras are from their middle, and for
    /// directions one radian apart.
    fn distance(&self, other: &Self, spread: f64) -> f64 {
        let apart = self.center.distance(other.center);
        let apart = if spread > 0.0 { apart / spread } else { 0.0 };
        apart + self.forward.dot(other.forward).clamp(-1.0, 1.0).acos()
    }

    fn viewpoint(&self) -> Viewpoint {
        let camera = self.camera;
        let wide = (f64::from(camera.width) / camera.fx).max(4.0 / 3.0 * f64::from(camera.height) / camera.fy);
        Viewpoint {
            name: self.name.to_owned(),
            position: self.center.to_array(),
            target: (self.center + self.depth * self.forward).to_array(),
            degrees: 2.0 * (0.5 * wide).atan().to_degrees(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera at `x` that looks along z, turned by `roll` degrees about its axis.
    fn camera(x: f64, roll: f64) -> Camera {
        let (sin, cos) = roll.to_radians().sin_cos();
        let rotation = [[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]];
        let translation = [-cos * x, sin * x, 0.0];
        Camera { rotation, translation, fx: 50.0, fy: 50.0, cx: 50.0, cy: 40.0, width: 100, height: 80 }
    }

    fn row_of_splats() -> Gaussians {
        let mut model = Gaussians::zeros(41);
        for k in 0..41 {
            model.means[3 * k..3 * k + 3].copy_from_slice(&[k as f32 * 0.1 - 2.0, 0.0, 2.0]);
            model.opacities[k] = 1.0;
        }
        model
    }

    #[test]
    fn first_viewpoint_sees_most_and_is_level() {
        let cameras =
            [("far", 3.0, 0.0), ("middle", 0.0, 0.0), ("rolled", 0.0, 40.0), ("side", -1.5, 0.0), ("out", 90.0, 0.0)];
        let cameras: Vec<(String, Camera)> = cameras.map(|(name, x, roll)| (name.to_owned(), camera(x, roll))).to_vec();
        let found = viewpoints(&row_of_splats(), &cameras, [0.0, -1.0, 0.0], 3);
        let names: Vec<&str> = found.iter().map(|view| view.name.as_str()).collect();
        assert_eq!(names, ["middle", "side"], "neither a camera that sees little nor one that sees nothing");
        assert_eq!((found[0].position, found[0].target), ([0.0; 3], [0.0, 0.0, 2.0]));
        let wide = 2.0 * (4.0_f64 / 3.0 * 0.8).atan().to_degrees();
        assert!((found[0].degrees - wide).abs() < 1e-9, "the height of 80 pixels has room too");
        assert!(viewpoints(&Gaussians::zeros(0), &cameras, [0.0, -1.0, 0.0], 3).is_empty());
        assert!(viewpoints(&row_of_splats(), &cameras, [0.0, -1.0, 0.0], 0).is_empty());
    }
}
