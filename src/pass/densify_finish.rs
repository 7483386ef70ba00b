//! The counts after a density change.

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
    doc: "One thread does all. Unless an overflow is noted: the number of splats, the next identity, and how many \
          splats were cloned, replaced by two children, pruned (the rest: splits whose children were pruned count \
          here), and met with a value that is not finite.",
    dispatch: "one workgroup",
    push: Push::FIELDS,
};
