//! Which kernel of the blending passes a variant set means on a device.

use super::variants::{Backward, COLUMN_WIDTH, GradientSum, TileShape, Variants};
use crate::pass::{Pass, blend_backward as backward, blend_forward as forward};
use crate::vk::{Error, Gpu, Result, Subgroup};

/// A pass, and the width of its emulated subgroups where that is to be told.
pub(super) type Chosen = (&'static Pass, Option<(&'static str, u32)>);

fn columns_by_hardware(gpu: &Gpu) -> bool {
    gpu.caps().subgroup == Subgroup::Hardware(COLUMN_WIDTH)
}

/// The forward pass.
pub(super) fn blend_forward(gpu: &Gpu, tile: TileShape) -> Chosen {
    match tile {
        TileShape::Column if columns_by_hardware(gpu) => (&forward::COLUMN, None),
        TileShape::Column => (&forward::COLUMN_EMULATED, None),
        TileShape::Pixel => (&forward::PIXEL, None),
    }
}

/// The backward pass; an error where the device has no way to run this form.
pub(super) fn blend_backward(gpu: &Gpu, variants: Variants) -> Result<Chosen> {
    use Backward::{PerPixel, PerSplat};
    use GradientSum::{Atomic, CompareAndSwap, Slots};
    use TileShape::{Column, Pixel};
    let lacks = |feature: &'static str, what: &str| {
        Err(Error::MissingFeature { feature, needed_for: what.to_owned(), device: gpu.caps().device.clone() })
    };
    let hardware = matches!(gpu.caps().subgroup, Subgroup::Hardware(_));
    let emulated = |pass: &'static Pass| Ok((pass, Some(("EMULATED_WIDTH", gpu.caps().subgroup.width()))));
    match (variants.tile, variants.backward, variants.gradients) {
        (Column, PerSplat, _) => lacks("pixel tiles", "a backward per splat"),
        (Column, PerPixel, Slots) if columns_by_hardware(gpu) => Ok((&backward::COLUMN_SLOTS, None)),
        (Column, PerPixel, Slots) => Ok((&backward::COLUMN_EMULATED_SLOTS, None)),
        (Column, PerPixel, Atomic) if columns_by_hardware(gpu) => Ok((&backward::COLUMN_ATOMIC, None)),
        (Column, PerPixel, CompareAndSwap) if columns_by_hardware(gpu) => Ok((&backward::COLUMN_CAS, None)),
        (Column, PerPixel, _) => lacks("subgroups of width 8", "gradients of column tiles summed other than in slots"),
        (Pixel, PerPixel, Slots) => Ok((&backward::PIXEL_SLOTS, None)),
        (Pixel, PerPixel, Atomic) if hardware => Ok((&backward::PIXEL_ATOMIC, None)),
        (Pixel, PerPixel, CompareAndSwap) if hardware => Ok((&backward::PIXEL_CAS, None)),
        (Pixel, PerPixel, CompareAndSwap) => emulated(&backward::PIXEL_EMULATED_CAS),
        (Pixel, PerSplat, Slots) if hardware => Ok((&backward::SPLAT_SLOTS, None)),
        (Pixel, PerSplat, Slots) => emulated(&backward::SPLAT_EMULATED_SLOTS),
        (Pixel, PerSplat, Atomic) if hardware => Ok((&backward::SPLAT_ATOMIC, None)),
        (Pixel, PerSplat, CompareAndSwap) if hardware => Ok((&backward::SPLAT_CAS, None)),
        (Pixel, PerSplat, CompareAndSwap) => emulated(&backward::SPLAT_EMULATED_CAS),
        (Pixel, _, Atomic) => lacks("subgroup operations", "gradients summed by float atomics"),
    }
}
