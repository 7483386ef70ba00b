//! Moves one plane to its rows after a density change.

use super::{Pass, module};
use crate::vk::{Constant, Kernel, read, write};

/// Copies every row from its source.
pub const MODE_COPY: u32 = 0;
/// Logarithmic scales: children of a split are 1.6 times smaller.
pub const MODE_SHRINK: u32 = 1;
/// Moments of the optimiser: zero for new rows.
pub const MODE_MOMENT: u32 = 2;
/// Statistics: zero for all rows.
pub const MODE_ZERO: u32 = 3;
/// Logarithmic scales: children are shorter along the split axis, so that both together have the covariance of the
/// parent.
pub const MODE_SHRINK_AXIS: u32 = 4;
/// Opacity logits: two children along an axis together match the parent's opacity at the parent's centre, and every
/// opacity is multiplied by `keep`.
pub const MODE_SHARE: u32 = 5;

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// One of the modes of this module.
        pub mode: u32,
        /// Factor of opacities in [`MODE_SHARE`].
        pub keep: f32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "densify_gather",
        spirv: module("densify_gather"),
        bindings: &[read("counters"), read("map"), read("source"), write("plane")],
        push_bytes: Push::BYTES,
        constants: &[Constant { id: 0, name: "WIDTH", default: 1 }],
        local_size: Some(64),
    },
    doc: "One thread owns one new row of WIDTH words; a workgroup owns 64 consecutive rows. `source` is a copy of the \
          plane before the change.",
    dispatch: "one thread per new row, through `args`",
    push: Push::FIELDS,
};
