//! Max pooling, 3x3 with stride 2 and windows that may hang over (ceil mode), and its gradient.

use super::{Pass, module};
use crate::vk::{Kernel, read, read_write, write};

pub use super::convolution::{FLAG_ADD, FLAG_GATE};

crate::push_constants! {
    /// Push constants of [`FORWARD`].
    pub struct Push {
        /// Width of the source in pixels.
        pub in_width: u32,
        /// Height of the source in pixels.
        pub in_height: u32,
        /// Width of the result in pixels.
        pub out_width: u32,
        /// Height of the result in pixels.
        pub out_height: u32,
        /// Rows of four channels in a pixel.
        pub quads: u32,
        /// Images, 1 or 2, one after the other.
        pub images: u32,
    }
}

crate::push_constants! {
    /// Push constants of [`BACKWARD`], which has one image.
    pub struct BackwardPush {
        /// Width of the source of the forward pass in pixels.
        pub in_width: u32,
        /// Its height.
        pub in_height: u32,
        /// Width of the result of the forward pass.
        pub out_width: u32,
        /// Its height.
        pub out_height: u32,
        /// Rows of four channels in a pixel.
        pub quads: u32,
        /// Sum of [`FLAG_ADD`] and [`FLAG_GATE`].
        pub flags: u32,
    }
}

/// Pixels along a side of what is pooled from `side` of them, of which there must be two at least.
pub const fn pooled(side: u32) -> u32 {
    side / 2
}

/// The largest of 3x3 values, and which it was.
pub const FORWARD: Pass = Pass {
    kernel: Kernel {
        name: "pool",
        spirv: module("pool"),
        bindings: &[read("source"), write("result"), write("winners")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns four channels of an output pixel; a workgroup owns 64 consecutive threads.",
    dispatch: "one thread per pixel and four channels of the result",
    push: Push::FIELDS,
};

/// The gradient of every maximum, given to the pixel that it was taken from.
pub const BACKWARD: Pass = Pass {
    kernel: Kernel {
        name: "pool_backward",
        spirv: module("pool_backward"),
        bindings: &[read("grad_out"), read("winners"), read("gate"), read_write("grad_in")],
        push_bytes: BackwardPush::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns four channels of an input pixel and looks at the windows over it; a workgroup owns 64 \
        consecutive threads.",
    dispatch: "one thread per pixel and four channels of the source",
    push: BackwardPush::FIELDS,
};
