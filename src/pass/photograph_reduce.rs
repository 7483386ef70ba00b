//! A photograph at a fraction of its size.

use super::{Pass, module};
use crate::vk::{Constant, Kernel, read, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Width of the photograph in pixels.
        pub width: u32,
        /// Height of the photograph in pixels.
        pub height: u32,
        /// Pixels of the photograph along each side of a pixel of the result.
        pub factor: u32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "photograph_reduce",
        spirv: module("photograph_reduce"),
        bindings: &[read("target"), write("reduced")],
        push_bytes: Push::BYTES,
        constants: &[Constant { id: 2, name: "PHOTOGRAPH_BITS", default: 8 }],
        local_size: Some(64),
    },
    doc: "One thread owns a pixel of the result, the mean of `factor` x `factor` pixels; a workgroup owns 64 \
          consecutive ones. The mean excludes masked pixels. A pixel of the result is masked when more than half of \
          its source pixels are.",
    dispatch: "one thread per pixel of the result",
    push: Push::FIELDS,
};
