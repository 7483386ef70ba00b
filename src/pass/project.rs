//! Projection of 3D Gaussians to the image, with colour and tile count.

use super::camera::CameraPush;
use super::cutoffs::ALPHA_MIN;
use super::{Pass, module};
use crate::twin::TwinCall;
use crate::vk::{Binding, Constant, Kernel, read, read_write, write};

const BINDINGS: &[Binding] = &[
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
];

const fn pass(name: &'static str, doc: &'static str, twin: fn(&mut TwinCall<'_>)) -> Pass {
    Pass {
        kernel: Kernel {
            name,
            spirv: module(name),
            bindings: BINDINGS,
            push_bytes: CameraPush::BYTES,
            constants: &[
                Constant { id: 0, name: "TILE_W", default: 16 },
                Constant { id: 1, name: "TILE_H", default: 16 },
                Constant { id: 2, name: "AUX", default: 0 },
                ALPHA_MIN,
            ],
            local_size: Some(64),
        },
        doc,
        dispatch: "one thread per splat of the model",
        push: CameraPush::FIELDS,
        twin,
    }
}

/// The pass.
pub const PASS: Pass = pass(
    "project",
    "One thread owns one splat; a workgroup owns 64 consecutive splats. EWA projection, SH colour, tile count (0 = culled, \
     nothing else is written then), normals when AUX = 1; splats with non-finite parameters are counted and culled.",
    crate::twin::project::run,
);

/// The same with the coefficients of spherical harmonics in half floats: coefficient `c` of a group of 12 is the lower half of word
/// `c / 2` of the row for even `c`, the upper for odd.
pub const HALF: Pass = pass(
    "project_half",
    "One thread owns one splat; a workgroup owns 64 consecutive splats. As project, with spherical harmonics in half floats: for \
     pictures only.",
    crate::twin::project::run_half,
);
