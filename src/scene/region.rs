//! Rectangles on the ground.

use super::Frame;

/// A rectangle on the ground with everything above and below it. Lower edges belong to the rectangle and upper edges do
/// not, so that of rectangles side by side exactly one has a place. An infinite edge is no edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// A point on the ground, where both ground coordinates are 0.
    pub origin: [f64; 3],
    /// Unit directions of the two ground coordinates, at right angles.
    pub axes: [[f64; 3]; 2],
    /// Lower edges.
    pub low: [f64; 2],
    /// Upper edges.
    pub high: [f64; 2],
}

impl Region {
    /// Ground coordinates of a point.
    pub fn coordinates(&self, point: [f64; 3]) -> [f64; 2] {
        let away: [f64; 3] = std::array::from_fn(|k| point[k] - self.origin[k]);
        self.axes.map(|axis| axis[0] * away[0] + axis[1] * away[1] + axis[2] * away[2])
    }

    /// Whether a point lies in the rectangle, above or below it.
    pub fn contains(&self, point: [f64; 3]) -> bool {
        let at = self.coordinates(point);
        (0..2).all(|k| self.low[k] <= at[k] && at[k] < self.high[k])
    }

    /// Distance on the ground from a point to the nearest edge, inside or outside of the rectangle.
    pub fn to_edge(&self, point: [f64; 3]) -> f64 {
        let at = self.coordinates(point);
        let beyond: [f64; 2] = std::array::from_fn(|k| (self.low[k] - at[k]).max(at[k] - self.high[k]));
        match beyond[0].max(beyond[1]) {
            inside if inside <= 0.0 => -inside,
            _ => beyond[0].max(0.0).hypot(beyond[1].max(0.0)),
        }
    }

    /// The rectangle with a margin on all sides.
    pub fn grown(&self, margin: f64) -> Self {
        Self { low: self.low.map(|v| v - margin), high: self.high.map(|v| v + margin), ..*self }
    }

    /// The same rectangle of a dataset in scene coordinates.
    pub fn in_scene(&self, frame: &Frame) -> Self {
        let scaled = |edges: [f64; 2]| edges.map(|edge| edge * frame.scale);
        Self { origin: frame.to_scene(self.origin), axes: self.axes, low: scaled(self.low), high: scaled(self.high) }
    }

    /// Of rows of three floats, those inside and those outside, in ascending order.
    pub fn divided(&self, means: &[f32]) -> [Vec<u32>; 2] {
        let inside = |row: u32| {
            let at = 3 * row as usize;
            means.get(at..at + 3).is_some_and(|m| self.contains([m[0], m[1], m[2]].map(f64::from)))
        };
        let (inside, outside) = (0..(means.len() / 3) as u32).partition(|row| inside(*row));
        [inside, outside]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TURNED: Region = Region {
        origin: [10.0, 20.0, 5.0],
        axes: [[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0]],
        low: [-1.0, f64::NEG_INFINITY],
        high: [2.0, 3.0],
    };

    fn at(region: &Region, [x, y]: [f64; 2], up: f64) -> [f64; 3] {
        let [east, north] = region.axes;
        std::array::from_fn(|k| region.origin[k] + x * east[k] + y * north[k] + if k == 2 { up } else { 0.0 })
    }

    #[test]
    fn lower_edges_belong_to_a_region_and_upper_ones_not() {
        let region = Region { origin: [0.0; 3], axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], ..TURNED };
        for (place, inside) in
            [([-1.0, 0.0], true), ([2.0, 0.0], false), ([1.9, 3.0], false), ([0.0, -1e300], true), ([-1.1, 0.0], false)]
        {
            assert_eq!(region.contains([place[0], place[1], 77.0]), inside, "{place:?}");
        }
        assert!(!region.contains([f64::NAN, 0.0, 0.0]));
        assert!(region.grown(0.5).contains([-1.4, 3.4, 0.0]) && !region.grown(0.5).contains([2.5, 0.0, 0.0]));
    }

    #[test]
    fn a_region_is_the_same_in_the_scene() {
        let frame = Frame { offset: [3.0, -40.0, 1.0], scale: 0.25 };
        let scene = TURNED.in_scene(&frame);
        for place in [[0.0, 0.0], [1.99, 2.99], [2.01, 0.0], [0.0, 3.01], [-0.99, -500.0], [-1.01, 0.0]] {
            let point = at(&TURNED, place, 9.0);
            assert_eq!(TURNED.contains(point), scene.contains(frame.to_scene(point)), "{place:?}");
        }
    }

    #[test]
    fn distances_are_to_the_nearest_edge() {
        for (place, distance) in [([0.0, 0.0], 1.0), ([1.5, 2.9], 0.1), ([3.0, 0.0], 1.0), ([5.0, 7.0], 5.0)] {
            assert!((TURNED.to_edge(at(&TURNED, place, 1.0)) - distance).abs() < 1e-9, "{place:?}");
        }
        let endless = Region { low: [f64::NEG_INFINITY; 2], high: [f64::INFINITY; 2], ..TURNED };
        assert_eq!(endless.to_edge([1.0, 2.0, 3.0]), f64::INFINITY);
    }
}
