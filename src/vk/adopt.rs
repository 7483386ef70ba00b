//! Running on a host's device.
//!
//! Nothing is created behind the host's back but objects of its device (buffers, memory where the host gives no
//! allocator, pipelines, command and descriptor pools, one timeline semaphore), nothing is destroyed that was not
//! created here, and neither the device nor the queue is ever waited idle.
//! All work goes to the one queue that the host names, inside its lock.

use super::lock::QueueLock;
use std::ffi::CStr;
use std::sync::Arc;

use ash::vk;

use super::device::{Device, Parts};
use super::device_query::report;
use super::error::{Error, Result};
use super::features::{Features, REQUIRED};
use super::gpu::Gpu;
use super::host_allocator::HostAllocator;
use super::options::OpenOptions;
use super::recorder::Recorder;
use super::submit_sync::SubmitSync;
use super::ticket::Ticket;
use super::validation::Messages;

/// A device that a host created and keeps.
pub struct HostDevice<'a> {
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
    /// Extensions that the host enabled, of the instance and of the device. With `VK_EXT_debug_utils` among them the
    /// engine names its objects; see [`super::USEFUL_EXTENSIONS`] for those of the device that it can use.
    pub extensions: &'a [&'a CStr],
    /// Features that the host enabled on the device; at least [`super::required_features`]. What is not stated here, or
    /// comes with an extension that is not stated, is not used.
    pub features: Features,
    /// The queue to submit to; its family has compute.
    pub queue: vk::Queue,
    /// The family of `queue`.
    pub queue_family: u32,
    /// The index of `queue` in its family.
    pub queue_index: u32,
    /// Guards the queue; `None` when nobody else submits to it while this engine is alive.
    pub lock: Option<QueueLock>,
    /// Where the memory of buffers comes from; `None` lets the engine allocate from the device.
    pub allocator: Option<Arc<dyn HostAllocator>>,
}

/// What the engine would use of a physical device, were it enabled.
#[derive(Clone, Debug)]
pub struct Usable {
    /// Features, the required ones among them where the device has them.
    pub features: Features,
    /// Extensions of the device.
    pub extensions: Vec<&'static CStr>,
}

/// The host's loader and instance, as functions to call.
///
/// # Safety
/// Loader and instance are valid.
unsafe fn loaded(
    get_instance_proc_addr: vk::PFN_vkGetInstanceProcAddr,
    instance: vk::Instance,
) -> (ash::Entry, ash::Instance) {
    // SAFETY: the caller's promise.
    unsafe {
        let entry = ash::Entry::from_static_fn(ash::StaticFn { get_instance_proc_addr });
        let instance = ash::Instance::load(entry.static_fn(), instance);
        (entry, instance)
    }
}

impl Gpu {
    /// What the engine would use of a physical device beyond [`super::required_features`], for a host that is about to
    /// make its device; [`Features::enable`] writes it into the structures for that.
    /// A device that lacks what is required is told by name.
    ///
    /// # Safety
    /// Loader, instance and physical device are valid, and the instance was created for Vulkan 1.1 or later.
    pub unsafe fn usable_features(
        get_instance_proc_addr: vk::PFN_vkGetInstanceProcAddr,
        instance: vk::Instance,
        physical_device: vk::PhysicalDevice,
    ) -> Result<Usable> {
        // SAFETY: the caller's promise.
        let (_entry, instance) = unsafe { loaded(get_instance_proc_addr, instance) };
        // SAFETY: as above.
        let reported = unsafe { report(&instance, physical_device) }?;
        reported.check()?;
        let extensions = reported.useful_extensions();
        Ok(Usable { features: reported.features.with_extensions(&extensions), extensions })
    }

    /// Runs on a device that a host has created. Of `options`, those about choosing a device and about validation do
    /// not apply.
    ///
    /// # Safety
    /// The handles are valid and belong together, the stated extensions and features are enabled, and all of them
    /// outlive this [`Gpu`], its clones, and every buffer, pipeline, recorder and recording made from them. The host
    /// uses the queue only inside the lock.
    pub unsafe fn adopt(host: HostDevice<'_>, options: &OpenOptions) -> Result<Gpu> {
        // SAFETY: the caller's promise: loader, instance and device are valid.
        let (entry, instance) = unsafe { loaded(host.get_instance_proc_addr, host.instance) };
        if host.api_version < vk::API_VERSION_1_3 {
            // SAFETY: as above; a command of Vulkan 1.0.
            let properties = unsafe { instance.get_physical_device_properties(host.physical_device) };
            let name = properties.device_name_as_c_str().map(|n| n.to_string_lossy().into_owned());
            let (feature, needed_for) = REQUIRED[0];
            return Err(Error::MissingFeature {
                feature,
                needed_for: needed_for.into(),
                device: as_made(&name.unwrap_or_default()),
            });
        }
        // SAFETY: as above; the instance has Vulkan 1.3.
        let mut reported = unsafe { report(&instance, host.physical_device) }?;
        reported.check()?;
        reported.features = reported.features.and(&host.features).with_extensions(host.extensions);
        reported.check().map_err(|error| match error {
            Error::MissingFeature { feature, needed_for, device } => {
                Error::MissingFeature { feature, needed_for, device: as_made(&device) }
            }
            error => error,
        })?;
        // SAFETY: as above.
        unsafe { check_queue(&instance, &host) }?;
        // SAFETY: as above.
        let raw = unsafe { ash::Device::load(instance.fp_v1_0(), host.device) };
        let parts = Parts {
            entry,
            instance,
            physical: host.physical_device,
            raw,
            queue: host.queue,
            family: host.queue_family,
            host_lock: host.lock,
            host_allocator: host.allocator,
            caps: reported.pick(options),
            canaries: options.canaries,
            garbage: options.garbage,
            debug_utils: host.extensions.contains(&ash::ext::debug_utils::NAME),
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

/// A device that lacks only what its host has not enabled.
fn as_made(device: &str) -> String {
    format!("{device}, as its host has made it,")
}

/// # Safety
/// The physical device belongs to the instance.
unsafe fn check_queue(instance: &ash::Instance, host: &HostDevice<'_>) -> Result<()> {
    // SAFETY: the caller's promise.
    let families = unsafe { instance.get_physical_device_queue_family_properties(host.physical_device) };
    let (family, index) = (host.queue_family, host.queue_index);
    let what = match families.get(family as usize) {
        None => "the device has no such family",
        Some(f) if !f.queue_flags.contains(vk::QueueFlags::COMPUTE) => "the family has no compute",
        Some(f) if index >= f.queue_count => "the family has no such queue",
        Some(_) if host.queue == vk::Queue::null() => "the handle is null",
        Some(_) => return Ok(()),
    };
    Err(Error::BadQueue { family, index, what })
}

impl Recorder {
    /// As [`Recorder::submit`], between points of the host's timelines.
    pub fn submit_with(self, order: SubmitSync<'_>) -> Result<Ticket> {
        let gpu = self.gpu.clone();
        gpu.submit_ordered(self, order)
    }
}
