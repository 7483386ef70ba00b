//! Source and identity of every row of the model after a density change.

use super::{Pass, module};
use crate::vk::{Kernel, read, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Words between the four segments of `flags` and of `offsets`.
        pub stride: u32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "densify_map",
        spirv: module("densify_map"),
        bindings: &[read("counters"), read("flags"), read("offsets"), read("old_ids"), write("map"), write("ids")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns one old splat and writes the rows that it becomes; a workgroup owns 64 consecutive old \
          splats. An entry of `map` is the source's index, with the kind of row (kept, clone, first child, second \
          child) in the upper two bits; `densify_axes` uses the two below.",
    dispatch: "one thread per old splat, through `args`",
    push: Push::FIELDS,
};
