//! The surface of a scene before any training: the pieces that points stand for, who sees them, and how many splats
//! they need.

use std::f64::consts::PI;
use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use super::Ground;
use super::frequency::{Frequency, Place};
use crate::dataset::{Dataset, Role, View};
use crate::scene::Camera;

/// Points that are looked at in any case ...
const POINTS: usize = 1 << 18;
/// ... and for each photograph.
const POINTS_OF_VIEW: usize = 64;
/// Points that are looked for in each photograph where the dataset does not say which photographs see a point.
const PROJECTED: usize = 1 << 14;
/// Neighbours by whose distance a point's surface is judged.
const NEIGHBOURS: usize = 6;
/// Most pixels of a photograph that a point stands for, as a share of all of them.
const LARGEST: f64 = 1.0 / 256.0;

/// A piece of surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Piece {
    /// Dataset coordinates.
    pub(super) position: [f64; 3],
    /// Place on the ground.
    pub(super) place: [f64; 2],
    /// Half the width of the piece in dataset units.
    pub(super) radius: f64,
    /// Splats that show the piece as finely as the photographs do.
    pub(super) splats: f64,
}

/// A photograph that sees a piece.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sight {
    /// Position of the view in [`Dataset::views`].
    pub(super) view: u32,
    /// Pixels of the photograph that the piece takes.
    pub(super) pixels: f32,
}

/// The pieces of a scene's surface, with the photographs to train on that see each of them.
pub(super) struct Surface {
    pub(super) pieces: Vec<Piece>,
    /// End of each piece's sights.
    ends: Vec<usize>,
    sights: Vec<Sight>,
}

impl Surface {
    /// From the points of a dataset. Each point stands for the surface as far as its neighbours, and its splats are
    /// those that the finest photograph asks for: the pixels of the piece there, times the splats that a pixel takes.
    pub(super) fn of(dataset: &Dataset, ground: &Ground, frequency: &Frequency<'_>) -> Result<Self, super::Error> {
        let points = Points::of(dataset, frequency.seed());
        let areas = areas(&points.positions);
        let (mut ends, mut sights, mut finest) = (Vec::new(), Vec::new(), Vec::new());
        let seen: Vec<Vec<Sight>> =
            (0..points.positions.len()).into_par_iter().map(|at| points.sights(at, areas[at], dataset)).collect();
        for (at, seen) in seen.into_iter().enumerate() {
            let best = seen.iter().copied().reduce(|a, b| if b.pixels > a.pixels { b } else { a });
            let placed = best.and_then(|sight| {
                let view = dataset.views.get(sight.view as usize)?;
                let [u, v, _] = view.camera.placed(points.positions[at])?;
                Some(Place { view: sight.view, at: [u, v], pixels: f64::from(sight.pixels) })
            });
            finest.push(placed);
            sights.extend(seen);
            ends.push(sights.len());
        }
        let splats = frequency.splats(dataset, &finest)?;
        let piece = |((position, area), splats): ((&[f64; 3], f64), f64)| Piece {
            position: *position,
            place: ground.place(*position),
            radius: (area / PI).sqrt(),
            splats,
        };
        let pieces = points.positions.iter().zip(areas).zip(splats).map(piece).collect();
        Ok(Self { pieces, ends, sights })
    }

    /// The photographs that see a piece.
    pub(super) fn sights(&self, piece: usize) -> &[Sight] {
        let start = piece.checked_sub(1).and_then(|before| self.ends.get(before)).copied().unwrap_or(0);
        self.ends.get(piece).and_then(|end| self.sights.get(start..*end)).unwrap_or(&[])
    }
}

/// Points of a dataset, thinned out evenly where there are many.
struct Points {
    positions: Vec<[f64; 3]>,
    /// Position in the dataset's points of each, if tracks say who sees it.
    tracked: Option<Vec<usize>>,
}

impl Points {
    fn of(dataset: &Dataset, seed: u64) -> Self {
        if !dataset.begins_at_random() && !dataset.tracks.is_empty() {
            let step = dataset.points.len().div_ceil(POINTS.max(POINTS_OF_VIEW * dataset.views.len())).max(1);
            let tracked: Vec<usize> = (0..dataset.points.len()).step_by(step).collect();
            let positions = tracked.iter().map(|at| dataset.points[*at].position).collect();
            return Self { positions, tracked: Some(tracked) };
        }
        let mut positions: Vec<[f64; 3]> = dataset.usable_points().iter().map(|point| point.position).collect();
        if dataset.begins_at_random() {
            positions.extend(dataset.random_points(seed).into_iter().map(|(position, _)| position));
        }
        let step = positions.len().div_ceil(PROJECTED).max(1);
        Self { positions: positions.into_iter().step_by(step).collect(), tracked: None }
    }

    /// The photographs to train on that see a point which stands for an `area` of surface.
    fn sights(&self, at: usize, area: f64, dataset: &Dataset) -> Vec<Sight> {
        let position = self.positions[at];
        let sight = |(view, of): (u32, &View)| {
            let pixels = pixels(&of.camera, position, area)?;
            (of.role == Role::Train).then_some(Sight { view, pixels: pixels as f32 })
        };
        match self.tracked.as_ref().and_then(|tracked| tracked.get(at)) {
            Some(point) => {
                let views = dataset.tracks.of(*point).iter();
                views.filter_map(|view| sight((*view, dataset.views.get(*view as usize)?))).collect()
            }
            None => (0..).zip(&dataset.views).filter_map(sight).collect(),
        }
    }
}

/// Pixels that an area of surface takes in a photograph, seen at right angles. `None` where the photograph does not see
/// the place.
fn pixels(camera: &Camera, position: [f64; 3], area: f64) -> Option<f64> {
    let [_, _, depth] = camera.placed(position)?;
    let all = f64::from(camera.width) * f64::from(camera.height);
    let pixels = area * camera.fx * camera.fy / (depth * depth);
    pixels.is_finite().then(|| pixels.min(LARGEST * all))
}

/// The surface that each point stands for, by the distance to a neighbour: on a surface, a circle with the k-th
/// neighbour on its edge has k times as large an area as each point.
fn areas(positions: &[[f64; 3]]) -> Vec<f64> {
    if positions.len() < 2 {
        return vec![0.0; positions.len()];
    }
    let tree = ImmutableKdTree::<f64, 3>::new_from_slice(positions);
    let wanted = NonZero::new(NEIGHBOURS + 1).unwrap_or(NonZero::<usize>::MIN);
    let one = |position: &[f64; 3]| {
        let found = tree.nearest_n::<SquaredEuclidean>(position, wanted);
        let (count, farthest) = (found.len().saturating_sub(1).max(1), found.last().map_or(0.0, |last| last.distance));
        PI * farthest / count as f64
    };
    positions.par_iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points at random, not in a grid: the mean over them is what counts.
    #[test]
    fn areas_of_points_add_up_to_the_surface() {
        let mut random = crate::scene::random::Random::new(4);
        let dense: Vec<[f64; 3]> = (0..4000).map(|_| [random.unit(), random.unit(), 0.0]).collect();
        let sum: f64 = areas(&dense).iter().sum();
        assert!((0.9..1.2).contains(&sum), "{sum}");
        // A tenth of the points stands for ten times the area each.
        let thin: Vec<[f64; 3]> = dense.iter().step_by(10).copied().collect();
        let sum: f64 = areas(&thin).iter().sum();
        assert!((0.9..1.35).contains(&sum), "{sum}");
        assert_eq!(areas(&[[1.0; 3]]), [0.0]);
        assert!(areas(&[[1.0; 3]; 40]).iter().all(|area| *area == 0.0));
    }
}
