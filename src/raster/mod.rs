//! Passes composed into forward and backward: the differentiable renderer.

mod live;
mod memory_footprint;
mod pass_select;
mod picture;
mod planes;
mod renderer;
pub mod scan;
mod scratch_buffers;
mod size;
pub mod sort;
mod target;
pub mod tiles;
mod variants;
mod viewer;

pub use live::LiveModel;
pub use memory_footprint::MemoryFootprint;
pub use picture::{DepthProbe, Picture};
pub use planes::ShStorage;
pub use planes::{
    MEANS, OPACITIES, PLANES, Plane, Planes, QUATS, SCALES, SH_HIGHER, SH0, gaussians_of, grown, planes_of,
};
pub use renderer::{
    BackwardStep, DENSITY_ENTRY, GradientTerms, Gradients, ImageGradients, Part, RenderView, Renderer, Subset,
};
pub(crate) use size::LARGEST_ROW;
pub use size::{LEAST_2D, Size, most_pairs, most_splats};
pub use target::Target;
pub use variants::{Chunks, GradientSum, ListSort, NamedVariants, TileShape, Variants};
pub use viewer::{Look, Shown, Style, Viewer};
