//! Decides which splats a density change keeps, splits and prunes, for sampled growth.

use super::{Pass, module};
use crate::vk::{Kernel, read, read_write, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Words between the four segments of `flags`: the capacity in splats.
        pub stride: u32,
        /// Least mean gradient norm for a split of a low-frequency splat (mask value 0).
        pub low_threshold: f32,
        /// Least mean gradient norm for a split of a high-frequency splat (mask value 1). Linear in the mask value
        /// between.
        pub high_threshold: f32,
        /// 1: uses the norm of the absolute gradient; 0: of the signed gradient.
        pub absolute: u32,
        /// Probability of a split at the threshold, for mask value 1 and error share 1.
        pub rate: f32,
        /// Part of the probability that is proportional to the mask value, from 0 to 1.
        pub mask_share: f32,
        /// Part of the probability that is proportional to the share of views in which the splat is wrong, from 0 to 1.
        pub error_share: f32,
        /// Logit of the opacity threshold for pruning.
        pub prune_opacity: f32,
        /// Largest logarithmic scale that is kept.
        pub prune_scale: f32,
        /// 1: prune by `prune_scale`.
        pub prune_large: u32,
        /// 1: prune splats that have blended into no pixel since the last change.
        pub prune_unseen: u32,
        /// The run's seed.
        pub seed: u32,
        /// Number of the density change.
        pub event: u32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "densify_sample",
        spirv: module("densify_sample"),
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
            read("scores"),
            read("ids"),
            write("flags"),
            read_write("tally"),
        ],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns one splat of the capacity and its flags in the segments kept, clone, first child, second \
          child; a workgroup owns 64 consecutive splats. Flags beyond the model are 0, and nothing is cloned. \
          `scores` holds (sum of mask value times absolute gradient norm, views in which the render is wrong). \
          `tally[0]` counts splats with a non-finite value, which are always pruned.",
    dispatch: "one thread per splat of the capacity",
    push: Push::FIELDS,
};
