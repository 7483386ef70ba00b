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
     culled, nothing else is written then), normals when AUX = 1; splats with non-finite parameters are counted and \
     culled.",
    PER_SPLAT,
);

/// The same with the coefficients of spherical harmonics in half floats: coefficient `c` of a group of 12 is the lower
/// half of word `c / 2` of the row for even `c`, the upper for odd.
pub const HALF: Pass = pass(
    "project_half",
    64,
    "One thread owns one splat; a workgroup owns 64 consecutive splats. As project, with spherical harmonics in half \
     floats: for pictures only.",
    PER_SPLAT,
);

/// For devices whose subgroups are exactly 8 wide and that run through a branch that no thread takes: lavapipe.
/// The same results.
pub const SPARSE: Pass = pass(
    "project_sparse",
    8,
    "A workgroup of 8 threads owns 64 consecutive splats: one thread a splat in turn looks whether it may be seen, \
     then one thread of these in turn projects it. Otherwise as project.",
    "one workgroup per 64 splats of the model",
);
