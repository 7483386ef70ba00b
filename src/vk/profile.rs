//! Counters of submitted work, and pass times.

/// Counts since the device was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Dispatches.
    pub dispatches: u64,
    /// Dispatches that reach their buffers by address.
    pub by_address: u64,
    /// Fills, copies and uploads.
    pub transfers: u64,
    /// Pipeline barriers.
    pub barriers: u64,
    /// Buffer ranges in pipeline barriers.
    pub buffer_barriers: u64,
    /// Queue submits.
    pub submits: u64,
    /// Waits for the last submit, after which the device has no submitted work.
    pub host_waits: u64,
    /// Waits for an earlier submit, which bound the work in the queue.
    pub pacing_waits: u64,
}

/// Time from the end of the previous command to the end of this command. The times of a recording add up to its total
/// time.
#[derive(Clone, Debug, PartialEq)]
pub struct PassTime {
    /// Name of the kernel, or `clear`, `copy`, `upload`.
    pub pass: String,
    /// Nanoseconds.
    pub ns: f64,
}
