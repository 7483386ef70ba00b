//! L1 + SSIM between a render and a photograph, value and gradient, in three passes per channel and a sum.
//!
//! `rows`, `columns` and `grad` run for one channel after the other on one buffer of a vec4 per pixel.

use super::{Pass, module};
use crate::twin::{TwinCall, loss as twin};
use crate::vk::{Binding, Kernel, read, read_write, write};

/// Pixels of a row that one thread owns.
pub const RUN: u32 = 64;
/// Floats of a slot of the `loss` ring: total, L1, SSIM, and one that is not written.
pub const SLOT_FLOATS: u32 = 4;

crate::push_constants! {
    /// Push constants of [`ROWS`], [`COLUMNS`] and [`GRAD`].
    pub struct Push {
        /// Image width in pixels.
        pub width: u32,
        /// Image height in pixels.
        pub height: u32,
        /// Channel, 0 to 2.
        pub channel: u32,
        /// Weight of 1 - SSIM; L1 has the rest.
        pub lambda: f32,
    }
}

crate::push_constants! {
    /// Push constants of [`SUM`].
    pub struct SumPush {
        /// Image width in pixels.
        pub width: u32,
        /// Image height in pixels.
        pub height: u32,
        /// Floats in `ssim_parts`.
        pub ssim_count: u32,
        /// Floats in `l1_parts`.
        pub l1_count: u32,
        /// Slot of the ring to write.
        pub slot: u32,
        /// Weight of 1 - SSIM.
        pub lambda: f32,
    }
}

/// Threads of [`ROWS`] and [`GRAD`]: one per run.
pub const fn runs(width: u32, height: u32) -> u32 {
    width.div_ceil(RUN) * height
}

/// Floats of `ssim_parts`.
pub const fn ssim_parts(width: u32) -> u32 {
    3 * width
}

/// Floats of `l1_parts`.
pub const fn l1_parts(width: u32, height: u32) -> u32 {
    3 * runs(width, height)
}

const fn pass(
    name: &'static str,
    bindings: &'static [Binding],
    doc: &'static str,
    dispatch: &'static str,
    run: fn(&mut TwinCall<'_>),
) -> Pass {
    Pass {
        kernel: Kernel {
            name,
            spirv: module(name),
            bindings,
            push_bytes: Push::BYTES,
            constants: &[],
            local_size: Some(8),
        },
        doc,
        dispatch,
        push: Push::FIELDS,
        twin: run,
    }
}

/// The window along rows of the moments of one channel.
pub const ROWS: Pass = pass(
    "loss_rows",
    &[read("image"), read("target"), write("planes")],
    "One thread owns a run of 64 pixels of a row; a workgroup of 8 threads owns the runs of 8 consecutive rows.",
    "one thread per run",
    twin::run_rows,
);

/// The window along columns, SSIM, its derivatives, and the window along columns of those, in place.
pub const COLUMNS: Pass = pass(
    "loss_columns",
    &[read_write("planes"), write("ssim_parts")],
    "One thread owns a column; a workgroup of 8 threads owns 8 consecutive columns.",
    "one thread per column",
    twin::run_columns,
);

/// The window along rows of the derivatives, and the gradient with respect to the render.
pub const GRAD: Pass = pass(
    "loss_grad",
    &[read("image"), read("target"), read("planes"), write("grad_image"), write("l1_parts")],
    "One thread owns a run of 64 pixels of a row; a workgroup of 8 threads owns the runs of 8 consecutive rows.",
    "one thread per run",
    twin::run_grad,
);

/// The parts of the loss added up, in a fixed order.
pub const SUM: Pass = Pass {
    kernel: Kernel {
        name: "loss_sum",
        spirv: module("loss_sum"),
        bindings: &[read("ssim_parts"), read("l1_parts"), write("loss")],
        push_bytes: SumPush::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns every 64th part of the loss; there is one workgroup.",
    dispatch: "one workgroup",
    push: SumPush::FIELDS,
    twin: twin::run_sum,
};
