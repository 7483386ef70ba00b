//! Photometric loss between a render and a photograph: L1 and SSIM, with gradient, in two passes and a sum.
//!
//! A subgroup owns a strip or a row, so partial sums and dispatches depend on the subgroup width: see [`LossLayout`].

use super::{Pass, module};
use crate::vk::{Binding, Constant, Kernel, read, write};

/// Floats of a slot of the `loss` ring: total, L1, SSIM, and one unused.
pub const SLOT_FLOATS: u32 = 4;
/// Least subgroup width for the SSIM window, whose reach must not exceed the neighbouring subgroups.
pub const LEAST_LANES: u32 = 8;
/// Threads in a workgroup of the emulated variants: the width of the widest emulated subgroup.
pub const EMULATED_LOCAL_SIZE: u32 = 64;
/// Least number of threads of [`SUM`]. Devices with long memory latency use a multiple.
pub const SUM_THREADS: u32 = 64;
/// Subgroup width of the emulated variants in training.
pub const EMULATED_LANES: u32 = 32;

crate::push_constants! {
    /// Push constants of the strips and the gradient.
    pub struct Push {
        /// Image width in pixels.
        pub width: u32,
        /// Image height in pixels.
        pub height: u32,
        /// Weight of 1 - SSIM; L1 has the rest.
        pub lambda: f32,
        /// Number of values in the means: see [`values`].
        pub values: f32,
        /// Gradient weight of a pixel with saliency 0; used only when WEIGHTED is 1.
        pub low_weight: f32,
        /// Gradient weight of a pixel with saliency 1; used only when WEIGHTED is 1.
        pub high_weight: f32,
    }
}

crate::push_constants! {
    /// Push constants of [`SUM`].
    pub struct SumPush {
        /// Number of values in the means: see [`values`].
        pub values: f32,
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

/// Number of values in the means: channels times unmasked pixels. `masked` is the number of masked pixels.
pub fn values(width: u32, height: u32, masked: u32) -> f32 {
    match masked {
        0 => 3.0 * width as f32 * height as f32,
        _ => 3.0 * (width * height).saturating_sub(masked).max(1) as f32,
    }
}

/// Number of subgroups that occupies the largest devices, with several per compute unit.
const ENOUGH_STRIPS: u64 = 1000;
/// Rows of the strips of large images.
const LONG: u32 = 64;
/// Rows of the strips of the smallest images.
const SHORT: u32 = 16;

/// How an image is divided among subgroups.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LossLayout {
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Subgroup width: a power of two, at least 8.
    pub lanes: u32,
    /// Rows of a strip: the constant SEGMENT. Each strip reads 10 additional rows, 20 with all channels.
    pub segment: u32,
    /// Subgroups per strip: 3 with one channel each, or 1 with all channels.
    pub apart: u32,
}

impl LossLayout {
    /// The layout for a device's subgroup width. Devices with 8 lanes are CPUs with few cores. Devices with wide
    /// subgroups need many subgroups at work, with few registers each. So a subgroup takes one channel of a strip, and
    /// strips are short in small images, although short strips read more additional rows in total.
    pub const fn new(width: u32, height: u32, lanes: u32) -> Self {
        if lanes <= LEAST_LANES {
            return Self { width, height, lanes, segment: 1024, apart: 1 };
        }
        let mut apart = Self { width, height, lanes, segment: LONG, apart: 3 };
        while apart.segment > SHORT && apart.strips() < ENOUGH_STRIPS {
            apart.segment /= 2;
        }
        apart
    }

    /// Number of subgroups of the strips.
    const fn strips(&self) -> u64 {
        let strips = self.width.div_ceil(self.lanes) as u64 * self.height.div_ceil(self.segment) as u64;
        strips * self.apart as u64
    }

    /// Threads of the strips: one subgroup per strip and share of the channels.
    pub const fn strip_threads(&self) -> u64 {
        self.strips() * self.lanes as u64
    }

    /// Threads of the gradient: one subgroup per row, or with channels apart as many as of the strips.
    pub const fn grad_threads(&self) -> u64 {
        if self.apart > 1 { self.strip_threads() } else { self.height as u64 * self.lanes as u64 }
    }

    /// Floats of `ssim_parts`.
    pub const fn ssim_parts(&self) -> u32 {
        self.height.div_ceil(self.segment) * self.apart * self.width
    }

    /// Floats of `l1_parts`.
    pub const fn l1_parts(&self) -> u32 {
        if self.apart > 1 { self.ssim_parts() } else { self.height * self.lanes }
    }

    /// Floats of each of the three planes.
    pub const fn plane_floats(&self) -> u64 {
        3 * self.width as u64 * self.height as u64
    }
}

const LOCAL_SIZE: Constant = Constant { id: 0, name: "LOCAL_SIZE", default: 8 };
const SEGMENT: Constant = Constant { id: 1, name: "SEGMENT", default: 64 };
const EMULATED_WIDTH: Constant = Constant { id: 100, name: "EMULATED_WIDTH", default: EMULATED_LANES };
/// Bits per channel of the photograph, 8 or 16.
const PHOTOGRAPH_BITS: Constant = Constant { id: 2, name: "PHOTOGRAPH_BITS", default: 8 };

/// 1: pixels are weighted by saliency.
const WEIGHTED: Constant = Constant { id: 3, name: "WEIGHTED", default: 0 };

const STRIPS: &[Binding] = &[
    read("image"),
    read("target"),
    write("red_planes"),
    write("green_planes"),
    write("blue_planes"),
    write("ssim_parts"),
    read("saliency"),
];

const GRAD: &[Binding] = &[
    read("image"),
    read("target"),
    read("red_planes"),
    read("green_planes"),
    read("blue_planes"),
    write("grad_image"),
    write("l1_parts"),
    read("saliency"),
];

const fn strips(name: &'static str, constants: &'static [Constant], local_size: Option<u32>) -> Pass {
    Pass {
        kernel: Kernel { name, spirv: module(name), bindings: STRIPS, push_bytes: Push::BYTES, constants, local_size },
        doc: "One subgroup owns a strip, as many columns as it has lanes and SEGMENT rows; one thread owns a column \
            of it.",
        dispatch: "one subgroup per strip",
        push: Push::FIELDS,
    }
}

const fn grad(
    name: &'static str,
    doc: &'static str,
    dispatch: &'static str,
    constants: &'static [Constant],
    local_size: Option<u32>,
) -> Pass {
    Pass {
        kernel: Kernel { name, spirv: module(name), bindings: GRAD, push_bytes: Push::BYTES, constants, local_size },
        doc,
        dispatch,
        push: Push::FIELDS,
    }
}

/// SSIM and its derivatives, filtered by the window along columns. LOCAL_SIZE is the subgroup width. For CPU devices.
pub const STRIPS_SUBGROUP: Pass =
    strips("loss_strips_subgroup", &[LOCAL_SIZE, SEGMENT, PHOTOGRAPH_BITS, WEIGHTED], None);
/// SSIM and its derivatives, with one channel of a strip per subgroup. For GPUs.
pub const STRIPS_APART: Pass = strips("loss_strips_apart", &[LOCAL_SIZE, SEGMENT, PHOTOGRAPH_BITS, WEIGHTED], None);
/// [`STRIPS_APART`] with emulated subgroups.
pub const STRIPS_EMULATED: Pass =
    strips("loss_strips_emulated", &[EMULATED_WIDTH, SEGMENT, PHOTOGRAPH_BITS, WEIGHTED], Some(EMULATED_LOCAL_SIZE));

const APART_DOC: &str = "One subgroup owns one channel of a strip, as in the strips; one thread owns a column of it.";

/// Filters by the window along rows, and computes the gradient with respect to the render. LOCAL_SIZE is the subgroup
/// width. Follows [`STRIPS_SUBGROUP`].
pub const GRAD_SUBGROUP: Pass = grad(
    "loss_grad_subgroup",
    "One subgroup owns a row and walks along it, as many pixels at a time as it has lanes.",
    "one subgroup per row",
    &[LOCAL_SIZE, PHOTOGRAPH_BITS, WEIGHTED],
    None,
);
/// Filters by the window along columns and rows, and computes the gradient with respect to the render. Follows
/// [`STRIPS_APART`].
pub const GRAD_APART: Pass = grad(
    "loss_grad_apart",
    APART_DOC,
    "one subgroup per strip and channel",
    &[LOCAL_SIZE, PHOTOGRAPH_BITS, WEIGHTED, SEGMENT],
    None,
);
/// [`GRAD_APART`] with emulated subgroups.
pub const GRAD_EMULATED: Pass = grad(
    "loss_grad_emulated",
    APART_DOC,
    "one subgroup per strip and channel",
    &[EMULATED_WIDTH, PHOTOGRAPH_BITS, WEIGHTED, SEGMENT],
    Some(EMULATED_LOCAL_SIZE),
);

/// Sums the parts of the loss in a fixed order.
pub const SUM: Pass = Pass {
    kernel: Kernel {
        name: "loss_sum",
        spirv: module("loss_sum"),
        bindings: &[read("ssim_parts"), read("l1_parts"), write("loss")],
        push_bytes: SumPush::BYTES,
        constants: &[Constant { id: 0, name: "LOCAL_SIZE", default: SUM_THREADS }],
        local_size: None,
    },
    doc: "One thread owns every LOCAL_SIZE-th part of the loss; there is one workgroup.",
    dispatch: "one workgroup",
    push: SumPush::FIELDS,
};
