//! Which kernel of the blending passes a variant set means on a device.

use super::variants::{COLUMN_WIDTH, GradientSum, TileShape, Variants};
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
    use GradientSum::{Atomic, CompareAndSwap, Slots};
    use TileShape::{Column, Pixel};
    let lacks = |feature: &'static str, what: &str| {
        Err(Error::MissingFeature { feature, needed_for: what.to_owned(), device: gpu.caps().device.clone() })
    };
    match (variants.tile, variants.gradients) {
        (Column, Slots) if columns_by_hardware(gpu) => Ok((&backward::COLUMN_SLOTS, None)),
        (Column, Slots) => Ok((&backward::COLUMN_EMULATED_SLOTS, None)),
        (Column, Atomic) if columns_by_hardware(gpu) => Ok((&backward::COLUMN_ATOMIC, None)),
        (Column, CompareAndSwap) if columns_by_hardware(gpu) => Ok((&backward::COLUMN_CAS, None)),
        (Column, _) => lacks("subgroups of width 8", "gradients of column tiles summed other than in slots"),
        (Pixel, Slots) => Ok((&backward::PIXEL_SLOTS, None)),
        (Pixel, sum) => match (gpu.caps().subgroup, sum) {
            (Subgroup::Hardware(_), Atomic) => Ok((&backward::PIXEL_ATOMIC, None)),
            (Subgroup::Hardware(_), _) => Ok((&backward::PIXEL_CAS, None)),
            (Subgroup::Emulated(width), CompareAndSwap) => {
                Ok((&backward::PIXEL_EMULATED_CAS, Some(("EMULATED_WIDTH", width))))
            }
            (Subgroup::Emulated(_), _) => lacks("subgroup operations", "gradients summed by float atomics"),
        },
    }
}
