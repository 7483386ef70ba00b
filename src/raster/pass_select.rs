//! Selection of the kernels for a variant set on a device.

use super::variants::{COLUMN_WIDTH, GradientSum, TileShape, Variants};
use crate::pass::{Pass, blend_backward as backward, blend_forward as forward};
use crate::pass::{emit_tiles, project, tile_offsets, tile_sort};
use crate::vk::{DeviceKind, Error, Gpu, Result, Subgroup};

/// A pass, with the constants that depend on the device and the variants.
pub(super) struct ChosenPass {
    pub(super) pass: &'static Pass,
    pub(super) constants: Vec<(&'static str, u32)>,
}

impl ChosenPass {
    fn plain(pass: &'static Pass) -> Self {
        Self { pass, constants: Vec::new() }
    }

    fn with(pass: &'static Pass, constants: &[(&'static str, u32)]) -> Self {
        Self { pass, constants: constants.to_vec() }
    }
}

fn columns_by_hardware(gpu: &Gpu) -> bool {
    gpu.caps().subgroup == Subgroup::Hardware(COLUMN_WIDTH)
}

/// Pixels of a block that splats are tested against: the pixels of one subgroup.
pub(super) fn block(gpu: &Gpu) -> (&'static str, u32) {
    ("BLOCK", gpu.caps().subgroup.width().clamp(8, 128))
}

/// The passes of lists that are sorted in tiles.
pub(super) struct ListPasses {
    pub(super) offsets: ChosenPass,
    pub(super) emit: ChosenPass,
    pub(super) sort: ChosenPass,
}

pub(super) fn list_passes(gpu: &Gpu) -> ListPasses {
    match gpu.caps().subgroup {
        Subgroup::Hardware(_) => ListPasses {
            offsets: ChosenPass::plain(&tile_offsets::PASS),
            emit: ChosenPass::plain(&emit_tiles::PASS),
            sort: ChosenPass::plain(&tile_sort::PASS),
        },
        Subgroup::Emulated(width) => {
            let width = &[("EMULATED_WIDTH", width)];
            ListPasses {
                offsets: ChosenPass::with(&tile_offsets::EMULATED, width),
                emit: ChosenPass::with(&emit_tiles::EMULATED, width),
                sort: ChosenPass::with(&tile_sort::EMULATED, width),
            }
        }
    }
}

/// The projection for models in 32 bits.
pub(super) fn projection(gpu: &Gpu) -> &'static Pass {
    if columns_by_hardware(gpu) && gpu.caps().kind == DeviceKind::Cpu { &project::SPARSE } else { &project::PASS }
}

/// The forward pass.
pub(super) fn blend_forward(gpu: &Gpu, variants: Variants) -> ChosenPass {
    match variants.tile {
        TileShape::Column if columns_by_hardware(gpu) => ChosenPass::plain(&forward::COLUMN),
        TileShape::Column => ChosenPass::plain(&forward::COLUMN_EMULATED),
        TileShape::Pixel => ChosenPass::with(&forward::PIXEL, &[block(gpu)]),
    }
}

/// The backward pass. Fails with [`Error::MissingFeature`] when the device cannot run the variant.
pub(super) fn blend_backward(gpu: &Gpu, variants: Variants) -> Result<ChosenPass> {
    use GradientSum::{Atomic, CompareAndSwap, Slots};
    use TileShape::{Column, Pixel};
    let lacks = |feature: &'static str, what: &str| {
        Err(Error::MissingFeature { feature, needed_for: what.to_owned(), device: gpu.caps().device.clone() })
    };
    let hardware = matches!(gpu.caps().subgroup, Subgroup::Hardware(_));
    let block = block(gpu);
    let width = ("EMULATED_WIDTH", gpu.caps().subgroup.width());
    Ok(match (variants.tile, variants.gradients) {
        (Column, Slots) if columns_by_hardware(gpu) => ChosenPass::plain(&backward::COLUMN_SLOTS),
        (Column, Slots) => ChosenPass::plain(&backward::COLUMN_EMULATED_SLOTS),
        (Column, Atomic) if columns_by_hardware(gpu) => ChosenPass::plain(&backward::COLUMN_ATOMIC),
        (Column, CompareAndSwap) if columns_by_hardware(gpu) => ChosenPass::plain(&backward::COLUMN_CAS),
        (Column, _) => {
            return lacks("subgroups of width 8", "gradients of column tiles without slots");
        }
        (Pixel, Slots) if hardware => ChosenPass::with(&backward::PIXEL_SLOTS, &[block]),
        (Pixel, Slots) => ChosenPass::with(&backward::PIXEL_EMULATED_SLOTS, &[width]),
        (Pixel, Atomic) if hardware => ChosenPass::with(&backward::PIXEL_ATOMIC, &[block]),
        (Pixel, CompareAndSwap) if hardware => ChosenPass::with(&backward::PIXEL_CAS, &[block]),
        (Pixel, CompareAndSwap) => ChosenPass::with(&backward::PIXEL_EMULATED_CAS, &[width]),
        (Pixel, Atomic) => return lacks("subgroup operations", "gradients summed by float atomics"),
    })
}
