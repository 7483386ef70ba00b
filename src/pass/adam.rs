//! The Adam optimiser on one attribute plane.

use super::{Pass, module};
use crate::vk::{Kernel, read, read_write};

crate::push_constants! {
    /// Push constants of [`PASS`]; see [`Push::new`].
    pub struct Push {
        /// Floats per splat in this plane.
        pub row: u32,
        /// Number of floats at the start of a row that learn at `lr_head`.
        pub head: u32,
        /// Learning rate of the head.
        pub lr_head: f32,
        /// Learning rate of the rest of the row.
        pub lr_rest: f32,
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

/// Settings of Adam (Kingma and Ba 2015). The default is that of the 3DGS reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamSettings {
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Added to the root of the second moment.
    pub eps: f64,
}

impl Default for AdamSettings {
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.999, eps: 1e-15 }
    }
}

impl Push {
    /// The push constants of step `step` (counted from 1) for a plane with rows of `row` floats. The first `head`
    /// floats of a row learn at `lr_head`, the others at `lr_rest`. Bias corrections are computed in double precision.
    pub fn new(settings: &AdamSettings, step: u32, row: u32, head: u32, lr_head: f64, lr_rest: f64) -> Self {
        let t = f64::from(step.max(1));
        Self {
            row,
            head,
            lr_head: lr_head as f32,
            lr_rest: lr_rest as f32,
            beta1: settings.beta1 as f32,
            gain1: (1.0 - settings.beta1) as f32,
            beta2: settings.beta2 as f32,
            gain2: (1.0 - settings.beta2) as f32,
            eps: settings.eps as f32,
            inv_bias1: (1.0 / (1.0 - settings.beta1.powf(t))) as f32,
            inv_sqrt_bias2: (1.0 / (1.0 - settings.beta2.powf(t)).sqrt()) as f32,
        }
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "adam",
        spirv: module("adam"),
        bindings: &[read("counters"), read("grad"), read_write("param"), read_write("first"), read_write("second")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns one float of an attribute plane with its two moments; a workgroup owns 64 consecutive \
          floats. An element with a non-finite gradient stays unchanged.",
    dispatch: "one thread per float: splats of the model x floats per splat",
    push: Push::FIELDS,
};
