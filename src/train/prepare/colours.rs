//! Colours of points that have none of their own: those of the photographs that see them.

use std::sync::Arc;

use rayon::prelude::*;

use super::spread;
use crate::dataset::{Colourless, Dataset, Pixels, Role};
use crate::scene::{Camera, Gaussians, init};
use crate::train::Error;
use crate::train::input::{Coloured, Input};

/// Photographs that a point takes its colour from, at most: the nearest, which see it best and between which and the point least lies.
const MOST: usize = 7;
/// Colour where no photograph says any.
const GREY: [u8; 3] = [128; 3];

/// Points to begin with whose colours say nothing.
#[derive(Clone, Debug, PartialEq)]
pub struct Uncoloured {
    /// What is to be said of them.
    pub colourless: Colourless,
    /// Places of all points, of which the first splats may be some, in dataset coordinates.
    positions: Vec<[f64; 3]>,
    /// The points are those of the dataset, which may say who observes them.
    of_dataset: bool,
}

/// What a point is seen as.
#[derive(Clone, Copy)]
struct Sample {
    depth: f32,
    colour: [u8; 3],
}

impl Uncoloured {
    pub(super) fn new(colourless: Colourless, positions: Vec<[f64; 3]>, of_dataset: bool) -> Self {
        Self { colourless, positions, of_dataset }
    }

    /// Gives the first splats of `input`, one for each of the points or of some of them, the colours that the photographs to train on
    /// have there: the median over the nearest of the photographs that observe a point, or that have the point in their picture where
    /// nothing says who observes it.
    pub fn take_colours(self, dataset: &Dataset, input: &mut Input) -> Result<(), Error> {
        let mut samples: Vec<Vec<Sample>> = vec![Vec::new(); self.positions.len()];
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
        let usual = median(&colours.iter().flatten().map(|c| Sample { depth: 0.0, colour: *c }).collect::<Vec<_>>());
        let colours: Vec<[u8; 3]> = colours.into_iter().map(|c| c.or(usual).unwrap_or(GREY)).collect();
        paint(&mut input.initial, &colours);
        let (points, colours) = (colours.len(), Arc::new(colours));
        let Self { colourless, of_dataset, .. } = self;
        input.optional.coloured = Some(Coloured { colourless, of_dataset, seen, points, colours });
        Ok(())
    }
}

/// Splats stand for some of the points, as [`spread`] takes them.
fn paint(splats: &mut Gaussians, colours: &[[u8; 3]]) {
    let chosen: Vec<[u8; 3]> = spread(colours, splats.len()).into_iter().copied().collect();
    init::paint(splats, &chosen);
}

/// What a photograph shows where a point is; nothing where it is masked.
fn sample(camera: &Camera, pixels: &Pixels, point: [f64; 3]) -> Option<Sample> {
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
    (alpha > 0).then_some(Sample { depth: z as f32, colour: [red, green, blue] })
}

fn keep_nearest(samples: &mut Vec<Sample>) {
    if samples.len() > MOST {
        let farthest = (0..samples.len()).max_by(|a, b| samples[*a].depth.total_cmp(&samples[*b].depth));
        farthest.map(|k| samples.swap_remove(k));
    }
}

/// The median of each channel.
fn median(samples: &[Sample]) -> Option<[u8; 3]> {
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
        let seen = |depth: f32, grey: u8| Sample { depth, colour: [grey, 255 - grey, 7] };
        let mut samples = Vec::new();
        // One of the near ones sees something else, and so do all far ones.
        for k in 0..20_u8 {
            samples.push(if k < 10 { seen(9.0, 200) } else { seen(1.0 + f32::from(k), if k == 12 { 90 } else { k }) });
            keep_nearest(&mut samples);
        }
        assert_eq!(samples.len(), MOST);
        assert_eq!(median(&[]), None);
        let near: Vec<Sample> = [3, 250, 4, 5].map(|grey| seen(1.0, grey)).to_vec();
        assert_eq!(median(&near), Some([5, 251, 7]));
    }
}
