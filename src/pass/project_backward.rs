//! Gradients of the 3D Gaussians from the gradients of their projections.

use super::camera::CameraPush;
use super::{Pass, module};
use crate::vk::{Constant, Kernel, read, read_write};

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "project_backward",
        spirv: module("project_backward"),
        bindings: &[
            read("counters"),
            read("means"),
            read("quats"),
            read("scales"),
            read("opacities"),
            read("sh0"),
            read("sh1"),
            read("sh2"),
            read("sh3"),
            read("splat2d"),
            read("tile_counts"),
            read("grad2d"),
            read("grad_normals"),
            read_write("g_means"),
            read_write("g_quats"),
            read_write("g_scales"),
            read_write("g_opacities"),
            read_write("g_sh0"),
            read_write("g_sh1"),
            read_write("g_sh2"),
            read_write("g_sh3"),
        ],
        push_bytes: CameraPush::BYTES,
        constants: &[
            Constant { id: 0, name: "AUX", default: 0 },
            Constant { id: 1, name: "FLATTEN", default: 0 },
            Constant { id: 2, name: "ADD", default: 0 },
            Constant { id: 3, name: "SHRINK", default: 0 },
        ],
        local_size: Some(64),
    },
    doc: "One thread owns one splat; a workgroup owns 64 consecutive splats. Recomputes the projection and writes the \
          gradients of all 59 parameters, zeros for culled splats; with ADD = 1 adds to them instead. \
          Normals take part when AUX = 1. FLATTEN and SHRINK, floats as bits, are the weights of the smallest \
          standard deviation and of half the squares of the view-dependent coefficients in use in the loss.",
    dispatch: "one thread per splat of the model",
    push: CameraPush::FIELDS,
};
