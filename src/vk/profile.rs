//! Counters of what was handed to the device, and times of passes.

/// Counted since the device was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Dispatches.
    pub dispatches: u64,
    /// Those of them that reach their buffers by address.
    pub by_address: u64,
    /// Fills, copies and uploads.
    pub transfers: u64,
    /// Pipeline barriers.
    pub barriers: u64,
    /// Buffer ranges in them.
    pub buffer_barriers: u64,
    /// Queue submits.
    pub submits: u64,
    /// Waits for the last submit: the device has no submitted work left afterwards.
    pub host_waits: u64,
    /// Waits for an earlier submit, to bound the queue.
    pub pacing_waits: u64,
}

/// Time from the end of the command before to the end of this one, so that the times of a recording add up to its
/// whole.
#[derive(Clone, Debug, PartialEq)]
pub struct PassTime {
    /// Name of the kernel, or `clear`, `copy`, `upload`.
    pub pass: String,
    /// Nanoseconds.
    pub ns: f64,
}
