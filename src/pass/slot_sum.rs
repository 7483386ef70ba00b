//! Sums the slots of each visible splat in a fixed order.

use super::blend_forward::AUX;
use super::turns::PER_TURN;
use super::{Pass, module};
use crate::vk::{Kernel, read, write};

/// Visible splats that one workgroup owns.
pub const SPLATS_PER_WORKGROUP: u32 = 16;

/// The pass. `listed` holds the visible splats in index order, `slot_offsets` the first slot of every splat. Rows of
/// invisible splats stay unchanged.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "slot_sum",
        spirv: module("slot_sum"),
        bindings: &[
            read("counters"),
            read("listed"),
            read("slot_offsets"),
            read("tile_counts"),
            read("slot_grads"),
            read("slot_normals"),
            write("grad2d"),
            write("grad_normals"),
        ],
        push_bytes: 0,
        constants: &[AUX, PER_TURN],
        local_size: Some(64),
    },
    doc: "One thread owns four columns of one visible splat; a workgroup of 64 threads owns 16 visible splats.",
    dispatch: "four threads per visible splat (16 splats per workgroup)",
    push: &[],
};
