//! Alpha blending front to back, for two tile shapes.

use super::alpha_min::ALPHA_MIN;
use super::{Pass, module};
use crate::vk::{Binding, Constant, Kernel, read, read_write, write};

crate::push_constants! {
    /// Push constants of the blending passes: image size and background colour.
    pub struct Push {
        /// Image width in pixels.
        pub width: u32,
        /// Image height in pixels.
        pub height: u32,
        /// Background, red.
        pub red: f32,
        /// Background, green.
        pub green: f32,
        /// Background, blue.
        pub blue: f32,
    }
}

/// Side of a tile of the COLUMN shape, in pixels.
pub const COLUMN_SIDE: u32 = 8;
/// Side of a tile of the PIXEL shape, in pixels.
pub const PIXEL_SIDE: u32 = 16;

/// Entries of `pair_counts` (4 x u32, never cleared by the passes): evaluated and blended (pixel, splat) pairs of the
/// forward pass, then of the backward pass.
pub const PAIR_COUNTS: usize = 4;

/// Blend depth and normal too (0 or 1).
pub(super) const AUX: Constant = Constant { id: 0, name: "AUX", default: 0 };
/// Count (pixel, splat) pairs in `pair_counts` (0 or 1).
pub(super) const COUNT: Constant = Constant { id: 1, name: "COUNT", default: 0 };

/// Pixels of a block of a tile that splats are tested against: a power of two from 8 to 256 (in the backward pass 128),
/// best the subgroup width; 0 for no test. Only in the PIXEL shape. The backward pass has the results of the test from
/// the forward pass, by `masks`. The test does not change the results.
pub(super) const BLOCK: Constant = Constant { id: 4, name: "BLOCK", default: 0 };

/// Write `masks` for the backward pass (0 or 1).
const MASKS: Constant = Constant { id: 6, name: "MASKS", default: 0 };

/// Most chunks of a tile's list that the backward pass walks in parallel, equal in both passes; 1 for none. Only in the
/// PIXEL shape.
pub(super) const CHUNKS: Constant = Constant { id: 7, name: "CHUNKS", default: 1 };

/// Words of `masks` in the PIXEL shape, for lists of `pairs` pairs in all and blocks of `block` pixels; 0 without blocks.
pub fn mask_words(pairs: u64, tiles: u64, block: u32) -> u64 {
    let pixels = u64::from(PIXEL_SIDE * PIXEL_SIDE);
    if block == 0 { 0 } else { (pairs / 32 + tiles + 1) * (pixels / u64::from(block)) }
}

/// Floats of `states` in the PIXEL shape: for each pixel at the end of every chunk but the last its colour behind and
/// its transmittance, with AUX depth and normal behind too.
pub fn state_floats(tiles: u64, chunks: u32, aux: bool) -> u64 {
    let rows = if aux { 2 } else { 1 };
    u64::from(PIXEL_SIDE * PIXEL_SIDE) * 4 * rows * tiles * u64::from(chunks.saturating_sub(1))
}

/// Keep the largest blending weight of every splat in `weights` (0 or 1).
const WEIGHTS: Constant = Constant { id: 5, name: "WEIGHTS", default: 0 };

/// The pass uses `aux` and `normals` only with AUX, `pair_counts` only with COUNT, and `weights` (bits of floats, which
/// only grow) only with WEIGHTS, `masks` only with MASKS, and `states` only with CHUNKS above 1. All are bound in any case.
const PIXEL_BINDINGS: &[Binding] = &[
    read("splat2d"),
    read("normals"),
    read("sorted_splats"),
    read("tile_ranges"),
    write("image"),
    write("aux"),
    write("last"),
    read_write("pair_counts"),
    read_write("weights"),
    write("masks"),
    read_write("states"),
];

/// Without masks and states.
const BINDINGS: &[Binding] = PIXEL_BINDINGS.split_at(PIXEL_BINDINGS.len() - 2).0;

const fn pass(name: &'static str, local_size: u32, doc: &'static str) -> Pass {
    Pass {
        kernel: Kernel {
            name,
            spirv: module(name),
            bindings: BINDINGS,
            push_bytes: Push::BYTES,
            constants: &[AUX, COUNT, WEIGHTS, ALPHA_MIN],
            local_size: Some(local_size),
        },
        doc,
        dispatch: "one workgroup per tile",
        push: Push::FIELDS,
    }
}

const COLUMN_DOC: &str = "One thread owns a column of 8 pixels; a workgroup of 8 threads owns a tile of 8x8 pixels.";
const PIXEL_DOC: &str = "One thread owns a pixel; a workgroup of 256 threads owns a tile of 16x16 pixels.";

/// For devices with subgroups of width 8: lavapipe.
pub const COLUMN: Pass = pass("blend_forward_column", 8, COLUMN_DOC);
/// COLUMN with its shuffles through shared memory, for any device (EMULATED_WIDTH is fixed at 8).
pub const COLUMN_EMULATED: Pass = with(
    &[AUX, COUNT, super::blend_backward::EMULATED_WIDTH_8, WEIGHTS, ALPHA_MIN],
    pass("blend_forward_column_emulated", 8, COLUMN_DOC),
);
/// For devices with wide subgroups and fast shared memory.
pub const PIXEL: Pass = {
    let pass =
        with(&[AUX, COUNT, BLOCK, MASKS, CHUNKS, WEIGHTS, ALPHA_MIN], pass("blend_forward_pixel", 256, PIXEL_DOC));
    Pass { kernel: Kernel { bindings: PIXEL_BINDINGS, ..pass.kernel }, ..pass }
};

const fn with(constants: &'static [Constant], pass: Pass) -> Pass {
    Pass { kernel: Kernel { constants, ..pass.kernel }, ..pass }
}
