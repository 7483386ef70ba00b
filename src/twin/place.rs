//! Twin of `glsl/include/place.glsl` and `glsl/include/mask.glsl`: lookups in maps of another size than the image.

use super::Real;

/// The position of an image's pixel in a map of another size that covers the same view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapPosition<R> {
    /// Pixel of the map at or before the position.
    pub low: [usize; 2],
    /// The next pixel.
    pub high: [usize; 2],
    /// Weight of `high`.
    pub share: [R; 2],
    /// Pixel of the map that contains the position.
    pub nearest: [usize; 2],
}

impl<R: Real> MapPosition<R> {
    /// The position of pixel `at` of an image of `size` pixels in a map of `map` pixels.
    pub fn of(at: [usize; 2], size: [usize; 2], map: [usize; 2]) -> Self {
        let axis = |k: usize| {
            let (unit, last) = (2 * size[k], map[k] - 1);
            let center = (2 * at[k] + 1) * map[k];
            let t = center.saturating_sub(size[k]).min(last * unit);
            let share = R::of((t % unit) as f64) / R::of(unit as f64);
            (t / unit, (t / unit + 1).min(last), share, center / unit)
        };
        let [x, y] = [axis(0), axis(1)];
        Self { low: [x.0, y.0], high: [x.1, y.1], share: [x.2, y.2], nearest: [x.3, y.3] }
    }

    /// The value at the position, interpolated linearly between the map's pixels.
    pub fn between(&self, value: impl Fn([usize; 2]) -> R) -> R {
        let mix = |a: R, b: R, share: R| a * (R::one() - share) + b * share;
        let row = |y: usize| mix(value([self.low[0], y]), value([self.high[0], y]), self.share[0]);
        mix(row(self.low[1]), row(self.high[1]), self.share[1])
    }
}

/// A mask of bytes, row after row.
#[derive(Clone, Copy, Debug)]
pub struct ByteMask<'a> {
    /// Values from 0 to 255.
    pub bytes: &'a [u8],
    /// Width and height.
    pub size: [usize; 2],
}

impl ByteMask<'_> {
    /// The mask from 0 to 1 at a pixel of an image of `size` pixels.
    pub fn at<R: Real>(&self, at: [usize; 2], size: [usize; 2]) -> R {
        let byte = |[x, y]: [usize; 2]| R::of(f64::from(self.bytes[y * self.size[0] + x]));
        MapPosition::of(at, size, self.size).between(byte) / R::of(255.0)
    }
}

#[cfg(test)]
mod tests {
    use super::{ByteMask, MapPosition};

    #[test]
    fn a_map_of_the_same_size_is_met_at_its_pixels() {
        for at in [[0, 0], [4, 2], [6, 4]] {
            let place = MapPosition::<f64>::of(at, [7, 5], [7, 5]);
            assert_eq!((place.low, place.share, place.nearest), (at, [0.0; 2], at));
        }
    }

    #[test]
    fn centres_lie_on_centres_whatever_the_sizes() {
        for (size, map) in [([12, 9], [5, 4]), ([5, 4], [12, 9]), ([8, 8], [4, 2]), ([3, 3], [1, 1])] {
            for x in 0..size[0] {
                let place = MapPosition::<f64>::of([x, 1], size, map);
                let wanted = ((x as f64 + 0.5) * map[0] as f64 / size[0] as f64 - 0.5).clamp(0.0, map[0] as f64 - 1.0);
                assert!((place.between(|[x, _]| x as f64) - wanted).abs() < 1e-12, "{x} of {size:?} in {map:?}");
                let center = (x as f64 + 0.5) * map[0] as f64 / size[0] as f64;
                assert_eq!(place.nearest[0], (center + 1e-9).floor() as usize);
            }
        }
        let mask = ByteMask { bytes: &[0, 255], size: [2, 1] };
        assert_eq!([0, 1, 2, 3].map(|x| mask.at::<f64>([x, 0], [4, 1])), [0.0, 0.25, 0.75, 1.0]);
    }
}
