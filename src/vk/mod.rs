//! The hand-managed Vulkan device: instance and device (own or adopted), memory, pipelines, recorder,
//! timestamps, errors.
//!
//! Nothing here knows of Gaussians. All `unsafe` and every Vulkan handle of the crate stay in this module.

mod adopt;
mod allocator;
mod barrier;
mod barrier_plan;
mod buffer;
mod buffer_range;
mod cache;
mod canary;
mod caps;
mod describe;
mod device;
mod device_query;
mod dry_run;
mod encode;
mod error;
mod features;
mod gpu;
mod hazard;
mod host_allocator;
mod host_commands;
mod kernel;
mod lock;
mod making;
mod mapped;
mod memory;
mod options;
mod pipeline;
mod pipeline_variant;
mod profile;
mod recorder;
mod shared_memory;
mod slot;
mod submit;
mod submit_sync;
mod ticket;
mod validation;

pub use adopt::{HostDevice, Usable};
pub use ash;
pub use buffer::{Buffer, BufferSlice};
pub use buffer_range::{Part, slices};
pub use caps::{Addresses, Caps, Choice, DeviceKind, Heap, Limits, Subgroup};
pub use describe::{Described, Wait};
pub use device::{DeviceInfo, device_kind, devices};
pub use error::{Error, Result};
pub use features::{FeatureStructures, Features, REQUIRED, USEFUL_EXTENSIONS, required_features};
pub use gpu::Gpu;
pub use host_allocator::Memory;
pub use host_allocator::{HostAllocator, MemoryBlock, MemoryRequest};
pub use host_commands::{Done, Executed, HostRecording};
pub use kernel::{Access, Binding, Constant, Kernel, Spirv, TexelFormat, TexelView, Texels, read, read_write, write};
pub use lock::QueueLock;
pub use making::PipelineEvent;
pub use memory::MemoryUse;
pub use options::{FloatAtomics, OpenOptions, Validation};
pub use pipeline::Pipeline;
pub use profile::{PassTime, Stats};
pub use recorder::{Groups, Recorder, fold};
pub use submit_sync::{HostSemaphore, SubmitSync};
pub use ticket::Ticket;
pub use validation::{Messages, validation_layer};
