//! The plane of vertical errors.

/// Rounds of reweighting. Errors change by less than a thousandth after far fewer.
const ROUNDS: usize = 30;
/// Errors below this share of the mean absolute error weigh alike.
const FLOOR: f64 = 1e-3;

/// A plane.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Plane {
    /// Height where both coordinates are zero.
    pub up: f64,
    /// Rise along each coordinate.
    pub tilt: [f64; 2],
    /// Root of the mean square of what the plane leaves.
    pub rmse: f64,
}

impl Plane {
    fn at(&self, [x, y]: [f64; 2]) -> f64 {
        self.up + self.tilt[0] * x + self.tilt[1] * y
    }
}

/// The plane through values at places that fits best in the mean of absolute values, found by least squares with weights.
/// Fewer than three places give a level plane.
pub fn plane(places: &[[f64; 2]], values: &[f64]) -> Plane {
    let mut found = Plane { up: super::median(values.to_vec()), ..Plane::default() };
    let count = values.len().max(1) as f64;
    for _ in 0..ROUNDS {
        let left = |k: usize| values[k] - found.at(places[k]);
        let floor = FLOOR * (0..values.len()).map(|k| left(k).abs()).sum::<f64>() / count;
        if floor <= 0.0 {
            break;
        }
        let mut normal = [[0.0; 4]; 3];
        for (k, ([x, y], value)) in places.iter().zip(values).enumerate() {
            let row = [1.0, *x, *y, *value];
            let weight = 1.0 / left(k).abs().max(floor);
            for i in 0..3 {
                (0..4).for_each(|j| normal[i][j] += weight * row[i] * row[j]);
            }
        }
        let Some([up, east, north]) = solved(normal) else { break };
        found = Plane { up, tilt: [east, north], rmse: 0.0 };
    }
    let squares: f64 = places.iter().zip(values).map(|(p, v)| (v - found.at(*p)).powi(2)).sum();
    Plane { rmse: (squares / count).sqrt(), ..found }
}

/// Solves N linear equations, whose last column is the right side. `None` where they are dependent.
pub(super) fn solved<const N: usize, const M: usize>(mut rows: [[f64; M]; N]) -> Option<[f64; N]> {
    for k in 0..N {
        let pivot = (k..N).max_by(|a, b| rows[*a][k].abs().total_cmp(&rows[*b][k].abs()))?;
        rows.swap(k, pivot);
        let size = rows[k].iter().fold(0.0_f64, |size, v| size.max(v.abs()));
        // A comparison with NaN is false too.
        let independent = rows[k][k].abs() > 1e-12 * size;
        if !independent {
            return None;
        }
        let row = rows[k];
        for other in (0..N).filter(|other| *other != k) {
            let factor = rows[other][k] / row[k];
            rows[other].iter_mut().zip(row).for_each(|(v, r)| *v -= factor * r);
        }
    }
    Some(std::array::from_fn(|k| rows[k][M - 1] / rows[k][k]))
}
