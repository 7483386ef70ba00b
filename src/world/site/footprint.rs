//! Rotated rectangles on the ground.

use glam::DVec2;

/// A rotated rectangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Footprint {
    pub(crate) centre: DVec2,
    /// Turn in radians, counter-clockwise.
    pub(crate) yaw: f64,
    /// Half sides.
    pub(crate) half: DVec2,
}

impl Footprint {
    pub(crate) fn to_local(self, p: DVec2) -> DVec2 {
        DVec2::from_angle(-self.yaw).rotate(p - self.centre)
    }

    pub(crate) fn to_world(self, q: DVec2) -> DVec2 {
        DVec2::from_angle(self.yaw).rotate(q) + self.centre
    }

    /// Distance from the rectangle; negative inside.
    pub(crate) fn distance(self, p: DVec2) -> f64 {
        let d = self.to_local(p).abs() - self.half;
        d.max(DVec2::ZERO).length() + d.max_element().min(0.0)
    }

    /// Radius of the circle around the rectangle.
    pub(crate) fn reach(self) -> f64 {
        self.half.length()
    }

    /// Corners and midpoints of the sides.
    pub(crate) fn outline(self) -> [DVec2; 8] {
        [(1., 1.), (-1., 1.), (-1., -1.), (1., -1.), (1., 0.), (-1., 0.), (0., 1.), (0., -1.)]
            .map(|(x, y)| self.to_world(self.half * DVec2::new(x, y)))
    }

    /// Points along the border, at most `step` apart.
    pub(crate) fn border(self, step: f64) -> impl Iterator<Item = DVec2> {
        let side = move |from: DVec2, to: DVec2| {
            let count = (from.distance(to) / step).ceil().max(1.0) as u32;
            (0..count).map(move |k| from.lerp(to, f64::from(k) / f64::from(count)))
        };
        let corner = move |x: f64, y: f64| self.to_world(self.half * DVec2::new(x, y));
        let round = [(1., 1.), (-1., 1.), (-1., -1.), (1., -1.), (1., 1.)].map(|(x, y)| corner(x, y));
        (0..4).flat_map(move |k| side(round[k], round[k + 1]))
    }

    /// Whether two rectangles are closer than `gap` (separating axis test; the gap is measured along the axes).
    pub(crate) fn overlaps(self, other: Self, gap: f64) -> bool {
        let delta = other.centre - self.centre;
        [self.yaw, self.yaw + std::f64::consts::FRAC_PI_2, other.yaw, other.yaw + std::f64::consts::FRAC_PI_2]
            .into_iter()
            .all(|angle| {
                let axis = DVec2::from_angle(angle);
                let extent = |f: Self| {
                    let q = DVec2::from_angle(-f.yaw).rotate(axis).abs();
                    q.dot(f.half)
                };
                delta.dot(axis).abs() < extent(self) + extent(other) + gap
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_and_overlap() {
        let f = Footprint { centre: DVec2::new(2.0, 1.0), yaw: 0.5, half: DVec2::new(3.0, 1.0) };
        assert!((f.distance(f.to_world(DVec2::new(5.0, 0.5))) - 2.0).abs() < 1e-12);
        assert!((f.distance(f.to_world(DVec2::new(6.0, 5.0))) - 5.0).abs() < 1e-12);
        assert!((f.distance(f.centre) + 1.0).abs() < 1e-12);
        let beside = Footprint { centre: f.to_world(DVec2::new(0.0, 3.0)), yaw: 0.5, half: DVec2::new(1.0, 1.0) };
        assert!(!f.overlaps(beside, 0.9) && f.overlaps(beside, 1.1));
    }
}
