//! The hand-managed Vulkan device: instance and device (own or adopted), memory, pipelines, recorder, timestamps, errors.
//!
//! Nothing here knows of Gaussians. All `unsafe` and every Vulkan handle of the crate stay in this module.

mod adopt;
mod allocator;
mod barrier;
mod buffer;
mod cache;
mod canary;
mod caps;
mod describe;
mod device;
mod encode;
mod error;
mod features;
mod form;
mod gpu;
mod hazard;
mod host_commands;
mod kernel;
mod memory;
mod options;
mod order;
mod part;
mod pipeline;
mod planning;
mod profile;
mod recorder;
mod report;
mod shared_memory;
mod slot;
mod submit;
mod validation;

pub use adopt::{HostDevice, QueueLock, Usable};
pub use allocator::{HostAllocator, MemoryBlock, MemoryRequest};
pub use ash;
pub use buffer::{Buffer, BufferSlice};
pub use caps::{Addresses, Caps, Choice, DeviceKind, Heap, Limits, Subgroup};
pub use describe::{Described, Wait};
pub use device::{DeviceInfo, device_kind, devices};
pub use error::{Error, Result};
pub use features::{FeatureStructures, Features, REQUIRED, USEFUL_EXTENSIONS, required_features};
pub use gpu::Gpu;
pub use host_commands::{Done, Executed, HostRecording};
pub use kernel::{Access, Binding, Constant, Kernel, Spirv, TexelFormat, TexelView, Texels, read, read_write, write};
pub use memory::{Memory, MemoryUse};
pub use options::{FloatAtomics, OpenOptions, Validation};
pub use order::{HostSemaphore, SubmitOrder};
pub use part::{Part, slices};
pub use pipeline::Pipeline;
pub use profile::{PassTime, Stats};
pub use recorder::{Groups, Recorder, Ticket, fold};
pub use validation::{Messages, validation_layer};
