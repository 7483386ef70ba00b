//! [`super::project_backward_adam`] on moments of half the size: both moments of a parameter share a word.

use super::project_backward_adam::{self as full, CONSTANTS, Push};
use super::{Pass, module};
use crate::vk::{Binding, Kernel};

/// The second moments, which come last but for the statistics there, have no planes of their own.
const WITHOUT_SECOND_MOMENTS: [Binding; 22] = {
    let all = full::PASS.kernel.bindings;
    let mut kept = [all[all.len() - 1]; 22];
    let mut k = 0;
    while k < all.len() - 9 {
        kept[k] = all[k];
        k += 1;
    }
    kept
};

/// The pass; its constants are those of [`full::constants`].
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "project_backward_adam_packed",
        spirv: module("project_backward_adam_packed"),
        bindings: &WITHOUT_SECOND_MOMENTS,
        push_bytes: Push::BYTES,
        constants: CONSTANTS,
        local_size: full::PASS.kernel.local_size,
    },
    doc: "One thread owns one splat, its parameters and a word for both moments of each; a workgroup owns 64 \
          consecutive splats. As project_backward_adam, on moments of 16 bits each, the second rounded at random.",
    dispatch: full::PASS.dispatch,
    push: Push::FIELDS,
};

/// Storage buffers that a device must bind at once for [`PASS`].
pub const BINDINGS: u32 = PASS.kernel.bindings.len() as u32;
