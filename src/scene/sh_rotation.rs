//! Rotation of functions given by real spherical harmonics up to degree 3.

use super::sh;

/// Nodes of the Gauss-Legendre rule of four points and their weights: exact for polynomials up to degree 7.
const LEGENDRE: [(f64, f64); 4] = [
    (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
    (-0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
    (0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
    (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
];
/// Equal steps around the axis: exact for trigonometric polynomials up to degree 7.
const AZIMUTHS: usize = 8;

/// The map of coefficients under a rotation R, which turns a function f into f' with f'(R d) = f(d). Each degree is
/// mapped to itself.
pub(super) struct ShRotation {
    /// `matrix[k][j]`: how much of coefficient j goes to coefficient k; zero between degrees.
    matrix: [[f64; 16]; 16],
}

impl ShRotation {
    /// The basis functions are orthonormal, so entry (k, j) is the integral over the sphere of Y_k(d) Y_j(R^T d). The
    /// integrand is a polynomial of degree 6 at most, which a product of the two rules above integrates exactly. This
    /// needs no recursion, and signs and orders follow from the definition of the basis alone.
    pub(super) fn new(rotation: &[[f64; 3]; 3]) -> Self {
        let mut matrix = [[0.0; 16]; 16];
        for (z, weight) in LEGENDRE {
            let radius = (1.0 - z * z).sqrt();
            for step in 0..AZIMUTHS {
                let (sin, cos) = (std::f64::consts::TAU * step as f64 / AZIMUTHS as f64).sin_cos();
                let direction = [radius * cos, radius * sin, z];
                let before = std::array::from_fn(|j| (0..3).map(|i| rotation[i][j] * direction[i]).sum::<f64>());
                let (here, there) = (sh::basis(direction, 3), sh::basis(before, 3));
                let weight = weight * std::f64::consts::TAU / AZIMUTHS as f64;
                for (k, row) in matrix.iter_mut().enumerate() {
                    for (j, entry) in row.iter_mut().enumerate().filter(|(j, _)| degree(*j) == degree(k)) {
                        *entry += weight * here[k] * there[j];
                    }
                }
            }
        }
        // The constant coefficient keeps its bits.
        matrix[0][0] = 1.0;
        Self { matrix }
    }

    /// Turns the 16 coefficients x RGB of a splat, in the four groups of a model's planes.
    pub(super) fn turn(&self, groups: [&mut [f32]; 4]) {
        let old: [[f64; 3]; 16] =
            std::array::from_fn(|k| std::array::from_fn(|c| f64::from(groups[k / 4][3 * (k % 4) + c])));
        for k in 1..16 {
            let first = degree(k) * degree(k);
            for c in 0..3 {
                let sum: f64 = (first..first + 2 * degree(k) + 1).map(|j| self.matrix[k][j] * old[j][c]).sum();
                groups[k / 4][3 * (k % 4) + c] = sum as f32;
            }
        }
    }
}

/// The degree of a coefficient.
fn degree(k: usize) -> usize {
    match k {
        0 => 0,
        1..=3 => 1,
        4..=8 => 2,
        _ => 3,
    }
}
