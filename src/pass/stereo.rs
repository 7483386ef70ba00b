//! Multi-view stereo by PatchMatch: pictures made ready for sampling, sweeps over hypotheses of planes, and the check
//! of views against each other.
//!
//! A hypothesis at a pixel is (d, gx, gy): inverse depth along the camera's axis, and its change per pixel to the right
//! and down. On a plane both slopes are constant, so hypotheses are carried to other pixels by adding. A row of
//! `planes` is a hypothesis and its score: 1 + NCC, 0 where there is none.

use super::{Pass, module};
use crate::vk::{Constant, Kernel, read, read_write, write};

/// Most sources that windows are compared with.
pub const MOST_SOURCES: usize = 4;
/// Most sources that depths are checked against.
pub const MOST_CHECKS: usize = 8;
/// Rows of four floats that a source has in `links`: three of (A, b), its size, three of the way back.
pub const LINK_ROWS: usize = 7;
/// Arms along which a sweep looks for better hypotheses.
pub const ARMS: u32 = 8;
/// Flag: what is there is scored, with random hypotheses; nothing is propagated.
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
        /// Its height.
        pub height: u32,
        /// Pixels from one picture to the next in `blocks`.
        pub stride: u32,
        /// Sources, at most [`MOST_SOURCES`].
        pub sources: u32,
        /// How many of the best of them count, from 1.
        pub best: u32,
        /// First of the list that is looked at.
        pub first: u32,
        /// How many of the list.
        pub count: u32,
        /// Number of the call, for random draws.
        pub turn: u32,
        /// Seed of random draws.
        pub seed: u32,
        /// Random hypotheses per pixel.
        pub draws: u32,
        /// [`FLAG_START`], or 0.
        pub flags: u32,
        /// Focal length of the reference in pixels.
        pub focal_x: f32,
        /// The same along y.
        pub focal_y: f32,
        /// Principal point.
        pub centre_x: f32,
        /// The same along y.
        pub centre_y: f32,
        /// Smallest possible inverse depth.
        pub least: f32,
        /// Largest possible inverse depth.
        pub most: f32,
        /// Largest random change of an inverse depth.
        pub amplitude: f32,
        /// Largest random change of its slopes.
        pub slope: f32,
        /// Factor of squared distances in a weight's exponent.
        pub by_distance: f32,
        /// Factor of squared differences of luma in it.
        pub by_luma: f32,
        /// Least cosine between a plane's normal and the ray.
        pub facing: f32,
    }
}

crate::push_constants! {
    /// Push constants of [`FILTER`].
    pub struct FilterPush {
        /// Width of the reference in pixels.
        pub width: u32,
        /// Its height.
        pub height: u32,
        /// Pixels from one picture to the next in `planes`.
        pub stride: u32,
        /// Sources.
        pub sources: u32,
        /// How many must agree.
        pub needed: u32,
        /// Distance in pixels from which on views disagree.
        pub pixels: f32,
        /// The same for depths, relative.
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
        /// Pixels to each side that are looked at.
        pub reach: u32,
        /// Share of an inverse depth by which another may differ from the pixel's plane.
        pub tolerance: f32,
    }
}

/// A picture as rows of 2x2 pixels.
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

macro_rules! sweep {
    ($(#[$meta:meta])* $name:ident, $module:literal, $side:literal) => {
        $(#[$meta])*
        pub const $name: Pass = Pass {
            kernel: Kernel {
                name: $module,
                spirv: module($module),
                bindings: &[read("blocks"), read("links"), read("pixels"), read_write("planes")],
                push_bytes: SweepPush::BYTES,
                constants: &[Constant { id: 0, name: "STEP", default: 2 }],
                local_size: Some(64),
            },
            doc: "One thread owns a pixel of the list; a workgroup owns 64 consecutive ones.",
            dispatch: "one thread per pixel of the part of the list",
            push: SweepPush::FIELDS,
        };
    };
}

sweep! {
    /// Windows of 3x3 taps.
    SWEEP_3, "stereo_sweep_side3", 3
}
sweep! {
    /// Windows of 4x4 taps.
    SWEEP_4, "stereo_sweep_side4", 4
}
sweep! {
    /// Windows of 5x5 taps.
    SWEEP_5, "stereo_sweep_side5", 5
}
sweep! {
    /// Windows of 6x6 taps.
    SWEEP_6, "stereo_sweep_side6", 6
}

/// What sources agree with.
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

/// Planes through what was kept.
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
