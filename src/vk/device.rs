//! Instance, physical device, logical device and queue, created here or by a host: everything that has to outlive
//! buffers.

use super::lock::lock;
use std::collections::HashMap;
use std::ffi::{CStr, CString, c_char};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, Weak};

use ash::vk;

use super::buffer::BufferInner;
use super::caps::Caps;
use super::device_query::{Reported, report};
use super::error::{Error, Result};
use super::features::FeatureStructures;
use super::host_allocator::HostAllocator;
use super::lock::QueueLock;
use super::memory::MemoryPool;
use super::options::{OpenOptions, Validation};
use super::statistics;
use super::ticket::next_device;
use super::validation::{FOLLOW_SHADERS, LAYER, Messages, Messenger, switch, takes_settings};

/// A device found by [`devices`].
#[derive(Clone, Debug)]
pub struct DeviceInfo {
    /// Name.
    pub name: String,
    /// Driver.
    pub driver: String,
    /// Kind.
    pub kind: super::DeviceKind,
    /// Why the device cannot be used; `None` for a usable device.
    pub unusable: Option<String>,
}

/// The handles that buffers and pipelines need. Destroyed after the last buffer and the last pipeline.
pub(super) struct Device {
    /// Number of the device, unique in the process.
    pub(super) id: u64,
    pub(super) raw: ash::Device,
    pub(super) instance: ash::Instance,
    pub(super) physical: vk::PhysicalDevice,
    pub(super) queue: vk::Queue,
    pub(super) family: u32,
    pub(super) host_lock: Option<QueueLock>,
    pub(super) caps: Caps,
    pub(super) canaries: bool,
    pub(super) garbage: bool,
    pub(super) debug: Option<ash::ext::debug_utils::Device>,
    /// Functions for statistics of pipelines, which are captured where there are functions.
    pub(super) executables: Option<ash::khr::pipeline_executable_properties::Device>,
    pub(super) messages: Messages,
    pub(super) memory: Mutex<Option<MemoryPool>>,
    pub(super) live: Mutex<HashMap<u64, Weak<BufferInner>>>,
    /// Numbers of the buffers destroyed since the last submit.
    pub(super) freed: Mutex<Vec<u64>>,
    messenger: Option<Messenger>,
    pub(super) owned: bool,
    next_buffer: AtomicU64,
    _entry: ash::Entry,
}

impl Device {
    pub(super) fn open(options: &OpenOptions) -> Result<Arc<Device>> {
        let (entry, instance, messages, messenger) = create_instance(options.validation)?;
        match Self::open_on(&instance, options) {
            Ok((physical, raw, family, caps)) => {
                // SAFETY: the device was created with queue 0 of this family.
                let queue = unsafe { raw.get_device_queue(family, 0) };
                let parts = DeviceParts {
                    entry,
                    instance,
                    physical,
                    raw,
                    queue,
                    family,
                    host_lock: None,
                    host_allocator: None,
                    caps,
                    canaries: options.canaries,
                    garbage: options.garbage,
                    debug_utils: messenger.is_some(),
                    statistics: options.statistics,
                    messages,
                    messenger,
                    owned: true,
                };
                Self::assemble(parts)
            }
            Err(error) => {
                drop(messenger);
                // SAFETY: only the messenger was created from the instance, and is destroyed.
                unsafe { instance.destroy_instance(None) };
                Err(error)
            }
        }
    }

    fn open_on(
        instance: &ash::Instance,
        options: &OpenOptions,
    ) -> Result<(vk::PhysicalDevice, ash::Device, u32, Caps)> {
        let found = enumerate(instance)?;
        let index = choose(&found, options.device.as_deref())?;
        let (physical, reported) = found.into_iter().nth(index).ok_or(Error::NoVulkan("no device".into()))?;
        reported.check()?;
        let (raw, family) = create_device(instance, physical, &reported, options.statistics)?;
        Ok((physical, raw, family, reported.pick(options)))
    }

    /// Makes a device of its handles. On failure destroys the owned handles.
    pub(super) fn assemble(parts: DeviceParts) -> Result<Arc<Device>> {
        let DeviceParts { entry, instance, physical, raw, queue, family, host_lock, caps, canaries, garbage, .. } =
            parts;
        let debug = parts.debug_utils.then(|| ash::ext::debug_utils::Device::new(&instance, &raw));
        let executables =
            parts.statistics.then(|| ash::khr::pipeline_executable_properties::Device::new(&instance, &raw));
        let device = Device {
            id: next_device(),
            memory: Mutex::new(None),
            raw,
            instance,
            physical,
            queue,
            family,
            host_lock,
            caps,
            canaries,
            garbage,
            debug,
            executables,
            messages: parts.messages,
            live: Mutex::default(),
            freed: Mutex::default(),
            messenger: parts.messenger,
            owned: parts.owned,
            next_buffer: AtomicU64::new(1),
            _entry: entry,
        };
        let pool = MemoryPool::new(&device, parts.host_allocator)?;
        *lock(&device.memory) = Some(pool);
        Ok(Arc::new(device))
    }

    pub(super) fn next_id(&self) -> u64 {
        self.next_buffer.fetch_add(1, Ordering::Relaxed)
    }

    /// Names an object for captures and validation messages.
    pub(super) fn name<H: vk::Handle>(&self, handle: H, name: &str) {
        if let (Some(debug), Ok(name)) = (&self.debug, CString::new(name)) {
            let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(handle).object_name(&name);
            // SAFETY: the handle belongs to this device; a failure to set the name does no harm.
            let _ = unsafe { debug.set_debug_utils_object_name(&info) };
        }
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // The allocator frees its memory blocks, so the allocator is dropped before the device.
        let pool = lock(&self.memory).take();
        let held = pool.as_ref().map_or(0, |pool| pool.tally().current);
        if held > 0 {
            self.messages.add(format!("{held} bytes of device memory were not freed"));
        }
        drop(pool);
        if self.owned {
            // SAFETY: everything created from the device holds an `Arc` of the device, so nothing is left.
            unsafe { self.raw.destroy_device(None) };
        }
        drop(self.messenger.take());
        if self.owned {
            // SAFETY: device and messenger, the only objects created from the instance, are destroyed.
            unsafe { self.instance.destroy_instance(None) };
        }
        self.messages.close();
    }
}

/// Handles that make up a [`Device`].
pub(super) struct DeviceParts {
    pub(super) entry: ash::Entry,
    pub(super) instance: ash::Instance,
    pub(super) physical: vk::PhysicalDevice,
    pub(super) raw: ash::Device,
    pub(super) queue: vk::Queue,
    pub(super) family: u32,
    pub(super) host_lock: Option<QueueLock>,
    pub(super) host_allocator: Option<Arc<dyn HostAllocator>>,
    pub(super) caps: Caps,
    pub(super) canaries: bool,
    pub(super) garbage: bool,
    pub(super) debug_utils: bool,
    /// Whether the device was created for statistics of pipelines.
    pub(super) statistics: bool,
    pub(super) messages: Messages,
    pub(super) messenger: Option<Messenger>,
    pub(super) owned: bool,
}

/// The kind of the device that [`super::Gpu::open`] would open for this [`OpenOptions::device`].
pub fn device_kind(device: Option<&str>) -> Result<super::DeviceKind> {
    let (_entry, instance, _, _) = create_instance(Validation::Off)?;
    let found = enumerate(&instance);
    // SAFETY: physical devices are not owned, and nothing else was created from the instance.
    unsafe { instance.destroy_instance(None) };
    let found = found?;
    let index = choose(&found, device)?;
    found.get(index).map(|(_, reported)| reported.kind).ok_or(Error::NoVulkan("no device".into()))
}

/// Every Vulkan device of this machine. [`OpenOptions::device`] may name a device by its index here.
pub fn devices() -> Result<Vec<DeviceInfo>> {
    let (_entry, instance, _, _) = create_instance(Validation::Off)?;
    let found = enumerate(&instance);
    // SAFETY: physical devices are not owned, and nothing else was created from the instance.
    unsafe { instance.destroy_instance(None) };
    Ok(found?
        .into_iter()
        .map(|(_, r)| DeviceInfo {
            unusable: r.check().err().map(|e| e.to_string()),
            name: r.device,
            driver: r.driver,
            kind: r.kind,
        })
        .collect())
}

fn create_instance(validation: Validation) -> Result<(ash::Entry, ash::Instance, Messages, Option<Messenger>)> {
    // SAFETY: loading the system's Vulkan loader runs its initialisers, as the caller asks.
    let entry = unsafe { ash::Entry::load() }.map_err(|e| Error::NoVulkan(e.to_string()))?;
    // SAFETY: a global command.
    let version = unsafe { entry.try_enumerate_instance_version() }.or_none("vkEnumerateInstanceVersion")?;
    if version.unwrap_or(vk::API_VERSION_1_0) < vk::API_VERSION_1_3 {
        return Err(Error::NoVulkan("the loader is older than Vulkan 1.3".into()));
    }
    // SAFETY: a global command.
    let layers =
        unsafe { entry.enumerate_instance_layer_properties() }.or_none("vkEnumerateInstanceLayerProperties")?;
    let enables = match validation {
        Validation::Off => None,
        Validation::CoreAndSync => Some([vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION]),
        Validation::GpuAssisted => Some([vk::ValidationFeatureEnableEXT::GPU_ASSISTED]),
    };
    let watched = enables.is_some();
    if watched && !layers.iter().any(|l| l.layer_name_as_c_str() == Ok(LAYER)) {
        return Err(Error::MissingLayer { layer: "VK_LAYER_KHRONOS_validation" });
    }
    // SAFETY: a global command.
    let extensions = unsafe { entry.enumerate_instance_extension_properties(None) }
        .or_none("vkEnumerateInstanceExtensionProperties")?;
    let has = |name: &CStr| extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(name));
    let has_debug = has(ash::ext::debug_utils::NAME);
    // The loader hides drivers that implement Vulkan on another API, as on macOS, unless an application asks for them.
    let layered = has(ash::khr::portability_enumeration::NAME);

    let messages = Messages::default();
    let layer_names: Vec<*const c_char> = if watched { vec![LAYER.as_ptr()] } else { Vec::new() };
    let mut extension_names: Vec<*const c_char> =
        if has_debug || watched { vec![ash::ext::debug_utils::NAME.as_ptr()] } else { Vec::new() };
    let takes_settings = watched && takes_settings(&entry)?;
    if takes_settings {
        extension_names.push(ash::ext::layer_settings::NAME.as_ptr());
    }
    if layered {
        extension_names.push(ash::khr::portability_enumeration::NAME.as_ptr());
    }
    let flags =
        if layered { vk::InstanceCreateFlags::ENUMERATE_PORTABILITY_KHR } else { vk::InstanceCreateFlags::empty() };
    let app = vk::ApplicationInfo::default().application_name(c"psrgs-vk").api_version(vk::API_VERSION_1_3);
    let enables = enables.unwrap_or_default();
    // Core checks have a mode of their own, and the layer rejects both modes at once.
    let disables = [vk::ValidationFeatureDisableEXT::CORE_CHECKS];
    let disables = if validation == Validation::GpuAssisted { &disables[..] } else { &[] };
    let mut features = vk::ValidationFeaturesEXT::default()
        .enabled_validation_features(&enables)
        .disabled_validation_features(disables);
    let mut listen = messages.create_info();
    let mut info = vk::InstanceCreateInfo::default()
        .flags(flags)
        .application_info(&app)
        .enabled_layer_names(&layer_names)
        .enabled_extension_names(&extension_names);
    if watched {
        info = info.push_next(&mut features).push_next(&mut listen);
    }
    let on = vk::TRUE;
    let settings = [switch(FOLLOW_SHADERS, &on)];
    let mut settings = vk::LayerSettingsCreateInfoEXT::default().settings(&settings);
    if takes_settings && validation == Validation::CoreAndSync {
        info = info.push_next(&mut settings);
    }
    // SAFETY: all pointers in the chain live until the call returns.
    let instance = unsafe { entry.create_instance(&info, None) }.or_none("vkCreateInstance")?;
    let messenger = if has_debug || watched {
        match Messenger::new(&entry, &instance, &messages, watched) {
            Ok(messenger) => Some(messenger),
            Err(error) => {
                // SAFETY: nothing was created from the instance.
                unsafe { instance.destroy_instance(None) };
                return Err(error);
            }
        }
    } else {
        None
    };
    Ok((entry, instance, messages, messenger))
}

/// Maps every failure before a device exists to [`Error::NoVulkan`]: loaders and drivers report unreadable files,
/// missing hardware and missing permission by different results.
trait OrNone<T> {
    fn or_none(self, call: &'static str) -> Result<T>;
}

impl<T> OrNone<T> for std::result::Result<T, vk::Result> {
    fn or_none(self, call: &'static str) -> Result<T> {
        self.map_err(|result| {
            Error::NoVulkan(match result {
                vk::Result::ERROR_INCOMPATIBLE_DRIVER => "the loader found no usable driver".to_owned(),
                result => format!("{call}: {result}"),
            })
        })
    }
}

fn enumerate(instance: &ash::Instance) -> Result<Vec<(vk::PhysicalDevice, Reported)>> {
    // SAFETY: the instance is alive.
    let found = unsafe { instance.enumerate_physical_devices() }.or_none("vkEnumeratePhysicalDevices")?;
    if found.is_empty() {
        return Err(Error::NoVulkan("the installed drivers offer no device".into()));
    }
    found
        .into_iter()
        // SAFETY: the device comes from this instance, whose Vulkan version is 1.3.
        .map(|physical| match unsafe { report(instance, physical) } {
            Ok(reported) => Ok((physical, reported)),
            Err(error) => Err(Error::NoVulkan(error.to_string())),
        })
        .collect()
}

/// Index of the wanted device; without a wish, of the best usable device.
fn choose(found: &[(vk::PhysicalDevice, Reported)], wanted: Option<&str>) -> Result<usize> {
    let best = |matching: &dyn Fn(&Reported) -> bool| {
        (0..found.len())
            .filter(|&i| matching(&found[i].1))
            .min_by_key(|&i| (found[i].1.check().is_err(), found[i].1.kind, i))
    };
    let picked = match wanted {
        None => best(&|_| true),
        Some(text) => match text.parse::<usize>() {
            Ok(index) => (index < found.len()).then_some(index),
            Err(_) => best(&|r| r.device.to_lowercase().contains(&text.to_lowercase())),
        },
    };
    picked.ok_or_else(|| Error::NoDevice {
        wanted: wanted.unwrap_or("any").to_owned(),
        found: found.iter().enumerate().map(|(i, (_, r))| format!("{i}: {} ({})", r.device, r.kind)).collect(),
    })
}

fn create_device(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    reported: &Reported,
    statistics: bool,
) -> Result<(ash::Device, u32)> {
    // SAFETY: the physical device comes from this instance.
    let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
    let family = families.iter().position(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE)).ok_or_else(|| {
        Error::MissingFeature {
            feature: "a compute queue",
            needed_for: "every pass".into(),
            device: reported.device.clone(),
        }
    })? as u32;
    let mut enabled = FeatureStructures::default();
    reported.features.enable(&mut enabled);
    let wanted = reported.useful_extensions();
    let mut names: Vec<*const c_char> = wanted.iter().map(|name| name.as_ptr()).collect();
    // Devices of layered drivers list this extension and require an application to enable the extension.
    if reported.has(ash::khr::portability_subset::NAME) {
        names.push(ash::khr::portability_subset::NAME.as_ptr());
    }
    if statistics {
        if !reported.statistics {
            return Err(statistics::missing(&reported.device));
        }
        names.push(ash::khr::pipeline_executable_properties::NAME.as_ptr());
    }
    let mut executables =
        vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default().pipeline_executable_info(true);
    let priorities = [1.0];
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&priorities)];
    let mut info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&names)
        .enabled_features(&enabled.core)
        .push_next(&mut enabled.v11)
        .push_next(&mut enabled.v12)
        .push_next(&mut enabled.v13);
    if wanted.contains(&ash::ext::shader_atomic_float::NAME) {
        info = info.push_next(&mut enabled.atomic_float);
    }
    if statistics {
        info = info.push_next(&mut executables);
    }
    // SAFETY: only features and extensions that the device reports are enabled;
    // all pointers live until the call returns.
    let raw = unsafe { instance.create_device(physical, &info, None) }
        .map_err(|result| Error::Unopened { device: reported.device.clone(), result })?;
    Ok((raw, family))
}
