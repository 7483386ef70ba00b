//! Withdraws growth past a limit on the number of splats.

use super::{Pass, module};
use crate::vk::{Kernel, read, read_write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Words between the four segments of `flags` and of `offsets`.
        pub stride: u32,
        /// Limit on the number of splats by growth. A larger model is kept, but does not grow.
        pub max_splats: u32,
        /// The run's seed.
        pub seed: u32,
        /// Number of the density change.
        pub event: u32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "densify_limit",
        spirv: module("densify_limit"),
        bindings: &[read("counters"), read("offsets"), read_write("flags")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns one splat and its four flags; a workgroup owns 64 consecutive splats. Withdraws clones and \
          splits, spread evenly over the order of birth, until the limit holds; the scan of the flags is then \
          repeated.",
    dispatch: "one thread per splat of the capacity",
    push: Push::FIELDS,
};
