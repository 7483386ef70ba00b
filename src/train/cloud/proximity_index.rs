//! Whether a place is near a cloud.

use std::collections::HashSet;
use std::fmt;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

/// Side of a cube over the distance. Of the points in a cube only the first is kept, which changes distances by at most
/// 0.11 times the distance.
const THINNED: f64 = 1.0 / 16.0;

/// A cloud that answers which places are within a distance of its points.
pub struct ProximityIndex {
    tree: ImmutableKdTree<f64, 3>,
    points: usize,
    within: f64,
}

impl ProximityIndex {
    /// For a cloud and a distance in its units; `None` without points. Points that are not finite are left out.
    pub fn new(points: &[[f64; 3]], within: f64) -> Option<Self> {
        let side = (THINNED * within).max(f64::MIN_POSITIVE);
        let mut taken = HashSet::new();
        let finite = points.iter().filter(|p| p.iter().all(|v| v.is_finite()));
        let kept: Vec<[f64; 3]> =
            finite.filter(|p| taken.insert(p.map(|v| (v / side).floor() as i64))).copied().collect();
        let tree = (!kept.is_empty()).then(|| ImmutableKdTree::new_from_slice(&kept));
        tree.map(|tree| Self { tree, points: kept.len(), within })
    }

    /// Whether a place is within the distance of a point of the cloud.
    pub fn is_near(&self, place: [f64; 3]) -> bool {
        let finite = place.iter().all(|v| v.is_finite());
        finite && self.tree.nearest_one::<SquaredEuclidean>(&place).distance <= self.within * self.within
    }

    /// [`Self::is_near`] for rows of three floats.
    pub fn near(&self, means: &[f32]) -> Vec<bool> {
        means.par_chunks_exact(3).map(|m| self.is_near([0, 1, 2].map(|k| f64::from(m[k])))).collect()
    }

    /// Number of points after thinning.
    pub fn points(&self) -> usize {
        self.points
    }
}

impl fmt::Debug for ProximityIndex {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ProximityIndex").field("points", &self.points).field("within", &self.within).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 40) as f64 / f64::from(1 << 24)
    }

    /// Compares with all distances, except near the limit, where thinning may change the answer.
    #[test]
    fn near_is_what_all_distances_say() {
        let mut state = 7;
        let cloud: Vec<[f64; 3]> =
            (0..3000).map(|_| [0, 1, 2].map(|k| random(&mut state) * [9.0, 7.0, 0.3][k])).collect();
        let within = 0.2;
        let gate = ProximityIndex::new(&cloud, within).expect("points");
        let means: Vec<f32> = (0..6000).map(|k| (random(&mut state) * [10.0, 8.0, 2.0][k % 3] - 0.5) as f32).collect();
        let (mut near, mut far) = (0, 0);
        for (mean, said) in means.chunks_exact(3).zip(gate.near(&means)) {
            let squared = |p: &[f64; 3]| (0..3).map(|k| (p[k] - f64::from(mean[k])).powi(2)).sum::<f64>();
            let distance = cloud.iter().map(squared).fold(f64::INFINITY, f64::min).sqrt();
            if distance < 0.89 * within {
                assert!(said, "{mean:?} at {distance}");
                near += 1;
            } else if distance > within {
                assert!(!said, "{mean:?} at {distance}");
                far += 1;
            }
        }
        assert!(near > 100 && far > 100, "{near} near, {far} far");
    }

    #[test]
    fn what_is_not_finite_is_far_and_no_points_are_no_gate() {
        assert!(ProximityIndex::new(&[], 1.0).is_none());
        assert!(ProximityIndex::new(&[[f64::NAN, 0.0, 0.0]], 1.0).is_none());
        let gate = ProximityIndex::new(&[[0.0; 3]; 200], 1.0).expect("a point");
        assert_eq!(gate.points(), 1);
        assert_eq!(gate.near(&[0.0, 0.0, 1.0, 0.0, f32::NAN, 0.0, f32::INFINITY, 0.0, 0.0]), [true, false, false]);
    }
}
