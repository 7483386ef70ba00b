//! Colours for points without colours, taken from the photographs that see the points.

use std::sync::Arc;

use rayon::prelude::*;

use super::spread;
use crate::dataset::{Colourless, Dataset, Pixels, Role};
use crate::scene::{Camera, Gaussians, init};
use crate::train::Error;
use crate::train::input::{Coloured, Input};

/// Most photographs that a point takes its colour from. The nearest ones see the point best and are least likely
/// occluded.
const MOST: usize = 7;
/// Colour of the points if no photograph sees any.
const GREY: [u8; 3] = [128; 3];

/// Points of the first model without colours of their own.
#[derive(Clone, Debug, PartialEq)]
pub struct Uncoloured {
    /// File of the points, and why they have no colours.
    pub colourless: Colourless,
    /// Positions of all points in dataset coordinates; the first splats may stand for only some of them.
    positions: Vec<[f64; 3]>,
    /// Whether the points are those of the dataset, which may have tracks.
    of_dataset: bool,
}

/// Depth and colour of a point in a photograph.
#[derive(Clone, Copy)]
struct ColourSample {
    depth: f32,
    colour: [u8; 3],
}

impl Uncoloured {
    pub(super) fn new(colourless: Colourless, positions: Vec<[f64; 3]>, of_dataset: bool) -> Self {
        Self { colourless, positions, of_dataset }
    }

    /// Gives the first splats of `input`, which stand for all or some of the points, colours from the training
    /// photographs. The colour of a point is the median over the nearest photographs that observe the point, or,
    /// without a track, over the nearest photographs into which the point projects.
    pub fn take_colours(self, dataset: &Dataset, input: &mut Input) -> Result<(), Error> {
        let mut samples: Vec<Vec<ColourSample>> = vec![Vec::new(); self.positions.len()];
        let places: Vec<[f64; 3]> = self.positions.iter().map(|p| dataset.frame.to_scene(*p)).collect();
        let trained_on: Vec<usize> = dataset.views_of(Role::Train).map(|(index, _)| index).collect();
        let observers = |point: usize| if self.of_dataset { dataset.tracks.of(point) } else { &[] };
        let tracked: Vec<bool> = (0..places.len())
            .map(|p| observers(p).iter().any(|view| trained_on.binary_search(&(*view as usize)).is_ok()))
            .collect();
        for view in &input.train {
            let index = trained_on.iter().find(|i| dataset.views[**i].name == view.name).map(|i| *i as u32);
            let pixels = view.photograph.pixels()?;
            samples.par_iter_mut().enumerate().for_each(|(point, samples)| {
                let observes = || index.is_some_and(|index| observers(point).binary_search(&index).is_ok());
                if !tracked[point] || observes() {
                    samples.extend(sample(&view.camera, &pixels, places[point]));
                    keep_nearest(samples);
                }
            });
        }
        let colours: Vec<Option<[u8; 3]>> = samples.iter().map(|samples| median(samples)).collect();
        let seen = colours.iter().flatten().count();
        let all: Vec<_> = colours.iter().flatten().map(|c| ColourSample { depth: 0.0, colour: *c }).collect();
        let usual = median(&all);
        let colours: Vec<[u8; 3]> = colours.into_iter().map(|c| c.or(usual).unwrap_or(GREY)).collect();
        paint(&mut input.initial, &colours);
        let (points, colours) = (colours.len(), Arc::new(colours));
        let Self { colourless, of_dataset, .. } = self;
        input.optional.coloured = Some(Coloured { colourless, of_dataset, seen, points, colours });
        Ok(())
    }
}

/// Paints splats, which stand for the points chosen by [`spread`].
fn paint(splats: &mut Gaussians, colours: &[[u8; 3]]) {
    let chosen: Vec<[u8; 3]> = spread(colours, splats.len()).into_iter().copied().collect();
    init::paint(splats, &chosen);
}

/// Depth and colour of the pixel at a point; `None` outside the photograph and at masked pixels.
fn sample(camera: &Camera, pixels: &Pixels, point: [f64; 3]) -> Option<ColourSample> {
    let centre = camera.center();
    let [x, y, z]: [f64; 3] = camera.rotation.map(|row| (0..3).map(|k| row[k] * (point[k] - centre[k])).sum());
    let (u, v) = (camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy);
    let inside = z > 0.0 && (0.0..f64::from(camera.width)).contains(&u) && (0.0..f64::from(camera.height)).contains(&v);
    if !inside {
        return None;
    }
    let at = 4 * (v as usize * camera.width as usize + u as usize);
    let [red, green, blue, alpha] = match pixels {
        Pixels::Rgba8(values) => <[u8; 4]>::try_from(values.get(at..at + 4)?).ok()?,
        Pixels::Rgba16(values) => <[u16; 4]>::try_from(values.get(at..at + 4)?).ok()?.map(|v| (v / 257) as u8),
    };
    (alpha > 0).then_some(ColourSample { depth: z as f32, colour: [red, green, blue] })
}

fn keep_nearest(samples: &mut Vec<ColourSample>) {
    if samples.len() > MOST {
        let farthest = (0..samples.len()).max_by(|a, b| samples[*a].depth.total_cmp(&samples[*b].depth));
        farthest.map(|k| samples.swap_remove(k));
    }
}

/// The median of each channel; `None` without samples.
fn median(samples: &[ColourSample]) -> Option<[u8; 3]> {
    let channel = |k: usize| {
        let mut values: Vec<u8> = samples.iter().map(|sample| sample.colour[k]).collect();
        values.sort_unstable();
        values.get(values.len() / 2).copied()
    };
    Some([channel(0)?, channel(1)?, channel(2)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_colour_is_the_median_of_the_nearest_photographs() {
        let seen = |depth: f32, grey: u8| ColourSample { depth, colour: [grey, 255 - grey, 7] };
        let mut samples = Vec::new();
        // One of the near photographs sees something else, and so do all the far ones.
        for k in 0..20_u8 {
            samples.push(if k < 10 { seen(9.0, 200) } else { seen(1.0 + f32::from(k), if k == 12 { 90 } else { k }) });
            keep_nearest(&mut samples);
        }
        assert_eq!(samples.len(), MOST);
        assert_eq!(median(&[]), None);
        let near: Vec<ColourSample> = [3, 250, 4, 5].map(|grey| seen(1.0, grey)).to_vec();
        assert_eq!(median(&near), Some([5, 251, 7]));
    }
}
