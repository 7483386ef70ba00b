//! Depths and normals of pictures against known ones: those of the truth, of reconstructed points, of stereo.

use super::truth::Known;
use crate::dataset::{Dataset, Role};
use crate::raster::{DepthProbe, Picture};
use crate::scene::Camera;

/// A pixel counts as covered above this opacity.
const COVERED: f32 = 0.5;

/// Reconstructed points with fewer observations are not relied on.
const LEAST_OBSERVATIONS: u64 = 4;

/// Nor are points with a larger reprojection error, in pixels.
const MOST_ERROR: f64 = 0.5;

/// Errors collected over pictures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Agreement {
    /// Relative errors of the depth of covered pixels.
    depth: Vec<f32>,
    /// Angles between normals in degrees, of covered pixels.
    degrees: Vec<f32>,
    /// Pixels with a true depth.
    pixels: usize,
    /// Relative errors of the median depth, of pixels that have one.
    median_depth: Vec<f32>,
    /// Sums of the weights in front of the true depth and behind it, over the pixels that training photographs see.
    off: [f64; 2],
    /// These pixels.
    seen: usize,
}

impl Agreement {
    /// Adds a picture of the same size, whose depths are `scale` times as large as the true ones.
    pub fn add(&mut self, picture: &Picture, known: &Known, scale: f64) {
        let Some(aux) = &picture.aux else { return };
        let pixels = picture.rgbt.chunks_exact(4).zip(aux.chunks_exact(4)).zip(&known.depth);
        let mut covered = Vec::with_capacity(known.depth.len());
        for ((colour, aux), &truth) in pixels {
            let opacity = 1.0 - colour[3];
            let counts = truth > 0.0 && truth.is_finite();
            self.pixels += usize::from(counts);
            covered.push(counts && opacity > COVERED);
            if counts && opacity > COVERED {
                let depth = f64::from(aux[0]) / f64::from(opacity) / scale;
                self.depth.push(((depth - f64::from(truth)).abs() / f64::from(truth)) as f32);
            }
        }
        let (Some(truth), Some(got)) = (&known.normals, picture.normals()) else { return };
        for ((truth, got), _) in truth.iter().zip(&got).zip(covered).filter(|(_, covered)| *covered) {
            let dot = |a: &[f32; 3], b: &[f32; 3]| (0..3).map(|k| f64::from(a[k]) * f64::from(b[k])).sum::<f64>();
            let (a, b) = (dot(truth, truth).sqrt(), dot(got, got).sqrt());
            // Without a normal of its own the picture is as wrong as can be;
            // without a true one there is nothing to compare.
            if a > 0.5 {
                let cosine = if b > 0.0 { dot(truth, got) / (a * b) } else { -1.0 };
                self.degrees.push(cosine.clamp(-1.0, 1.0).acos().to_degrees() as f32);
            }
        }
    }

    /// Adds median depths, and weights in front of the true depths and behind them, where the surface is `seen`.
    pub fn add_probe(&mut self, probe: &DepthProbe, known: &Known, seen: &[bool], scale: f64) {
        let weights = probe.front.iter().zip(&probe.behind);
        let pixels = probe.median.iter().zip(weights).zip(&known.depth).zip(seen);
        for (((&depth, (&front, &behind)), &truth), &seen) in pixels {
            if !(truth > 0.0 && truth.is_finite()) {
                continue;
            }
            if depth > 0.0 {
                self.median_depth.push((f64::from(depth) / scale / f64::from(truth) - 1.0).abs() as f32);
            }
            if seen {
                self.off[0] += f64::from(front);
                self.off[1] += f64::from(behind);
                self.seen += 1;
            }
        }
    }

    /// Median of the relative errors of the median depth; none where no pixel has one.
    pub fn error_of_median(&self) -> Option<f64> {
        median(&self.median_depth)
    }

    /// Mean weight of splats in front of the true surface, and of splats behind it; none without a seen pixel.
    pub fn floaters(&self) -> [Option<f64>; 2] {
        self.off.map(|sum| (self.seen > 0).then(|| sum / self.seen as f64))
    }

    /// Median of the relative errors of the depth; none without a covered pixel.
    pub fn median_error(&self) -> Option<f64> {
        median(&self.depth)
    }

    /// Share of all pixels with a true depth that are covered and off by at most `share` of the depth.
    pub fn within(&self, share: f64) -> Option<f64> {
        let good = self.depth.iter().filter(|e| f64::from(**e) <= share).count();
        (self.pixels > 0).then(|| good as f64 / self.pixels as f64)
    }

    /// Share of all pixels with a true depth that are covered.
    pub fn coverage(&self) -> Option<f64> {
        (self.pixels > 0).then(|| self.depth.len() as f64 / self.pixels as f64)
    }

    /// Median of the angles between normals, degrees.
    pub fn median_degrees(&self) -> Option<f64> {
        median(&self.degrees)
    }
}

/// Depths that are known at some places of a photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct Judge {
    /// The camera in scene coordinates, at any size.
    pub camera: Camera,
    /// Positions in pixels with depths in scene units.
    pub places: Vec<[f64; 3]>,
}

/// Median relative errors against judges; none where no place could be compared.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JudgedDepth {
    /// Of the median depth.
    pub median: Option<f64>,
    /// Of the expected depth.
    pub expected: Option<f64>,
}

impl Judge {
    /// The reconstructed points of a dataset, one judge for each held-out photograph that has some: points with four or
    /// more observations and at most half a pixel of error, in the photographs that observe them. Where the dataset
    /// does not say who observes its points, in all photographs into which they project, hidden or not.
    pub fn of_points(dataset: &Dataset) -> Vec<Self> {
        let good = |k: &usize| {
            let point = &dataset.points[*k];
            point.track >= LEAST_OBSERVATIONS && (0.0..=MOST_ERROR).contains(&point.error)
        };
        let good: Vec<usize> = (0..dataset.points.len()).filter(good).collect();
        let of = |(view, camera): (usize, Camera)| {
            let observed =
                |k: &&usize| dataset.tracks.is_empty() || dataset.tracks.of(**k).binary_search(&(view as u32)).is_ok();
            let place = |k: &usize| camera.placed(dataset.frame.to_scene(dataset.points[*k].position));
            Self { camera, places: good.iter().filter(observed).filter_map(place).collect() }
        };
        let held_out = dataset.views_of(Role::HeldOut).filter_map(|(k, _)| Some((k, dataset.scene_camera(k)?)));
        held_out.map(of).filter(|judge| !judge.places.is_empty()).collect()
    }
}

impl JudgedDepth {
    /// The errors of a model over the places of all judges. `render` draws the model from a camera, as for
    /// [`super::measure`]. A place counts where its pixel is covered, or has a median depth.
    pub fn of<E>(
        judges: &[Judge],
        mut render: impl FnMut(&Camera, Option<&[f32]>) -> Result<(Picture, DepthProbe), E>,
    ) -> Result<Self, E> {
        let (mut medians, mut expected) = (Vec::new(), Vec::new());
        for judge in judges {
            let (picture, probe) = render(&judge.camera, None)?;
            for [u, v, depth] in &judge.places {
                let pixel = *v as usize * picture.width as usize + *u as usize;
                let error = |got: f64| (got / depth - 1.0).abs() as f32;
                if let Some(&got) = probe.median.get(pixel).filter(|z| **z > 0.0) {
                    medians.push(error(f64::from(got)));
                }
                let opacity = picture.rgbt.get(4 * pixel + 3).map_or(0.0, |transmittance| 1.0 - transmittance);
                let sum = picture.aux.as_ref().and_then(|aux| aux.get(4 * pixel)).filter(|_| opacity > COVERED);
                expected.extend(sum.map(|sum| error(f64::from(*sum) / f64::from(opacity))));
            }
        }
        Ok(Self { median: median(&medians), expected: median(&expected) })
    }
}

/// The middle of the sorted values; of an even number, the upper one of the two.
pub(super) fn median(values: &[f32]) -> Option<f64> {
    let mut values = values.to_vec();
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| f64::from(*values.select_nth_unstable_by(middle, f32::total_cmp).1))
}
