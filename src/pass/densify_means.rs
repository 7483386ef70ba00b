//! The means after a density change.

use super::{Pass, module};
use crate::vk::{Kernel, read, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// The run's seed.
        pub seed: u32,
        /// Number of the density change.
        pub event: u32,
        /// 1: children are placed along the parent's longest axis, or the axis in `map`; 0: children are drawn from the
        /// parent's Gaussian.
        pub along_axis: u32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "densify_means",
        spirv: module("densify_means"),
        bindings: &[
            read("counters"),
            read("map"),
            read("old_ids"),
            read("source"),
            read("quats"),
            read("scales"),
            write("means"),
        ],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns one new row; a workgroup owns 64 consecutive rows. Children of a split are drawn from their \
          parent's Gaussian or stand along one of its axes, other rows keep their source's centre. `source` is a copy \
          of the old means; quats and scales are still the old ones.",
    dispatch: "one thread per new row, through `args`",
    push: Push::FIELDS,
};
