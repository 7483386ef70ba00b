//! A step of Gauss and Newton for a similarity, with deviations of their own for east, north and up.

use super::Pair;
use crate::scene::Similarity;

/// Unknowns: turn about three axes, logarithm of the scale, shift.
const N: usize = 7;

/// A better similarity for weighed pairs. `None` where the pairs leave it open.
pub(super) fn step(pairs: &[Pair], weights: &[f64], from: &Similarity) -> Option<Similarity> {
    let total: f64 = weights.iter().sum();
    let middle: [f64; 3] = std::array::from_fn(|k| {
        pairs.iter().zip(weights).map(|(pair, weight)| weight * pair.point[k]).sum::<f64>() / total
    });
    // About the middle, so that a turn moves nothing far away.
    let pivot = from.point(middle);
    let (mut normal, mut right) = ([[0.0; N]; N], [0.0; N]);
    for (pair, weight) in pairs.iter().zip(weights) {
        let at = from.point(pair.point);
        let [x, y, z]: [f64; 3] = std::array::from_fn(|k| at[k] - pivot[k]);
        let rows = [[0.0, z, -y, x, 1.0, 0.0, 0.0], [-z, 0.0, x, y, 0.0, 1.0, 0.0], [y, -x, 0.0, z, 0.0, 0.0, 1.0]];
        for (k, row) in rows.iter().enumerate().filter(|(k, _)| pair.deviation[*k].is_finite()) {
            let weight = weight / pair.deviation[k].powi(2);
            let off = pair.place[k] - at[k];
            for i in 0..N {
                right[i] += weight * row[i] * off;
                (0..N).for_each(|j| normal[i][j] += weight * row[i] * row[j]);
            }
        }
    }
    let d = solved(normal, right)?;
    let turn = glam::DMat3::from_quat(glam::DQuat::from_scaled_axis(glam::DVec3::new(d[0], d[1], d[2])));
    let by = Similarity { rotation: turn.transpose().to_cols_array_2d(), scale: d[3].exp(), translation: [0.0; 3] };
    // y = pivot + shift + s R (x - pivot)
    let moved = by.point(pivot);
    let by = Similarity { translation: std::array::from_fn(|k| pivot[k] + d[4 + k] - moved[k]), ..by };
    let next = from.then(&by);
    // The product of many rotations is made one again.
    let [a, b, c, _] = next.rows();
    Similarity::from_rows(&[a, b, c]).ok()
}

/// Solves a symmetric system, scaled to a diagonal of ones first.
fn solved(mut m: [[f64; N]; N], mut b: [f64; N]) -> Option<[f64; N]> {
    let size: [f64; N] = std::array::from_fn(|i| m[i][i].sqrt());
    if !size.iter().all(|v| *v > 0.0 && v.is_finite()) {
        return None;
    }
    for i in 0..N {
        b[i] /= size[i];
        (0..N).for_each(|j| m[i][j] /= size[i] * size[j]);
    }
    for i in 0..N {
        if m[i][i] < 1e-12 {
            return None;
        }
        for k in i + 1..N {
            let by = m[k][i] / m[i][i];
            let row = m[i];
            m[k].iter_mut().zip(row).for_each(|(to, from)| *to -= by * from);
            b[k] -= by * b[i];
        }
    }
    for i in (0..N).rev() {
        let known: f64 = (i + 1..N).map(|j| m[i][j] * b[j]).sum();
        b[i] = (b[i] - known) / m[i][i];
    }
    Some(std::array::from_fn(|i| b[i] / size[i]))
}
