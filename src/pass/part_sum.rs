//! Sums rows of four floats in a fixed order.

use super::{Pass, module};
use crate::vk::{Kernel, read, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Rows to add up.
        pub count: u32,
        /// Row of the result to write.
        pub slot: u32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "part_sum",
        spirv: module("part_sum"),
        bindings: &[read("parts"), write("part_sums")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns every 64th row; there is one workgroup.",
    dispatch: "one workgroup",
    push: Push::FIELDS,
};
