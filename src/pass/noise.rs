//! Noise on the means of faint splats.

use super::{Pass, module};
use crate::vk::{Kernel, read, read_write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Length of the noise where the covariance is the identity and the splat has no opacity.
        pub rate: f32,
        /// Seed of the run.
        pub seed: u32,
        /// Training step.
        pub step: u32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "noise",
        spirv: module("noise"),
        bindings: &[
            read("counters"),
            read_write("means"),
            read("quats"),
            read("scales"),
            read("opacities"),
            read("ids"),
        ],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns one splat; a workgroup owns 64 consecutive splats. Moves means by `rate` times the covariance \
          times standard normals times sigmoid(100 (0.005 - opacity)); a move that is not finite is left out.",
    dispatch: "one thread per splat of the model",
    push: Push::FIELDS,
};
