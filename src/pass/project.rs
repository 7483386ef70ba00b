//! Projection of 3D Gaussians to the image, with colour and tile count.

use super::camera::CameraPush;
use super::{Pass, module};
use crate::vk::{Constant, Kernel, read, read_write, write};

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "project",
        spirv: module("project"),
        bindings: &[
            read_write("counters"),
            read("means"),
            read("quats"),
            read("scales"),
            read("opacities"),
            read("sh0"),
            read("sh1"),
            read("sh2"),
            read("sh3"),
            write("splat2d"),
            write("tile_counts"),
            write("normals"),
        ],
        push_bytes: CameraPush::BYTES,
        constants: &[
            Constant { id: 0, name: "TILE_W", default: 16 },
            Constant { id: 1, name: "TILE_H", default: 16 },
            Constant { id: 2, name: "AUX", default: 0 },
        ],
        local_size: Some(64),
    },
    doc: "One thread owns one splat; a workgroup owns 64 consecutive splats. EWA projection, SH colour, tile count (0 = culled, \
          nothing else is written then), normals when AUX = 1; splats with non-finite parameters are counted and culled.",
    dispatch: "one thread per splat of the model",
    push: CameraPush::FIELDS,
    twin: crate::twin::project::run,
};
