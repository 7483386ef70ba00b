//! The GPU passes as data: shader, bindings with access, push constants, dispatch rule.
//! [`crate::twin`] has their CPU twins.
//!
//! One file per pass; [`ALL`] is the registry that `psrgs-vk passes` prints and that the twin tests enumerate.

pub mod adam;
pub mod alpha_min;
pub mod blend_backward;
pub mod blend_forward;
pub mod camera;
pub mod compact;
pub mod constrain;
pub mod convolution;
pub mod counters;
pub mod crop;
pub mod densify_axes;
pub mod densify_classify;
pub mod densify_finish;
pub mod densify_gather;
pub mod densify_limit;
pub mod densify_map;
pub mod densify_means;
pub mod densify_order;
pub mod densify_sample;
pub mod densify_scores;
pub mod densify_stats;
pub mod densify_views;
pub mod depth_probe;
pub mod emit;
pub mod emit_tiles;
pub mod exposure;
pub mod feature_distance;
pub mod fill;
pub mod finish;
pub mod geometry;
pub mod gradient_map;
pub mod loss;
pub mod noise;
pub mod opacity_reset;
pub mod part_sum;
pub mod photograph_reduce;
pub mod plan;
pub mod pool;
pub mod probe;
pub mod project;
pub mod project_backward;
pub mod project_backward_adam;
pub mod project_backward_adam_packed;
pub mod radix;
pub mod saliency_plane;
pub mod scan;
mod shaders;
pub mod slot_sum;
pub mod splat_outlines;
pub mod stereo;
pub mod subgroup_probe;
pub mod tile_edges;
pub mod tile_offsets;
pub mod tile_ranges;
pub mod tile_sort;
pub mod turns;

pub use shaders::module;

use crate::vk::Kernel;

/// A push-constant field. A test checks that the shader's block has the same member at the same offset.
#[derive(Clone, Copy, Debug)]
pub struct Field {
    /// Member name in Rust and in GLSL.
    pub name: &'static str,
    /// Byte offset in the block.
    pub offset: u32,
    /// Size in bytes.
    pub bytes: u32,
}

/// One GPU pass.
pub struct Pass {
    /// The shader and its interface.
    pub kernel: Kernel,
    /// What one thread and one workgroup own, and what the pass computes.
    pub doc: &'static str,
    /// Size of the dispatch, in words.
    pub dispatch: &'static str,
    /// The push-constant block.
    pub push: &'static [Field],
}

/// Every pass. A test compares the shader folder with this list.
pub const ALL: &[&Pass] = &[
    &adam::PASS,
    &blend_backward::COLUMN_ATOMIC,
    &blend_backward::COLUMN_CAS,
    &blend_backward::COLUMN_EMULATED_SLOTS,
    &blend_backward::COLUMN_SLOTS,
    &blend_backward::PIXEL_ATOMIC,
    &blend_backward::PIXEL_CAS,
    &blend_backward::PIXEL_EMULATED_CAS,
    &blend_backward::PIXEL_EMULATED_SLOTS,
    &blend_backward::PIXEL_SLOTS,
    &blend_forward::COLUMN,
    &blend_forward::COLUMN_EMULATED,
    &blend_forward::PIXEL,
    &compact::GATHER_COUNTS,
    &compact::PASS,
    &constrain::ADD,
    &constrain::KEEP,
    &constrain::PASS,
    &convolution::PASS,
    &crop::GRADIENT,
    &crop::PAIR,
    &densify_axes::PASS,
    &densify_classify::PASS,
    &densify_finish::PASS,
    &densify_gather::PASS,
    &densify_limit::PASS,
    &densify_map::PASS,
    &densify_means::PASS,
    &densify_order::BIRTHS,
    &densify_order::CODES,
    &densify_order::FLAGS,
    &densify_order::ORDER,
    &densify_sample::PASS,
    &densify_scores::PASS,
    &densify_stats::PASS,
    &densify_views::PASS,
    &depth_probe::PASS,
    &emit::PASS,
    &emit_tiles::EMULATED,
    &emit_tiles::PASS,
    &exposure::APPLY,
    &exposure::BACKWARD,
    &exposure::STEP,
    &feature_distance::PASS,
    &feature_distance::SUM,
    &fill::PASS,
    &finish::PASS,
    &geometry::DEPTH,
    &geometry::GRAD,
    &gradient_map::GRAD,
    &gradient_map::SOBEL,
    &gradient_map::WINDOWS,
    &loss::GRAD_APART,
    &loss::GRAD_EMULATED,
    &loss::GRAD_SUBGROUP,
    &loss::STRIPS_APART,
    &loss::STRIPS_EMULATED,
    &loss::STRIPS_SUBGROUP,
    &loss::SUM,
    &noise::PASS,
    &opacity_reset::PASS,
    &photograph_reduce::PASS,
    &part_sum::PASS,
    &plan::PASS,
    &pool::BACKWARD,
    &pool::FORWARD,
    &probe::COPY,
    &probe::RATE,
    &project::HALF,
    &project::PASS,
    &project::SPARSE,
    &project_backward::PASS,
    &project_backward_adam::PASS,
    &project_backward_adam_packed::PASS,
    &radix::COUNT_GROUPS,
    &radix::COUNT_RUNS,
    &radix::ROWS,
    &radix::ROWS_EMULATED,
    &radix::SCATTER_GROUPS,
    &radix::SCATTER_GROUPS_EMULATED,
    &radix::SCATTER_RUNS,
    &scan::ADD,
    &scan::ADD_EMULATED,
    &scan::ONCE,
    &scan::ONCE_RUNS,
    &scan::ONCE_EMULATED,
    &scan::REDUCE,
    &scan::REDUCE_EMULATED,
    &scan::SPINE,
    &scan::SPINE_EMULATED,
    &saliency_plane::PASS,
    &slot_sum::PASS,
    &splat_outlines::PASS,
    &stereo::BLOCKS,
    &stereo::FILTER,
    &stereo::REFIT,
    &stereo::SWEEP,
    &subgroup_probe::EMULATED,
    &subgroup_probe::SUBGROUP,
    &tile_edges::PASS,
    &tile_offsets::EMULATED,
    &tile_offsets::PASS,
    &tile_ranges::PASS,
    &tile_sort::EMULATED,
    &tile_sort::PASS,
];

/// Declares a push-constant block: a `#[repr(C)]` plain-data struct with a `FIELDS` table for [`Pass::push`].
#[macro_export]
macro_rules! push_constants {
    ($(#[$meta:meta])* pub struct $name:ident { $($(#[$fmeta:meta])* pub $field:ident : $ty:ty),* $(,)? }) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name { $($(#[$fmeta])* pub $field: $ty),* }
        impl $name {
            /// Layout of the block; a test compares the layout with the shader.
            pub const FIELDS: &'static [$crate::pass::Field] = &[$($crate::pass::Field {
                name: stringify!($field),
                offset: std::mem::offset_of!($name, $field) as u32,
                bytes: std::mem::size_of::<$ty>() as u32,
            }),*];
            /// Size of the block in bytes.
            pub const BYTES: u32 = std::mem::size_of::<$name>() as u32;
        }
    };
}
