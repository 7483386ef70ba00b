//! Windows of a render and of its photograph for a perceptual distance, and the reverse for the gradient.

use super::{Pass, module};
use crate::vk::{Kernel, read, read_write, write};

crate::push_constants! {
    /// Push constants of [`PAIR`].
    pub struct Push {
        /// Width of the photograph in pixels.
        pub image_width: u32,
        /// First column of the window.
        pub left: u32,
        /// First row of the window.
        pub top: u32,
        /// Width of the window in pixels.
        pub width: u32,
        /// Height of the window in pixels.
        pub height: u32,
        /// 1: the render covers only the window.
        pub cropped: u32,
    }
}

crate::push_constants! {
    /// Push constants of [`GRADIENT`].
    pub struct GradientPush {
        /// Width of the photograph in pixels.
        pub image_width: u32,
        /// First column of the window.
        pub left: u32,
        /// First row of the window.
        pub top: u32,
        /// Width of the window in pixels.
        pub width: u32,
        /// Height of the window in pixels.
        pub height: u32,
        /// Factor of the gradient.
        pub weight: f32,
        /// 1: the render covers only the window.
        pub cropped: u32,
    }
}

/// Copies the window of the render, then the window of the photograph, into one buffer.
pub const PAIR: Pass = Pass {
    kernel: Kernel {
        name: "crop_pair",
        spirv: module("crop_pair"),
        bindings: &[read("image"), read("target"), write("pair")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns a pixel of the window; a workgroup owns 64 consecutive pixels.",
    dispatch: "one thread per pixel of the window",
    push: Push::FIELDS,
};

/// Adds the gradient of the window, given in blocks of 2x2 pixels, to the gradient of the render.
pub const GRADIENT: Pass = Pass {
    kernel: Kernel {
        name: "crop_gradient",
        spirv: module("crop_gradient"),
        bindings: &[read("blocks"), read("target"), read_write("grad_image")],
        push_bytes: GradientPush::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns a pixel of the window; a workgroup owns 64 consecutive pixels.",
    dispatch: "one thread per pixel of the window",
    push: GradientPush::FIELDS,
};
