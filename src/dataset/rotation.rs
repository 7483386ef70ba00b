//! Rotations in the forms of dataset files.

/// Largest error of the products of a rotation's rows from rounding in a file.
const ROUNDING: f64 = 1e-3;

/// The nearest rotation to a matrix that is a rotation up to rounding and one scale of all axes; for any other matrix
/// its fault.
pub(super) fn nearest(matrix: &[[f64; 3]; 3]) -> Result<[[f64; 3]; 3], &'static str> {
    let [a, b, c] = matrix;
    let det =
        a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
    let mut m = *matrix;
    if off(&m) > ROUNDING && det.is_finite() && det != 0.0 {
        let scale = det.abs().cbrt();
        m = m.map(|row| row.map(|v| v / scale));
    }
    if !(det.is_finite() && off(&m) <= ROUNDING) {
        return Err("no rotation: the axes are scaled apart, not at right angles, or missing");
    }
    if det < 0.0 {
        return Err("a reflection, which no camera makes: one axis points the wrong way");
    }
    // Newton's iteration for the polar factor, which squares the error each time.
    for _ in 0..4 {
        m = std::array::from_fn(|i| {
            std::array::from_fn(|j| 1.5 * m[i][j] - 0.5 * (0..3).map(|k| gram(&m, i, k) * m[k][j]).sum::<f64>())
        });
    }
    Ok(m)
}

fn gram(m: &[[f64; 3]; 3], i: usize, j: usize) -> f64 {
    (0..3).map(|k| m[i][k] * m[j][k]).sum()
}

/// Deviation of the rows from an orthonormal basis.
fn off(m: &[[f64; 3]; 3]) -> f64 {
    let pairs = (0..9).map(|k| (gram(m, k / 3, k % 3) - if k / 3 == k % 3 { 1.0 } else { 0.0 }).abs());
    pairs.fold(0.0, |most: f64, v| if v.is_nan() { f64::INFINITY } else { most.max(v) })
}

/// The rotation about an axis by the vector's length in radians (Rodrigues).
pub(super) fn of_vector(v: [f64; 3]) -> [[f64; 3]; 3] {
    let angle = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    // sin(a) / a and (1 - cos(a)) / a^2, by series where the quotients lose digits.
    let (s, c) = if angle < 1e-4 {
        (1.0 - angle * angle / 6.0, 0.5 - angle * angle / 24.0)
    } else {
        (angle.sin() / angle, 2.0 * (0.5 * angle).sin().powi(2) / (angle * angle))
    };
    let cross = [[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]];
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let square = (0..3).map(|k| cross[i][k] * cross[k][j]).sum::<f64>();
            (if i == j { 1.0 } else { 0.0 }) + s * cross[i][j] + c * square
        })
    })
}

pub(super) fn apply(rotation: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    rotation.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_scale_of_all_axes_is_divided_out() {
        let turned = of_vector([0.3, -0.7, 1.1]);
        let alike = |m: &[[f64; 3]; 3]| (0..9).all(|k| (m[k / 3][k % 3] - turned[k / 3][k % 3]).abs() < 1e-12);
        for scale in [1.0, 1.0004, 0.01, 2.5, 1e6] {
            let found = nearest(&turned.map(|row| row.map(|v| v * scale))).expect("a rotation");
            assert!(alike(&found), "{scale}: {found:?}");
        }
        let mut other = turned;
        other[1] = other[1].map(|v| -2.0 * v);
        assert!(nearest(&other).expect_err("two scales").contains("scaled apart"));
        assert!(nearest(&turned.map(|row| row.map(|v| -3.0 * v))).expect_err("mirrored").contains("reflection"));
        other[1] = [turned[1][0] + 0.1, turned[1][1], turned[1][2]];
        assert!(nearest(&other).expect_err("sheared").contains("right angles"));
        assert!(nearest(&[[0.0; 3]; 3]).is_err() && nearest(&[[f64::NAN; 3]; 3]).is_err());
    }
}
