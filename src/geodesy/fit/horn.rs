//! The similarity of least squares in closed form (Horn 1987; the scale is that of Umeyama 1991).

use super::Pair;
use crate::scene::Similarity;

/// The similarity that brings points to their places in least squares, all of them weighed alike. `None` where the
/// points or the places lie on a line.
pub(super) fn similarity(pairs: &[Pair]) -> Option<Similarity> {
    let n = pairs.len() as f64;
    let mean = |of: fn(&Pair) -> [f64; 3]| -> [f64; 3] {
        std::array::from_fn(|k| pairs.iter().map(|pair| of(pair)[k]).sum::<f64>() / n)
    };
    let (from, to) = (mean(|pair| pair.point), mean(|pair| pair.place));
    let mut s = [[0.0; 3]; 3];
    let (mut size_from, mut size_to) = (0.0, 0.0);
    for pair in pairs {
        for i in 0..3 {
            let a = pair.point[i] - from[i];
            size_from += a * a;
            size_to += (pair.place[i] - to[i]).powi(2);
            for (j, value) in s[i].iter_mut().enumerate() {
                *value += a * (pair.place[j] - to[j]);
            }
        }
    }
    let unit = (size_from * size_to).sqrt();
    if !(unit > 0.0 && unit.is_finite()) {
        return None;
    }
    let s = s.map(|row| row.map(|v| v / unit));
    let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = s;
    let (values, vectors) = eigen([
        [xx + yy + zz, yz - zy, zx - xz, xy - yx],
        [yz - zy, xx - yy - zz, xy + yx, zx + xz],
        [zx - xz, xy + yx, yy - xx - zz, yz + zy],
        [xy - yx, zx + xz, yz + zy, zz - xx - yy],
    ]);
    let mut order = [0, 1, 2, 3];
    order.sort_by(|a: &usize, b: &usize| values[*b].total_cmp(&values[*a]));
    // Points on a line turn about the line freely: two quaternions fit alike.
    if values[order[0]] - values[order[1]] < 1e-9 {
        return None;
    }
    let rotation = matrix(std::array::from_fn(|k| vectors[k][order[0]]));
    let along: f64 = (0..3).flat_map(|i| (0..3).map(move |j| (i, j))).map(|(i, j)| rotation[j][i] * s[i][j]).sum();
    let scale = along * unit / size_from;
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    let turned = Similarity { rotation, scale, translation: [0.0; 3] };
    let moved = turned.point(from);
    Some(Similarity { translation: std::array::from_fn(|k| to[k] - moved[k]), ..turned })
}

/// The rotation of a quaternion (w first).
fn matrix([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
    let turn = glam::DQuat::from_xyzw(x, y, z, w).normalize();
    glam::DMat3::from_quat(turn).transpose().to_cols_array_2d()
}

/// Eigenvalues and eigenvectors (in columns) of a symmetric matrix, by Jacobi's rotations.
fn eigen(mut m: [[f64; 4]; 4]) -> ([f64; 4], [[f64; 4]; 4]) {
    let mut vectors: [[f64; 4]; 4] = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    for _ in 0..30 {
        for p in 0..4 {
            for q in p + 1..4 {
                if m[p][q].abs() < 1e-300 {
                    continue;
                }
                let angle = 0.5 * (2.0 * m[p][q]).atan2(m[q][q] - m[p][p]);
                let (s, c) = angle.sin_cos();
                let turned = |a: f64, b: f64| (c * a - s * b, s * a + c * b);
                for row in m.iter_mut().chain(&mut vectors) {
                    (row[p], row[q]) = turned(row[p], row[q]);
                }
                let (a, b) = (m[p], m[q]);
                for k in 0..4 {
                    (m[p][k], m[q][k]) = turned(a[k], b[k]);
                }
            }
        }
    }
    (std::array::from_fn(|k| m[k][k]), vectors)
}
