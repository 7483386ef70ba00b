//! The recorder: commands as data. A submit creates barriers, descriptors and the command buffer, in submission order,
//! so that several recorders may be filled in parallel.

use std::sync::Arc;

use super::barrier::{BufferUse, Use};
use super::buffer::{Buffer, BufferSlice};
use super::caps::Addresses;
use super::device::Device;
use super::error::{Error, Result};
use super::gpu::Gpu;
use super::kernel::Access;
use super::pipeline::Pipeline;
use super::pipeline_variant::BindingMode;
use super::ticket::Ticket;

/// Most workgroups along one axis that every device allows.
const AXIS: u64 = 65_535;

/// Size of a dispatch.
#[derive(Clone, Copy, Debug)]
pub enum Groups<'a> {
    /// At least this many threads.
    Items(u64),
    /// At least this many workgroups.
    Workgroups(u64),
    /// Workgroup counts (x, y, z as u32) from a byte offset of a buffer.
    Indirect(&'a Buffer, u64),
}

/// Spreads a number of workgroups over x and y, with as little excess as the axis limit allows. `None` for too many.
pub fn fold(groups: u64) -> Option<(u32, u32)> {
    let y = groups.div_ceil(AXIS).max(1);
    let x = groups.div_ceil(y);
    (y <= AXIS).then_some((x as u32, y as u32))
}

pub(super) enum Counts {
    Fixed(u32, u32),
    Indirect(Buffer, u64),
}

/// A bound range. A range up to the end of the buffer includes the guard.
pub(super) struct Bound {
    pub(super) buffer: Buffer,
    pub(super) offset: u64,
    pub(super) bytes: u64,
}

/// Table of the addresses of a dispatch's buffers, in staging memory that the recording keeps.
pub(super) struct Table {
    pub(super) buffer: Buffer,
    pub(super) offset: u64,
    pub(super) bytes: u64,
}

pub(super) enum Command {
    Dispatch {
        pipeline: Pipeline,
        mode: BindingMode,
        buffers: Vec<Bound>,
        table: Option<Table>,
        push: Vec<u8>,
        counts: Counts,
    },
    Fill {
        buffer: Buffer,
        offset: u64,
        bytes: u64,
        value: u32,
    },
    Copy {
        from: Buffer,
        from_offset: u64,
        to: Buffer,
        to_offset: u64,
        bytes: u64,
        staged: bool,
    },
}

impl Command {
    pub(super) fn name(&self) -> &str {
        match self {
            Command::Dispatch { pipeline, .. } => pipeline.name(),
            Command::Fill { .. } => "clear",
            Command::Copy { staged: true, .. } => "upload",
            Command::Copy { .. } => "copy",
        }
    }

    pub(super) fn uses(&self) -> Vec<BufferUse> {
        let one = |buffer: &Buffer, offset: u64, bytes: u64, kind: Use| BufferUse {
            buffer: buffer.inner.id,
            range: offset..offset + bytes,
            kind,
        };
        match self {
            Command::Dispatch { pipeline, buffers, counts, .. } => {
                let mut uses: Vec<BufferUse> = Vec::with_capacity(buffers.len() + 1);
                for (bound, binding) in buffers.iter().zip(pipeline.inner.kernel.bindings) {
                    let kind = match binding.access {
                        Access::Read => Use::ShaderRead,
                        Access::Write => Use::ShaderWrite,
                        Access::ReadWrite => Use::ShaderReadWrite,
                    };
                    uses.push(one(&bound.buffer, bound.offset, bound.bytes, kind));
                }
                if let Counts::Indirect(buffer, offset) = counts {
                    uses.push(one(buffer, *offset, 12, Use::Indirect));
                }
                uses
            }
            Command::Fill { buffer, offset, bytes, .. } => vec![one(buffer, *offset, *bytes, Use::CopyWrite)],
            // Only the host writes staging memory, before the submit and after the previous user's ticket has passed.
            Command::Copy { to, to_offset, bytes, staged: true, .. } => {
                vec![one(to, *to_offset, *bytes, Use::CopyWrite)]
            }
            Command::Copy { from, from_offset, to, to_offset, bytes, .. } => {
                vec![one(from, *from_offset, *bytes, Use::CopyRead), one(to, *to_offset, *bytes, Use::CopyWrite)]
            }
        }
    }

    pub(super) fn buffers(&self) -> Vec<&Buffer> {
        match self {
            Command::Dispatch { buffers, counts, .. } => {
                let mut all: Vec<&Buffer> = buffers.iter().map(|b| &b.buffer).collect();
                if let Counts::Indirect(buffer, _) = counts {
                    all.push(buffer);
                }
                all
            }
            Command::Fill { buffer, .. } => vec![buffer],
            Command::Copy { from, to, .. } => vec![from, to],
        }
    }
}

/// A list of commands for the device. Commands run in order, and overlap when no barrier is needed.
pub struct Recorder {
    pub(super) gpu: Gpu,
    pub(super) label: String,
    pub(super) commands: Vec<Command>,
    /// Staging buffers, each with the bytes used.
    pub(super) staging: Vec<(Buffer, u64)>,
    pub(super) profile: bool,
    pub(super) omit_barrier: Option<usize>,
    pub(super) addresses: Option<bool>,
    pub(super) texels: Option<bool>,
}

impl Recorder {
    /// Sets every word of a buffer, or of a slice, to `value`.
    pub fn fill<'a>(&mut self, target: impl Into<BufferSlice<'a>>, value: u32) -> Result<()> {
        let BufferSlice { buffer, offset, bytes } = target.into();
        self.inside(buffer, offset, bytes)?;
        if offset % 4 != 0 || bytes % 4 != 0 {
            return Err(buffer.bad_range(offset, bytes, "offset and size of a fill must be multiples of 4"));
        }
        if bytes > 0 {
            self.commands.push(Command::Fill { buffer: buffer.clone(), offset, bytes, value });
        }
        Ok(())
    }

    /// Copies bytes from one buffer to another, or between ranges of one buffer that do not overlap.
    pub fn copy(&mut self, from: &Buffer, from_offset: u64, to: &Buffer, to_offset: u64, bytes: u64) -> Result<()> {
        from.of(self.gpu.device())?;
        to.of(self.gpu.device())?;
        from.inside(from_offset, bytes)?;
        to.inside(to_offset, bytes)?;
        let apart = from_offset + bytes <= to_offset || to_offset + bytes <= from_offset;
        if from.inner.id == to.inner.id && !apart {
            return Err(to.bad_range(to_offset, bytes, "source and destination of a copy overlap"));
        }
        if bytes > 0 {
            let (from, to) = (from.clone(), to.clone());
            self.commands.push(Command::Copy { from, from_offset, to, to_offset, bytes, staged: false });
        }
        Ok(())
    }

    /// Writes host bytes into a buffer, in order with the other commands. The bytes are copied to staging memory at
    /// once.
    pub fn upload(&mut self, to: &Buffer, to_offset: u64, bytes: &[u8]) -> Result<()> {
        let len = bytes.len() as u64;
        to.of(self.gpu.device())?;
        to.inside(to_offset, len)?;
        if bytes.is_empty() {
            return Ok(());
        }
        let (from, from_offset) = self.stage(bytes, 16)?;
        self.commands.push(Command::Copy { from, from_offset, to: to.clone(), to_offset, bytes: len, staged: true });
        Ok(())
    }

    /// Copies host bytes into staging memory, at a multiple of `alignment`. The staging memory is not reused before the
    /// ticket has passed. The device sees host writes before a submit without a barrier.
    fn stage(&mut self, bytes: &[u8], alignment: u64) -> Result<(Buffer, u64)> {
        let len = bytes.len() as u64;
        let free = self.staging.last().and_then(|(chunk, used)| {
            let at = used.next_multiple_of(alignment);
            (at + len <= chunk.size()).then(|| (chunk.clone(), at))
        });
        let (chunk, at) = match free {
            Some(free) => free,
            None => {
                let chunk = self.gpu.staging(len)?;
                self.staging.push((chunk.clone(), 0));
                (chunk, 0)
            }
        };
        chunk.store(at, bytes)?;
        if let Some((_, used)) = self.staging.last_mut() {
            *used = at + len;
        }
        Ok((chunk, at))
    }

    /// Runs a kernel with `buffers` in binding order. A dispatch of zero items or workgroups is left out.
    pub fn dispatch<'a, B: Copy + Into<BufferSlice<'a>>>(
        &mut self,
        pipeline: &Pipeline,
        buffers: &[B],
        push: &impl bytemuck::NoUninit,
        groups: Groups<'_>,
    ) -> Result<()> {
        let kernel = pipeline.name();
        let bad = |what: String| Error::Interface { kernel, what };
        pipeline.of(self.gpu.device())?;
        let bindings = pipeline.inner.kernel.bindings;
        if buffers.len() != bindings.len() {
            return Err(bad(format!("{} buffers given for {} bindings", buffers.len(), bindings.len())));
        }
        let push = bytemuck::bytes_of(push);
        let push_bytes = pipeline.inner.kernel.push_bytes;
        if push.len() != push_bytes as usize {
            return Err(bad(format!("{} bytes of push constants given, {push_bytes} expected", push.len())));
        }
        let slices: Vec<BufferSlice<'a>> = buffers.iter().map(|&b| b.into()).collect();
        let mode = self.binding_mode(pipeline, &slices)?;
        let limits = self.gpu.caps().limits;
        let mut bound = Vec::with_capacity(buffers.len());
        for BufferSlice { buffer, offset, bytes } in slices {
            self.inside(buffer, offset, bytes)?;
            if offset % limits.storage_alignment != 0 || bytes == 0 {
                return Err(buffer.bad_range(
                    offset,
                    bytes,
                    "a binding must not be empty and must start at a multiple of the device's storage alignment",
                ));
            }
            // The guard is bound too, so that a write past the end reaches the guard instead of being dropped by the
            // driver.
            let fits = mode.by_address() || bytes + buffer.inner.guard <= limits.storage_range;
            let last = offset + bytes == buffer.inner.capacity && fits;
            let bytes = if last { bytes + buffer.inner.guard } else { bytes };
            bound.push(Bound { buffer: buffer.clone(), offset, bytes });
        }
        let size = u64::from(pipeline.workgroup_size());
        let counts = match groups {
            Groups::Items(0) | Groups::Workgroups(0) => return Ok(()),
            Groups::Items(items) => fold(items.div_ceil(size)).map(|(x, y)| Counts::Fixed(x, y)),
            Groups::Workgroups(groups) => fold(groups).map(|(x, y)| Counts::Fixed(x, y)),
            Groups::Indirect(buffer, offset) => {
                buffer.of(self.gpu.device())?;
                buffer.inside(offset, 12)?;
                if offset % 4 != 0 {
                    return Err(buffer.bad_range(
                        offset,
                        12,
                        "the offset of indirect workgroup counts must be a multiple of 4",
                    ));
                }
                Some(Counts::Indirect(buffer.clone(), offset))
            }
        };
        let counts = counts.ok_or_else(|| bad(format!("{groups:?} exceeds the size limit of a dispatch")))?;
        self.gpu.make_variant(pipeline, mode)?;
        let table = if mode.by_address() { Some(self.table(&bound)?) } else { None };
        let (pipeline, push) = (pipeline.clone(), push.to_vec());
        self.commands.push(Command::Dispatch { pipeline, mode, buffers: bound, table, push, counts });
        Ok(())
    }

    /// How a dispatch reaches its buffers. By address when a binding is larger than a descriptor's range, or always on
    /// request. Rows are read as texels when texels are on and the kernel has the variant.
    fn binding_mode(&self, pipeline: &Pipeline, slices: &[BufferSlice<'_>]) -> Result<BindingMode> {
        let caps = self.gpu.caps();
        let limit = caps.limits.storage_range;
        let possible = caps.addresses != Addresses::Never && pipeline.inner.by_address();
        let beyond = slices.iter().find(|slice| slice.bytes > limit);
        let always = self.addresses.unwrap_or(caps.addresses == Addresses::Always);
        let texels = self.texels.unwrap_or(caps.texels);
        match beyond {
            _ if possible && (always || beyond.is_some()) => {
                // A request for addresses applies to all buffers, unless texels are requested too.
                let texels = if always { self.texels == Some(true) } else { texels };
                let seen = texels && self.as_texels(pipeline, slices, BindingMode::TexelsByAddress);
                Ok(if seen { BindingMode::TexelsByAddress } else { BindingMode::Addresses })
            }
            None if texels && self.as_texels(pipeline, slices, BindingMode::Texels) => Ok(BindingMode::Texels),
            None => Ok(BindingMode::Descriptors),
            Some(BufferSlice { buffer, bytes, .. }) => {
                Err(Error::BindingTooLarge { buffer: buffer.name().to_owned(), bytes: *bytes, limit })
            }
        }
    }

    /// Whether this variant can read rows as texels: the kernel has the variant, and each slice fits the limits of
    /// texel buffers.
    fn as_texels(&self, pipeline: &Pipeline, slices: &[BufferSlice<'_>], mode: BindingMode) -> bool {
        let caps = self.gpu.caps();
        let Some(views) = pipeline.inner.texels(caps, mode) else { return false };
        views.iter().all(|view| {
            slices.get(view.binding as usize).is_some_and(|slice| {
                let count = slice.bytes / view.format.bytes();
                (1..=caps.limits.texels).contains(&count) && slice.offset % caps.limits.texel_alignment == 0
            })
        })
    }

    fn table(&mut self, bound: &[Bound]) -> Result<Table> {
        let addresses: Vec<u64> = bound.iter().map(|b| b.buffer.inner.address + b.offset).collect();
        let bytes = bytemuck::cast_slice(&addresses);
        let (buffer, offset) = self.stage(bytes, self.gpu.caps().limits.storage_alignment)?;
        Ok(Table { buffer, offset, bytes: bytes.len() as u64 })
    }

    /// Makes later dispatches reach buffers by address (`Some(true)`), or through descriptors up to their range
    /// (`Some(false)`), regardless of the device's options. For tests that compare both.
    #[doc(hidden)]
    pub fn force_addresses(&mut self, addresses: Option<bool>) {
        self.addresses = addresses;
    }

    /// Makes later dispatches read rows as texels, or not. No effect unless the device was opened with texels. For
    /// tests that compare both.
    #[doc(hidden)]
    pub fn force_texels(&mut self, texels: Option<bool>) {
        self.texels = texels.filter(|_| self.gpu.caps().texels);
    }

    /// Takes timestamps around every command. [`Gpu::timings`] returns the times after the ticket has passed.
    pub fn profile(&mut self, on: bool) {
        self.profile = on;
    }

    /// Number of commands recorded so far.
    pub fn len(&self) -> usize {
        self.commands.len()
    }

    /// Whether no command was recorded.
    pub fn is_empty(&self) -> bool {
        self.commands.is_empty()
    }

    /// Submits the commands to the device without waiting.
    pub fn submit(self) -> Result<Ticket> {
        let gpu = self.gpu.clone();
        gpu.submit(self)
    }

    /// Leaves out inferred barrier number `n` of this recording. For tests that expect the omission to be detected.
    #[doc(hidden)]
    pub fn omit_barrier(&mut self, n: usize) {
        self.omit_barrier = Some(n);
    }

    /// Checks that the recorder belongs to `device`.
    pub(super) fn of(&self, device: &Arc<Device>) -> Result<()> {
        if Arc::ptr_eq(self.gpu.device(), device) {
            return Ok(());
        }
        Err(Error::Foreign { what: format!("recording {}", self.label) })
    }

    fn inside(&self, buffer: &Buffer, offset: u64, bytes: u64) -> Result<()> {
        buffer.of(self.gpu.device())?;
        // The bound is the capacity, not the size: a whole buffer is bound and filled up to its rounded size.
        match offset.checked_add(bytes) {
            Some(end) if end <= buffer.inner.capacity => Ok(()),
            _ => Err(buffer.bad_range(offset, bytes, "the range reaches past the end")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::fold;

    #[test]
    fn folding_covers_every_group_with_less_than_a_row_of_excess() {
        for groups in [0, 1, 65_535, 65_536, 70_000, 129_600, 131_070, 131_071, 5_000_000, 65_535 * 65_535] {
            let (x, y) = fold(groups).unwrap();
            assert!(x <= 65_535 && y <= 65_535);
            let run = u64::from(x) * u64::from(y);
            assert!(run >= groups && run < groups + u64::from(y), "{groups} as {x} x {y}");
        }
        assert!(fold(65_535 * 65_535 + 1).is_none());
    }
}
