//! The last pass of an event: records its number unless `status` is set, and reports counters and losses to the host.

use super::{Pass, module};
use crate::vk::{Kernel, read, read_write, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Number of the event.
        pub event: u32,
        /// 1: the current splats become the constrained set.
        pub constrain: u32,
        /// Optimiser step, modulo 2^16, at which the event caught up every splat; otherwise [`NOT_CAUGHT_UP`].
        pub caught_up: u32,
    }
}

/// [`Push::caught_up`] of an event that does not catch up splats.
pub const NOT_CAUGHT_UP: u32 = u32::MAX;

/// Words of the report: the counters, then total loss, L1 and SSIM.
pub const REPORT_WORDS: usize = super::counters::COUNT + 3;

/// The pass. `ring` is a slot of [`REPORT_WORDS`] words.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "finish",
        spirv: module("finish"),
        bindings: &[read_write("counters"), read("loss"), write("ring")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(1),
    },
    doc: "One thread owns everything.",
    dispatch: "one workgroup",
    push: Push::FIELDS,
};
