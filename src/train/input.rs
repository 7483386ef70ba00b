//! What a training is given: views with their photographs, and a first model; and whether a resumed one is given the same.

mod dataset_fingerprint;

pub(super) use dataset_fingerprint::PerceptualBy;
pub use dataset_fingerprint::TrainedOn;

use std::sync::Arc;

use super::cloud::ProximityIndex;
use crate::dataset::{Colourless, Depth, Pixels, Supply, Undecoded, Warning};
use crate::perceptual::LpipsWeights;
use crate::scene::{Camera, Gaussians};
use crate::stereo::{Prior, Scene};

/// A photograph with its camera in scene coordinates.
#[derive(Clone, Debug)]
pub struct View {
    /// Name of the photograph.
    pub name: String,
    /// Camera, of the size of the photograph.
    pub camera: Camera,
    /// The pixels. Where alpha is 0 a pixel is masked: it has no part in losses and metrics.
    pub photograph: Supply,
}

impl View {
    /// With a photograph that is in memory. Pixels less than half opaque are masked.
    pub fn new(name: &str, camera: Camera, pixels: Pixels) -> Self {
        Self { name: name.to_owned(), camera, photograph: Supply::of(pixels) }
    }

    /// Number of masked pixels.
    pub fn masked(&self) -> u32 {
        self.photograph.masked()
    }
}

/// The input of a training, in scene coordinates.
#[derive(Clone, Debug)]
pub struct Input {
    /// Views to train on.
    pub train: Vec<View>,
    /// Views to evaluate on; training never reads them.
    pub held_out: Vec<View>,
    /// Splats to begin with.
    pub initial: Gaussians,
    /// Extent of the training cameras in scene units (1.1 x the largest distance from their mean).
    pub extent: f32,
    /// What is known besides.
    pub known: Known,
}

/// What a training can be given besides photographs and a first model; nothing of it has to be there.
#[derive(Clone, Debug, Default)]
pub struct Known {
    /// Depth and normals of the views to train on, in their order and in scene coordinates.
    pub priors: Vec<Option<Prior>>,
    /// Weights for the perceptual distance; a bank of filters stands in for them.
    pub perceptual: Option<Arc<LpipsWeights>>,
    /// Where the colours of the first splats come from, where their points had none.
    pub coloured: Option<Coloured>,
    /// Where splats may grow; everywhere without.
    pub gate: Option<Arc<ProximityIndex>>,
    /// Splats that come when growth has ended and splats of little weight have gone: what lies where no photograph looks.
    pub skirt: Option<Arc<Gaussians>>,
    /// What is to be told of photographs that were left out, as their poses are wrong or their pixels cannot be decoded.
    pub left_out: Vec<Warning>,
    /// Those of them whose pixels cannot be decoded.
    pub undecoded: Undecoded,
    /// The views as stereo sees them, in their order, where depths are propagated.
    pub scene: Option<Arc<Scene>>,
}

/// Where the colours of the first splats come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Coloured {
    /// What is to be said of the points.
    pub colourless: Colourless,
    /// Whether the points are those of the dataset, of which [`crate::dataset::Dataset::warnings`] has told this.
    pub of_dataset: bool,
    /// Points with a colour of photographs.
    pub seen: usize,
    /// All points.
    pub points: usize,
    /// Their colours.
    pub colours: Arc<Vec<[u8; 3]>>,
}

impl Input {
    /// Whether any splat to begin with lies before one of the cameras to train on, in its picture or not farther from it than the picture is
    /// wide and high.
    pub fn sees_any(&self) -> bool {
        let means = &self.initial.means;
        means.chunks_exact(3).any(|mean| self.train.iter().any(|view| is_before(&view.camera, mean)))
    }

    /// What memory depends on.
    pub fn outline(&self) -> Outline {
        Outline {
            train: self.train.iter().map(|view| (view.camera, view.photograph.depth())).collect(),
            held_out: self.held_out.iter().map(|view| (view.camera, view.photograph.depth())).collect(),
            extent: self.extent,
        }
    }
}

/// Sizes and depths of the photographs of a training: what its memory depends on, known before any is decoded.
#[derive(Clone, Debug)]
pub struct Outline {
    /// Views to train on.
    pub train: Vec<(Camera, Depth)>,
    /// Views to evaluate on.
    pub held_out: Vec<(Camera, Depth)>,
    /// As that of [`Input`].
    pub extent: f32,
}

impl Outline {
    /// Bytes of photographs, decoded.
    pub fn bytes(views: &[(Camera, Depth)]) -> u64 {
        views.iter().map(|(c, depth)| u64::from(c.width) * u64::from(c.height) * depth.bytes_per_pixel()).sum()
    }

    /// Bytes of the largest photograph, decoded.
    pub fn largest(&self) -> u64 {
        self.train.iter().chain(&self.held_out).map(|view| Self::bytes(std::slice::from_ref(view))).max().unwrap_or(0)
    }
}

fn is_before(camera: &Camera, mean: &[f32]) -> bool {
    let [x, y, z]: [f64; 3] = std::array::from_fn(|i| {
        let row = camera.rotation[i];
        camera.translation[i] + (0..3).map(|k| row[k] * f64::from(mean[k])).sum::<f64>()
    });
    let inside = |at: f64, size: u32| (-f64::from(size)..2.0 * f64::from(size)).contains(&at);
    z > 0.0
        && inside(camera.fx * x / z + camera.cx, camera.width)
        && inside(camera.fy * y / z + camera.cy, camera.height)
}
