//! Max pooling, 3x3 with stride 2, with windows that may extend past the border (ceil mode), and its gradient.

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
        /// Number of images, 1 or 2, stored one after the other.
        pub images: u32,
    }
}

crate::push_constants! {
    /// Push constants of [`BACKWARD`], for one image.
    pub struct BackwardPush {
        /// Width of the source of the forward pass in pixels.
        pub in_width: u32,
        /// Height of the source of the forward pass in pixels.
        pub in_height: u32,
        /// Width of the result of the forward pass in pixels.
        pub out_width: u32,
        /// Height of the result of the forward pass in pixels.
        pub out_height: u32,
        /// Rows of four channels in a pixel.
        pub quads: u32,
        /// Sum of [`FLAG_ADD`] and [`FLAG_GATE`].
        pub flags: u32,
    }
}

/// Side of the result in pixels for a source of `side` pixels, at least 2.
pub const fn pooled(side: u32) -> u32 {
    side / 2
}

/// The largest of 3x3 values, and its index in the window.
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

/// Passes the gradient of every maximum to the source pixel of the maximum.
pub const BACKWARD: Pass = Pass {
    kernel: Kernel {
        name: "pool_backward",
        spirv: module("pool_backward"),
        bindings: &[read("grad_out"), read("winners"), read("gate"), read_write("grad_in")],
        push_bytes: BackwardPush::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns four channels of an input pixel and reads the windows that cover the pixel; a \
        workgroup owns 64 consecutive threads.",
    dispatch: "one thread per pixel and four channels of the source",
    push: BackwardPush::FIELDS,
};
