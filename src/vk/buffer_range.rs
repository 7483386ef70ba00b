//! Ranges of buffers, for memory that several owners use in turn.

use std::ops::Range;

use super::buffer::{Buffer, BufferSlice};
use super::error::Result;
use super::gpu::Gpu;

/// A range of a buffer that keeps the buffer alive. Barriers are inferred per byte, so overlapping ranges are ordered
/// like any other use of the same bytes.
#[derive(Clone, Debug)]
pub struct BufferRange {
    buffer: Buffer,
    range: Range<u64>,
}

impl BufferRange {
    /// The bytes `range` of `buffer`.
    pub fn of(buffer: &Buffer, range: Range<u64>) -> BufferRange {
        BufferRange { buffer: buffer.clone(), range }
    }

    /// The whole of `buffer`.
    pub fn whole(buffer: Buffer) -> BufferRange {
        let range = 0..buffer.size();
        BufferRange { buffer, range }
    }

    /// The range, to bind, fill or name in a command.
    pub fn slice(&self) -> BufferSlice<'_> {
        self.buffer.slice(self.range.clone())
    }
}

impl BufferSlice<'_> {
    /// First byte in the buffer.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// Size in bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// Whole buffers as slices, to bind together with ranges of other buffers.
pub fn slices<const N: usize>(buffers: [&Buffer; N]) -> [BufferSlice<'_>; N] {
    buffers.map(Into::into)
}

impl<'a> From<&'a BufferRange> for BufferSlice<'a> {
    fn from(part: &'a BufferRange) -> Self {
        part.slice()
    }
}

impl Gpu {
    /// The first `count` values of a slice, after everything submitted so far. Waits.
    pub fn read_slice<T: bytemuck::Pod>(&self, slice: BufferSlice<'_>, count: usize) -> Result<Vec<T>> {
        self.read_at(slice.buffer, slice.offset, count)
    }
}
