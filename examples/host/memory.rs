//! The host's memory: an allocator for the engine, and the host's own buffer and image.

use std::collections::HashMap;
use std::ffi::c_void;
use std::ptr::NonNull;
use std::sync::{Arc, Mutex, PoisonError};

use psrgs_vk::vk::ash::{self, vk};
use psrgs_vk::vk::{HostAllocator, Memory, MemoryBlock, MemoryRequest};

use super::Host;

// ANCHOR: allocator
/// An allocator of the host: one memory object per buffer, which suffices for the hundred buffers of a training.
pub struct Allocator {
    device: ash::Device,
    types: vk::PhysicalDeviceMemoryProperties,
    /// Bytes of every lent memory object by handle, and the largest number of lent objects.
    lent: Mutex<(HashMap<vk::DeviceMemory, u64>, usize)>,
}

// SAFETY: each block is a memory object of its own, which lives until it is freed.
unsafe impl HostAllocator for Allocator {
    fn allocate(&self, request: &MemoryRequest<'_>) -> Result<MemoryBlock, vk::Result> {
        let visible = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        let wanted = match request.memory {
            Memory::Device => vk::MemoryPropertyFlags::DEVICE_LOCAL,
            Memory::Upload => visible,
            Memory::Readback => visible | vk::MemoryPropertyFlags::HOST_CACHED,
        };
        let needs = request.requirements;
        let memory_type = self
            .memory_type(needs.memory_type_bits, wanted)
            .or_else(|| self.memory_type(needs.memory_type_bits, visible & wanted))
            .ok_or(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY)?;
        let mut flags = vk::MemoryAllocateFlagsInfo::default();
        if request.device_address {
            flags = flags.flags(vk::MemoryAllocateFlags::DEVICE_ADDRESS);
        }
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(needs.size)
            .memory_type_index(memory_type)
            .push_next(&mut flags);
        // SAFETY: valid description.
        let memory = unsafe { self.device.allocate_memory(&info, None) }?;
        let (lent, most) = &mut *self.lent.lock().unwrap_or_else(PoisonError::into_inner);
        lent.insert(memory, needs.size);
        *most = lent.len().max(*most);
        Ok(MemoryBlock { memory, offset: 0, size: needs.size, memory_type, token: 0 })
    }

    fn map(&self, block: &MemoryBlock) -> Result<NonNull<c_void>, vk::Result> {
        // SAFETY: the memory is host-visible, and mapped once.
        let pointer =
            unsafe { self.device.map_memory(block.memory, block.offset, block.size, vk::MemoryMapFlags::empty()) }?;
        NonNull::new(pointer).ok_or(vk::Result::ERROR_MEMORY_MAP_FAILED)
    }

    fn free(&self, block: MemoryBlock) {
        self.lent.lock().unwrap_or_else(PoisonError::into_inner).0.remove(&block.memory);
        // SAFETY: the engine no longer uses the block; freeing unmaps the memory.
        unsafe { self.device.free_memory(block.memory, None) };
    }
}
// ANCHOR_END: allocator

impl Allocator {
    /// An allocator on the host's device. The device outlives the allocator.
    pub fn new(host: &Host) -> Arc<Allocator> {
        Arc::new(Allocator { device: host.device.clone(), types: host.memory_types(), lent: Mutex::default() })
    }

    fn memory_type(&self, bits: u32, wanted: vk::MemoryPropertyFlags) -> Option<u32> {
        memory_type(&self.types, bits, wanted)
    }

    /// Number of blocks lent now, and the largest number so far.
    pub fn lent(&self) -> (usize, usize) {
        let lent = self.lent.lock().unwrap_or_else(PoisonError::into_inner);
        (lent.0.len(), lent.1)
    }
}

fn memory_type(types: &vk::PhysicalDeviceMemoryProperties, bits: u32, wanted: vk::MemoryPropertyFlags) -> Option<u32> {
    let fits = |i: &u32| bits & (1 << i) != 0 && types.memory_types[*i as usize].property_flags.contains(wanted);
    (0..types.memory_type_count).find(fits)
}

/// A buffer that the host reads.
pub struct HostBuffer<'a> {
    host: &'a Host,
    /// The buffer.
    pub buffer: vk::Buffer,
    memory: vk::DeviceMemory,
    pointer: NonNull<f32>,
    floats: usize,
}

impl<'a> HostBuffer<'a> {
    /// A buffer of `floats` floats.
    pub fn new(host: &'a Host, floats: usize) -> Result<Self, vk::Result> {
        let size = 4 * floats as u64;
        let info = vk::BufferCreateInfo::default().size(size).usage(vk::BufferUsageFlags::TRANSFER_DST);
        let wanted = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        // SAFETY: valid descriptions; the memory is bound to this buffer alone and stays mapped.
        unsafe {
            let buffer = host.device.create_buffer(&info, None)?;
            let needs = host.device.get_buffer_memory_requirements(buffer);
            let kind = memory_type(&host.memory_types(), needs.memory_type_bits, wanted)
                .ok_or(vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
            let info = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(kind);
            let memory = host.device.allocate_memory(&info, None)?;
            host.device.bind_buffer_memory(buffer, memory, 0)?;
            let pointer = host.device.map_memory(memory, 0, size, vk::MemoryMapFlags::empty())?;
            let pointer = NonNull::new(pointer.cast()).ok_or(vk::Result::ERROR_MEMORY_MAP_FAILED)?;
            Ok(Self { host, buffer, memory, pointer, floats })
        }
    }

    /// The buffer's content.
    ///
    /// # Safety
    /// The device has finished writing to the buffer.
    pub unsafe fn read(&self) -> Vec<f32> {
        // SAFETY: the mapping has this many floats; the rest is the caller's promise.
        unsafe { std::slice::from_raw_parts(self.pointer.as_ptr(), self.floats) }.to_vec()
    }
}

impl Drop for HostBuffer<'_> {
    fn drop(&mut self) {
        // SAFETY: hosts wait for the last use before.
        unsafe {
            self.host.device.destroy_buffer(self.buffer, None);
            self.host.device.free_memory(self.memory, None);
        }
    }
}

/// An image of the host with four floats per pixel, for display or encoding.
pub struct HostImage<'a> {
    host: &'a Host,
    /// The image.
    pub image: vk::Image,
    memory: vk::DeviceMemory,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
}

impl<'a> HostImage<'a> {
    /// An image of the given size with undefined content.
    pub fn new(host: &'a Host, width: u32, height: u32) -> Result<Self, vk::Result> {
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(vk::Format::R32G32B32A32_SFLOAT)
            .extent(vk::Extent3D { width, height, depth: 1 })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST);
        // SAFETY: valid descriptions; the memory is bound to this image alone.
        unsafe {
            let image = host.device.create_image(&info, None)?;
            let needs = host.device.get_image_memory_requirements(image);
            let kind = memory_type(&host.memory_types(), needs.memory_type_bits, vk::MemoryPropertyFlags::DEVICE_LOCAL)
                .ok_or(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY)?;
            let info = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(kind);
            let memory = host.device.allocate_memory(&info, None)?;
            host.device.bind_image_memory(image, memory, 0)?;
            Ok(Self { host, image, memory, width, height })
        }
    }

    /// The copy region of the whole image, to or from a tightly packed buffer.
    pub fn region(&self) -> vk::BufferImageCopy {
        let layers = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
        vk::BufferImageCopy::default().image_subresource(layers).image_extent(vk::Extent3D {
            width: self.width,
            height: self.height,
            depth: 1,
        })
    }

    /// Records a layout transition, after all earlier writes and before all later commands.
    ///
    /// # Safety
    /// `commands` is being recorded, and `from` is the image's layout at that point.
    pub unsafe fn layout(&self, commands: vk::CommandBuffer, from: vk::ImageLayout, to: vk::ImageLayout) {
        let range =
            vk::ImageSubresourceRange::default().aspect_mask(vk::ImageAspectFlags::COLOR).level_count(1).layer_count(1);
        let barriers = [vk::ImageMemoryBarrier2::default()
            .src_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
            .src_access_mask(vk::AccessFlags2::MEMORY_WRITE)
            .dst_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
            .dst_access_mask(vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE)
            .old_layout(from)
            .new_layout(to)
            .image(self.image)
            .subresource_range(range)];
        let info = vk::DependencyInfo::default().image_memory_barriers(&barriers);
        // SAFETY: the caller's promise.
        unsafe { self.host.device.cmd_pipeline_barrier2(commands, &info) };
    }
}

impl Drop for HostImage<'_> {
    fn drop(&mut self) {
        // SAFETY: hosts wait for the last use before.
        unsafe {
            self.host.device.destroy_image(self.image, None);
            self.host.device.free_memory(self.memory, None);
        }
    }
}
