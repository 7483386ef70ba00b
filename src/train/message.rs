//! The messages of a trainer.

use std::path::PathBuf;

use crate::eval::Quality;
use crate::train::learning::sigma::SigmaUpdate;

/// A message of the training stream.
#[derive(Clone, Debug)]
pub enum Message {
    /// A step is done on the device. Messages of steps come in order, some steps after the step was submitted.
    Step {
        /// Step, from 1.
        step: u32,
        /// (1 - lambda) L1 + lambda (1 - SSIM) of the step's view.
        loss: f32,
        /// Splats in the model.
        splats: u32,
        /// (splat, tile) pairs of the step's view.
        pairs: u32,
        /// Seconds since training began, earlier runs of a resumed training included.
        seconds: f64,
    },
    /// Density control changed the set of splats.
    Density {
        /// Step.
        step: u32,
        /// Splats cloned.
        cloned: u32,
        /// Splats split.
        split: u32,
        /// Splats pruned.
        pruned: u32,
        /// Splats after the change.
        splats: u32,
    },
    /// The width of the saliency filter was learned from a step.
    Sigma {
        /// Step.
        step: u32,
        /// What was learned.
        learned: SigmaUpdate,
    },
    /// Depths of a step's view were propagated before the step.
    Propagated {
        /// Step.
        step: u32,
        /// Splats that were added.
        added: u32,
        /// Share of the view's pixels that have a depth.
        share: f64,
        /// Splats after the change.
        splats: u32,
    },
    /// Splats where no photograph looks were added before a step.
    Skirted {
        /// Step.
        step: u32,
        /// Splats that were added.
        added: u32,
        /// Splats after the change.
        splats: u32,
    },
    /// Splats wider than the local wavelength of the photographs were split before a step.
    SplitWide {
        /// Step.
        step: u32,
        /// Splats that were split.
        split: u32,
        /// Splats after the change.
        splats: u32,
    },
    /// Dead splats were put in the places of live ones, and splats were added, before a step.
    Relocated {
        /// Step.
        step: u32,
        /// Splats that were dead.
        relocated: u32,
        /// Splats that were added.
        added: u32,
        /// Splats after the change.
        splats: u32,
    },
    /// Splats of little weight, or too large for their surroundings, were dropped before a step.
    Pruned {
        /// Step.
        step: u32,
        /// Splats that were dropped.
        dropped: u32,
        /// Splats after the change.
        splats: u32,
    },
    /// The splats with spherical harmonics above degree 1 were chosen before a step.
    HarmonicsSettled {
        /// Step.
        step: u32,
        /// Splats with harmonics above degree 1.
        full: u32,
        /// Splats in the model.
        splats: u32,
    },
    /// Opacities were clamped.
    OpacityReset {
        /// Step.
        step: u32,
    },
    /// A buffer was too small: the buffer was grown, and the lost events are being replayed.
    Grown {
        /// What the buffers hold: splats or pairs.
        what: &'static str,
        /// New capacity in elements.
        capacity: u64,
        /// First step that is replayed.
        replay_from: u32,
    },
    /// Held-out photographs were rendered and compared.
    Evaluated {
        /// Step.
        step: u32,
        /// Mean quality and quality of each photograph.
        quality: Quality,
        /// Splats in the model.
        splats: u32,
        /// Seconds since training began.
        seconds: f64,
    },
    /// Scoring was given up because of [`super::Trainer::give_up_scoring_when`]. A run that goes on from a checkpoint
    /// of this step scores again.
    ScoringGivenUp {
        /// Step.
        step: u32,
    },
    /// A checkpoint is on disk.
    Checkpoint {
        /// Step.
        step: u32,
        /// File.
        path: PathBuf,
    },
    /// Something the user should know.
    Warning(String),
    /// All steps are done.
    Finished {
        /// Last step.
        step: u32,
        /// Splats in the model.
        splats: u32,
        /// Seconds of training.
        seconds: f64,
    },
}
