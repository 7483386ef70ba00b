//! What a dataset shows: the area, the heights, and the ground sample distance of its photographs.

use super::grid::two_digits;
use super::quantile::quantile;
use super::{Bounds, Placement};
use crate::dataset::Dataset;
use crate::scene::Gaussians;

/// Fewer points say nothing of an area.
const ENOUGH: usize = 50;
/// The share of points at either end of easting and northing that may be strays.
const STRAYS: f64 = 0.005;
/// The same of heights.
const HIGH: f64 = 0.001;
/// What is this much higher or lower, as a share of the range of heights, does not belong to the scene.
const BEYOND: f64 = 0.5;
/// Most points and photographs that a ground sample distance is taken from.
const SAMPLE: usize = 400;

/// The area and the heights of what is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    /// Easting and northing.
    pub bounds: Bounds,
    /// Height below which nothing is a surface.
    pub bottom: f64,
    /// Height above which splats are taken to float, and are left out.
    pub top: f64,
}

/// Points of the dataset, or the middles of opaque splats where there are too few.
fn places(dataset: &Dataset, model: &Gaussians) -> Vec<[f64; 3]> {
    let points = dataset.usable_points();
    if points.len() >= ENOUGH {
        return points.iter().map(|point| point.position).collect();
    }
    let opaque = |row: &usize| model.opacities[*row] > 0.0;
    let centre = |row: usize| {
        let scene = std::array::from_fn(|k| f64::from(model.means[3 * row + k]));
        dataset.frame.to_dataset(scene)
    };
    (0..model.len()).filter(opaque).map(centre).collect()
}

impl Area {
    /// The area over which points lie, less strays; `model` is in scene coordinates. `None` where nothing says it.
    pub fn of(dataset: &Dataset, model: &Gaussians, placement: &Placement) -> Option<Self> {
        let places: Vec<[f64; 3]> = places(dataset, model).into_iter().map(|p| placement.to_map(p)).collect();
        Self::of_places(&places)
    }

    fn of_places(places: &[[f64; 3]]) -> Option<Self> {
        let axis = |k: usize| -> Vec<f64> { places.iter().map(|p| p[k]).filter(|v| v.is_finite()).collect() };
        let [mut east, mut north, mut height] = [axis(0), axis(1), axis(2)];
        let bounds = Bounds {
            west: quantile(&mut east, STRAYS)?,
            south: quantile(&mut north, STRAYS)?,
            east: quantile(&mut east, 1.0 - STRAYS)?,
            north: quantile(&mut north, 1.0 - STRAYS)?,
        };
        let (low, high) = (quantile(&mut height, HIGH)?, quantile(&mut height, 1.0 - HIGH)?);
        // A plane has no range of heights of its own.
        let across = (bounds.east - bounds.west).max(bounds.north - bounds.south);
        let margin = (BEYOND * (high - low)).max(0.02 * across);
        Some(Self { bounds, bottom: low - margin, top: high + margin })
    }
}

/// The median ground sample distance of the photographs in metres of the map, rounded up to two digits.
pub fn ground_sample_distance(dataset: &Dataset, model: &Gaussians, placement: &Placement) -> Option<f64> {
    let places = places(dataset, model);
    let few = |count: usize| count.div_ceil(SAMPLE).max(1);
    let sample: Vec<[f64; 3]> = places.iter().copied().step_by(few(places.len())).collect();
    let of_view = |camera: &crate::scene::Camera| {
        let mut depths: Vec<f64> = sample.iter().filter_map(|point| camera.placed(*point)).map(|[_, _, z]| z).collect();
        quantile(&mut depths, 0.5).map(|depth| depth / (camera.fx * camera.fy).sqrt())
    };
    let views = dataset.views.iter().step_by(few(dataset.views.len()));
    let mut distances: Vec<f64> = views.filter_map(|view| of_view(&view.camera)).collect();
    let scale = placement.similarity_at(*sample.first()?).scale;
    quantile(&mut distances, 0.5).map(|distance| two_digits(distance * scale))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strays_do_not_widen_the_area() {
        let mut places: Vec<[f64; 3]> =
            (0..4000).map(|k| [f64::from(k % 80), f64::from(k / 80), f64::from(k % 7)]).collect();
        places.extend([[1e6, -1e6, 500.0], [-1e6, 1e6, -500.0], [f64::NAN, 0.0, 0.0]]);
        let area = Area::of_places(&places).unwrap();
        let Bounds { west, south, east, north } = area.bounds;
        assert!(west >= 0.0 && east <= 79.0 && south >= 0.0 && north <= 50.0, "{:?}", area.bounds);
        assert!(east - west > 77.0 && north - south > 47.0, "{:?}", area.bounds);
        assert_eq!((area.bottom, area.top), (-3.0, 9.0));
        assert_eq!(Area::of_places(&[]), None);
    }
}
