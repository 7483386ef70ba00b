//! What a device can do, and what was picked because of it, as plain data.

use super::features::Features;
use super::options::FloatAtomics;

/// Kind of a device, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DeviceKind {
    /// A graphics card of its own.
    Discrete,
    /// A graphics unit that shares the host's memory.
    Integrated,
    /// A virtual graphics card.
    Virtual,
    /// Software.
    Cpu,
    /// Not said.
    Other,
}

impl std::fmt::Display for DeviceKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            DeviceKind::Discrete => "discrete",
            DeviceKind::Integrated => "integrated",
            DeviceKind::Virtual => "virtual",
            DeviceKind::Cpu => "CPU",
            DeviceKind::Other => "other",
        })
    }
}

/// Limits that the engine works within.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Bytes of one storage-buffer descriptor.
    pub storage_range: u64,
    /// Alignment of the offset of a binding.
    pub storage_alignment: u64,
    /// Storage buffers of one kernel.
    pub storage_buffers: u32,
    /// Texels of one texel buffer.
    pub texels: u64,
    /// Alignment of the offset of a texel buffer.
    pub texel_alignment: u64,
    /// Texel buffers of one kernel.
    pub texel_buffers: u32,
    /// Bytes of push constants.
    pub push_bytes: u32,
    /// Bytes of shared memory of a workgroup.
    pub shared_bytes: u32,
    /// Threads of a workgroup.
    pub workgroup_size: u32,
    /// Workgroups along x of a dispatch.
    pub workgroups: u32,
    /// Bytes of one allocation.
    pub allocation: u64,
    /// Nanoseconds of a timestamp tick; 0 where the queue has no timestamps.
    pub timestamp_ns: f32,
}

/// How subgroup operations run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subgroup {
    /// By the hardware's operations, at this width.
    Hardware(u32),
    /// In shared memory, at this width.
    Emulated(u32),
}

impl Subgroup {
    /// Threads of a subgroup.
    pub fn width(self) -> u32 {
        match self {
            Subgroup::Hardware(width) | Subgroup::Emulated(width) => width,
        }
    }
}

/// When kernels reach their buffers by address rather than through descriptors. On processors both give the same bits;
/// a compiler for a GPU may contract operations differently in each module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Addresses {
    /// Never: no kernel can use a buffer that is larger than one descriptor's range.
    Never,
    /// In dispatches that bind more in one piece than a descriptor's range.
    BeyondRange,
    /// In every dispatch of a kernel that has the variant.
    Always,
}

/// One capability as picked, for `psrgs-vk info`.
#[derive(Clone, Debug)]
pub struct Choice {
    /// What was decided.
    pub what: &'static str,
    /// The decision.
    pub picked: String,
    /// Its reason.
    pub why: String,
}

/// A heap of device memory.
#[derive(Clone, Copy, Debug)]
pub struct Heap {
    /// Bytes, as the driver says.
    pub bytes: u64,
    /// Local to the device.
    pub device_local: bool,
}

/// What the device can do and what was picked.
#[derive(Clone, Debug)]
pub struct Caps {
    /// Name of the device.
    pub device: String,
    /// Name and version of the driver.
    pub driver: String,
    /// Kind.
    pub kind: DeviceKind,
    /// Vulkan version of the device (major, minor, patch).
    pub api: (u32, u32, u32),
    /// Enabled features.
    pub features: Features,
    /// Limits.
    pub limits: Limits,
    /// Float atomics on buffers.
    pub buffer_floats: FloatAtomics,
    /// Float atomics on shared memory.
    pub shared_floats: FloatAtomics,
    /// When kernels reach their buffers by address.
    pub addresses: Addresses,
    /// Kernels read rows of buffers as texels where they have that form.
    pub texels: bool,
    /// Subgroup operations.
    pub subgroup: Subgroup,
    /// Smallest and largest width that a pipeline can require; equal where it cannot choose.
    pub subgroup_range: (u32, u32),
    /// Subgroup operations of compute shaders, by their Vulkan names in lower case.
    pub subgroup_operations: Vec<&'static str>,
    /// Memory heaps.
    pub heaps: Vec<Heap>,
    /// Bytes that may be allocated.
    pub memory_limit: u64,
    /// Every decision with its reason.
    pub choices: Vec<Choice>,
    /// Identifies the driver's pipeline caches.
    pub(super) cache_id: [u8; 16],
    /// A pipeline has to ask for its subgroup width, because the driver could choose another.
    pub(super) pin_subgroup: bool,
    pub(super) max_subgroups: u32,
}

impl Caps {
    /// Bytes of the largest buffer that a kernel can use whole.
    pub fn largest_buffer(&self) -> u64 {
        match self.addresses {
            Addresses::Never => self.limits.storage_range.min(self.limits.allocation),
            Addresses::BeyondRange | Addresses::Always => self.limits.allocation,
        }
    }
}
