//! A part of a scene that is trained by itself, with the rest of the scene as a coarse background.

use std::collections::BTreeMap;

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use super::input::View;
use crate::scene::{Camera, ExposureMatrix, Frame, Gaussians, Region};

/// A part of a scene, in scene coordinates.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Part {
    /// The cell whose splats are wanted; `None` is everything.
    pub cell: Option<Region>,
    /// How far outside of the cell splats begin and grow as they do inside.
    pub margin: f64,
    /// Splats of a coarse model outside of cell and margin, which are trained too but do not grow.
    pub background: Gaussians,
    /// Splats of the coarse model inside. The training begins with those where it has nothing finer.
    pub filling: Gaussians,
    /// Steps that a training of the whole scene takes with as many looks at each photograph; `None` where that is not
    /// known.
    pub whole_steps: Option<u32>,
    /// Exposures of photographs by name. They stay as they are; photographs without one have the identity. `None`
    /// leaves exposures to the settings.
    pub exposures: Option<BTreeMap<String, ExposureMatrix>>,
}

impl Part {
    /// The part of a cell, with the splats of a coarse model of the whole scene that some photograph may show.
    pub fn new(cell: Region, margin: f64, coarse: &Gaussians, cameras: &[Camera]) -> Self {
        let region = cell.grown(margin);
        let shown = |row: &u32| {
            let (place, width) = ball(coarse, *row);
            cameras.iter().any(|camera| may_show(camera, place, REACH * width))
        };
        let [filling, background] =
            region.divided(&coarse.means).map(|rows| coarse.rows(&rows.into_iter().filter(shown).collect::<Vec<_>>()));
        Self { cell: Some(cell), margin, background, filling, ..Self::default() }
    }

    /// Where splats begin and grow; `None` is everywhere.
    pub fn region(&self) -> Option<Region> {
        self.cell.map(|cell| cell.grown(self.margin))
    }

    /// The largest standard deviation that a splat may have at a place. A splat must not reach far across the edges of
    /// the cell: other parts have it, and do not have this one's.
    pub(super) fn widest(&self, place: [f64; 3]) -> f64 {
        let across = (ACROSS * self.margin).max(LEAST_ACROSS);
        self.cell.map_or(f64::INFINITY, |cell| (cell.to_edge(place) + across) / REACH)
    }

    /// The splats inside of the region, followed by coarse ones where there are none, and by the background, with new
    /// identities.
    pub(super) fn with_background(&self, first: &Gaussians) -> Gaussians {
        let mut all = self.inside(first);
        let missing = missing(&all, &self.filling);
        for more in [&self.filling.rows(&missing), &self.background] {
            all.append(more);
        }
        all.ids = (0..all.len() as u32).collect();
        all
    }

    /// The splats inside of the region.
    pub(super) fn inside(&self, first: &Gaussians) -> Gaussians {
        match self.region() {
            Some(region) => first.rows(&region.divided(&first.means)[0]),
            None => first.clone(),
        }
    }

    /// Whether a place in the scene is inside of the region.
    pub(super) fn has(&self, place: [f64; 3]) -> bool {
        self.region().is_none_or(|region| region.contains(place))
    }

    /// The exposures of views, in their order, if they are given.
    pub(super) fn exposures_of(&self, views: &[View]) -> Option<Vec<ExposureMatrix>> {
        let known = self.exposures.as_ref()?;
        Some(views.iter().map(|view| known.get(&view.name).copied().unwrap_or(IDENTITY)).collect())
    }
}

const IDENTITY: ExposureMatrix = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// Rows of `coarse` with none of `fine` closer than their largest standard deviation.
fn missing(fine: &Gaussians, coarse: &Gaussians) -> Vec<u32> {
    let rows = 0..coarse.len() as u32;
    let places: Vec<[f64; 3]> = fine.means.chunks_exact(3).map(|m| [m[0], m[1], m[2]].map(f64::from)).collect();
    if places.is_empty() {
        return rows.collect();
    }
    let tree = ImmutableKdTree::<f64, 3>::new_from_slice(&places);
    let lonely = |row: &u32| {
        let (place, width) = ball(coarse, *row);
        tree.nearest_one::<SquaredEuclidean>(&place).distance > width * width
    };
    rows.filter(lonely).collect()
}

/// The centre of a splat and its largest standard deviation.
fn ball(of: &Gaussians, row: u32) -> ([f64; 3], f64) {
    let at = 3 * row as usize;
    let log = of.scales[at..at + 3].iter().fold(f32::NEG_INFINITY, |most, scale| most.max(*scale));
    (std::array::from_fn(|k| f64::from(of.means[at + k])), f64::from(log).exp())
}

/// Share of the margin by which splats may reach across the edges of the cell, and the least distance, in scene units.
const ACROSS: f64 = 0.5;
const LEAST_ACROSS: f64 = 1e-3 * Frame::EXTENT;

/// Standard deviations to which a splat is seen.
const REACH: f64 = 3.0;

/// Whether a ball is, at least in part, before a camera and inside of its picture.
fn may_show(camera: &Camera, centre: [f64; 3], radius: f64) -> bool {
    let [x, y, z]: [f64; 3] = std::array::from_fn(|row| {
        camera.translation[row] + (0..3).map(|k| camera.rotation[row][k] * centre[k]).sum::<f64>()
    });
    if z <= 0.0 {
        return z > -radius;
    }
    let inside = |at: f64, focal: f64, middle: f64, size: u32| {
        let reach = focal * radius / z;
        (-reach..f64::from(size) + reach).contains(&(focal * at / z + middle))
    };
    inside(x, camera.fx, camera.cx, camera.width) && inside(y, camera.fy, camera.cy, camera.height)
}

#[cfg(test)]
mod tests {
    use super::*;

    const REGION: Region =
        Region { origin: [0.0; 3], axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], low: [-1.0, -1.0], high: [1.0, 1.0] };

    /// A camera 20 pixels wide at the origin that looks along z and sees from -1 to 1 at a depth of 1.
    fn camera() -> Camera {
        Camera {
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.0; 3],
            fx: 10.0,
            fy: 10.0,
            cx: 10.0,
            cy: 10.0,
            width: 20,
            height: 20,
        }
    }

    fn splats(places: &[[f32; 3]], size: f32) -> Gaussians {
        let mut out = Gaussians::zeros(places.len());
        out.means = places.concat();
        out.scales.fill(size.ln());
        out
    }

    #[test]
    fn a_background_is_outside_and_before_a_camera() {
        let places = [[0.0, 0.0, 5.0], [2.0, 0.0, 5.0], [7.0, 0.0, 5.0], [2.0, 0.0, -5.0], [0.0, -3.0, 5.0]];
        let part = |size| Part::new(REGION, 0.0, &splats(&places, size), &[camera()]);
        let found = |size| part(size).background.means;
        assert_eq!(found(0.01), [places[1], places[4]].concat());
        assert_eq!(part(0.01).filling.means, places[0]);
        assert_eq!(found(1.0), [places[1], places[2], places[4]].concat(), "the rim of a wide splat is in the picture");
    }

    #[test]
    fn a_part_begins_inside_with_the_background_behind() {
        let background = splats(&[[3.0, 0.0, 5.0]], 1.0);
        let filling = splats(&[[0.5, 0.4, 1.0], [-0.5, 0.0, 1.0]], 0.2);
        let part = Part { cell: Some(REGION), background, filling, ..Part::default() };
        let begun = part.with_background(&splats(&[[9.0, 9.0, 1.0], [0.5, 0.5, 1.0], [1.0, 0.0, 1.0]], 0.1));
        assert_eq!(begun.means, [0.5, 0.5, 1.0, -0.5, 0.0, 1.0, 3.0, 0.0, 5.0]);
        assert_eq!((begun.ids.as_slice(), begun.len()), ([0, 1, 2].as_slice(), 3));
        assert!(part.has([0.0; 3]) && !part.has([1.0, 0.0, 0.0]) && Part::default().has([1e9; 3]));
    }

    #[test]
    fn a_splat_may_be_wide_only_far_from_the_edges() {
        let part = Part { cell: Some(REGION), margin: 0.4, ..Part::default() };
        for (place, reach) in
            [([0.0, 0.0, 9.0], 1.2), ([0.9, 0.0, 0.0], 0.3), ([1.5, 0.0, 0.0], 0.7), ([4.0, 5.0, 0.0], 5.2)]
        {
            assert!((REACH * part.widest(place) - reach).abs() < 1e-9, "{place:?}");
        }
        assert_eq!(Part::default().widest([0.0; 3]), f64::INFINITY);
    }
}
