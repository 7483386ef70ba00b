//! Geometry loss between a render's depth and normals and a prior, with gradient, in two passes.
//!
//! [`crate::loss::GeometryLoss`] composes the passes. `image` and `aux` are the outputs of the forward blend. The first
//! pass, [`DEPTH`], counts the pixels for the means; [`super::part_sum`] adds its parts to the totals for the second
//! pass. The parts of the second pass, [`GRAD`], add up to the loss: depth, smoothness, normals, and their sum. The
//! formulas are in `glsl/include/geometry.glsl`. GRAD adds to the fourth component of `grad_image` and leaves the
//! others unchanged, so GRAD follows every pass that overwrites `grad_image`.
//!
//! Sources: the Huber loss on relative residuals and the second differences of unit-free depth are PSRGS'; the
//! edge-aware weights are from monocular depth estimation (Godard et al. 2017).

use super::{Pass, module};
use crate::vk::{Constant, Kernel, read, read_write, write};

crate::push_constants! {
    /// Push constants of both passes.
    pub struct Push {
        /// Image width in pixels.
        pub width: u32,
        /// Image height in pixels.
        pub height: u32,
        /// Width of the prior in its own pixels, at least 1. Prior and mask cover the same view as the image.
        pub prior_width: u32,
        /// Height of the prior.
        pub prior_height: u32,
        /// Width of the mask, used only when MASK is 1.
        pub mask_width: u32,
        /// Height of the mask.
        pub mask_height: u32,
        /// Number of unmasked pixels of the photograph: a third of [`super::loss::values`].
        pub pixels: f32,
        /// Median depth of the view, the unit of depth for smoothness.
        pub median: f32,
        /// Weight of the depth term. A weight of 0 turns a term off.
        pub depth_weight: f32,
        /// Relative residual at which the depth term's Huber function becomes linear.
        pub huber: f32,
        /// Weight of edges in the depth term's factor E; the constant EDGES chooses its formula.
        pub edge: f32,
        /// Weight of the smoothness term.
        pub smooth_weight: f32,
        /// Decay of smoothness at edges: the weight is exp(-edge_stop |grad I|), with I from 0 to 1.
        pub edge_stop: f32,
        /// Weight of 1 - cosine of the normals' angle.
        pub cosine_weight: f32,
        /// Weight of the normals' L1 distance.
        pub l1_weight: f32,
    }
}

/// Pixels that a workgroup owns.
pub const PIXELS: u32 = 4096;

/// Workgroups of both passes.
pub const fn groups(width: u32, height: u32) -> u32 {
    (width * height).div_ceil(PIXELS)
}

/// Rows of four floats in `parts`.
pub const fn parts(width: u32, height: u32) -> u32 {
    64 * groups(width, height)
}

/// Largest coordinate of a packed normal.
const FOLDED: f64 = 4094.0;

/// Packs a pixel of a prior: depth along the camera's axis in scene units (0 or non-finite for none), unit normal in
/// the camera frame, confidence from 0 to 1 (0 ignores the pixel). The normal is exact to a fifteenth of a degree.
pub fn pack_prior(depth: f32, normal: Option<[f32; 3]>, confidence: f32) -> [u32; 2] {
    // Octahedral coordinates (Meyer et al. 2010); both 0 stand for no normal.
    let code = normal.map_or(0, |normal| {
        let [x, y, z] = normal.map(f64::from);
        let size = x.abs() + y.abs() + z.abs();
        if !(size.is_finite() && size > 0.0) {
            return 0;
        }
        let (x, y) = (x / size, y / size);
        let folded = if z >= 0.0 {
            [x, y]
        } else {
            let side = |v: f64| if v >= 0.0 { 1.0 } else { -1.0 };
            [(1.0 - y.abs()) * side(x), (1.0 - x.abs()) * side(y)]
        };
        let [u, v] = folded.map(|v| ((v + 1.0) * 0.5 * FOLDED).round() as u32);
        match u | v << 12 {
            // (0, 0) is reserved, so (0, 0, -1) uses another corner; all corners stand for (0, 0, -1).
            0 => FOLDED as u32 | (FOLDED as u32) << 12,
            code => code,
        }
    });
    // A NaN confidence becomes 0.
    [depth.to_bits(), code | ((confidence.clamp(0.0, 1.0) * 255.0).round() as u32) << 24]
}

/// 1: a mask M is bound; 0: M = 0.
const MASK: Constant = Constant { id: 0, name: "MASK", default: 0 };
/// Formula of E. 0: 1 + edge |grad I| / (|grad I| + mean |grad I|), more weight at edges; 1: exp(-edge |grad I|), less
/// weight at edges.
const EDGES: Constant = Constant { id: 0, name: "EDGES", default: 0 };
const PHOTOGRAPH_BITS: Constant = Constant { id: 2, name: "PHOTOGRAPH_BITS", default: 8 };

/// Writes the depth map, and counts valid depths.
pub const DEPTH: Pass = Pass {
    kernel: Kernel {
        name: "geometry_depth",
        spirv: module("geometry_depth"),
        bindings: &[
            read("image"),
            read("aux"),
            read("target"),
            read("prior"),
            read("mask"),
            write("depth_map"),
            write("parts"),
        ],
        push_bytes: Push::BYTES,
        constants: &[MASK, PHOTOGRAPH_BITS],
        local_size: Some(64),
    },
    doc: "One thread owns 64 pixels and a row of four counts; a workgroup owns 4096 consecutive pixels.",
    dispatch: "one workgroup per 4096 pixels",
    push: Push::FIELDS,
};

/// Loss and gradients.
pub const GRAD: Pass = Pass {
    kernel: Kernel {
        name: "geometry_grad",
        spirv: module("geometry_grad"),
        bindings: &[
            read("image"),
            read("aux"),
            read("prior"),
            read("depth_map"),
            read("totals"),
            read_write("grad_image"),
            write("grad_aux"),
            write("parts"),
        ],
        push_bytes: Push::BYTES,
        constants: &[EDGES],
        local_size: Some(64),
    },
    doc: "One thread owns 64 pixels and a row of four sums; a workgroup owns 4096 consecutive pixels. Adds to dL/dT, \
          writes the gradient of the auxiliary image.",
    dispatch: "one workgroup per 4096 pixels",
    push: Push::FIELDS,
};
