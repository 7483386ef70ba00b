//! [`super::project_backward_adam`] with packed moments: both moments of a parameter share a word.

use super::project_backward_adam::{self as full, CONSTANTS, Push};
use super::{Pass, module};
use crate::vk::{Binding, Kernel};

/// The bindings of the full pass without the planes of second moments, which stand before the statistics at the end.
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

/// The pass. See [`full::constants`] for the constants.
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
          consecutive splats. Like project_backward_adam, with moments of 16 bits each; second \
          moments are rounded at random.",
    dispatch: full::PASS.dispatch,
    push: Push::FIELDS,
};

/// Storage buffers that a device must bind at once for [`PASS`].
pub const BINDINGS: u32 = PASS.kernel.bindings.len() as u32;
