//! Training: settings, schedule, losses, optimiser, density control, checkpoints, and the trainer as a stream of messages.

pub mod density;
pub mod schedule;
pub mod settings;

pub use schedule::{Schedule, StepPlan};
pub use settings::Settings;
