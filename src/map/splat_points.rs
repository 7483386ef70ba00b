//! Splats as points on a map.

use glam::{DQuat, DVec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use crate::format::las::CloudPoint;
use crate::geodesy::Georeference;
use crate::scene::{Gaussians, SH_GROUP_FLOATS, Similarity, sh};

/// Points made at a time, so that the whole cloud is never in memory.
const BATCH: usize = 1 << 16;

/// A model whose splats become points.
pub struct SplatPoints<'a> {
    /// The splats.
    pub gaussians: &'a Gaussians,
    /// Degree of their spherical harmonics.
    pub sh_degree: u32,
    /// From the coordinates of the splats to the dataset's.
    pub to_dataset: Similarity,
    /// From the dataset to the map.
    pub georeference: &'a Georeference,
    /// Centres of cameras in dataset coordinates. Normals point to the nearest one; without cameras, up on a map.
    pub eyes: &'a [[f64; 3]],
    /// Splats of less opacity become no points.
    pub least_opacity: f64,
}

/// What all splats share.
struct Ways {
    /// From the coordinates of the splats to the map, but for positions.
    turned: Similarity,
    /// Down on the map in the coordinates of the splats; nothing where down is not known.
    down: Option<[f64; 3]>,
    /// Up in dataset coordinates, where it is known.
    up: Option<[f64; 3]>,
    eyes: Option<ImmutableKdTree<f64, 3>>,
}

impl SplatPoints<'_> {
    /// The points, in the order of the splats. The position of a point is the middle of its splat; its normal is the
    /// splat's shortest axis, and its error the standard deviation along it. Its colour is what is seen from straight
    /// above on a map, and else that of all directions.
    pub fn points(&self) -> impl Iterator<Item = CloudPoint> + '_ {
        let ways = self.ways();
        let batches = (0..self.gaussians.len()).step_by(BATCH);
        batches.flat_map(move |first| {
            let rows = first..(first + BATCH).min(self.gaussians.len());
            rows.into_par_iter().filter_map(|row| self.point(row, &ways)).collect::<Vec<_>>()
        })
    }

    fn ways(&self) -> Ways {
        let middle = |axis: usize| {
            let values = self.gaussians.means.iter().skip(axis).step_by(3).filter(|v| v.is_finite());
            let (sum, count) = values.fold((0.0, 0.0), |(sum, count), v| (sum + f64::from(*v), count + 1.0));
            sum / f64::max(count, 1.0)
        };
        let at = self.to_dataset.point([middle(0), middle(1), middle(2)]);
        let to_map = self.georeference.similarity_at(at);
        let turned = self.to_dataset.then(&to_map);
        // A row of a rotation is an axis of the target in the source.
        let is_map = self.georeference.system().is_some();
        Ways {
            down: is_map.then(|| turned.rotation[2].map(|v| -v)),
            up: is_map.then_some(to_map.rotation[2]),
            turned,
            eyes: (!self.eyes.is_empty()).then(|| ImmutableKdTree::new_from_slice(self.eyes)),
        }
    }

    fn point(&self, row: usize, ways: &Ways) -> Option<CloudPoint> {
        let Gaussians { means, quats, scales, opacities, .. } = self.gaussians;
        let opacity = 1.0 / (1.0 + (-f64::from(opacities[row])).exp());
        // A comparison with NaN is false too.
        let visible = opacity >= self.least_opacity;
        if !visible {
            return None;
        }
        let at = self.to_dataset.point([0, 1, 2].map(|k| f64::from(means[3 * row + k])));
        let sizes = [0, 1, 2].map(|k| f64::from(scales[3 * row + k]));
        let shortest = (0..3).min_by(|a, b| sizes[*a].total_cmp(&sizes[*b]))?;
        let axis = axis([0, 1, 2, 3].map(|k| f64::from(quats[4 * row + k])), shortest);
        let in_dataset = times(&self.to_dataset.rotation, axis);
        let towards = match &ways.eyes {
            Some(eyes) => {
                let eye = self.eyes[eyes.nearest_one::<SquaredEuclidean>(&at).item as usize];
                Some([0, 1, 2].map(|k| eye[k] - at[k]))
            }
            None => ways.up,
        };
        let away = towards.is_some_and(|towards| (0..3).map(|k| towards[k] * in_dataset[k]).sum::<f64>() < 0.0);
        let normal = times(&ways.turned.rotation, axis).map(|v| if away { -v } else { v } as f32);
        let error = ways.turned.scale * sizes[shortest].exp();
        let position = self.georeference.to_map(at);
        Some(CloudPoint { position, colour: self.colour(row, ways.down), normal, error: error as f32 })
    }

    fn colour(&self, row: usize, down: Option<[f64; 3]>) -> [u8; 3] {
        let degree = if down.is_some() { self.sh_degree } else { 0 };
        let basis = sh::basis(down.unwrap_or_default(), degree);
        let of = |channel: usize| -> f64 {
            let term = |k: usize| f64::from(self.gaussians.sh[k / 4][SH_GROUP_FLOATS * row + 3 * (k % 4) + channel]);
            0.5 + (0..sh::coefficients(degree)).map(|k| basis[k] * term(k)).sum::<f64>()
        };
        [0, 1, 2].map(|channel| (255.0 * of(channel)).round().clamp(0.0, 255.0) as u8)
    }
}

fn times(rows: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    rows.map(|row| (0..3).map(|k| row[k] * v[k]).sum())
}

/// An axis of a splat, a column of its rotation. A quaternion of no length turns nothing.
fn axis([w, x, y, z]: [f64; 4], number: usize) -> [f64; 3] {
    let turn = DQuat::from_xyzw(x, y, z, w);
    let turn = if turn.length_squared() > 0.0 { turn.normalize() } else { DQuat::IDENTITY };
    (turn * DVec3::AXES[number]).to_array()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geodesy::ReferenceSystem;
    use crate::scene::{Coordinates, Geodetic};

    /// Four splats: flat on the ground and turned, and a faint one.
    fn splats() -> Gaussians {
        let mut model = Gaussians::zeros(3);
        model.opacities = vec![4.0, 4.0, -4.0];
        model.means = vec![1.0, 2.0, 3.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let long = 0.5_f32.ln();
        model.scales = vec![long, long, 0.01_f32.ln(), 0.02_f32.ln(), long, long, long, long, long];
        // The second is turned by 90 degrees about y, so that its x axis points down.
        let half = 0.5_f32.sqrt();
        model.quats = vec![1.0, 0.0, 0.0, 0.0, half, 0.0, half, 0.0, 1.0, 0.0, 0.0, 0.0];
        model.sh[0][0] = 1.0;
        // The coefficient of z in the second degree's first group: seen from above it takes away from green.
        model.sh[0][3 * 2 + 1] = 0.5;
        model
    }

    fn points(georeference: &Georeference, to_dataset: Similarity, eyes: &[[f64; 3]]) -> Vec<CloudPoint> {
        let model = splats();
        let of = SplatPoints { gaussians: &model, sh_degree: 1, to_dataset, georeference, eyes, least_opacity: 0.5 };
        of.points().collect()
    }

    fn close(a: [f32; 3], b: [f64; 3], far: f64) -> bool {
        (0..3).all(|k| (f64::from(a[k]) - b[k]).abs() < far)
    }

    #[test]
    fn splats_become_points_with_normals_towards_the_nearest_camera() {
        let scaled = Similarity { scale: 2.0, translation: [10.0, 0.0, 0.0], ..Similarity::IDENTITY };
        let found = points(&Georeference::local(), scaled, &[[10.0, 0.0, -50.0]]);
        assert_eq!(found.len(), 2, "the faint one is none");
        assert_eq!(found[0].position, [12.0, 4.0, 6.0]);
        assert!(close(found[0].normal, [0.0, 0.0, -1.0], 1e-6), "{found:?}");
        assert!(close(found[1].normal, [0.0, 0.0, -1.0], 1e-6), "{found:?}");
        assert!((found[0].error - 0.02).abs() < 1e-6 && (found[1].error - 0.04).abs() < 1e-6, "{found:?}");
        // Without a map, the colour of all directions.
        assert_eq!(found[0].colour, [199, 128, 128]);
    }

    #[test]
    fn points_on_a_map_are_turned_by_its_convergence() {
        let origin = Geodetic { latitude: 45.0, longitude: 11.0, altitude: 200.0 };
        let utm = ReferenceSystem::epsg(32_632).expect("a system");
        let map = Georeference::of_coordinates(&Coordinates::EastNorthUp { origin }, Some(utm)).expect("a map");
        // The first splat is tilted to the north by half a right angle: its normal shows the convergence.
        let tilted = Similarity {
            rotation: [[1.0, 0.0, 0.0], [0.0, 0.5_f64.sqrt(), 0.5_f64.sqrt()], [0.0, -0.5_f64.sqrt(), 0.5_f64.sqrt()]],
            ..Similarity::IDENTITY
        };
        let found = points(&map, tilted, &[]);
        let want = map.to_map(tilted.point([1.0, 2.0, 3.0]));
        assert!((0..3).all(|k| (found[0].position[k] - want[k]).abs() < 1e-9));
        // Two degrees east of the meridian of the middle, at 45 degrees north: 2 sin 45 degrees.
        let convergence = 2.0_f64.to_radians() * 0.5_f64.sqrt();
        let half = 0.5_f64.sqrt();
        let turned = [-half * convergence.sin(), half * convergence.cos(), half];
        assert!(close(found[0].normal, turned, 2e-3), "{:?} {turned:?}", found[0].normal);
        assert!(found[0].normal[0] < -0.01, "{:?}", found[0].normal);
        // Down is not -z of the model but tilted: 0.4886 * -cos 45 * 0.5 of green are gone.
        let green = 255.0 * (0.5 - 0.488_602_5 * half * 0.5);
        assert!((f64::from(found[0].colour[1]) - green).abs() < 1.5, "{:?} {green}", found[0].colour);
    }
}
