//! Reusable objects of a submit: command buffer, descriptor pools, timestamp queries. Free again after the ticket has
//! passed.

use ash::vk;

use super::device::Device;
use super::error::{Named, Result};

const SETS_PER_POOL: u32 = 128;
const BUFFERS_PER_POOL: u32 = 1024;

pub(super) struct Slot {
    pool: vk::CommandPool,
    pub(super) commands: vk::CommandBuffer,
    descriptor_pools: Vec<vk::DescriptorPool>,
    /// Index of the pool that new sets come from.
    current: usize,
    queries: vk::QueryPool,
    query_capacity: u32,
}

impl Slot {
    pub(super) fn new(device: &Device) -> Result<Slot> {
        let info = vk::CommandPoolCreateInfo::default()
            .flags(vk::CommandPoolCreateFlags::TRANSIENT)
            .queue_family_index(device.family);
        // SAFETY: live device, its own queue family.
        let pool = unsafe { device.raw.create_command_pool(&info, None) }.named("vkCreateCommandPool")?;
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(pool)
            .level(vk::CommandBufferLevel::PRIMARY)
            .command_buffer_count(1);
        // SAFETY: the pool was just made.
        match unsafe { device.raw.allocate_command_buffers(&info) } {
            Ok(buffers) => Ok(Slot {
                pool,
                commands: buffers.first().copied().unwrap_or_default(),
                descriptor_pools: Vec::new(),
                current: 0,
                queries: vk::QueryPool::null(),
                query_capacity: 0,
            }),
            Err(result) => {
                // SAFETY: made above, empty.
                unsafe { device.raw.destroy_command_pool(pool, None) };
                Err(result).named("vkAllocateCommandBuffers")
            }
        }
    }

    /// Resets the command buffer and all descriptor sets for reuse.
    ///
    /// # Safety
    /// The last submit from this slot has finished.
    pub(super) unsafe fn reset(&mut self, device: &Device) -> Result<()> {
        // SAFETY: the caller's promise.
        unsafe {
            device.raw.reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty()).named("vkResetCommandPool")?;
            for &pool in &self.descriptor_pools {
                device
                    .raw
                    .reset_descriptor_pool(pool, vk::DescriptorPoolResetFlags::empty())
                    .named("vkResetDescriptorPool")?;
            }
        }
        self.current = 0;
        Ok(())
    }

    /// A descriptor set, from a new pool when the existing pools are full.
    pub(super) fn set(&mut self, device: &Device, layout: vk::DescriptorSetLayout) -> Result<vk::DescriptorSet> {
        loop {
            let fresh = self.current == self.descriptor_pools.len();
            if fresh {
                let sizes = [vk::DescriptorType::STORAGE_BUFFER, vk::DescriptorType::UNIFORM_TEXEL_BUFFER]
                    .map(|ty| vk::DescriptorPoolSize { ty, descriptor_count: BUFFERS_PER_POOL });
                let info = vk::DescriptorPoolCreateInfo::default().max_sets(SETS_PER_POOL).pool_sizes(&sizes);
                // SAFETY: valid description.
                let pool = unsafe { device.raw.create_descriptor_pool(&info, None) }.named("vkCreateDescriptorPool")?;
                self.descriptor_pools.push(pool);
            }
            let layouts = [layout];
            let info = vk::DescriptorSetAllocateInfo::default()
                .descriptor_pool(self.descriptor_pools[self.current])
                .set_layouts(&layouts);
            // SAFETY: pool and layout are alive.
            match unsafe { device.raw.allocate_descriptor_sets(&info) } {
                Ok(sets) => return Ok(sets.first().copied().unwrap_or_default()),
                Err(vk::Result::ERROR_OUT_OF_POOL_MEMORY | vk::Result::ERROR_FRAGMENTED_POOL) if !fresh => {
                    self.current += 1;
                }
                Err(result) => return Err(result).named("vkAllocateDescriptorSets"),
            }
        }
    }

    /// A pool of at least `count` timestamp queries.
    pub(super) fn queries(&mut self, device: &Device, count: u32) -> Result<vk::QueryPool> {
        if count > self.query_capacity {
            // SAFETY: the slot is not in flight while it is being recorded.
            unsafe { device.raw.destroy_query_pool(self.queries, None) };
            (self.queries, self.query_capacity) = (vk::QueryPool::null(), 0);
            let capacity = count.next_power_of_two();
            let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(capacity);
            // SAFETY: valid description.
            self.queries = unsafe { device.raw.create_query_pool(&info, None) }.named("vkCreateQueryPool")?;
            self.query_capacity = capacity;
        }
        Ok(self.queries)
    }

    /// The first `count` timestamps of the finished submit.
    pub(super) fn timestamps(&self, device: &Device, count: usize) -> Result<Vec<u64>> {
        let mut ticks = vec![0_u64; count];
        // SAFETY: the queries were written by the finished submit.
        unsafe { device.raw.get_query_pool_results(self.queries, 0, &mut ticks, vk::QueryResultFlags::TYPE_64) }
            .named("vkGetQueryPoolResults")?;
        Ok(ticks)
    }

    /// Destroys all objects of the slot.
    ///
    /// # Safety
    /// The last submit from this slot has finished.
    pub(super) unsafe fn destroy(self, device: &Device) {
        // SAFETY: the caller's promise; null handles are ignored.
        unsafe {
            device.raw.destroy_query_pool(self.queries, None);
            self.descriptor_pools.iter().for_each(|&pool| device.raw.destroy_descriptor_pool(pool, None));
            device.raw.destroy_command_pool(self.pool, None);
        }
    }
}
