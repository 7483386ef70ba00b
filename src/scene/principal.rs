//! Principal axes of symmetric matrices.

use glam::DMat3;

/// Sweeps of Jacobi's rotations; each further sweep squares the remaining error.
const SWEEPS: usize = 8;

/// Principal values and axes (columns) of a symmetric matrix, by Jacobi's rotations.
pub fn principal(matrix: DMat3) -> ([f64; 3], DMat3) {
    let (mut a, mut axes) = (matrix, DMat3::IDENTITY);
    for _ in 0..SWEEPS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = a.col(q)[p];
            if off == 0.0 {
                continue;
            }
            let theta = (a.col(q)[q] - a.col(p)[p]) / (2.0 * off);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let mut turn = DMat3::IDENTITY;
            turn.col_mut(p)[p] = c;
            turn.col_mut(q)[q] = c;
            turn.col_mut(q)[p] = t * c;
            turn.col_mut(p)[q] = -t * c;
            a = turn.transpose() * a * turn;
            axes *= turn;
        }
    }
    ([a.x_axis.x, a.y_axis.y, a.z_axis.z], axes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn principal_axes_make_the_matrix() {
        let m = DMat3::from_cols_array(&[4.0, 1.0, -2.0, 1.0, 3.0, 0.5, -2.0, 0.5, 7.0]);
        for matrix in [m, DMat3::from_diagonal(DVec3::new(3.0, 1.0, 2.0)), DMat3::ZERO] {
            let (values, axes) = principal(matrix);
            let again = axes * DMat3::from_diagonal(DVec3::from_array(values)) * axes.transpose();
            assert!((again - matrix).to_cols_array().iter().all(|v| v.abs() < 1e-12), "{again}");
            assert!((axes.transpose() * axes - DMat3::IDENTITY).to_cols_array().iter().all(|v| v.abs() < 1e-12));
        }
    }
}
