//! The saliency of a view's pixels from its mask of reduced size.

use super::{Pass, module};
use crate::vk::{Kernel, read, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Image width in pixels.
        pub width: u32,
        /// Image height in pixels.
        pub height: u32,
        /// Its first row in the image that the mask is of.
        pub top: u32,
        /// Rows of that image.
        pub of_height: u32,
        /// Width of the mask: a byte per value, row after row.
        pub mask_width: u32,
        /// Height of the mask.
        pub mask_height: u32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "saliency_plane",
        spirv: module("saliency_plane"),
        bindings: &[read("mask"), write("saliency")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns a pixel; a workgroup owns 64 consecutive pixels. Linear between the pixels of the mask.",
    dispatch: "one thread per pixel",
    push: Push::FIELDS,
};
