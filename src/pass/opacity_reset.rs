//! Caps every opacity and clears its moments.

use super::{Pass, module};
use crate::vk::{Kernel, read, read_write, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Logit of the largest allowed opacity.
        pub logit_cap: f32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "opacity_reset",
        spirv: module("opacity_reset"),
        bindings: &[read("counters"), read_write("opacities"), write("m_opacities"), write("v_opacities")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns one splat; a workgroup owns 64 consecutive splats.",
    dispatch: "one thread per splat of the model, through `args`",
    push: Push::FIELDS,
};
