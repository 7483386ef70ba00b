//! Loss on gradient maps of render and photograph: correlation in windows, and total variation of the residual.
//!
//! [`crate::loss::GradientMapLoss`] composes the passes. [`SOBEL`] computes the maps, and [`WINDOWS`] correlates them
//! in windows. [`super::part_sum`] adds the windows to the totals for [`GRAD`]. GRAD adds to `grad_image`, and its
//! parts add up to the loss: (correlation term, variation, mean correlation, sum of both terms). The formulas are in
//! `glsl/include/gradient_map.glsl`. GRAD follows the pass that overwrites `grad_image`. For a photograph with
//! exposure, the image is the exposed image, and the exposure's backward pass comes after.
//!
//! Source: PSRGS (correlation of gradient maps, total variation). The variation is taken of the residual, not of the
//! render, because the variation of the render would blur texture.

use super::{Pass, module};
use crate::vk::{Constant, Kernel, read, read_write, write};

crate::push_constants! {
    /// Push constants of the three passes.
    pub struct Push {
        /// Image width in pixels.
        pub width: u32,
        /// Image height in pixels.
        pub height: u32,
        /// Width of the mask, used only when MASK is 1. The mask covers the same view.
        pub mask_width: u32,
        /// Height of the mask.
        pub mask_height: u32,
        /// Weight of 1 - the mean correlation.
        pub weight: f32,
        /// Weight of the residual's total variation, a mean over pixels and channels.
        pub tv_weight: f32,
        /// Number of values in the variation's mean: see [`super::loss::values`].
        pub values: f32,
    }
}

/// Side of a window in pixels.
pub const WINDOW_SIDE: u32 = 32;
/// Pixels that a workgroup of [`GRAD`] owns.
pub const PIXELS: u32 = 4096;

/// Workgroups of [`WINDOWS`], and rows of four floats in `windows`.
pub const fn windows(width: u32, height: u32) -> u32 {
    width.div_ceil(WINDOW_SIDE) * height.div_ceil(WINDOW_SIDE)
}

/// Workgroups of [`GRAD`].
pub const fn groups(width: u32, height: u32) -> u32 {
    (width * height).div_ceil(PIXELS)
}

/// Rows of four floats in the parts of [`GRAD`].
pub const fn parts(width: u32, height: u32) -> u32 {
    64 * groups(width, height)
}

/// 1: a mask M is bound; 0: M = 1.
const MASK: Constant = Constant { id: 0, name: "MASK", default: 0 };
/// 0: leaves out the residual's variation.
const VARIATION: Constant = Constant { id: 0, name: "VARIATION", default: 1 };
/// 1: gradient maps are compared with those of another render; 0: with those of the photograph.
const OTHER: Constant = Constant { id: 3, name: "OTHER", default: 0 };
const PHOTOGRAPH_BITS: Constant = Constant { id: 2, name: "PHOTOGRAPH_BITS", default: 8 };

/// Gradient maps.
pub const SOBEL: Pass = Pass {
    kernel: Kernel {
        name: "gradient_map_sobel",
        spirv: module("gradient_map_sobel"),
        bindings: &[read("image"), read("target"), read("other"), write("maps")],
        push_bytes: Push::BYTES,
        constants: &[PHOTOGRAPH_BITS, OTHER],
        local_size: Some(64),
    },
    doc: "One thread owns a pixel.",
    dispatch: "one thread per pixel",
    push: Push::FIELDS,
};

/// Correlations per window; overwrites the maps with the derivatives.
pub const WINDOWS: Pass = Pass {
    kernel: Kernel {
        name: "gradient_map_windows",
        spirv: module("gradient_map_windows"),
        bindings: &[read("mask"), read_write("maps"), write("windows")],
        push_bytes: Push::BYTES,
        constants: &[MASK],
        local_size: Some(64),
    },
    doc: "One workgroup owns a window of 32x32 pixels; one thread owns 16 pixels of it.",
    dispatch: "one workgroup per window",
    push: Push::FIELDS,
};

/// Loss and gradient.
pub const GRAD: Pass = Pass {
    kernel: Kernel {
        name: "gradient_map_grad",
        spirv: module("gradient_map_grad"),
        bindings: &[
            read("image"),
            read("target"),
            read("maps"),
            read("totals"),
            read_write("grad_image"),
            write("parts"),
        ],
        push_bytes: Push::BYTES,
        constants: &[VARIATION, PHOTOGRAPH_BITS],
        local_size: Some(64),
    },
    doc: "One thread owns 64 pixels and a row of four sums; a workgroup owns 4096 consecutive pixels. Adds to the \
        gradient of the image.",
    dispatch: "one workgroup per 4096 pixels",
    push: Push::FIELDS,
};
