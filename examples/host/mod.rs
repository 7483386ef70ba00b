//! A host program's own instance, device and queue, a lock around the queue, and an allocator.
//!
//! The host creates and destroys everything here.
// Each example uses a part of the module. A host calls Vulkan itself, so examples are the only code outside the device
// layer with `unsafe`.
#![allow(dead_code)]

pub mod memory;

use std::error::Error;
use std::ffi::CStr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};

use psrgs_vk::vk::ash::{self, vk};
use psrgs_vk::vk::{
    FeatureStructures, Features, HostAllocator, HostDevice, HostSemaphore, QueueLock, required_features,
};

/// A lock around a queue that more than one thread submits to.
#[derive(Default)]
pub struct Turn {
    taken: Mutex<bool>,
    freed: Condvar,
    uses: AtomicU64,
}

impl Turn {
    /// Waits until the lock is free, and takes the lock.
    pub fn take(&self) {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        while *taken {
            taken = self.freed.wait(taken).unwrap_or_else(PoisonError::into_inner);
        }
        *taken = true;
        self.uses.fetch_add(1, Ordering::Relaxed);
    }

    /// Releases the lock.
    pub fn give(&self) {
        *self.taken.lock().unwrap_or_else(PoisonError::into_inner) = false;
        self.freed.notify_one();
    }

    /// Whether a thread holds the lock now.
    pub fn is_taken(&self) -> bool {
        *self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Number of times that the lock was taken.
    pub fn uses(&self) -> u64 {
        self.uses.load(Ordering::Relaxed)
    }
}

/// Instance, device and queue of the host.
pub struct Host {
    entry: ash::Entry,
    instance: ash::Instance,
    /// The physical device.
    pub physical_device: vk::PhysicalDevice,
    /// The device.
    pub device: ash::Device,
    /// The device's queue, shared with the engine.
    pub queue: vk::Queue,
    /// The family of the queue.
    pub family: u32,
    /// Enabled extensions of instance and device.
    pub extensions: Vec<&'static CStr>,
    /// Enabled features that the engine knows.
    pub features: Features,
    /// Lock around the queue.
    pub turn: Arc<Turn>,
}

impl Host {
    /// A host whose device has only the features that the engine requires. `None` without a Vulkan driver.
    pub fn new() -> Result<Option<Host>, Box<dyn Error>> {
        Self::with(required_features())
    }

    /// Creates an instance and, on the first device with Vulkan 1.3 and a compute queue, a device with one queue and
    /// these features, which the device must have.
    pub fn with(features: Features) -> Result<Option<Host>, Box<dyn Error>> {
        // SAFETY: loads the system's Vulkan loader.
        let Ok(entry) = (unsafe { ash::Entry::load() }) else { return Ok(None) };
        let app = vk::ApplicationInfo::default().application_name(c"host").api_version(vk::API_VERSION_1_3);
        let info = vk::InstanceCreateInfo::default().application_info(&app);
        // SAFETY: valid description.
        let instance = match unsafe { entry.create_instance(&info, None) } {
            Err(vk::Result::ERROR_INCOMPATIBLE_DRIVER) => return Ok(None),
            instance => instance?,
        };
        // SAFETY: instance and physical devices are valid.
        let found = unsafe {
            let mut found = None;
            for physical in instance.enumerate_physical_devices()? {
                let new_enough = instance.get_physical_device_properties(physical).api_version >= vk::API_VERSION_1_3;
                let families = instance.get_physical_device_queue_family_properties(physical);
                let compute = families.iter().position(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE));
                if let (true, Some(family), None) = (new_enough, compute, found) {
                    found = Some((physical, family as u32));
                }
            }
            found
        };
        let Some((physical_device, family)) = found else {
            // SAFETY: nothing was created from the instance.
            unsafe { instance.destroy_instance(None) };
            return Ok(None);
        };
        // ANCHOR: features
        // `features` are `required_features()`, known before a device exists. The host may add features of its own.
        let mut enabled = FeatureStructures::default();
        features.enable(&mut enabled);
        let priorities = [1.0];
        let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&priorities)];
        let info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_features(&enabled.core)
            .push_next(&mut enabled.v11)
            .push_next(&mut enabled.v12)
            .push_next(&mut enabled.v13);
        // SAFETY: the caller's features; every device with Vulkan 1.3 has the required features.
        let device = unsafe { instance.create_device(physical_device, &info, None) }?;
        // ANCHOR_END: features
        // SAFETY: the device was created with one queue of this family.
        let queue = unsafe { device.get_device_queue(family, 0) };
        let (extensions, turn) = (Vec::new(), Arc::default());
        Ok(Some(Host { entry, instance, physical_device, device, queue, family, extensions, features, turn }))
    }

    // ANCHOR: describe
    /// Description of the host's device for the engine.
    pub fn describe(&self, allocator: Option<Arc<dyn HostAllocator>>) -> HostDevice<'_> {
        let (taken, given) = (self.turn.clone(), self.turn.clone());
        HostDevice {
            get_instance_proc_addr: self.entry.static_fn().get_instance_proc_addr,
            instance: self.instance.handle(),
            physical_device: self.physical_device,
            device: self.device.handle(),
            api_version: vk::API_VERSION_1_3,
            extensions: &self.extensions,
            features: self.features,
            queue: self.queue,
            queue_family: self.family,
            queue_index: 0,
            lock: Some(QueueLock { lock: Box::new(move || taken.take()), unlock: Box::new(move || given.give()) }),
            allocator,
        }
    }
    // ANCHOR_END: describe

    /// The memory types of the device.
    pub fn memory_types(&self) -> vk::PhysicalDeviceMemoryProperties {
        // SAFETY: the physical device belongs to the instance.
        unsafe { self.instance.get_physical_device_memory_properties(self.physical_device) }
    }

    /// A timeline of the host, at 0.
    pub fn timeline(&self) -> Result<Timeline<'_>, vk::Result> {
        let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        // SAFETY: timeline semaphores are enabled.
        Ok(Timeline { host: self, semaphore: unsafe { self.device.create_semaphore(&info, None) }? })
    }

    /// A pool for command buffers of the host.
    pub fn commands(&self) -> Result<Commands<'_>, vk::Result> {
        let info = vk::CommandPoolCreateInfo::default().queue_family_index(self.family);
        // SAFETY: the family is the queue's family.
        Ok(Commands { host: self, pool: unsafe { self.device.create_command_pool(&info, None) }? })
    }

    // ANCHOR: submit
    /// Submits a command buffer of the host, inside the queue's lock.
    ///
    /// # Safety
    /// The command buffer is complete, and everything that it refers to lives until it has run.
    pub unsafe fn submit(
        &self,
        commands: vk::CommandBuffer,
        wait: HostSemaphore,
        signal: HostSemaphore,
    ) -> Result<(), vk::Result> {
        let point = |at: HostSemaphore| {
            [vk::SemaphoreSubmitInfo::default()
                .semaphore(at.semaphore())
                .value(at.value())
                .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)]
        };
        let (wait, signal) = (point(wait), point(signal));
        let commands = [vk::CommandBufferSubmitInfo::default().command_buffer(commands)];
        let info = vk::SubmitInfo2::default()
            .wait_semaphore_infos(&wait)
            .command_buffer_infos(&commands)
            .signal_semaphore_infos(&signal);
        self.turn.take();
        // SAFETY: the queue is the host's and nobody else uses it now; the rest is the caller's promise.
        let result = unsafe { self.device.queue_submit2(self.queue, &[info], vk::Fence::null()) };
        self.turn.give();
        result
    }
    // ANCHOR_END: submit
}

impl Drop for Host {
    fn drop(&mut self) {
        // SAFETY: the engine and all its buffers are gone: hosts drop them first.
        unsafe {
            self.device.destroy_device(None);
            self.instance.destroy_instance(None);
        }
    }
}

/// A timeline semaphore of the host. It outlives every submit that names it.
pub struct Timeline<'a> {
    host: &'a Host,
    semaphore: vk::Semaphore,
}

impl Timeline<'_> {
    /// The semaphore with a value, for a submit.
    pub fn at(&self, value: u64) -> HostSemaphore {
        // SAFETY: a timeline semaphore of the device that outlives the submits; values rise from submit to submit, and
        // nothing waits for a value whose signal has not been submitted.
        unsafe { HostSemaphore::new(self.semaphore, value) }
    }

    /// Waits until the semaphore reaches a value, or for a time in nanoseconds. Returns whether the value was reached.
    pub fn wait(&self, value: u64, nanoseconds: u64) -> Result<bool, vk::Result> {
        let (semaphores, values) = ([self.semaphore], [value]);
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: the semaphore is the host's.
        match unsafe { self.host.device.wait_semaphores(&info, nanoseconds) } {
            Err(vk::Result::TIMEOUT) => Ok(false),
            result => result.map(|()| true),
        }
    }

    /// Signals a value from the host.
    pub fn signal(&self, value: u64) -> Result<(), vk::Result> {
        let info = vk::SemaphoreSignalInfo::default().semaphore(self.semaphore).value(value);
        // SAFETY: the semaphore is the host's, and values only grow.
        unsafe { self.host.device.signal_semaphore(&info) }
    }

    /// Leaks the semaphore: for tests that the leak is noticed.
    pub fn forget(self) {
        std::mem::forget(self);
    }
}

impl Drop for Timeline<'_> {
    fn drop(&mut self) {
        // SAFETY: every submit that uses the semaphore has finished: hosts wait for the last value before.
        unsafe { self.host.device.destroy_semaphore(self.semaphore, None) };
    }
}

/// A command pool of the host.
pub struct Commands<'a> {
    host: &'a Host,
    pool: vk::CommandPool,
}

impl Commands<'_> {
    /// A new command buffer, being recorded.
    pub fn begin(&self) -> Result<vk::CommandBuffer, vk::Result> {
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(self.pool)
            .level(vk::CommandBufferLevel::PRIMARY)
            .command_buffer_count(1);
        let once = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the pool is the host's, and used by one thread.
        unsafe {
            let commands = self.host.device.allocate_command_buffers(&info)?[0];
            self.host.device.begin_command_buffer(commands, &once)?;
            Ok(commands)
        }
    }

    /// Frees every command buffer.
    ///
    /// # Safety
    /// All command buffers have run.
    pub unsafe fn reset(&self) -> Result<(), vk::Result> {
        // SAFETY: the caller's promise.
        unsafe { self.host.device.reset_command_pool(self.pool, vk::CommandPoolResetFlags::RELEASE_RESOURCES) }
    }
}

impl Drop for Commands<'_> {
    fn drop(&mut self) {
        // SAFETY: every command buffer has run: hosts wait for the last value before.
        unsafe { self.host.device.destroy_command_pool(self.pool, None) };
    }
}
