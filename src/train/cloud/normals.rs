//! Normals of a cloud, from the neighbours of each point.

use std::num::NonZero;

use glam::{DMat3, DVec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};

use crate::scene::principal;

/// Points to which a plane is fitted, the point itself among them.
const NEIGHBOURS: usize = 12;
/// Largest standard deviation of points across a plane, as a share of the smaller one along the plane.
const FLAT: f64 = 0.3;

/// Unit normal, of either sign, of the plane through the points nearest to `place`; `None` if the points lie on no
/// plane.
pub(super) fn normal_at(tree: &ImmutableKdTree<f64, 3>, points: &[[f64; 3]], place: [f64; 3]) -> Option<DVec3> {
    let wanted = NonZero::new(NEIGHBOURS).unwrap_or(NonZero::<usize>::MIN);
    let near = tree.nearest_n::<SquaredEuclidean>(&place, wanted);
    let near: Vec<DVec3> =
        near.iter().filter_map(|n| points.get(n.item as usize)).map(|p| DVec3::from_array(*p)).collect();
    if near.len() < 4 {
        return None;
    }
    let mean = near.iter().sum::<DVec3>() / near.len() as f64;
    let mut spread = DMat3::ZERO;
    for p in &near {
        let d = *p - mean;
        spread += DMat3::from_cols(d * d.x, d * d.y, d * d.z);
    }
    let (values, axes) = principal(spread);
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let [least, middle, _] = order.map(|k| values[k].max(0.0));
    (middle > 0.0 && least <= FLAT * FLAT * middle).then(|| axes.col(order[0]).normalize_or_zero())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tilted_plane_has_its_normal_and_a_ball_has_none() {
        let normal = DVec3::new(0.2, -0.3, 0.9).normalize();
        let along = normal.any_orthonormal_pair();
        let at = |i: u32, j: u32| 1e5 * DVec3::ONE + along.0 * f64::from(i) + along.1 * f64::from(j);
        let plane: Vec<[f64; 3]> = (0..100).map(|k| at(k % 10, k / 10).to_array()).collect();
        let tree = ImmutableKdTree::new_from_slice(&plane);
        let found = normal_at(&tree, &plane, plane[44]).expect("a plane");
        assert!(found.dot(normal).abs() > 1.0 - 1e-9, "{found}");
        let corners: Vec<[f64; 3]> =
            (0..27).map(|k| [k % 3, k / 3 % 3, k / 9].map(|v| f64::from(v) + 1e-3 * f64::from(k))).collect();
        assert_eq!(normal_at(&ImmutableKdTree::new_from_slice(&corners), &corners, corners[13]), None);
        assert_eq!(normal_at(&ImmutableKdTree::new_from_slice(&plane[..3]), &plane[..3], plane[0]), None);
    }
}
