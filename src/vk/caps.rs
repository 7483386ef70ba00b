//! Capabilities of a device, and the choices made from them, as plain data.

use super::features::Features;
use super::options::FloatAtomics;

/// Kind of a device, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DeviceKind {
    /// A separate graphics card.
    Discrete,
    /// A graphics unit that shares the host's memory.
    Integrated,
    /// A virtual graphics card.
    Virtual,
    /// A software driver.
    Cpu,
    /// Not reported.
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
    /// Largest range of a storage-buffer descriptor, in bytes.
    pub storage_range: u64,
    /// Alignment of the offset of a storage-buffer binding, in bytes.
    pub storage_alignment: u64,
    /// Most storage buffers of one kernel.
    pub storage_buffers: u32,
    /// Most texels of one texel buffer.
    pub texels: u64,
    /// Alignment of the offset of a texel buffer, in bytes.
    pub texel_alignment: u64,
    /// Most texel buffers of one kernel.
    pub texel_buffers: u32,
    /// Most bytes of push constants.
    pub push_bytes: u32,
    /// Most bytes of shared memory of a workgroup.
    pub shared_bytes: u32,
    /// Most threads of a workgroup.
    pub workgroup_size: u32,
    /// Most workgroups along x of a dispatch.
    pub workgroups: u32,
    /// Most bytes of one allocation.
    pub allocation: u64,
    /// Nanoseconds per timestamp tick; 0 when the queue has no timestamps.
    pub timestamp_ns: f32,
}

/// How subgroup operations run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subgroup {
    /// With the hardware's operations, at this width.
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

/// When kernels reach their buffers by address instead of through descriptors. On a CPU device both variants give the
/// same bits; a GPU compiler may contract floating-point operations differently in each module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Addresses {
    /// Never. No kernel can then use a buffer larger than a descriptor's range.
    Never,
    /// In dispatches with a binding larger than a descriptor's range.
    BeyondRange,
    /// In every dispatch of a kernel that has a variant by address.
    Always,
}

/// One choice among capabilities, as `psrgs-vk info` shows it.
#[derive(Clone, Debug)]
pub struct Choice {
    /// The capability.
    pub what: &'static str,
    /// The choice.
    pub picked: String,
    /// The reason for the choice.
    pub why: String,
}

/// A heap of device memory.
#[derive(Clone, Copy, Debug)]
pub struct Heap {
    /// Size in bytes, as reported by the driver.
    pub bytes: u64,
    /// Whether the heap is local to the device.
    pub device_local: bool,
}

/// Capabilities of a device, and the choices made from them.
#[derive(Clone, Debug)]
pub struct Caps {
    /// Name of the device.
    pub device: String,
    /// Name and version of the driver.
    pub driver: String,
    /// Kind of the device.
    pub kind: DeviceKind,
    /// Vulkan version of the device: (major, minor, patch).
    pub api: (u32, u32, u32),
    /// Enabled features.
    pub features: Features,
    /// Limits.
    pub limits: Limits,
    /// How floats in buffers are added atomically.
    pub buffer_floats: FloatAtomics,
    /// How floats in shared memory are added atomically.
    pub shared_floats: FloatAtomics,
    /// When kernels reach their buffers by address.
    pub addresses: Addresses,
    /// Whether kernels read rows of buffers as texels, where a kernel has such a variant.
    pub texels: bool,
    /// How subgroup operations run.
    pub subgroup: Subgroup,
    /// Smallest and largest subgroup width that a pipeline can require; equal when there is no choice.
    pub subgroup_range: (u32, u32),
    /// Subgroup operations that compute shaders may use, by their Vulkan names in lower case.
    pub subgroup_operations: Vec<&'static str>,
    /// Memory heaps.
    pub heaps: Vec<Heap>,
    /// Most bytes of device memory that may be allocated.
    pub memory_limit: u64,
    /// Every choice with its reason.
    pub choices: Vec<Choice>,
    /// Identifies the driver's pipeline caches.
    pub(super) cache_id: [u8; 16],
    /// Whether a pipeline has to require its subgroup width, because the driver could choose another width.
    pub(super) pin_subgroup: bool,
    pub(super) max_subgroups: u32,
}

impl Caps {
    /// Size in bytes of the largest buffer that a kernel can bind as a whole.
    pub fn largest_buffer(&self) -> u64 {
        match self.addresses {
            Addresses::Never => self.limits.storage_range.min(self.limits.allocation),
            Addresses::BeyondRange | Addresses::Always => self.limits.allocation,
        }
    }
}
