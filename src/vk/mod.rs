//! The hand-managed Vulkan device: instance and device (own or adopted), memory, pipelines, recorder, timestamps, errors.
//!
//! Nothing here knows of Gaussians. All `unsafe` and every Vulkan handle of the crate stay in this module.

mod kernel;

pub use kernel::{Access, Binding, Constant, Kernel, read, read_write, write};
