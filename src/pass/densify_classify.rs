//! Decides which splats a density change keeps, clones, splits and prunes.

use super::{Pass, module};
use crate::vk::{Kernel, read, read_write, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Words between the four segments of `flags`: the capacity in splats.
        pub stride: u32,
        /// Mean gradient norm from which a small splat is cloned.
        pub clone_threshold: f32,
        /// Mean gradient norm from which a large splat is split.
        pub split_threshold: f32,
        /// 1: splits use the norm of the absolute gradient (AbsGS); 0: of the signed gradient (3DGS).
        pub split_absolute: u32,
        /// Largest logarithmic scale of a small splat.
        pub split_scale: f32,
        /// Logit of the opacity threshold for pruning.
        pub prune_opacity: f32,
        /// Largest logarithmic scale that is kept.
        pub prune_scale: f32,
        /// 1: prune by `prune_scale`.
        pub prune_large: u32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "densify_classify",
        spirv: module("densify_classify"),
        bindings: &[
            read("counters"),
            read("means"),
            read("quats"),
            read("scales"),
            read("opacities"),
            read("sh0"),
            read("sh1"),
            read("sh2"),
            read("sh3"),
            read("stats"),
            write("flags"),
            read_write("tally"),
        ],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns one splat of the capacity and its flags in the segments kept, clone, first child, second \
          child; a workgroup owns 64 consecutive splats. Flags beyond the model are 0. `tally[0]` counts splats with \
          a non-finite value, which are always pruned.",
    dispatch: "one thread per splat of the capacity",
    push: Push::FIELDS,
};
