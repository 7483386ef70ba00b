//! Training: settings, schedule, losses, optimiser, density control, checkpoints, and the trainer as a stream of messages.

mod checkpoint;
mod cost;
pub mod density;
mod embedded;
mod engine;
mod error;
mod evaluate;
mod event;
mod exposures;
mod history;
mod input;
mod losses;
mod memory;
mod message;
mod optimiser;
pub mod prepare;
pub mod schedule;
pub mod settings;
mod state;
mod trainer;
pub mod tune;

pub use checkpoint::Checkpointed;
pub use cost::MemoryCost;
pub use engine::{Engine, Outcome};
pub use error::Error;
pub use evaluate::score;
pub use event::{Event, Kind};
pub use exposures::ExposureMatrix;
pub use history::History;
pub use input::{Input, View};
pub use memory::MemoryPlan;
pub use message::Message;
pub use schedule::{Schedule, StepPlan};
pub use settings::Settings;
pub use state::State;
pub use trainer::{Pacing, Restart, Trainer, chosen_variants};
