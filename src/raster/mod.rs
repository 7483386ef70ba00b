//! Passes composed into forward and backward: the differentiable renderer.

mod held;
mod kernels;
mod live;
mod loan;
mod picture;
mod planes;
mod renderer;
pub mod scan;
mod sh_storage;
mod size;
pub mod sort;
mod target;
pub mod tiles;
mod variants;
mod viewer;

pub use held::Held;
pub use live::LiveModel;
pub use picture::Picture;
pub use planes::{MEANS, OPACITIES, PLANES, Plane, Planes, QUATS, SCALES, SH0, UPPER, gaussians_of, grown, planes_of};
pub use renderer::{BackwardStep, DENSITY_ENTRY, Gradients, ImageGradients, Renderer, Shot, Terms};
pub use sh_storage::ShStorage;
pub(crate) use size::LARGEST_ROW;
pub use size::{LEAST_2D, Size, most_pairs, most_splats};
pub use target::Target;
pub use variants::{GradientSum, TileShape, Variants};
pub use viewer::Viewer;
