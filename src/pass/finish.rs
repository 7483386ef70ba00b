//! The last pass of an event: records its number unless `status` is set.

use super::{Pass, module};
use crate::vk::{Kernel, read_write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Number of the event.
        pub event: u32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "finish",
        spirv: module("finish"),
        bindings: &[read_write("counters")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(1),
    },
    doc: "One thread owns everything.",
    dispatch: "one workgroup",
    push: Push::FIELDS,
    twin: crate::twin::finish::run,
};
