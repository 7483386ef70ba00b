//! Running on a host's device.
//!
//! The engine creates only child objects of the host's device: buffers, memory (where the host gives no allocator),
//! pipelines, command and descriptor pools, and one timeline semaphore. The engine destroys only objects that it
//! created, and never waits for the device or the queue to be idle. All work goes to the one queue that the host names,
//! inside the host's lock.

use super::lock::QueueLock;
use std::ffi::CStr;
use std::sync::Arc;

use ash::vk;

use super::device::{Device, DeviceParts};
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
    /// Vulkan version of the instance and the device; at least 1.3.
    pub api_version: u32,
    /// Instance and device extensions that the host enabled. With `VK_EXT_debug_utils` the engine names its Vulkan
    /// objects. [`super::USEFUL_EXTENSIONS`] lists the device extensions that the engine can use.
    pub extensions: &'a [&'a CStr],
    /// Features that the host enabled on the device; at least [`super::required_features`]. The engine does not use a
    /// feature that is missing here, or whose extension is missing in `extensions`.
    pub features: Features,
    /// The queue to submit to. Its family supports compute.
    pub queue: vk::Queue,
    /// The family of `queue`.
    pub queue_family: u32,
    /// The index of `queue` in its family.
    pub queue_index: u32,
    /// Guards the queue; `None` when only the engine submits to the queue while the engine is alive.
    pub lock: Option<QueueLock>,
    /// Allocator for the memory of buffers; with `None` the engine allocates from the device.
    pub allocator: Option<Arc<dyn HostAllocator>>,
}

/// Features and extensions of a physical device that the engine would use if the host enables them.
#[derive(Clone, Debug)]
pub struct Usable {
    /// Usable features, including the required features.
    pub features: Features,
    /// Usable device extensions.
    pub extensions: Vec<&'static CStr>,
}

/// Loads the functions of the host's loader and instance.
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
    /// Features and extensions of a physical device that the engine would use, for a host that is about to create its
    /// device. [`Features::enable`] writes the features into the structures for `vkCreateDevice`. Fails with
    /// [`Error::MissingFeature`] where the device lacks one of [`super::required_features`].
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

    /// Opens the engine on a device that a host has created. The options for device selection and validation do not
    /// apply.
    ///
    /// # Safety
    /// The handles are valid and belong together, and the stated extensions and features are enabled. The handles
    /// outlive this [`Gpu`], its clones, and every buffer, pipeline, recorder and recording made from them. The host
    /// uses the queue only inside the lock.
    pub unsafe fn adopt(host: HostDevice<'_>, options: &OpenOptions) -> Result<Gpu> {
        // SAFETY: the caller's promise: loader, instance and device are valid.
        let (entry, instance) = unsafe { loaded(host.get_instance_proc_addr, host.instance) };
        if host.api_version < vk::API_VERSION_1_3 {
            // SAFETY: as above; the command belongs to Vulkan 1.0.
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
        let parts = DeviceParts {
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
            statistics: false,
            messages: Messages::default(),
            messenger: None,
            owned: false,
        };
        let device: Arc<Device> = Device::assemble(parts)?;
        Gpu::start(device, options)
    }

    /// The timeline semaphore that counts tickets, for a host to wait on.
    pub fn timeline(&self) -> vk::Semaphore {
        self.raw_timeline()
    }
}

/// Description of a device that has a feature which its host has not enabled.
fn as_made(device: &str) -> String {
    format!("{device}, as created by the host,")
}

/// # Safety
/// The physical device belongs to the instance.
unsafe fn check_queue(instance: &ash::Instance, host: &HostDevice<'_>) -> Result<()> {
    // SAFETY: the caller's promise.
    let families = unsafe { instance.get_physical_device_queue_family_properties(host.physical_device) };
    let (family, index) = (host.queue_family, host.queue_index);
    let what = match families.get(family as usize) {
        None => "the device has no queue family of this index",
        Some(f) if !f.queue_flags.contains(vk::QueueFlags::COMPUTE) => "the family does not support compute",
        Some(f) if index >= f.queue_count => "the family has no queue of this index",
        Some(_) if host.queue == vk::Queue::null() => "the handle is null",
        Some(_) => return Ok(()),
    };
    Err(Error::BadQueue { family, index, what })
}

impl Recorder {
    /// Like [`Recorder::submit`], but waits for and signals timeline semaphores of the host.
    pub fn submit_with(self, order: SubmitSync<'_>) -> Result<Ticket> {
        let gpu = self.gpu.clone();
        gpu.submit_ordered(self, order)
    }
}
