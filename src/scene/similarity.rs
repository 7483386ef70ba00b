//! Similarities of space, and what they do to splats.

use rayon::prelude::*;

use super::sh_rotation::ShRotation;
use super::{Frame, Gaussians, SH_GROUP_FLOATS};

/// Relative deviation up to which a matrix counts as a scaled rotation: files hold products of matrices in f32.
const TOLERANCE: f64 = 1e-4;

/// A rotation, a positive scale and a translation, applied in this order: `y = scale (rotation x) + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Row-major, orthonormal, without reflection.
    pub rotation: [[f64; 3]; 3],
    /// Units of the target per unit of the source.
    pub scale: f64,
    /// The source's origin in the target.
    pub translation: [f64; 3],
}

/// A matrix is no similarity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoSimilarity {
    /// A number is not finite, or everything is mapped to one point.
    #[error("its numbers must be finite and its scale positive")]
    Degenerate,
    /// The axes do not stay at right angles, or are scaled differently.
    #[error("it stretches or shears: its linear part must be a rotation times one positive scale")]
    Stretches,
    /// Left and right are exchanged.
    #[error("it mirrors the scene: its determinant is negative")]
    Mirrors,
}

impl Similarity {
    /// Source and target are the same.
    pub const IDENTITY: Self =
        Self { rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], scale: 1.0, translation: [0.0; 3] };

    /// From the rows of a 3x4 matrix whose linear part is a rotation times a scale.
    /// The rotation is made orthonormal to f64.
    pub fn from_rows(rows: &[[f64; 4]; 3]) -> Result<Self, NoSimilarity> {
        if !rows.iter().flatten().all(|v| v.is_finite()) {
            return Err(NoSimilarity::Degenerate);
        }
        let linear: [[f64; 3]; 3] = std::array::from_fn(|i| [rows[i][0], rows[i][1], rows[i][2]]);
        let squares: f64 = linear.iter().flatten().map(|v| v * v).sum();
        let scale = (squares / 3.0).sqrt();
        if scale <= 0.0 || !scale.is_finite() {
            return Err(NoSimilarity::Degenerate);
        }
        let unit = linear.map(|row| row.map(|v| v / scale));
        for i in 0..3 {
            for j in 0..3 {
                let dot: f64 = (0..3).map(|k| unit[i][k] * unit[j][k]).sum();
                if (dot - f64::from(u8::from(i == j))).abs() > TOLERANCE {
                    return Err(NoSimilarity::Stretches);
                }
            }
        }
        if determinant(&unit) < 0.0 {
            return Err(NoSimilarity::Mirrors);
        }
        let rotation = matrix_of(quaternion_of(&unit));
        Ok(Self { rotation, scale, translation: std::array::from_fn(|i| rows[i][3]) })
    }

    /// From a dataset's coordinates to a scene's.
    pub fn to_scene(frame: &Frame) -> Self {
        let translation = frame.offset.map(|v| -v * frame.scale);
        Self { scale: frame.scale, translation, ..Self::IDENTITY }
    }

    /// The 4x4 matrix, row by row.
    pub fn rows(&self) -> [[f64; 4]; 4] {
        let row = |i: usize| {
            let [x, y, z] = self.rotation[i].map(|v| v * self.scale);
            [x, y, z, self.translation[i]]
        };
        [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
    }

    /// A point in the target.
    pub fn point(&self, p: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|i| self.scale * dot(&self.rotation[i], &p) + self.translation[i])
    }

    /// From the target back to the source.
    pub fn inverse(&self) -> Self {
        let rotation: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| self.rotation[j][i]));
        let scale = 1.0 / self.scale;
        let translation = std::array::from_fn(|i| -scale * dot(&rotation[i], &self.translation));
        Self { rotation, scale, translation }
    }

    /// First this, then `next`.
    pub fn then(&self, next: &Self) -> Self {
        let rotation = std::array::from_fn(|i| {
            std::array::from_fn(|j| (0..3).map(|k| next.rotation[i][k] * self.rotation[k][j]).sum())
        });
        Self { rotation, scale: next.scale * self.scale, translation: next.point(self.translation) }
    }

    /// This similarity after a shift of the source by `by`.
    pub fn after_shift(&self, by: [f64; 3]) -> Self {
        Self { translation: self.point(by), ..*self }
    }

    /// Angle of the rotation in degrees.
    pub fn degrees(&self) -> f64 {
        let [w, x, y, z] = quaternion_of(&self.rotation);
        2.0 * (x * x + y * y + z * z).sqrt().atan2(w.abs()).to_degrees()
    }

    /// Maps splats from the source to the target: centres are mapped, standard deviations scaled, rotations and
    /// spherical harmonics turned. A camera that is mapped too sees the same colours.
    pub fn gaussians(&self, gaussians: &Gaussians) -> Gaussians {
        let mut out = gaussians.clone();
        out.means.par_chunks_exact_mut(3).for_each(|p| {
            let moved = self.point([f64::from(p[0]), f64::from(p[1]), f64::from(p[2])]);
            p.iter_mut().zip(moved).for_each(|(p, v)| *p = v as f32);
        });
        let ln = self.scale.ln();
        out.scales.par_iter_mut().for_each(|s| *s = (f64::from(*s) + ln) as f32);
        if self.rotation == Self::IDENTITY.rotation {
            return out;
        }
        let turn = quaternion_of(&self.rotation);
        out.quats.par_chunks_exact_mut(4).for_each(|q| {
            let turned = product(turn, [f64::from(q[0]), f64::from(q[1]), f64::from(q[2]), f64::from(q[3])]);
            q.iter_mut().zip(turned).for_each(|(q, v)| *q = v as f32);
        });
        let harmonics = ShRotation::new(&self.rotation);
        let [a, b, c, d] = &mut out.sh;
        let rows = |plane| <[f32]>::par_chunks_exact_mut(plane, SH_GROUP_FLOATS);
        rows(a).zip(rows(b)).zip(rows(c)).zip(rows(d)).for_each(|(((a, b), c), d)| harmonics.turn([a, b, c, d]));
        out
    }
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn determinant(m: &[[f64; 3]; 3]) -> f64 {
    let cross = [
        m[1][1] * m[2][2] - m[1][2] * m[2][1],
        m[1][2] * m[2][0] - m[1][0] * m[2][2],
        m[1][0] * m[2][1] - m[1][1] * m[2][0],
    ];
    dot(&m[0], &cross)
}

/// Hamilton's product: the rotation of `b`, then that of `a`.
fn product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

/// The unit quaternion (w first) of a rotation, from the largest of its components (Shepperd 1978).
fn quaternion_of(m: &[[f64; 3]; 3]) -> [f64; 4] {
    let trace = m[0][0] + m[1][1] + m[2][2];
    let squares = [1.0 + trace, 1.0 - trace + 2.0 * m[0][0], 1.0 - trace + 2.0 * m[1][1], 1.0 - trace + 2.0 * m[2][2]];
    let [wx, wy, wz] = [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]];
    let [xy, xz, yz] = [m[0][1] + m[1][0], m[0][2] + m[2][0], m[1][2] + m[2][1]];
    let rows = [[squares[0], wx, wy, wz], [wx, squares[1], xy, xz], [wy, xy, squares[2], yz], [wz, xz, yz, squares[3]]];
    let largest = (0..4).fold(0, |best, k| if squares[k] > squares[best] { k } else { best });
    let row = rows[largest];
    let length = row.iter().map(|v| v * v).sum::<f64>().sqrt();
    row.map(|v| v / length)
}

fn matrix_of([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}
