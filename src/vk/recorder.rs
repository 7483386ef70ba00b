//! The recorder: commands as data. Barriers, descriptors and the command buffer are made when it is submitted, in
//! submission order, so that recorders may be filled side by side.

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

/// Workgroups along one axis that every device takes.
const AXIS: u64 = 65_535;

/// How much a dispatch runs.
#[derive(Clone, Copy, Debug)]
pub enum Groups<'a> {
    /// At least this many threads.
    Items(u64),
    /// At least this many workgroups.
    Workgroups(u64),
    /// Workgroup counts (x, y, z as u32) at a byte offset of a buffer.
    Indirect(&'a Buffer, u64),
}

/// Folds a number of workgroups over x and y, with as little excess as the axis limit allows.
pub fn fold(groups: u64) -> Option<(u32, u32)> {
    let y = groups.div_ceil(AXIS).max(1);
    let x = groups.div_ceil(y);
    (y <= AXIS).then_some((x as u32, y as u32))
}

pub(super) enum Counts {
    Fixed(u32, u32),
    Indirect(Buffer, u64),
}

/// A bound range, guard included where it reaches the end of the buffer.
pub(super) struct Bound {
    pub(super) buffer: Buffer,
    pub(super) offset: u64,
    pub(super) bytes: u64,
}

/// Addresses of a dispatch's buffers, in staging memory that the recording keeps.
pub(super) struct Table {
    pub(super) buffer: Buffer,
    pub(super) offset: u64,
    pub(super) bytes: u64,
}

pub(super) enum Command {
    Dispatch {
        pipeline: Pipeline,
        reach: BindingMode,
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
            // Staging memory is written by the host only, before the submit and after the ticket of the one before.
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

/// Commands on their way to the device. They run in order, overlapping where no barrier is needed.
pub struct Recorder {
    pub(super) gpu: Gpu,
    pub(super) label: String,
    pub(super) commands: Vec<Command>,
    /// Staging buffers and the bytes used of each.
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
            return Err(buffer.bad_range(offset, bytes, "a fill covers whole words"));
        }
        if bytes > 0 {
            self.commands.push(Command::Fill { buffer: buffer.clone(), offset, bytes, value });
        }
        Ok(())
    }

    /// Copies bytes from one buffer to another, or within one where the ranges do not overlap.
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

    /// Writes host bytes into a buffer. They are copied at once; the device sees them when the recorder's turn comes.
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

    /// Copies host bytes into staging memory, at a multiple of `alignment`. It stays theirs until the ticket has
    /// passed; what the host writes before a submit the device sees without a barrier.
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

    /// Runs a kernel with `buffers` in binding order. A dispatch of nothing is left out.
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
            return Err(bad(format!("{} buffers for {} bindings", buffers.len(), bindings.len())));
        }
        let push = bytemuck::bytes_of(push);
        let push_bytes = pipeline.inner.kernel.push_bytes;
        if push.len() != push_bytes as usize {
            return Err(bad(format!("{} bytes of push constants for {push_bytes}", push.len())));
        }
        let slices: Vec<BufferSlice<'a>> = buffers.iter().map(|&b| b.into()).collect();
        let reach = self.reach(pipeline, &slices)?;
        let limits = self.gpu.caps().limits;
        let mut bound = Vec::with_capacity(buffers.len());
        for BufferSlice { buffer, offset, bytes } in slices {
            self.inside(buffer, offset, bytes)?;
            if offset % limits.storage_alignment != 0 || bytes == 0 {
                return Err(buffer.bad_range(
                    offset,
                    bytes,
                    "a binding is not empty and starts at a multiple of the device's storage alignment",
                ));
            }
            // The guard is bound too, so that a write past the end lands in it rather than being dropped by the driver.
            let fits = reach.by_address() || bytes + buffer.inner.guard <= limits.storage_range;
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
                    return Err(buffer.bad_range(offset, 12, "indirect counts start at a multiple of 4"));
                }
                Some(Counts::Indirect(buffer.clone(), offset))
            }
        };
        let counts = counts.ok_or_else(|| bad(format!("{groups:?} is more than a dispatch holds")))?;
        self.gpu.make_form(pipeline, reach)?;
        let table = if reach.by_address() { Some(self.table(&bound)?) } else { None };
        let (pipeline, push) = (pipeline.clone(), push.to_vec());
        self.commands.push(Command::Dispatch { pipeline, reach, buffers: bound, table, push, counts });
        Ok(())
    }

    /// How a dispatch reaches its buffers: by address where one is larger than a descriptor's range, or always where
    /// that was asked for; rows as texels where the kernel does.
    fn reach(&self, pipeline: &Pipeline, slices: &[BufferSlice<'_>]) -> Result<BindingMode> {
        let caps = self.gpu.caps();
        let limit = caps.limits.storage_range;
        let possible = caps.addresses != Addresses::Never && pipeline.inner.by_address();
        let beyond = slices.iter().find(|slice| slice.bytes > limit);
        let always = self.addresses.unwrap_or(caps.addresses == Addresses::Always);
        let texels = self.texels.unwrap_or(caps.texels);
        match beyond {
            _ if possible && (always || beyond.is_some()) => {
                // Whoever asks for addresses means all of them, unless texels are asked for too.
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

    /// Whether rows can be read as texels in this variant: where the kernel has it,
    /// and every buffer concerned can be seen so.
    fn as_texels(&self, pipeline: &Pipeline, slices: &[BufferSlice<'_>], reach: BindingMode) -> bool {
        let caps = self.gpu.caps();
        let Some(views) = pipeline.inner.texels(caps, reach) else { return false };
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

    /// Reaches buffers by address in the dispatches to come (`Some(true)`), or through descriptors as far as they go
    /// (`Some(false)`), whatever the device was opened for: for tests that compare the two.
    #[doc(hidden)]
    pub fn force_addresses(&mut self, addresses: Option<bool>) {
        self.addresses = addresses;
    }

    /// Reads rows as texels in the dispatches to come, or not, where the device was opened for it:
    /// for tests that compare the two.
    #[doc(hidden)]
    pub fn force_texels(&mut self, texels: Option<bool>) {
        self.texels = texels.filter(|_| self.gpu.caps().texels);
    }

    /// Takes timestamps around every command; [`Gpu::timings`] has them after the ticket has passed.
    pub fn profile(&mut self, on: bool) {
        self.profile = on;
    }

    /// Number of commands recorded so far.
    pub fn len(&self) -> usize {
        self.commands.len()
    }

    /// True when nothing was recorded.
    pub fn is_empty(&self) -> bool {
        self.commands.is_empty()
    }

    /// Hands the commands to the device and returns at once.
    pub fn submit(self) -> Result<Ticket> {
        let gpu = self.gpu.clone();
        gpu.submit(self)
    }

    /// Leaves out the `n`th inferred barrier of this recording: for tests that something notices.
    #[doc(hidden)]
    pub fn omit_barrier(&mut self, n: usize) {
        self.omit_barrier = Some(n);
    }

    /// Checks that it is a recorder of this device.
    pub(super) fn of(&self, device: &Arc<Device>) -> Result<()> {
        if Arc::ptr_eq(self.gpu.device(), device) {
            return Ok(());
        }
        Err(Error::Foreign { what: format!("recording {}", self.label) })
    }

    fn inside(&self, buffer: &Buffer, offset: u64, bytes: u64) -> Result<()> {
        buffer.of(self.gpu.device())?;
        // Up to the capacity: a whole buffer is bound and filled with its last word and its least size.
        match offset.checked_add(bytes) {
            Some(end) if end <= buffer.inner.capacity => Ok(()),
            _ => Err(buffer.bad_range(offset, bytes, "it reaches past the end")),
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
