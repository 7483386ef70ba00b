//! Exposures: affine colour transforms of photographs between blend and loss, with their own optimiser.
//!
//! A camera exposes each photograph differently, and the model should not learn the exposure. So photograph v is
//! compared with `E_v (r, g, b, 1)` of the render, with a 3x4 matrix E_v (idea: the exposure compensation of the 3DGS
//! reference). The buffer stores deviations D: `E_v = I + D_v - mean of all D`. The mean of E over photographs is
//! therefore always the identity, and the model learns what all photographs share. A step uses the photograph's
//! gradient minus the mean of the last gradients of all photographs, which is the gradient of the summed loss with
//! respect to D. So a model that is too dark or too bright as a whole moves no exposure.

use super::{Pass, adam, module};
use crate::vk::{Kernel, read, read_write, write};

/// Numbers of a matrix, row-major.
pub const NUMBERS: usize = 12;
/// Floats of a row of `exposures`: deviation, two moments and the last gradient. Photograph v has row v. The row after
/// the last photograph begins with the mean.
pub const ROW: usize = 4 * NUMBERS;
/// Pixels that a workgroup of the passes over pixels owns.
pub const PIXELS: u32 = 1024;

crate::push_constants! {
    /// Push constants of the passes over pixels.
    pub struct Push {
        /// Pixels of the image.
        pub pixels: u32,
        /// Row of the photograph.
        pub view: u32,
        /// Number of photographs.
        pub views: u32,
    }
}

crate::push_constants! {
    /// Push constants of [`STEP`]; see [`StepPush::new`].
    pub struct StepPush {
        /// Rows of 12 in `exposure_parts`.
        pub parts: u32,
        /// Row of the photograph.
        pub view: u32,
        /// Number of photographs.
        pub views: u32,
        /// Number of photographs seen so far, including this photograph.
        pub known: u32,
        /// Learning rate.
        pub lr: f32,
        /// Decay of the first moment.
        pub beta1: f32,
        /// 1 - beta1.
        pub gain1: f32,
        /// Decay of the second moment.
        pub beta2: f32,
        /// 1 - beta2.
        pub gain2: f32,
        /// Added to the root of the second moment.
        pub eps: f32,
        /// 1 / (1 - beta1^t).
        pub inv_bias1: f32,
        /// 1 / sqrt(1 - beta2^t).
        pub inv_sqrt_bias2: f32,
    }
}

impl StepPush {
    /// The step of row `view` of `views`, a photograph of `pixels` pixels. `known` photographs have been seen so far,
    /// and this photograph `seen` times, both including this time.
    pub fn new(
        settings: &adam::AdamSettings,
        pixels: u32,
        [view, views]: [u32; 2],
        [known, seen]: [u32; 2],
        lr: f64,
    ) -> Self {
        let a = adam::Push::new(settings, seen, NUMBERS as u32, 0, lr, lr);
        Self {
            parts: parts(pixels),
            view,
            views,
            known: known.max(1),
            lr: a.lr_rest,
            beta1: a.beta1,
            gain1: a.gain1,
            beta2: a.beta2,
            gain2: a.gain2,
            eps: a.eps,
            inv_bias1: a.inv_bias1,
            inv_sqrt_bias2: a.inv_sqrt_bias2,
        }
    }
}

/// Workgroups of the passes over pixels, and rows of 12 floats that [`BACKWARD`] writes.
pub fn parts(pixels: u32) -> u32 {
    pixels.div_ceil(PIXELS)
}

/// Floats of `exposures` for `views` photographs.
pub fn floats(views: usize) -> usize {
    ROW * (views + 1)
}

/// The render under a photograph's exposure.
pub const APPLY: Pass = Pass {
    kernel: Kernel {
        name: "exposure_apply",
        spirv: module("exposure_apply"),
        bindings: &[read("image"), read("exposures"), write("exposed")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns 16 pixels, every 64th of the 1024 consecutive ones of its workgroup.",
    dispatch: "one workgroup per 1024 pixels",
    push: Push::FIELDS,
};

/// Gradients of the render and of the photograph's matrix.
pub const BACKWARD: Pass = Pass {
    kernel: Kernel {
        name: "exposure_backward",
        spirv: module("exposure_backward"),
        bindings: &[read("image"), read("exposures"), read_write("grad_image"), write("exposure_parts")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns 16 pixels, every 64th of the 1024 consecutive ones of its workgroup, which owns a row of 12 \
        partial sums.",
    dispatch: "one workgroup per 1024 pixels",
    push: Push::FIELDS,
};

/// The optimiser's step of a photograph's matrix.
pub const STEP: Pass = Pass {
    kernel: Kernel {
        name: "exposure_step",
        spirv: module("exposure_step"),
        bindings: &[read("exposure_parts"), read_write("exposures")],
        push_bytes: StepPush::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "Threads below 60 own a fifth of the parts and photographs of one of 12 numbers; threads below 12 own its \
        step and mean.",
    dispatch: "one workgroup",
    push: StepPush::FIELDS,
};
