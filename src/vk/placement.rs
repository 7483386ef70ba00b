//! Where buffers live.

/// Where a buffer lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Memory {
    /// Fast for the device.
    Device,
    /// Written by the host.
    Upload,
    /// Read by the host.
    Readback,
}
