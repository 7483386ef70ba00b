//! Updates the counters after a density change.

use super::{Pass, module};
use crate::vk::{Kernel, read, read_write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Words between the four segments of `offsets`.
        pub stride: u32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "densify_finish",
        spirv: module("densify_finish"),
        bindings: &[read_write("counters"), read("offsets"), read("tally")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread does everything. Unless `status` has an overflow, updates the number of splats, the next \
          identity, and the numbers of splats that were cloned, replaced by two children, pruned (all others, \
          including splits whose children were pruned), or non-finite.",
    dispatch: "one workgroup",
    push: Push::FIELDS,
};
