//! The centres after a density change.

use super::{Pass, module};
use crate::vk::{Kernel, read, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// The run's seed.
        pub seed: u32,
        /// Number of the event.
        pub event: u32,
        /// 1: children stand along their parent's longest axis, or along that which the map notes; 0:
        /// they are drawn from its Gaussian.
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
          of the old centres; rotations and scales are still the old ones.",
    dispatch: "one thread per new row, through `args`",
    push: Push::FIELDS,
};
