//! CPU twins of the GPU passes: equal file names, equal buffers in equal order, plain loops.
//!
//! A twin is a typed function generic over [`Real`] (f64 is the reference, f32 mirrors the shader's arithmetic) and a
//! thin adapter `run` over raw buffers, so that any pass can be replaced by its twin.

pub mod adam;
pub mod blend_backward;
pub mod blend_forward;
pub mod compact;
pub mod constrain;
pub mod convolution;
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
pub mod geometry;
pub mod gradient_map;
pub mod loss;
pub mod noise;
pub mod opacity_reset;
pub mod photograph_reduce;
pub mod place;
pub mod plan;
pub mod pool;
pub mod probe;
pub mod project;
pub mod project_backward;
pub mod project_backward_adam;
pub mod project_backward_adam_packed;
pub mod projection;
pub mod radix;
pub mod random;
pub mod reference;
pub mod saliency_plane;
pub mod scan;
pub mod slot_sum;
pub mod splat;
pub mod splat_outlines;
pub mod stereo;
pub mod subgroup_probe;
mod table;
pub mod tile_edges;
pub mod tile_offsets;
pub mod tile_ranges;
pub mod tile_sort;
mod vec3;

pub use crate::scene::Real;
pub use table::{TABLE, TwinFn, of};

/// The inputs and outputs of a dispatch.
pub struct TwinCall<'a> {
    /// The bound buffers in binding order. A twin does not change buffers that its pass only reads.
    pub buffers: &'a mut [Vec<u8>],
    /// The bytes of the push constants.
    pub push: &'a [u8],
    /// Specialization constants in the order of the kernel's table.
    pub constants: &'a [u32],
    /// Workgroups dispatched.
    pub groups: u32,
}

impl TwinCall<'_> {
    /// The push constants as their struct.
    pub fn push<T: bytemuck::AnyBitPattern>(&self) -> T {
        bytemuck::pod_read_unaligned(&self.push[..size_of::<T>()])
    }
    /// A copy of buffer `i`.
    pub fn get<T: bytemuck::AnyBitPattern>(&self, i: usize) -> Vec<T> {
        self.buffers[i].chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect()
    }
    /// Overwrites the beginning of buffer `i`.
    pub fn set<T: bytemuck::NoUninit>(&mut self, i: usize, values: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        self.buffers[i][..bytes.len()].copy_from_slice(bytes);
    }
}
