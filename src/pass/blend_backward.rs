//! Gradients of the blended image with respect to the projected splats, for two tile shapes and three ways of
//! summation.

use super::alpha_min::ALPHA_MIN;
use super::blend_forward::{AUX, BLOCK, COUNT, Push};
use super::{Pass, module};
use crate::vk::{Binding, Constant, Kernel, read, read_write, write};

/// Sum absolute values of the mean's per-pixel gradient into columns 10 and 11 (0 or 1). With 0 the columns are 0.
pub(super) const ABS: Constant = Constant { id: 2, name: "ABS", default: 1 };
/// Pass the gradient through min(0.99, alpha), as the 3DGS reference does (0 or 1).
pub(super) const CLAMP_GRADIENT_PASSES: Constant = Constant { id: 3, name: "CLAMP_GRADIENT_PASSES", default: 0 };
/// Width of an emulated subgroup in the COLUMN shape, which requires 8.
pub(super) const EMULATED_WIDTH_8: Constant = Constant { id: 100, name: "EMULATED_WIDTH", default: 8 };
const EMULATED_WIDTH: Constant = Constant { id: 100, name: "EMULATED_WIDTH", default: 32 };

const CONSTANTS: &[Constant] = &[AUX, COUNT, ABS, CLAMP_GRADIENT_PASSES, ALPHA_MIN];
const BLOCK_CONSTANTS: &[Constant] = &[AUX, COUNT, ABS, CLAMP_GRADIENT_PASSES, BLOCK, ALPHA_MIN];
const EMULATED_CONSTANTS: &[Constant] = &[AUX, COUNT, ABS, CLAMP_GRADIENT_PASSES, EMULATED_WIDTH, ALPHA_MIN];

/// Slots: the pass writes every row of `slot_grads` of a pair in the tile lists, zeros included, and no other row. The
/// pass also reads `slot_grads`, but only to prefetch the row.
const SLOT_BINDINGS: &[Binding] = &[
    read("splat2d"),
    read("normals"),
    read("sorted_splats"),
    read("tile_ranges"),
    read("image"),
    read("last"),
    read("grad_image"),
    read("grad_aux"),
    read("sorted_slots"),
    read_write("slot_grads"),
    write("slot_normals"),
    read_write("pair_counts"),
];

/// Atomic and compare-and-swap: `grad2d` (and `grad_normals` when AUX) must be zero beforehand.
const SUM_BINDINGS: &[Binding] = &[
    read("splat2d"),
    read("normals"),
    read("sorted_splats"),
    read("tile_ranges"),
    read("image"),
    read("last"),
    read("grad_image"),
    read("grad_aux"),
    read_write("grad2d"),
    read_write("grad_normals"),
    read_write("pair_counts"),
];

/// Whether a thread owns a column or a pixel.
#[derive(Clone, Copy)]
enum Owned {
    Columns,
    Pixels,
}

const fn pass(name: &'static str, owned: Owned, bindings: &'static [Binding], constants: &'static [Constant]) -> Pass {
    Pass {
        kernel: Kernel {
            name,
            spirv: module(name),
            bindings,
            push_bytes: Push::BYTES,
            constants,
            local_size: Some(if matches!(owned, Owned::Columns) { 8 } else { 256 }),
        },
        doc: match owned {
            Owned::Columns => {
                "One thread owns a column of 8 pixels; a workgroup of 8 threads owns a tile of 8x8 pixels."
            }
            Owned::Pixels => "One thread owns a pixel; a workgroup of 256 threads owns a tile of 16x16 pixels.",
        },
        dispatch: "one workgroup per tile",
        push: Push::FIELDS,
    }
}

/// COLUMN shape (subgroups of width 8), partial sums to slots: deterministic, and fastest on lavapipe.
pub const COLUMN_SLOTS: Pass = pass("blend_backward_column_slots", Owned::Columns, SLOT_BINDINGS, CONSTANTS);
/// COLUMN shape, native float atomics (needs `shaderBufferFloat32AtomicAdd`).
pub const COLUMN_ATOMIC: Pass = pass("blend_backward_column_atomic", Owned::Columns, SUM_BINDINGS, CONSTANTS);
/// COLUMN shape, compare-and-swap.
pub const COLUMN_CAS: Pass = pass("blend_backward_column_cas", Owned::Columns, SUM_BINDINGS, CONSTANTS);
/// COLUMN shape with its shuffles through shared memory, slots.
pub const COLUMN_EMULATED_SLOTS: Pass = pass(
    "blend_backward_column_emulated_slots",
    Owned::Columns,
    SLOT_BINDINGS,
    &[AUX, COUNT, ABS, CLAMP_GRADIENT_PASSES, EMULATED_WIDTH_8, ALPHA_MIN],
);
/// PIXEL shape, partial sums to slots: deterministic, sums through shared memory.
pub const PIXEL_SLOTS: Pass = pass("blend_backward_pixel_slots", Owned::Pixels, SLOT_BINDINGS, CONSTANTS);
/// PIXEL shape, subgroup sums to slots: deterministic for a given subgroup width.
pub const PIXEL_APART_SLOTS: Pass =
    pass("blend_backward_pixel_apart_slots", Owned::Pixels, SLOT_BINDINGS, BLOCK_CONSTANTS);
/// PIXEL shape, subgroup sums and native float atomics (needs `shaderBufferFloat32AtomicAdd`).
pub const PIXEL_ATOMIC: Pass = pass("blend_backward_pixel_atomic", Owned::Pixels, SUM_BINDINGS, BLOCK_CONSTANTS);
/// PIXEL shape, subgroup sums and compare-and-swap.
pub const PIXEL_CAS: Pass = pass("blend_backward_pixel_cas", Owned::Pixels, SUM_BINDINGS, BLOCK_CONSTANTS);
/// PIXEL shape, emulated subgroups of any width and compare-and-swap: needs no optional feature.
pub const PIXEL_EMULATED_CAS: Pass =
    pass("blend_backward_pixel_emulated_cas", Owned::Pixels, SUM_BINDINGS, EMULATED_CONSTANTS);
