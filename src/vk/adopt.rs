//! Running on a host's device.
//!
//! Nothing is created behind the host's back but objects of its device (buffers, memory, pipelines, command and descriptor
//! pools, one timeline semaphore), nothing is destroyed that was not created here, and neither the device nor the queue is ever
//! waited idle. All work goes to the one queue that the host names.

use std::sync::Arc;

use ash::vk;

use super::caps::Features;
use super::device::{Device, HostLock, Parts};
use super::encode::External;
use super::error::{Error, Result};
use super::gpu::Gpu;
use super::options::OpenOptions;
use super::recorder::{Recorder, Ticket};
use super::report::report;
use super::validation::Messages;

/// Called around every use of the host's queue: take the lock, give it back.
pub type QueueLock = (Box<dyn Fn() + Send + Sync>, Box<dyn Fn() + Send + Sync>);

/// A device that a host created and keeps.
pub struct HostDevice {
    /// The loader's entry point, as the host loaded it.
    pub get_instance_proc_addr: vk::PFN_vkGetInstanceProcAddr,
    /// The host's instance.
    pub instance: vk::Instance,
    /// The physical device that `device` was made from.
    pub physical_device: vk::PhysicalDevice,
    /// The host's device.
    pub device: vk::Device,
    /// The Vulkan version that the instance and the device were created for; at least 1.3.
    pub api_version: u32,
    /// Features that the host enabled on the device. What is not stated here is not used.
    pub features: Features,
    /// The host enabled `VK_EXT_debug_utils` on the instance.
    pub debug_utils: bool,
    /// The queue to submit to; its family has compute.
    pub queue: vk::Queue,
    /// The family of `queue`.
    pub queue_family: u32,
    /// Guards the queue; `None` when nobody else submits to it while this engine is alive.
    pub lock: Option<QueueLock>,
}

/// A timeline semaphore of the host and a value of it.
#[derive(Clone, Copy, Debug)]
pub struct HostSemaphore {
    /// The semaphore.
    pub semaphore: vk::Semaphore,
    /// The value to wait for or to signal.
    pub value: u64,
}

impl Gpu {
    /// Runs on a device that a host has created. Of `options`, those about choosing a device and about validation do not apply.
    ///
    /// # Safety
    /// The handles are valid and belong together, the stated features are enabled, and all of them outlive this [`Gpu`], its
    /// clones, and every buffer, pipeline and recorder made from them. The host uses the queue only inside the lock.
    pub unsafe fn adopt(host: HostDevice, options: &OpenOptions) -> Result<Gpu> {
        let functions = ash::StaticFn { get_instance_proc_addr: host.get_instance_proc_addr };
        // SAFETY: the caller's promise: loader, instance and device are valid.
        let (entry, instance) = unsafe {
            let entry = ash::Entry::from_static_fn(functions);
            let instance = ash::Instance::load(entry.static_fn(), host.instance);
            (entry, instance)
        };
        if host.api_version < vk::API_VERSION_1_3 {
            // SAFETY: as above; a command of Vulkan 1.0.
            let properties = unsafe { instance.get_physical_device_properties(host.physical_device) };
            let name = properties.device_name_as_c_str().map(|n| n.to_string_lossy().into_owned());
            return Err(Error::MissingFeature {
                feature: "Vulkan 1.3",
                needed_for: "every pass".into(),
                device: name.unwrap_or_default(),
            });
        }
        // SAFETY: as above; the instance has Vulkan 1.3.
        let mut reported = unsafe { report(&instance, host.physical_device) }?;
        reported.features = both(reported.features, host.features);
        reported.check()?;
        // SAFETY: as above.
        let raw = unsafe { ash::Device::load(instance.fp_v1_0(), host.device) };
        let parts = Parts {
            entry,
            instance,
            physical: host.physical_device,
            raw,
            queue: host.queue,
            family: host.queue_family,
            host_lock: host.lock.map(|(lock, unlock)| HostLock { lock, unlock }),
            caps: reported.pick(options),
            canaries: options.canaries,
            debug_utils: host.debug_utils,
            messages: Messages::default(),
            messenger: None,
            owned: false,
        };
        let device: Arc<Device> = Device::assemble(parts)?;
        Gpu::start(device, options)
    }

    /// The semaphore whose values are the tickets, for a host to wait on.
    pub fn timeline(&self) -> vk::Semaphore {
        self.raw_timeline()
    }
}

impl Ticket {
    /// The value of [`Gpu::timeline`] once the submit has finished.
    pub fn value(self) -> u64 {
        self.0
    }
}

impl Recorder {
    /// As [`Recorder::submit`], after the host's semaphores have reached their values; signals others when it has run.
    ///
    /// # Safety
    /// The semaphores are timeline semaphores of the same device, and signalling them to these values is allowed.
    pub unsafe fn submit_with(self, wait: &[HostSemaphore], signal: &[HostSemaphore]) -> Result<Ticket> {
        let gpu = self.gpu.clone();
        gpu.submit_external(self, External { wait, signal })
    }
}

/// Features that the device has and the host enabled.
fn both(a: Features, b: Features) -> Features {
    Features {
        synchronization2: a.synchronization2 && b.synchronization2,
        timeline_semaphore: a.timeline_semaphore && b.timeline_semaphore,
        maintenance4: a.maintenance4 && b.maintenance4,
        buffer_float_atomic_add: a.buffer_float_atomic_add && b.buffer_float_atomic_add,
        shared_float_atomic_add: a.shared_float_atomic_add && b.shared_float_atomic_add,
        int64: a.int64 && b.int64,
        buffer_int64_atomics: a.buffer_int64_atomics && b.buffer_int64_atomics,
        storage_16bit: a.storage_16bit && b.storage_16bit,
        float16: a.float16 && b.float16,
        int16: a.int16 && b.int16,
        storage_8bit: a.storage_8bit && b.storage_8bit,
        int8: a.int8 && b.int8,
        memory_model: a.memory_model && b.memory_model,
        buffer_device_address: a.buffer_device_address && b.buffer_device_address,
        subgroup_size_control: a.subgroup_size_control && b.subgroup_size_control,
    }
}
