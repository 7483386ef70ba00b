//! Gradients of the blended image with respect to the projected splats, for two tile shapes and three ways of
//! summation.

use super::alpha_min::ALPHA_MIN;
use super::blend_forward::{AUX, BLOCK, CHUNKS, COUNT, Push};
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
const PIXEL_CONSTANTS: &[Constant] = &[AUX, COUNT, ABS, CLAMP_GRADIENT_PASSES, BLOCK, CHUNKS, ALPHA_MIN];
const EMULATED_CONSTANTS: &[Constant] = &[AUX, COUNT, ABS, CLAMP_GRADIENT_PASSES, EMULATED_WIDTH, CHUNKS, ALPHA_MIN];

/// Slots: the pass writes every row of `slot_grads` of a pair in the tile lists, zeros included, and no other row. The
/// pass also reads `slot_grads`, but only to prefetch the row.
const SLOT_BINDINGS: &[Binding; 12] = &[
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
const SUM_BINDINGS: &[Binding; 11] = &[
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

/// Bindings `FROM`, with those of what the forward pass keeps: `masks`, used only with BLOCK, and `states`, used only with
/// CHUNKS above 1. Emulated subgroups have no masks.
const fn kept<const N: usize, const M: usize>(from: &[Binding; N], masks: bool) -> [Binding; M] {
    let mut all = [read("states"); M];
    let mut i = 0;
    while i < N {
        all[i] = from[i];
        i += 1;
    }
    if masks {
        all[N] = read("masks");
    }
    all
}

const PIXEL_SLOT_BINDINGS: &[Binding] = &kept::<12, 14>(SLOT_BINDINGS, true);
const PIXEL_SUM_BINDINGS: &[Binding] = &kept::<11, 13>(SUM_BINDINGS, true);
const EMULATED_SLOT_BINDINGS: &[Binding] = &kept::<12, 13>(SLOT_BINDINGS, false);
const EMULATED_SUM_BINDINGS: &[Binding] = &kept::<11, 12>(SUM_BINDINGS, false);

/// Whether a thread owns a column or two pixels.
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
            local_size: Some(if matches!(owned, Owned::Columns) { 8 } else { 128 }),
        },
        doc: match owned {
            Owned::Columns => {
                "One thread owns a column of 8 pixels; a workgroup of 8 threads owns a tile of 8x8 pixels."
            }
            Owned::Pixels => {
                "One thread owns two pixels; a workgroup of 128 threads owns a tile of 16x16 pixels, with CHUNKS one chunk \
                 of its list."
            }
        },
        dispatch: match owned {
            Owned::Columns => "one workgroup per tile",
            Owned::Pixels => "CHUNKS workgroups per tile",
        },
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
/// PIXEL shape, subgroup sums to slots: deterministic for a given subgroup width.
pub const PIXEL_SLOTS: Pass = pass("blend_backward_pixel_slots", Owned::Pixels, PIXEL_SLOT_BINDINGS, PIXEL_CONSTANTS);
/// PIXEL shape, subgroup sums and native float atomics (needs `shaderBufferFloat32AtomicAdd`).
pub const PIXEL_ATOMIC: Pass = pass("blend_backward_pixel_atomic", Owned::Pixels, PIXEL_SUM_BINDINGS, PIXEL_CONSTANTS);
/// PIXEL shape, subgroup sums and compare-and-swap.
pub const PIXEL_CAS: Pass = pass("blend_backward_pixel_cas", Owned::Pixels, PIXEL_SUM_BINDINGS, PIXEL_CONSTANTS);
/// PIXEL shape, sums of emulated subgroups to slots. All threads walk every splat.
pub const PIXEL_EMULATED_SLOTS: Pass =
    pass("blend_backward_pixel_emulated_slots", Owned::Pixels, EMULATED_SLOT_BINDINGS, EMULATED_CONSTANTS);
/// PIXEL shape, emulated subgroups of any width and compare-and-swap: needs no optional feature.
pub const PIXEL_EMULATED_CAS: Pass =
    pass("blend_backward_pixel_emulated_cas", Owned::Pixels, EMULATED_SUM_BINDINGS, EMULATED_CONSTANTS);
