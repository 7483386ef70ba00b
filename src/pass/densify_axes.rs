//! Axis along which a split separates its children, when growth follows the gradient.

use super::{Pass, module};
use crate::vk::{Kernel, read, read_write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// 1: words of `moments` hold both moments (16 bits each); 0: only first moments.
        pub packed_moments: u32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "densify_axes",
        spirv: module("densify_axes"),
        bindings: &[read("counters"), read("quats"), read("scales"), read("moments"), read_write("map")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns one new row and its entry of `map`; a workgroup owns 64 consecutive rows. Children get the \
          axis of their parent along which the loss changes most over a standard deviation, by the optimiser's first \
          moments of the means, in the two bits below the kind. All planes are still from before the change.",
    dispatch: "one thread per new row, through `args`",
    push: Push::FIELDS,
};
