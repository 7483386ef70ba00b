//! Gaussian splatting on raw Vulkan compute: read posed photographs, train a 3D Gaussian model, render and score it.
//!
//! The layers, each knowing only those below it: [`train`] and [`eval`] compose [`raster`], which composes [`pass`],
//! which describes compute shaders that [`vk`] runs. [`scene`], [`dataset`] and [`format`] know no Vulkan.
//! Conventions (frames, units, orders) are in `docs/CONVENTIONS.md`.

pub mod bench;
pub mod dataset;
pub mod eval;
pub mod format;
pub mod pass;
pub mod raster;
pub mod scene;
pub mod train;
pub mod twin;
pub mod vk;
pub mod world;
