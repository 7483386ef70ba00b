//! The hand-managed Vulkan device: instance and device (own or adopted), memory, pipelines, recorder, timestamps, errors.
//!
//! Nothing here knows of Gaussians. All `unsafe` and every Vulkan handle of the crate stay in this module.

mod adopt;
mod barrier;
mod buffer;
mod cache;
mod canary;
mod caps;
mod describe;
mod device;
mod encode;
mod error;
mod form;
mod gpu;
mod hazard;
mod kernel;
mod memory;
mod options;
mod part;
mod pipeline;
mod planning;
mod profile;
mod recorder;
mod report;
mod slot;
mod submit;
mod validation;

pub use adopt::{HostDevice, HostSemaphore, QueueLock};
pub use ash;
pub use buffer::{Buffer, BufferSlice};
pub use caps::{Addresses, Caps, Choice, DeviceKind, Features, Heap, Limits, REQUIRED, Subgroup};
pub use describe::{Described, Wait};
pub use device::{DeviceInfo, devices};
pub use error::{Error, Result};
pub use gpu::Gpu;
pub use kernel::{Access, Binding, Constant, Kernel, Spirv, read, read_write, write};
pub use memory::{Memory, MemoryUse};
pub use options::{FloatAtomics, OpenOptions, Validation};
pub use part::{Part, slices};
pub use pipeline::Pipeline;
pub use profile::{PassTime, Stats};
pub use recorder::{Groups, Recorder, Ticket, fold};
