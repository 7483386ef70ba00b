//! What a training is given: views with photographs, and a first model; and whether a resumed training is given the
//! same.

mod dataset_fingerprint;

pub(super) use dataset_fingerprint::PerceptualBy;
pub use dataset_fingerprint::TrainedOn;

use std::sync::Arc;

use super::cloud::ProximityIndex;
use super::part::Part;
use crate::dataset::{Colourless, Depth, Pixels, Supply, Undecoded, Warning};
use crate::perceptual::LpipsWeights;
use crate::scene::{Camera, Gaussians};
use crate::stereo::{Prior, Scene};

/// A photograph with its camera in scene coordinates.
#[derive(Clone, Debug)]
pub struct View {
    /// Name of the photograph.
    pub name: String,
    /// Camera; width and height are those of the photograph.
    pub camera: Camera,
    /// The pixels. A pixel with alpha 0 is masked: it has no part in losses and metrics.
    pub photograph: Supply,
}

impl View {
    /// A view whose photograph is in memory. Pixels less than half opaque are masked.
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
    /// Depths, weights and other parts that may be absent.
    pub optional: OptionalInput,
}

/// What a training can be given besides photographs and a first model; every part may be absent.
#[derive(Clone, Debug, Default)]
pub struct OptionalInput {
    /// Depth and normals of the views to train on, in the order of the views and in scene coordinates.
    pub priors: Vec<Option<Prior>>,
    /// Weights of the perceptual distance; without them a bank of oriented filters is used.
    pub perceptual: Option<Arc<LpipsWeights>>,
    /// Where the colours of the first splats come from, if their points had none.
    pub coloured: Option<Coloured>,
    /// Points near which splats may grow; without them splats grow everywhere.
    pub gate: Option<Arc<ProximityIndex>>,
    /// Splats where no photograph looks. Added when growth has ended and splats of little weight were dropped.
    pub skirt: Option<Arc<Gaussians>>,
    /// Warnings about photographs that were left out because of wrong poses or pixels that cannot be decoded.
    pub left_out: Vec<Warning>,
    /// The photographs left out because their pixels cannot be decoded.
    pub undecoded: Undecoded,
    /// The part of the scene that is trained; without one the whole scene is.
    pub part: Option<Arc<Part>>,
    /// The views as stereo sees them, in the order of the views, if depths are propagated.
    pub scene: Option<Arc<Scene>>,
}

/// Where the colours of the first splats come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Coloured {
    /// The points that had no colour.
    pub colourless: Colourless,
    /// Whether the points are those of the dataset: then [`crate::dataset::Dataset::warnings`] tells that they had no
    /// colour.
    pub of_dataset: bool,
    /// Number of points with a colour taken from photographs.
    pub seen: usize,
    /// Number of points.
    pub points: usize,
    /// Colours of the points.
    pub colours: Arc<Vec<[u8; 3]>>,
}

impl Input {
    /// Whether any first splat lies in front of a training camera and projects into its image, or no farther outside
    /// than the image is wide and high.
    pub fn sees_any(&self) -> bool {
        let means = &self.initial.means;
        means.chunks_exact(3).any(|mean| self.train.iter().any(|view| is_before(&view.camera, mean)))
    }

    /// The sizes and depths that memory depends on.
    pub fn outline(&self) -> Outline {
        Outline {
            train: self.train.iter().map(|view| (view.camera, view.photograph.depth())).collect(),
            held_out: self.held_out.iter().map(|view| (view.camera, view.photograph.depth())).collect(),
            extent: self.extent,
        }
    }
}

/// Sizes and bit depths of the photographs of a training. Its memory depends on them, and they are known before any
/// photograph is decoded.
#[derive(Clone, Debug)]
pub struct Outline {
    /// Views to train on.
    pub train: Vec<(Camera, Depth)>,
    /// Views to evaluate on.
    pub held_out: Vec<(Camera, Depth)>,
    /// Extent of the training cameras, as in [`Input`].
    pub extent: f32,
}

impl Outline {
    /// Bytes of the decoded photographs.
    pub fn bytes(views: &[(Camera, Depth)]) -> u64 {
        views.iter().map(|(c, depth)| u64::from(c.width) * u64::from(c.height) * depth.bytes_per_pixel()).sum()
    }

    /// Pixels of the largest view to train on.
    pub fn most_pixels(&self) -> u64 {
        self.train.iter().map(|(c, _)| u64::from(c.width) * u64::from(c.height)).max().unwrap_or(0)
    }

    /// Bytes of the largest decoded photograph.
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
