//! Depths of a held-out photograph, without any model: true ones, or those of the reconstructed points.

use std::collections::HashMap;
use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use super::{projected, squared_distance};
use crate::dataset::{Dataset, Tracks};
use crate::eval::geometry::{DepthFile, GeometryError};
use crate::scene::Camera;

/// Points whose inverse depths are averaged.
const NEAREST: NonZero<usize> = NonZero::new(4).unwrap();
/// Photographs that share most points with one are its neighbours.
const NEIGHBOURS: usize = 8;
/// Cells along the longer side in which the best points are chosen.
const CELLS: f64 = 16.0;
/// Points are looked at up to this share of the sides beyond the picture.
const BEYOND: f64 = 0.25;
/// A point that is not observed is taken to be hidden this much farther away than the nearer points of its cell are.
const HIDDEN: f64 = 1.5;
/// The share of a cell's points that is nearer.
const NEARER: f64 = 0.1;
/// The share of the points at either end of their depths that says nothing of the range of depths, and how far that
/// range goes beyond the others.
const OUTSIDE: f64 = 0.01;
const BEYOND_POINTS: f64 = 2.0;
/// Pixels at which a point is as good as at the place itself.
const AT_ONCE: f64 = 0.5;

/// The depths of a photograph.
pub(super) struct Depths {
    size: [f64; 2],
    /// Width, height and values.
    known: Option<(u32, u32, Vec<f32>)>,
    points: Option<Points>,
}

/// Points in the picture: a plane through all, and how much the inverse depth of each is off that plane.
struct Points {
    tree: ImmutableKdTree<f64, 2>,
    plane: Plane,
    off: Vec<f64>,
    /// The range that inverse depths have.
    range: [f64; 2],
}

/// Inverse depth as an affine function of the place in the picture: that of a plane is one.
struct Plane([f64; 3]);

/// A point as the photograph would show it.
#[derive(Clone, Copy)]
struct Shown {
    at: [f64; 2],
    depth: f64,
    /// 0 where the photograph observes it, 1 where a neighbour does.
    rank: u8,
}

impl Depths {
    /// Of a view of a dataset. `map` has the true ones, where there is one.
    pub(super) fn of(dataset: &Dataset, at: usize, map: Option<DepthFile>) -> Result<Self, GeometryError> {
        let camera = dataset.views.get(at).map(|view| view.camera);
        let known = map.zip(camera).map(|(map, camera)| map.read(&camera)).transpose()?;
        let size = camera.map_or([1.0; 2], |c| [f64::from(c.width), f64::from(c.height)]);
        let points = camera.and_then(|camera| Points::new(&in_front(shown(dataset, at, &camera), size), size));
        Ok(Self { size, known, points })
    }

    /// The depth at a place of the picture; `None` where nothing says it.
    pub(super) fn at(&self, at: [f64; 2]) -> Option<f64> {
        let of_map = |(width, height, values): &(u32, u32, Vec<f32>)| {
            let cell = |k: usize, of: u32| ((at[k] / self.size[k] * f64::from(of)) as usize).min(of as usize - 1);
            let depth = f64::from(*values.get(cell(1, *height) * *width as usize + cell(0, *width))?);
            (depth > 0.0 && depth.is_finite()).then_some(depth)
        };
        self.known.as_ref().and_then(of_map).or_else(|| self.points.as_ref().map(|points| points.depth(at)))
    }
}

impl Points {
    fn new(shown: &[Shown], size: [f64; 2]) -> Option<Self> {
        if shown.is_empty() {
            return None;
        }
        let mut sorted: Vec<f64> = shown.iter().map(|point| 1.0 / point.depth).collect();
        sorted.sort_by(f64::total_cmp);
        let quantile = |share: f64| sorted[((sorted.len() - 1) as f64 * share).round() as usize];
        let range = [quantile(OUTSIDE) / BEYOND_POINTS, quantile(1.0 - OUTSIDE) * BEYOND_POINTS];
        let places: Vec<[f64; 2]> = shown.iter().map(|point| point.at).collect();
        let inverse: Vec<f64> = shown.iter().map(|point| (1.0 / point.depth).clamp(range[0], range[1])).collect();
        let plane = Plane::through(&places, &inverse, size);
        let off = places.iter().zip(&inverse).map(|(at, inverse)| inverse - plane.at(*at)).collect();
        Some(Self { tree: ImmutableKdTree::new_from_slice(&places), plane, off, range })
    }

    /// The plane's depth, moved by how much the nearest points are off the plane.
    fn depth(&self, at: [f64; 2]) -> f64 {
        let (mut off, mut weights) = (0.0, 0.0);
        for near in self.tree.nearest_n::<SquaredEuclidean>(&at, NEAREST) {
            let weight = 1.0 / near.distance.sqrt().max(AT_ONCE);
            off += weight * self.off.get(near.item as usize).copied().unwrap_or(0.0);
            weights += weight;
        }
        1.0 / (self.plane.at(at) + off / weights).clamp(self.range[0], self.range[1])
    }
}

impl Plane {
    /// With the least squares of what values are off; level where the places do not span a plane.
    fn through(places: &[[f64; 2]], values: &[f64], size: [f64; 2]) -> Self {
        let n = places.len() as f64;
        let mean = |of: &dyn Fn(usize) -> f64| (0..places.len()).map(of).sum::<f64>() / n;
        let [x, y, v] = [mean(&|k| places[k][0]), mean(&|k| places[k][1]), mean(&|k| values[k])];
        let moment = |a: &dyn Fn(usize) -> f64, b: &dyn Fn(usize) -> f64| mean(&|k| a(k) * b(k));
        let (dx, dy, dv) = (|k: usize| places[k][0] - x, |k: usize| places[k][1] - y, |k: usize| values[k] - v);
        let (xx, xy, yy) = (moment(&dx, &dx), moment(&dx, &dy), moment(&dy, &dy));
        let (xv, yv) = (moment(&dx, &dv), moment(&dy, &dv));
        let spanned = xx * yy - xy * xy;
        if spanned <= 1e-6 * (size[0] * size[1]).powi(2) {
            return Self([v, 0.0, 0.0]);
        }
        let (a, b) = ((yy * xv - xy * yv) / spanned, (xx * yv - xy * xv) / spanned);
        Self([v - a * x - b * y, a, b])
    }

    fn at(&self, [x, y]: [f64; 2]) -> f64 {
        self.0[0] + self.0[1] * x + self.0[2] * y
    }
}

/// The points that lie in the picture or little beyond.
fn shown(dataset: &Dataset, at: usize, camera: &Camera) -> Vec<Shown> {
    let (points, tracks) = match &dataset.useless {
        Some(useless) => (&useless.kept, &Tracks::default()),
        None => (&dataset.points, &dataset.tracks),
    };
    let near = neighbours(dataset, tracks, at, camera);
    let one = |(k, position): (usize, [f64; 3])| {
        let (place, depth) = projected(camera, position)?;
        let inside = |k: usize, side: u32| {
            let side = f64::from(side);
            (-BEYOND * side..(1.0 + BEYOND) * side).contains(&place[k])
        };
        let observed = |by: &dyn Fn(usize) -> bool| tracks.of(k).iter().any(|view| by(*view as usize));
        let rank = match () {
            () if observed(&|view| view == at) => 0,
            () if observed(&|view| near.contains(&view)) => 1,
            () => 2,
        };
        let whole = depth.is_finite() && inside(0, camera.width) && inside(1, camera.height);
        whole.then_some(Shown { at: place, depth, rank })
    };
    points.iter().map(|point| point.position).enumerate().filter_map(one).collect()
}

/// The views that share most points with one; the nearest where it shares none.
fn neighbours(dataset: &Dataset, tracks: &Tracks, at: usize, camera: &Camera) -> Vec<usize> {
    let mut shared: HashMap<usize, usize> = HashMap::new();
    let observed = (0..dataset.points.len()).map(|point| tracks.of(point));
    for views in observed.filter(|views| views.contains(&(at as u32))) {
        views.iter().for_each(|view| *shared.entry(*view as usize).or_default() += 1);
    }
    shared.remove(&at);
    let mut order: Vec<(f64, usize)> = match shared.is_empty() {
        false => shared.into_iter().map(|(view, points)| (-(points as f64), view)).collect(),
        true => {
            let center = camera.center();
            let away = |other: &Camera| squared_distance(other.center(), center);
            let others = dataset.views.iter().enumerate().filter(|(view, _)| *view != at);
            others.map(|(view, other)| (away(&other.camera), view)).collect()
        }
    };
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    order.into_iter().take(NEIGHBOURS).map(|(_, view)| view).collect()
}

/// Without those that something hides: of each cell those that the photograph observes, else those that its neighbours
/// do, else all; and of the others than its own none that is far behind the nearer ones.
fn in_front(shown: Vec<Shown>, size: [f64; 2]) -> Vec<Shown> {
    let side = size[0].max(size[1]) / CELLS;
    let mut cells: HashMap<[i64; 2], Vec<Shown>> = HashMap::new();
    let mut order = Vec::new();
    for point in shown {
        let cell = point.at.map(|at| (at / side).floor() as i64);
        let of_cell = cells.entry(cell).or_default();
        if of_cell.is_empty() {
            order.push(cell);
        }
        of_cell.push(point);
    }
    let mut kept = Vec::new();
    for cell in order {
        let Some(points) = cells.remove(&cell) else { continue };
        let Some(best) = points.iter().map(|point| point.rank).min() else { continue };
        let of_best: Vec<Shown> = points.into_iter().filter(|point| point.rank == best).collect();
        let mut depths: Vec<f64> = of_best.iter().map(|point| point.depth).collect();
        depths.sort_by(f64::total_cmp);
        let nearer = depths[((depths.len() - 1) as f64 * NEARER).round() as usize];
        kept.extend(of_best.into_iter().filter(|point| best == 0 || point.depth <= HIDDEN * nearer));
    }
    kept
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::eval::seen) const SIZE: [f64; 2] = [100.0, 80.0];

    /// A camera at `center`, tilted by an angle from looking straight down on the ground, which is z = 0.
    pub(in crate::eval::seen) fn tilted(degrees: f64, center: [f64; 3]) -> Camera {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        let rotation = [[1.0, 0.0, 0.0], [0.0, -cosine, -sine], [0.0, sine, -cosine]];
        let turned = |i: usize| -(0..3).map(|k| rotation[i][k] * center[k]).sum::<f64>();
        let translation = [turned(0), turned(1), turned(2)];
        let (width, height) = (SIZE[0] as u32, SIZE[1] as u32);
        Camera { rotation, translation, fx: 100.0, fy: 100.0, cx: 50.0, cy: 40.0, width, height }
    }

    /// Points of the ground as a camera shows them.
    pub(in crate::eval::seen) fn of_ground(camera: &Camera) -> Depths {
        let places =
            (0..9).flat_map(|i| (0..9).map(move |j| [2.3 * f64::from(i) - 9.0, 2.1 * f64::from(j) - 9.0, 0.0]));
        let shown = |point| projected(camera, point).map(|(at, depth)| Shown { at, depth, rank: 0 });
        let inside = |at: [f64; 2]| (0..2).all(|k| (0.0..SIZE[k]).contains(&at[k]));
        let shown: Vec<Shown> = places.filter_map(shown).filter(|shown| inside(shown.at)).collect();
        Depths { size: SIZE, known: None, points: Points::new(&shown, SIZE) }
    }

    /// Of a tilted plane too, between its points and little beyond them.
    #[test]
    fn depths_of_a_plane_are_exact_between_few_points() {
        for degrees in [0.0, 20.0, 35.0] {
            let camera = tilted(degrees, [0.5, -3.0, 10.0]);
            let depths = of_ground(&camera);
            for at in [[50.0, 40.0], [20.5, 31.0], [71.0, 55.5], [33.0, 12.0], [99.5, 79.5]] {
                let axis = camera.rotation.map(|row| row[2]);
                let ray = [(at[0] - camera.cx) / camera.fx, (at[1] - camera.cy) / camera.fy, 1.0];
                let down: f64 = (0..3).map(|k| axis[k] * ray[k]).sum();
                let (truth, found) = (-10.0 / down, depths.at(at).expect("a depth"));
                assert!((found / truth - 1.0).abs() < 1e-9, "{degrees} at {at:?}: {found} for {truth}");
            }
        }
    }

    /// Two surfaces: what the photograph observes is taken, and of the rest what is in front.
    #[test]
    fn points_behind_a_surface_are_left_out() {
        let shown = |x: f64, depth: f64, rank: u8| Shown { at: [x, 10.0], depth, rank };
        let depths = |points: Vec<Shown>| in_front(points, SIZE).iter().map(|p| p.depth).collect::<Vec<f64>>();
        assert_eq!(depths(vec![shown(1.0, 9.0, 2), shown(2.0, 30.0, 0), shown(3.0, 5.0, 1)]), [30.0], "observed");
        assert_eq!(depths(vec![shown(1.0, 9.0, 2), shown(2.0, 30.0, 1)]), [30.0], "by a neighbour");
        assert_eq!(depths(vec![shown(1.0, 9.0, 2), shown(2.0, 30.0, 2), shown(3.0, 10.0, 2)]), [9.0, 10.0], "hidden");
        assert_eq!(depths(vec![shown(1.0, 9.0, 0), shown(90.0, 30.0, 2)]), [9.0, 30.0], "elsewhere");
    }

    #[test]
    fn true_depths_come_before_those_of_points() {
        let mut depths = of_ground(&tilted(0.0, [0.0, 0.0, 10.0]));
        depths.known = Some((2, 1, vec![7.0, f32::NAN]));
        assert_eq!(depths.at([49.0, 79.0]), Some(7.0));
        let right = depths.at([51.0, 1.0]).expect("that of points");
        assert!((right - 10.0).abs() < 1e-9, "{right}");
        depths.points = None;
        assert_eq!((depths.at([0.0, 0.0]), depths.at([51.0, 1.0])), (Some(7.0), None));
        assert!(Points::new(&[], SIZE).is_none());
    }
}
