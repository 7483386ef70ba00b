//! The barriers of a recording.

use super::barrier::{Barrier, BufferUse};

/// The barriers in front of every command, those at the end for the host, and what the host may read.
pub(super) struct Plan {
    pub(super) commands: Vec<Vec<Barrier>>,
    pub(super) end: Vec<Barrier>,
    pub(super) landings: Vec<BufferUse>,
}
