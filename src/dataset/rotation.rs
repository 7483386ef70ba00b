//! Rotations as files have them.

/// The rotation nearest to a matrix that is one up to its rounding; `None` for anything else.
pub(super) fn nearest(matrix: &[[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let gram = |m: &[[f64; 3]; 3], i: usize, j: usize| -> f64 { (0..3).map(|k| m[i][k] * m[j][k]).sum() };
    let off = |m: &[[f64; 3]; 3]| {
        let pairs = (0..9).map(|k| (gram(m, k / 3, k % 3) - if k / 3 == k % 3 { 1.0 } else { 0.0 }).abs());
        pairs.fold(0.0, |most: f64, v| if v.is_nan() { f64::INFINITY } else { most.max(v) })
    };
    let [a, b, c] = matrix;
    let det =
        a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
    if off(matrix) > 1e-3 || det < 0.0 {
        return None;
    }
    let mut m = *matrix;
    // Newton's iteration for the polar factor: the error is squared each time.
    for _ in 0..4 {
        m = std::array::from_fn(|i| {
            std::array::from_fn(|j| 1.5 * m[i][j] - 0.5 * (0..3).map(|k| gram(&m, i, k) * m[k][j]).sum::<f64>())
        });
    }
    Some(m)
}

/// The rotation about an axis by the vector's length in radians (Rodrigues).
pub(super) fn of_vector(v: [f64; 3]) -> [[f64; 3]; 3] {
    let angle = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    // sin(a) / a and (1 - cos(a)) / a^2, by their series where the quotients lose their digits.
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
