//! Counts the views that 3DGS counts for a splat although the splat covers no pixel.

use super::camera::CameraPush;
use super::{Pass, module};
use crate::vk::{Kernel, read, read_write};

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "densify_views",
        spirv: module("densify_views"),
        bindings: &[
            read("counters"),
            read("tile_counts"),
            read("means"),
            read("quats"),
            read("scales"),
            read_write("stats"),
        ],
        push_bytes: CameraPush::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns one splat and its row of `stats`; a workgroup owns 64 consecutive splats. Adds 1 view where \
          no pixel centre lies within the ellipse of the splat, but the square that 3DGS draws about the splat (half \
          side: three standard deviations of the longer axis, rounded up) touches a tile of 16 x 16 pixels.",
    dispatch: "one thread per splat of the model, through `args`",
    push: CameraPush::FIELDS,
};
