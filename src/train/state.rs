//! Everything the device holds between two steps.

/// Host copy of the training state. Planes have rows as in [`crate::raster::PLANES`].
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// The model's planes.
    pub params: [Vec<f32>; 8],
    /// Identities of the splats.
    pub ids: Vec<u32>,
    /// Moments of Adam: the first and the second, or words that hold both
    /// ([`crate::pass::project_backward_adam_packed`]).
    pub moments: Vec<[Vec<f32>; 8]>,
    /// Densification statistics, 4 floats per splat.
    pub stats: Vec<f32>,
    /// Scores of sampled growth, 2 floats per splat; empty where growth is not sampled.
    pub scores: Vec<f32>,
    /// The counters.
    pub counters: Vec<u32>,
    /// Exposures of the photographs with their moments ([`crate::pass::exposure`]); empty where exposures are off.
    pub exposures: Vec<f32>,
    /// State of learning the saliency filter's width, as JSON; empty where the width is not learned.
    pub sigma: String,
    /// Propagated depths: for each view the median depth and the packed prior; empty where depths are not propagated.
    pub priors: Vec<u32>,
}

impl State {
    /// Number of splats.
    pub fn splats(&self) -> u32 {
        self.ids.len() as u32
    }
}
