//! Saliency per pixel of a view, interpolated from a mask of reduced size.

use super::{Pass, module};
use crate::vk::{Kernel, read, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Image width in pixels.
        pub width: u32,
        /// Image height in pixels.
        pub height: u32,
        /// First row of this image in the full image that the mask covers.
        pub top: u32,
        /// Rows of the full image.
        pub of_height: u32,
        /// Width of the mask (one byte per value, row-major).
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
