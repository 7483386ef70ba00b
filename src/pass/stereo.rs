//! Multi-view stereo by PatchMatch: conversion of photographs for sampling, sweeps over plane hypotheses, and the
//! consistency check between views.
//!
//! A hypothesis at a pixel is (d, gx, gy): inverse depth along the camera's axis, and its change per pixel to the right
//! and down. On a plane both slopes are constant, so propagation to another pixel is an addition. A row of `planes` is
//! a hypothesis and its score: 1 + NCC, or 0 for no hypothesis.

use super::{Pass, module};
use crate::vk::{Constant, Kernel, read, read_write, write};

/// Most source views for the comparison of windows.
pub const MOST_SOURCES: usize = 4;
/// Most source views for the consistency check.
pub const MOST_CHECKS: usize = 8;
/// Rows of four floats per source view in `links`: three rows of (A, b), one row of the image size, three rows of the
/// inverse map.
pub const LINK_ROWS: usize = 7;
/// Number of arms along which a sweep searches better hypotheses.
pub const ARMS: u32 = 8;
/// Flag: scores the given and random hypotheses, without propagation.
pub const FLAG_START: u32 = 1;

crate::push_constants! {
    /// Push constants of [`BLOCKS`].
    pub struct BlocksPush {
        /// Width in pixels.
        pub width: u32,
        /// Height in pixels.
        pub height: u32,
        /// Row of the first pixel in `blocks`.
        pub first: u32,
    }
}

crate::push_constants! {
    /// Push constants of the sweeps.
    pub struct SweepPush {
        /// Width of the reference in pixels.
        pub width: u32,
        /// Height of the reference in pixels.
        pub height: u32,
        /// Distance between photographs in `blocks`, in pixels.
        pub stride: u32,
        /// Number of source views, at most [`MOST_SOURCES`].
        pub sources: u32,
        /// Number of best source views that count, at least 1.
        pub best: u32,
        /// Index of the first pixel of the list to process.
        pub first: u32,
        /// Number of pixels of the list to process.
        pub count: u32,
        /// Number of the call, for random draws.
        pub turn: u32,
        /// Seed of random draws.
        pub seed: u32,
        /// Random hypotheses per pixel.
        pub draws: u32,
        /// [`FLAG_START`], or 0.
        pub flags: u32,
        /// Focal length of the reference along x, in pixels.
        pub focal_x: f32,
        /// Focal length along y.
        pub focal_y: f32,
        /// Principal point along x, in pixels.
        pub centre_x: f32,
        /// Principal point along y.
        pub centre_y: f32,
        /// Smallest possible inverse depth.
        pub least: f32,
        /// Largest possible inverse depth.
        pub most: f32,
        /// Largest random change of an inverse depth.
        pub amplitude: f32,
        /// Largest random change of a slope.
        pub slope: f32,
        /// Factor of squared pixel distance in the exponent of a weight.
        pub by_distance: f32,
        /// Factor of squared luma difference in the exponent of a weight.
        pub by_luma: f32,
        /// Least cosine of the angle between a plane's normal and the ray.
        pub facing: f32,
    }
}

crate::push_constants! {
    /// Push constants of [`FILTER`].
    pub struct FilterPush {
        /// Width of the reference in pixels.
        pub width: u32,
        /// Height of the reference in pixels.
        pub height: u32,
        /// Distance between photographs in `planes`, in pixels.
        pub stride: u32,
        /// Number of source views.
        pub sources: u32,
        /// Number of source views that must agree.
        pub needed: u32,
        /// Reprojection distance, in pixels, at which views disagree.
        pub pixels: f32,
        /// Relative depth difference at which views disagree.
        pub depth: f32,
        /// Least score.
        pub score: f32,
    }
}

crate::push_constants! {
    /// Push constants of [`REFIT`].
    pub struct RefitPush {
        /// Width in pixels.
        pub width: u32,
        /// Height in pixels.
        pub height: u32,
        /// Half side of the window, in pixels.
        pub reach: u32,
        /// Largest relative difference of a neighbour's inverse depth from the pixel's plane.
        pub tolerance: f32,
    }
}

/// Converts a photograph to one row of 2x2 pixels per pixel.
pub const BLOCKS: Pass = Pass {
    kernel: Kernel {
        name: "stereo_blocks",
        spirv: module("stereo_blocks"),
        bindings: &[read("luma"), write("blocks")],
        push_bytes: BlocksPush::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns a pixel; a workgroup owns 64 consecutive pixels.",
    dispatch: "one thread per pixel",
    push: BlocksPush::FIELDS,
};

/// PatchMatch for a list of pixels. STEP is the distance between the taps of the window in pixels, SIDE the number of
/// taps along its side, from 3 to 6.
pub const SWEEP: Pass = Pass {
    kernel: Kernel {
        name: "stereo_sweep",
        spirv: module("stereo_sweep"),
        bindings: &[read("blocks"), read("links"), read("pixels"), read_write("planes")],
        push_bytes: SweepPush::BYTES,
        constants: &[Constant { id: 0, name: "STEP", default: 2 }, Constant { id: 1, name: "SIDE", default: 5 }],
        local_size: Some(64),
    },
    doc: "One thread owns a pixel of the list; a workgroup owns 64 consecutive ones.",
    dispatch: "one thread per pixel of the part of the list",
    push: SweepPush::FIELDS,
};

/// Keeps hypotheses that enough source views agree with.
pub const FILTER: Pass = Pass {
    kernel: Kernel {
        name: "stereo_filter",
        spirv: module("stereo_filter"),
        bindings: &[read("planes"), read("links"), write("kept")],
        push_bytes: FilterPush::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns a pixel of the reference; a workgroup owns 64 consecutive pixels.",
    dispatch: "one thread per pixel",
    push: FilterPush::FIELDS,
};

/// Refits planes to the kept hypotheses.
pub const REFIT: Pass = Pass {
    kernel: Kernel {
        name: "stereo_refit",
        spirv: module("stereo_refit"),
        bindings: &[read("kept"), write("refined")],
        push_bytes: RefitPush::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns a pixel; a workgroup owns 64 consecutive pixels.",
    dispatch: "one thread per pixel",
    push: RefitPush::FIELDS,
};
