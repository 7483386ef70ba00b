//! Distance of two images' features per pixel, with gradient, and the sum over pixels and layers.

use super::{Pass, module};
use crate::vk::{Kernel, read, write};

pub use super::convolution::FLAG_GATE;

/// Flag: write the gradient.
pub const FLAG_GRADIENT: u32 = 8;
/// Most layers.
pub const MOST_LAYERS: usize = 8;

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Pixels of an image.
        pub pixels: u32,
        /// Rows of four channels in a pixel.
        pub quads: u32,
        /// First row of the layer's channel weights.
        pub weight_row: u32,
        /// Index of the layer's first part.
        pub part_first: u32,
        /// Added to the length of a feature before normalisation.
        pub eps: f32,
        /// Sum of [`FLAG_GATE`] and [`FLAG_GRADIENT`].
        pub flags: u32,
    }
}

crate::push_constants! {
    /// Push constants of [`SUM`].
    pub struct SumPush {
        /// End of each layer's parts. A layer begins at the end of the previous layer.
        pub ends: [u32; 8],
        /// Number of layers.
        pub layers: u32,
    }
}

/// The distance at each pixel, divided by the number of pixels, and the gradient with respect to the first image's
/// features.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "feature_distance",
        spirv: module("feature_distance"),
        bindings: &[read("features"), read("channel_weights"), write("parts"), write("grads")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns a pixel of both images; a workgroup owns 64 consecutive pixels.",
    dispatch: "one thread per pixel",
    push: Push::FIELDS,
};

/// A sum per layer, then the sum of all layers.
pub const SUM: Pass = Pass {
    kernel: Kernel {
        name: "distance_sum",
        spirv: module("distance_sum"),
        bindings: &[read("parts"), write("result")],
        push_bytes: SumPush::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns every 64th part of each layer; there is one workgroup.",
    dispatch: "one workgroup",
    push: SumPush::FIELDS,
};
