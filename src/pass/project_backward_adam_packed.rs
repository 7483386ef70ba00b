//! [`super::project_backward_adam`] on moments of half the size: both moments of a parameter share a word.

use super::project_backward_adam::{self as full, CONSTANTS, Push};
use super::{Pass, module};
use crate::vk::{Kernel, read, read_write};

/// The pass; its constants are those of [`full::constants`].
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "project_backward_adam_packed",
        spirv: module("project_backward_adam_packed"),
        bindings: &[
            read("counters"),
            read("splat2d"),
            read("tile_counts"),
            read("grad2d"),
            read("grad_normals"),
            read_write("means"),
            read_write("quats"),
            read_write("scales"),
            read_write("opacities"),
            read_write("sh0"),
            read_write("sh1"),
            read_write("sh2"),
            read_write("sh3"),
            read_write("m_means"),
            read_write("m_quats"),
            read_write("m_scales"),
            read_write("m_opacities"),
            read_write("m_sh0"),
            read_write("m_sh1"),
            read_write("m_sh2"),
            read_write("m_sh3"),
        ],
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
