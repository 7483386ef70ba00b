//! Projection of 3D Gaussians to the image, with colour and tile count.

use super::alpha_min::ALPHA_MIN;
use super::camera::CameraPush;
use super::{Pass, module};
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

const fn pass(name: &'static str, local_size: u32, doc: &'static str, dispatch: &'static str) -> Pass {
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
                Constant { id: 3, name: "ORTHOGRAPHIC", default: 0 },
                ALPHA_MIN,
            ],
            local_size: Some(local_size),
        },
        doc,
        dispatch,
        push: CameraPush::FIELDS,
    }
}

const PER_SPLAT: &str = "one thread per splat of the model";

/// The pass.
pub const PASS: Pass = pass(
    "project",
    64,
    "One thread owns one splat; a workgroup owns 64 consecutive splats. EWA projection, SH colour, tile count (0 = \
     culled, nothing else is written then), normals when AUX = 1, parallel rays when ORTHOGRAPHIC = 1; splats with non-finite parameters are counted and \
     culled.",
    PER_SPLAT,
);

/// [`PASS`] with sh coefficients in half floats. Coefficient `c` of a group of 12 is in word `c / 2` of the row: in the
/// lower half for even `c`, in the upper half for odd `c`.
pub const HALF: Pass = pass(
    "project_half",
    64,
    "One thread owns one splat; a workgroup owns 64 consecutive splats. Like project, with sh coefficients in half \
     floats, for renders only.",
    PER_SPLAT,
);

/// [`PASS`] for devices with subgroups of width 8 that also execute branches that no thread takes: lavapipe. Same
/// results.
pub const SPARSE: Pass = pass(
    "project_sparse",
    8,
    "A workgroup of 8 threads owns 64 consecutive splats. First each thread tests splats in turn for visibility, then \
     each thread projects visible splats in turn. Otherwise like project.",
    "one workgroup per 64 splats of the model",
);
