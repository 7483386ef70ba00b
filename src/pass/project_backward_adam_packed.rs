//! [`super::project_backward_adam`] on moments of half the size: both moments of a parameter share a word.

use super::project_backward_adam::{self as full, CONSTANTS, Push};
use super::{Pass, module};
use crate::vk::Kernel;

/// The pass; its constants are those of [`full::constants`].
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "project_backward_adam_packed",
        spirv: module("project_backward_adam_packed"),
        // The second moments, which come last there, have no planes of their own.
        bindings: full::PASS.kernel.bindings.split_at(full::PASS.kernel.bindings.len() - 8).0,
        push_bytes: Push::BYTES,
        constants: CONSTANTS,
        local_size: full::PASS.kernel.local_size,
    },
    doc: "One thread owns one splat, its parameters and a word for both moments of each; a workgroup owns 64 consecutive splats. As \
          project_backward_adam, on moments of 16 bits each, the second rounded at random.",
    dispatch: full::PASS.dispatch,
    push: Push::FIELDS,
    twin: crate::twin::project_backward_adam_packed::run,
};

/// Storage buffers that a device must bind at once for [`PASS`].
pub const BINDINGS: u32 = PASS.kernel.bindings.len() as u32;
