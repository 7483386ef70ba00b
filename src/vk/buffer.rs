//! Buffers: named and reference counted. A buffer is freed after the last handle is dropped and the last submit that
//! uses the buffer has finished.

use std::ops::Range;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64};

use ash::vk;

use super::caps::Addresses;
use super::device::Device;
use super::error::{Error, Named, Result};
use super::host_allocator::Memory;
use super::kernel::TexelFormat;
use super::lock::lock;
use super::memory::Block;

/// Least alignment of buffers and bound ranges, in bytes: the alignment that shaders declare for buffers reached by
/// address.
pub(super) const REFERENCE_ALIGNMENT: u64 = 16;
/// Word that fills new buffers when [`super::OpenOptions::garbage`] is on: NaN as a float or a half, and far too large
/// as a count.
pub(super) const GARBAGE: u32 = 0x7fff_7fff;
/// Bytes of the guard after a buffer.
pub(super) const GUARD: u64 = 256;

/// The Vulkan format of a texel.
pub(super) fn texel_format(format: TexelFormat) -> vk::Format {
    match format {
        TexelFormat::Float3 => vk::Format::R32G32B32_SFLOAT,
        TexelFormat::Float4 => vk::Format::R32G32B32A32_SFLOAT,
        TexelFormat::Uint4 => vk::Format::R32G32B32A32_UINT,
    }
}

/// Start of host-visible memory.
#[derive(Clone, Copy)]
struct Mapped(*mut u8);
// SAFETY: a plain address; the methods below guard every access through the address.
unsafe impl Send for Mapped {}
// SAFETY: as above.
unsafe impl Sync for Mapped {}

pub(super) struct BufferInner {
    pub(super) device: Arc<Device>,
    pub(super) raw: vk::Buffer,
    pub(super) id: u64,
    pub(super) name: String,
    pub(super) size: u64,
    /// Bytes before the guard: the size rounded up to a multiple of 4, at least 16.
    pub(super) capacity: u64,
    /// Bytes of the guard, 0 for none.
    pub(super) guard: u64,
    /// Device address of the first byte; 0 when `bufferDeviceAddress` is not in use.
    pub(super) address: u64,
    /// Whether the guard holds its pattern.
    pub(super) armed: AtomicBool,
    /// Whether the first content is in place: garbage, when new buffers are filled with garbage.
    pub(super) filled: AtomicBool,
    pub(super) memory: Memory,
    /// Ticket of the last submit that uses the buffer.
    pub(super) last_use: AtomicU64,
    /// Recordings for a host that use the buffer and have not ended.
    pub(super) lent: AtomicU32,
    mapped: Option<Mapped>,
    allocation: Mutex<Option<Block>>,
    /// Texel views of ranges, created when first bound. Only a few exist: of the whole buffer, and of ranges that stay
    /// the same.
    views: Mutex<Vec<(u64, u64, TexelFormat, vk::BufferView)>>,
}

/// A buffer without memory. `Drop` destroys the buffer when the allocation fails or the host's allocator panics.
struct Unbound<'a> {
    device: &'a Device,
    raw: vk::Buffer,
}

impl Drop for Unbound<'_> {
    fn drop(&mut self) {
        // SAFETY: created from this device and never used.
        unsafe { self.device.raw.destroy_buffer(self.raw, None) };
    }
}

/// A storage buffer. Cloning it gives another handle to the same memory.
#[derive(Clone)]
pub struct Buffer {
    pub(super) inner: Arc<BufferInner>,
}

impl std::fmt::Debug for Buffer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Buffer({}, {} bytes)", self.inner.name, self.inner.size)
    }
}

impl Buffer {
    pub(super) fn new(device: &Arc<Device>, name: &str, size: u64, memory: Memory) -> Result<Buffer> {
        let limit = device.caps.limits.allocation;
        let capacity = size.max(16).checked_next_multiple_of(4).unwrap_or(u64::MAX);
        if capacity > limit {
            return Err(Error::BufferTooLarge { buffer: name.to_owned(), bytes: size, limit });
        }
        let guarded = device.canaries && memory == Memory::Device && capacity <= limit - GUARD.min(limit);
        let guard = if guarded { GUARD } else { 0 };
        let addressed = device.caps.addresses != Addresses::Never;
        let mut usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::INDIRECT_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST;
        if device.caps.texels {
            usage |= vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER;
        }
        if addressed {
            usage |= vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS;
        }
        let info = vk::BufferCreateInfo::default()
            .size(capacity + guard)
            .usage(usage)
            .sharing_mode(vk::SharingMode::EXCLUSIVE);
        // SAFETY: the device is alive and the description valid.
        let raw = unsafe { device.raw.create_buffer(&info, None) }.named("vkCreateBuffer")?;
        let unbound = Unbound { device, raw };
        // SAFETY: `raw` was just created.
        let mut requirements = unsafe { device.raw.get_buffer_memory_requirements(raw) };
        requirements.alignment = requirements.alignment.max(REFERENCE_ALIGNMENT);
        let allocation = match lock(&device.memory).as_mut() {
            Some(pool) => pool.allocate(name, memory, requirements)?,
            None => return Err(Error::NoVulkan("the device is closed".into())),
        };
        std::mem::forget(unbound);
        let mut inner = BufferInner {
            device: device.clone(),
            raw,
            id: device.next_id(),
            name: name.to_owned(),
            size,
            capacity,
            guard,
            address: 0,
            armed: AtomicBool::new(guard == 0),
            filled: AtomicBool::new(!(device.garbage && memory == Memory::Device)),
            memory,
            last_use: AtomicU64::new(0),
            lent: AtomicU32::new(0),
            mapped: allocation.mapped().map(|p| Mapped(p.as_ptr().cast())),
            allocation: Mutex::new(Some(allocation)),
            views: Mutex::default(),
        };
        if let Some(allocation) = lock(&inner.allocation).as_ref() {
            let (memory, offset) = allocation.place();
            // SAFETY: the allocation was made for this buffer's requirements and is bound to nothing else.
            unsafe { device.raw.bind_buffer_memory(raw, memory, offset) }.named("vkBindBufferMemory")?;
        }
        if addressed {
            let info = vk::BufferDeviceAddressInfo::default().buffer(raw);
            // SAFETY: the buffer is bound to memory; buffer and memory were created for use by address.
            inner.address = unsafe { device.raw.get_buffer_device_address(&info) };
        }
        device.name(raw, name);
        let buffer = Buffer { inner: Arc::new(inner) };
        lock(&device.live).insert(buffer.inner.id, Arc::downgrade(&buffer.inner));
        if device.garbage && memory != Memory::Device {
            let words = GARBAGE.to_ne_bytes().into_iter().cycle().take(size as usize);
            buffer.store(0, &words.collect::<Vec<u8>>())?;
        }
        Ok(buffer)
    }

    /// A placeholder without memory, with size 0, so that no command can use the buffer. `bytes` are checked as for a
    /// real buffer.
    pub(super) fn unallocated(device: &Arc<Device>, name: &str, size: u64, memory: Memory) -> Result<Buffer> {
        let limit = device.caps.limits.allocation;
        if size > limit {
            return Err(Error::BufferTooLarge { buffer: name.to_owned(), bytes: size, limit });
        }
        let inner = BufferInner {
            device: device.clone(),
            raw: vk::Buffer::null(),
            id: device.next_id(),
            name: name.to_owned(),
            size: 0,
            capacity: 0,
            guard: 0,
            address: 0,
            armed: AtomicBool::new(true),
            filled: AtomicBool::new(true),
            memory,
            last_use: AtomicU64::new(0),
            lent: AtomicU32::new(0),
            mapped: None,
            allocation: Mutex::new(None),
            views: Mutex::default(),
        };
        Ok(Buffer { inner: Arc::new(inner) })
    }

    /// Bytes.
    pub fn size(&self) -> u64 {
        self.inner.size
    }

    /// Name.
    pub fn name(&self) -> &str {
        &self.inner.name
    }

    /// Kind of memory of the buffer.
    pub fn memory(&self) -> Memory {
        self.inner.memory
    }

    /// The Vulkan buffer, for a host that shares the device. Valid as long as a handle of this buffer exists.
    pub fn raw(&self) -> vk::Buffer {
        self.inner.raw
    }

    /// Device address of the first byte; `None` when `bufferDeviceAddress` is not in use.
    pub fn address(&self) -> Option<vk::DeviceAddress> {
        (self.inner.address != 0).then_some(self.inner.address)
    }

    /// The bytes `range`, to bind, fill or name in a command.
    pub fn slice(&self, range: Range<u64>) -> BufferSlice<'_> {
        BufferSlice { buffer: self, offset: range.start, bytes: range.end.saturating_sub(range.start) }
    }

    pub(super) fn bad_range(&self, offset: u64, bytes: u64, why: &'static str) -> Error {
        Error::BadRange { buffer: self.inner.name.clone(), size: self.inner.size, offset, bytes, why }
    }

    /// Checks that the buffer belongs to `device`.
    pub(super) fn of(&self, device: &Arc<Device>) -> Result<()> {
        if Arc::ptr_eq(&self.inner.device, device) {
            return Ok(());
        }
        Err(Error::Foreign { what: format!("buffer {}", self.inner.name) })
    }

    /// Checks that `bytes` at `offset` are inside.
    pub(super) fn inside(&self, offset: u64, bytes: u64) -> Result<()> {
        match offset.checked_add(bytes) {
            Some(end) if end <= self.inner.size => Ok(()),
            _ => Err(self.bad_range(offset, bytes, "the range reaches past the end")),
        }
    }

    /// A texel view of the bytes, without an incomplete texel at the end.
    pub(super) fn texels(&self, offset: u64, bytes: u64, format: TexelFormat) -> Result<vk::BufferView> {
        let mut views = lock(&self.inner.views);
        if let Some(&(.., view)) = views.iter().find(|&&(o, b, f, _)| (o, b, f) == (offset, bytes, format)) {
            return Ok(view);
        }
        let info = vk::BufferViewCreateInfo::default()
            .buffer(self.inner.raw)
            .format(texel_format(format))
            .offset(offset)
            .range(bytes / format.bytes() * format.bytes());
        // SAFETY: the range is inside the buffer, whose usage allows texel views; alignment and number of texels were
        // checked when the command was recorded.
        let view = unsafe { self.inner.device.raw.create_buffer_view(&info, None) }.named("vkCreateBufferView")?;
        views.push((offset, bytes, format, view));
        Ok(view)
    }

    /// Copies host bytes into mapped memory.
    pub(super) fn store(&self, offset: u64, bytes: &[u8]) -> Result<()> {
        self.inside(offset, bytes.len() as u64)?;
        let mapped = self.inner.mapped.ok_or_else(|| self.bad_range(offset, 0, "the buffer is not host-visible"))?;
        // One writer at a time.
        let _held = lock(&self.inner.allocation);
        // SAFETY: the range is inside the mapping, which lives as long as the buffer. No other thread writes while the
        // lock is held, and nothing reads through the mapping. The device does not read meanwhile: only one recorder at
        // a time holds a staging buffer, and a direct write happens under the lock of the queue while nothing in flight
        // uses the buffer.
        unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), mapped.0.add(offset as usize), bytes.len()) };
        Ok(())
    }

    /// Copies mapped memory to the host.
    pub(super) fn load<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
        &self,
        offset: u64,
        count: usize,
    ) -> Result<Vec<T>> {
        let bytes = (count as u64).saturating_mul(size_of::<T>() as u64);
        self.inside(offset, bytes)?;
        let mapped =
            self.inner.mapped.ok_or_else(|| self.bad_range(offset, bytes, "the buffer is not host-visible"))?;
        let mut values = vec![<T as bytemuck::Zeroable>::zeroed(); count];
        // SAFETY: the range is inside the mapping; `values` has the same number of bytes, and any bytes are a valid
        // `T`. The device does not write: the buffer is the caller's own and its only submit has finished, or the
        // caller holds the lock of the queue and nothing in flight writes the range.
        unsafe {
            let target = values.as_mut_ptr().cast::<u8>();
            std::ptr::copy_nonoverlapping(mapped.0.add(offset as usize), target, bytes as usize);
        }
        Ok(values)
    }
}

impl Drop for BufferInner {
    fn drop(&mut self) {
        // SAFETY: no handle is left, and the recorder holds one until every submit that uses the buffer has finished.
        unsafe {
            lock(&self.views).drain(..).for_each(|(.., view)| self.device.raw.destroy_buffer_view(view, None));
            self.device.raw.destroy_buffer(self.raw, None);
        }
        lock(&self.device.live).remove(&self.id);
        lock(&self.device.freed).push(self.id);
        // Freed last, because a host's allocator may panic.
        if let Some(allocation) = lock(&self.allocation).take()
            && let Some(pool) = lock(&self.device.memory).as_mut()
        {
            pool.free(self.memory, allocation);
        }
    }
}

/// A range of a buffer.
#[derive(Clone, Copy, Debug)]
pub struct BufferSlice<'a> {
    pub(super) buffer: &'a Buffer,
    pub(super) offset: u64,
    pub(super) bytes: u64,
}

impl<'a> From<&'a Buffer> for BufferSlice<'a> {
    fn from(buffer: &'a Buffer) -> Self {
        BufferSlice { buffer, offset: 0, bytes: buffer.inner.capacity }
    }
}
