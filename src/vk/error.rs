//! What can go wrong on a device, as one type.

use ash::vk;

/// Errors of the device layer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The Vulkan loader could not be loaded or offers no Vulkan 1.3.
    #[error("no Vulkan loader or driver: {0}")]
    NoVulkan(String),
    /// A driver is there, and a device, but it does not open.
    #[error("{device} cannot be opened: vkCreateDevice: {result}")]
    Unopened {
        /// The device's name.
        device: String,
        /// What the driver says.
        result: vk::Result,
    },
    /// No device matches.
    #[error("no Vulkan device matches `{wanted}`; there are: {}", list(found))]
    NoDevice {
        /// What was asked for.
        wanted: String,
        /// Every device found, as `index: name (kind)`.
        found: Vec<String>,
    },
    /// The device, or the device that a host handed over, lacks something.
    #[error("{device} lacks {feature}, needed for {needed_for}")]
    MissingFeature {
        /// The feature by its Vulkan name.
        feature: &'static str,
        /// What needs it.
        needed_for: String,
        /// The device's name.
        device: String,
    },
    /// A Vulkan layer that was asked for is not installed.
    #[error("the Vulkan layer {layer} is not installed")]
    MissingLayer {
        /// Its name.
        layer: &'static str,
    },
    /// An allocation was refused by the limit or by the driver.
    #[error(
        "out of device memory: {name} needs {requested} bytes; {in_use} bytes are in use and the limit is {limit}, \
         which leaves {}",
        limit.saturating_sub(*in_use)
    )]
    OutOfDeviceMemory {
        /// Bytes asked for.
        requested: u64,
        /// Name of the buffer.
        name: String,
        /// Bytes allocated by this device so far.
        in_use: u64,
        /// The limit that applies.
        limit: u64,
    },
    /// A buffer is larger than any allocation of the device.
    #[error("buffer {buffer}: {bytes} bytes, the device's largest allocation is {limit}")]
    BufferTooLarge {
        /// Name of the buffer.
        buffer: String,
        /// Bytes asked for.
        bytes: u64,
        /// The limit: `maxMemoryAllocationSize` or `maxBufferSize`.
        limit: u64,
    },
    /// More bytes bound in one binding than a descriptor covers, and the kernel or the device cannot do by address.
    #[error("buffer {buffer}: {bytes} bytes in one binding, the device's maxStorageBufferRange is {limit}")]
    BindingTooLarge {
        /// Name of the buffer.
        buffer: String,
        /// Bytes of the binding.
        bytes: u64,
        /// `maxStorageBufferRange`.
        limit: u64,
    },
    /// A range reaches past the end of a buffer, or is not aligned as the operation needs.
    #[error("buffer {buffer} of {size} bytes: no access to {bytes} bytes at {offset}: {why}")]
    BadRange {
        /// Name of the buffer.
        buffer: String,
        /// Its size in bytes.
        size: u64,
        /// First byte.
        offset: u64,
        /// Bytes.
        bytes: u64,
        /// The rule that was broken.
        why: &'static str,
    },
    /// The caller's arguments do not fit the kernel's interface.
    #[error("kernel {kernel}: {what}")]
    Interface {
        /// The kernel.
        kernel: &'static str,
        /// What does not fit.
        what: String,
    },
    /// The hazard checker found two accesses without a barrier between them: a bug of the recorder.
    #[error("{0}")]
    Hazard(String),
    /// A shader wrote past the end of a buffer: its guard has changed.
    #[error("write past the end of buffer {buffer} of {size} bytes: {value:#010x} at byte {offset}")]
    Overrun {
        /// Name of the buffer.
        buffer: String,
        /// Its size in bytes.
        size: u64,
        /// First byte of the guard that changed.
        offset: u64,
        /// What stands there.
        value: u32,
    },
    /// A ticket that this device has not given out.
    #[error("ticket {ticket} is of another device: this one has given out {last}")]
    ForeignTicket {
        /// The ticket.
        ticket: u64,
        /// The last one given out.
        last: u64,
    },
    /// A buffer, a pipeline or a recording of another device.
    #[error("{what} is of another device")]
    Foreign {
        /// What it is, with its name.
        what: String,
    },
    /// Memory that the host sees is part of commands that were recorded for a host, whose end has not been told.
    #[error("buffer {buffer} is used by a recording for the host that has not been told to be finished")]
    InHostCommands {
        /// Name of the buffer.
        buffer: String,
    },
    /// The device was lost.
    #[error("device lost in {during}; last pass known to have started: {pass}")]
    DeviceLost {
        /// The call that reported it.
        during: &'static str,
        /// Name of the pass, or what is known of it.
        pass: String,
    },
    /// A Vulkan call failed.
    #[error("{call}: {result}")]
    Vulkan {
        /// The call.
        call: &'static str,
        /// Its result.
        result: vk::Result,
    },
    /// The memory allocator failed otherwise than by lack of memory.
    #[error("memory allocator: {0}")]
    Allocator(#[from] gpu_allocator::AllocationError),
    /// A host's allocator gave memory that cannot be used.
    #[error("the host's allocator, asked for memory of buffer {buffer}: {what}")]
    HostAllocator {
        /// Name of the buffer.
        buffer: String,
        /// What is wrong with it.
        what: &'static str,
    },
    /// The queue that a host handed over cannot be used.
    #[error("queue {index} of family {family}: {what}")]
    BadQueue {
        /// Family.
        family: u32,
        /// Index in it.
        index: u32,
        /// What is wrong with it.
        what: &'static str,
    },
    /// An environment variable that cannot be read.
    #[error("{name}={value}: it is to be {want}")]
    Variable {
        /// Its name.
        name: &'static str,
        /// What it holds.
        value: String,
        /// What it may hold.
        want: &'static str,
    },
    /// A file of the device layer (the pipeline cache) could not be read or written.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: std::path::PathBuf,
        /// Why.
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
