//! The error type of the device layer.

use ash::vk;

/// Errors of the device layer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The Vulkan loader could not be loaded or offers no Vulkan 1.3.
    #[error("no Vulkan loader or driver: {0}")]
    NoVulkan(String),
    /// A device was found but cannot be opened.
    #[error("{device} cannot be opened: vkCreateDevice: {result}")]
    Unopened {
        /// The device's name.
        device: String,
        /// The driver's result.
        result: vk::Result,
    },
    /// No device matches the wanted name or index.
    #[error("no Vulkan device matches `{wanted}`; available: {}", list(found))]
    NoDevice {
        /// The wanted name or index.
        wanted: String,
        /// Every device found, as `index: name (kind)`.
        found: Vec<String>,
    },
    /// The device, opened here or adopted from a host, lacks a feature.
    #[error("{device} lacks {feature}, needed for {needed_for}")]
    MissingFeature {
        /// Vulkan name of the feature.
        feature: &'static str,
        /// What needs the feature.
        needed_for: String,
        /// The device's name.
        device: String,
    },
    /// A requested Vulkan layer is not installed.
    #[error("the Vulkan layer {layer} is not installed")]
    MissingLayer {
        /// Name of the layer.
        layer: &'static str,
    },
    /// The memory limit or the driver refused an allocation.
    #[error(
        "out of device memory: {name} needs {requested} bytes; {in_use} bytes are in use and the limit is {limit}, \
         which leaves {}",
        limit.saturating_sub(*in_use)
    )]
    OutOfDeviceMemory {
        /// Requested bytes.
        requested: u64,
        /// Name of the buffer.
        name: String,
        /// Bytes allocated from this device.
        in_use: u64,
        /// The memory limit in bytes.
        limit: u64,
    },
    /// A buffer is larger than any allocation of the device.
    #[error("buffer {buffer}: {bytes} bytes exceed the device's largest allocation of {limit}")]
    BufferTooLarge {
        /// Name of the buffer.
        buffer: String,
        /// Requested bytes.
        bytes: u64,
        /// The limit: `maxMemoryAllocationSize` or `maxBufferSize`.
        limit: u64,
    },
    /// A binding exceeds a descriptor's range, and the kernel or the device cannot reach the buffer by address.
    #[error("buffer {buffer}: {bytes} bytes in one binding exceed the device's maxStorageBufferRange of {limit}")]
    BindingTooLarge {
        /// Name of the buffer.
        buffer: String,
        /// Bytes of the binding.
        bytes: u64,
        /// `maxStorageBufferRange`.
        limit: u64,
    },
    /// A range of a buffer is out of bounds, misaligned, or otherwise invalid for the operation.
    #[error("buffer {buffer} of {size} bytes: no access to {bytes} bytes at {offset}: {why}")]
    BadRange {
        /// Name of the buffer.
        buffer: String,
        /// Size of the buffer in bytes.
        size: u64,
        /// First byte of the range.
        offset: u64,
        /// Length of the range in bytes.
        bytes: u64,
        /// The broken rule.
        why: &'static str,
    },
    /// The caller's arguments do not fit the kernel's interface.
    #[error("kernel {kernel}: {what}")]
    Interface {
        /// Name of the kernel.
        kernel: &'static str,
        /// What is wrong.
        what: String,
    },
    /// The hazard checker found two conflicting accesses without a barrier between them: a bug of the recorder.
    #[error("{0}")]
    Hazard(String),
    /// A shader wrote past the end of a buffer: the buffer's guard has changed.
    #[error("write past the end of buffer {buffer} of {size} bytes: {value:#010x} at byte {offset}")]
    Overrun {
        /// Name of the buffer.
        buffer: String,
        /// Size of the buffer in bytes.
        size: u64,
        /// Offset in the buffer of the first changed word.
        offset: u64,
        /// The word found there.
        value: u32,
    },
    /// A ticket of another device.
    #[error("ticket {ticket} belongs to another device; the last ticket of this device is {last}")]
    ForeignTicket {
        /// Value of the ticket.
        ticket: u64,
        /// Value of this device's last ticket.
        last: u64,
    },
    /// A buffer, a pipeline, a recorder or a recording of another device.
    #[error("{what} belongs to another device")]
    Foreign {
        /// Kind and name of the object.
        what: String,
    },
    /// A host-visible buffer is used by a [`super::HostRecording`] that has not been finished or dropped.
    #[error(
        "buffer {buffer} is used by a recording in a command buffer of the host; call HostRecording::finished first"
    )]
    InHostCommands {
        /// Name of the buffer.
        buffer: String,
    },
    /// The device was lost.
    #[error("device lost in {during}; last pass known to have started: {pass}")]
    DeviceLost {
        /// The Vulkan call that reported the loss.
        during: &'static str,
        /// Name of the pass, or what is known about the pass.
        pass: String,
    },
    /// A Vulkan call failed.
    #[error("{call}: {result}")]
    Vulkan {
        /// The call's name.
        call: &'static str,
        /// The call's result.
        result: vk::Result,
    },
    /// The memory allocator failed for a reason other than lack of memory.
    #[error("memory allocator: {0}")]
    Allocator(#[from] gpu_allocator::AllocationError),
    /// A host's allocator returned unusable memory.
    #[error("the host's allocator returned unusable memory for buffer {buffer}: {what}")]
    HostAllocator {
        /// Name of the buffer.
        buffer: String,
        /// What is wrong.
        what: &'static str,
    },
    /// A host's queue cannot be used.
    #[error("queue {index} of family {family}: {what}")]
    BadQueue {
        /// Index of the queue family.
        family: u32,
        /// Index of the queue in the family.
        index: u32,
        /// What is wrong.
        what: &'static str,
    },
    /// An environment variable has an invalid value.
    #[error("{name}={value}: expected {want}")]
    Variable {
        /// Name of the variable.
        name: &'static str,
        /// Value of the variable.
        value: String,
        /// Description of valid values.
        want: &'static str,
    },
    /// A file of the device layer (the pipeline cache) could not be read or written.
    #[error("{path}: {source}")]
    File {
        /// Path of the file.
        path: std::path::PathBuf,
        /// The I/O error.
        source: std::io::Error,
    },
}

/// Result of the device layer.
pub type Result<T> = std::result::Result<T, Error>;

/// Attaches the name of the call to a raw Vulkan result.
pub(super) trait Named<T> {
    fn named(self, call: &'static str) -> Result<T>;
}

impl<T> Named<T> for std::result::Result<T, vk::Result> {
    fn named(self, call: &'static str) -> Result<T> {
        self.map_err(|result| match result {
            vk::Result::ERROR_DEVICE_LOST => Error::DeviceLost { during: call, pass: "unknown".into() },
            result => Error::Vulkan { call, result },
        })
    }
}

fn list(found: &[String]) -> String {
    if found.is_empty() { "none".to_owned() } else { found.join("; ") }
}
