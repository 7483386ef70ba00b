//! Training: settings, schedule, losses, optimiser, density control, checkpoints, and the trainer, which yields
//! messages.

mod actions;
pub mod cloud;
pub mod density;
mod engine;
mod error;
mod input;
/// What a training learns: splats, exposures of photographs, and widths of the saliency filter.
mod learning {
    pub(super) mod exposures;
    pub(super) mod optimiser;
    pub(super) mod sigma;
}
mod memory;
mod message;
mod pacing;
mod part;
mod photographs;
pub mod prepare;
pub mod schedule;
pub mod settings;
mod state;
mod terms;
mod trainer;
pub mod tune;

pub use crate::scene::ExposureMatrix;
pub use engine::{Engine, MemoryCost, Outcome};
pub use error::Error;
pub use input::{Input, OptionalInput, Outline, TrainedOn, View};
pub use learning::sigma::SigmaUpdate;
pub use memory::{HostMemory, HostPlan, MemoryPlan, shares_memory};
pub use message::Message;
pub use pacing::{Pacing, Residency};
pub use part::Part;
pub use photographs::FeedCounts;
pub use prepare::{CloudReport, StereoReport, compute_stereo_priors, longer_side, splats_on_surfaces, stereo_settings};
pub use schedule::{Event, Kind, Schedule, StepPlan};
pub use settings::Settings;
pub use state::State;
pub use trainer::{Checkpointed, History, Restart, Trainer, score};
pub use tune::{Estimate, chosen_variants};
