//! In what steps coordinates are written.

use super::quantile::quantile;

/// Steps of coordinates in metres.
const MILLIMETRE: f64 = 1e-3;

/// The step of coordinates and what is taken off them first, for positions like the given ones. On a map the step is a
/// millimetre and the offset is of whole metres. Coordinates of unknown units have steps of about a millionth of their
/// extent.
pub fn steps(positions: &[[f64; 3]], metres: bool) -> (f64, [f64; 3]) {
    let middle = |axis: usize| {
        let mut values: Vec<f64> = positions.iter().map(|p| p[axis]).filter(|v| v.is_finite()).collect();
        quantile(&mut values, 0.5).unwrap_or(0.0)
    };
    let middles = [middle(0), middle(1), middle(2)];
    let step = if metres {
        MILLIMETRE
    } else {
        let far = |p: &[f64; 3]| (0..3).map(|k| (p[k] - middles[k]).abs()).fold(0.0, f64::max);
        let mut distances: Vec<f64> = positions.iter().map(far).filter(|v| v.is_finite()).collect();
        // Few splats far away do not decide.
        let extent = quantile(&mut distances, 0.9).unwrap_or(1.0).clamp(1e-9, 1e9);
        10_f64.powf(extent.log10().floor() - 6.0)
    };
    (step, middles.map(|v| (v / (1000.0 * step)).round() * 1000.0 * step))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_have_millimetres_and_other_coordinates_a_millionth() {
        let near = |a: [f64; 3], b: [f64; 3]| (0..3).all(|k| (a[k] - b[k]).abs() < 1e-6);
        let map = [[500_000.4, 4_600_001.2, 99.0], [500_000.6, 4_600_000.7, 101.0], [f64::NAN; 3]];
        let (step, offset) = steps(&map, true);
        assert!(step == 0.001 && near(offset, [500_001.0, 4_600_001.0, 101.0]), "{offset:?}");
        let mut small: Vec<[f64; 3]> = (0..100).map(|k| [0.05 * f64::from(k), 1.0, 0.0]).collect();
        small.push([1e12, 0.0, 0.0]);
        let (step, offset) = steps(&small, false);
        assert!((step - 1e-6).abs() < 1e-9 && near(offset, [2.5, 1.0, 0.0]), "{step} {offset:?}");
        assert_eq!(steps(&[], true), (0.001, [0.0; 3]));
    }
}
