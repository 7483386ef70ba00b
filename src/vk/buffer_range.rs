//! Parts of buffers, for memory that several owners use one after the other.

use std::ops::Range;

use super::buffer::{Buffer, BufferSlice};
use super::error::Result;
use super::gpu::Gpu;

/// A range of a buffer with a handle of its own. Barriers are inferred per byte, so parts that overlap are ordered like
/// any other use of the same bytes.
#[derive(Clone, Debug)]
pub struct Part {
    buffer: Buffer,
    range: Range<u64>,
}

impl Part {
    /// The bytes `range` of `buffer`.
    pub fn of(buffer: &Buffer, range: Range<u64>) -> Part {
        Part { buffer: buffer.clone(), range }
    }

    /// All of a buffer.
    pub fn whole(buffer: Buffer) -> Part {
        let range = 0..buffer.size();
        Part { buffer, range }
    }

    /// As something to bind, fill or name in a command.
    pub fn slice(&self) -> BufferSlice<'_> {
        self.buffer.slice(self.range.clone())
    }
}

impl BufferSlice<'_> {
    /// Where it begins in its buffer.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// Its size.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// Whole buffers, to be bound with parts of others.
pub fn slices<const N: usize>(buffers: [&Buffer; N]) -> [BufferSlice<'_>; N] {
    buffers.map(Into::into)
}

impl<'a> From<&'a Part> for BufferSlice<'a> {
    fn from(part: &'a Part) -> Self {
        part.slice()
    }
}

impl Gpu {
    /// The first `count` values of a slice, after all that was submitted. Waits.
    pub fn read_slice<T: bytemuck::Pod>(&self, slice: BufferSlice<'_>, count: usize) -> Result<Vec<T>> {
        self.read_at(slice.buffer, slice.offset, count)
    }
}
