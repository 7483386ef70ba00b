//! Windows of a render and of its photograph, for a distance between them, and the way back for its gradient.

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
        /// 1: the render is of the window alone.
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
        /// What the gradient is multiplied by.
        pub weight: f32,
        /// 1: the render is of the window alone.
        pub cropped: u32,
    }
}

/// Render and photograph in the window, one after the other.
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

/// The gradient in the window, which comes in blocks of 2x2 pixels, added to that of the render.
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
