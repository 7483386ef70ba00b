//! Queries the capabilities of a physical device.

mod pick;

use std::ffi::CStr;

use ash::vk;

use super::buffer::{REFERENCE_ALIGNMENT, texel_format};
use super::caps::{DeviceKind, Heap, Limits};
use super::error::{Error, Result};
use super::features::{Features, REQUIRED, USEFUL_EXTENSIONS};
use super::kernel::TexelFormat;

/// Properties that a physical device reports.
pub(super) struct Reported {
    pub(super) device: String,
    pub(super) driver: String,
    pub(super) kind: DeviceKind,
    pub(super) api: u32,
    pub(super) features: Features,
    pub(super) extensions: Vec<String>,
    /// Whether the driver tells statistics of pipelines.
    pub(super) statistics: bool,
    limits: Limits,
    /// Whether the device supports texel buffers of every [`TexelFormat`].
    texel_formats: bool,
    heaps: Vec<Heap>,
    budget: Option<u64>,
    cache_id: [u8; 16],
    subgroup: u32,
    subgroup_range: (u32, u32),
    required_size: bool,
    max_subgroups: u32,
    operations: vk::SubgroupFeatureFlags,
}

/// The text of an array that ends with a zero.
pub(super) fn text(bytes: &[std::ffi::c_char]) -> String {
    let bytes: Vec<u8> = bytes.iter().map(|&b| b as u8).collect();
    CStr::from_bytes_until_nul(&bytes).map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Properties and features of a Vulkan 1.3 device; empty for an older device.
#[derive(Default)]
struct Answers {
    v11: vk::PhysicalDeviceVulkan11Properties<'static>,
    v12: vk::PhysicalDeviceVulkan12Properties<'static>,
    v13: vk::PhysicalDeviceVulkan13Properties<'static>,
    f11: vk::PhysicalDeviceVulkan11Features<'static>,
    f12: vk::PhysicalDeviceVulkan12Features<'static>,
    f13: vk::PhysicalDeviceVulkan13Features<'static>,
    float: vk::PhysicalDeviceShaderAtomicFloatFeaturesEXT<'static>,
    executables: vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR<'static>,
    core: vk::PhysicalDeviceFeatures,
}

impl Answers {
    /// Queries the properties and features.
    ///
    /// # Safety
    /// `physical` belongs to `instance` and has Vulkan 1.3; `has` says whether the device has an extension.
    unsafe fn ask(&mut self, instance: &ash::Instance, physical: vk::PhysicalDevice, has: impl Fn(&CStr) -> bool) {
        let mut chain = vk::PhysicalDeviceProperties2::default()
            .push_next(&mut self.v11)
            .push_next(&mut self.v12)
            .push_next(&mut self.v13);
        let mut features = vk::PhysicalDeviceFeatures2::default()
            .push_next(&mut self.f11)
            .push_next(&mut self.f12)
            .push_next(&mut self.f13);
        if has(ash::ext::shader_atomic_float::NAME) {
            features = features.push_next(&mut self.float);
        }
        if has(ash::khr::pipeline_executable_properties::NAME) {
            features = features.push_next(&mut self.executables);
        }
        // SAFETY: a Vulkan 1.3 device knows the chained structures; an extension's structure is chained only where the device
        // has the extension.
        unsafe {
            instance.get_physical_device_properties2(physical, &mut chain);
            instance.get_physical_device_features2(physical, &mut features);
        }
        self.core = features.features;
    }

    /// Supported features that the engine can use.
    fn features(&self) -> Features {
        let Self { f11, f12, f13, float, core, .. } = self;
        Features {
            synchronization2: f13.synchronization2 != 0,
            timeline_semaphore: f12.timeline_semaphore != 0,
            maintenance4: f13.maintenance4 != 0,
            buffer_float_atomic_add: float.shader_buffer_float32_atomic_add != 0,
            shared_float_atomic_add: float.shader_shared_float32_atomic_add != 0,
            int64: core.shader_int64 != 0,
            buffer_int64_atomics: f12.shader_buffer_int64_atomics != 0,
            storage_16bit: f11.storage_buffer16_bit_access != 0,
            float16: f12.shader_float16 != 0,
            int16: core.shader_int16 != 0,
            storage_8bit: f12.storage_buffer8_bit_access != 0,
            int8: f12.shader_int8 != 0,
            memory_model: f12.vulkan_memory_model != 0 && f12.vulkan_memory_model_device_scope != 0,
            buffer_device_address: f12.buffer_device_address != 0,
            subgroup_size_control: f13.subgroup_size_control != 0 && f13.compute_full_subgroups != 0,
        }
    }

    /// Limits for the engine; `l` are the limits of Vulkan 1.0.
    fn limits(&self, l: &vk::PhysicalDeviceLimits, timestamps: bool) -> Limits {
        let largest_buffer = if self.v13.max_buffer_size > 0 { self.v13.max_buffer_size } else { u64::MAX };
        Limits {
            storage_range: u64::from(l.max_storage_buffer_range),
            storage_alignment: l.min_storage_buffer_offset_alignment.max(REFERENCE_ALIGNMENT),
            storage_buffers: l.max_per_stage_descriptor_storage_buffers,
            texels: u64::from(l.max_texel_buffer_elements),
            texel_alignment: l.min_texel_buffer_offset_alignment.max(REFERENCE_ALIGNMENT),
            texel_buffers: l.max_per_stage_descriptor_sampled_images,
            push_bytes: l.max_push_constants_size,
            shared_bytes: l.max_compute_shared_memory_size,
            workgroup_size: l.max_compute_work_group_invocations.min(l.max_compute_work_group_size[0]),
            workgroups: l.max_compute_work_group_count[0],
            allocation: self.v11.max_memory_allocation_size.max(1 << 30).min(largest_buffer),
            timestamp_ns: if timestamps { l.timestamp_period } else { 0.0 },
        }
    }
}

/// The memory heaps of a device, and the bytes that the budget leaves of the largest device-local heap, when the device
/// reports a budget.
///
/// # Safety
/// `physical` belongs to `instance`, whose API version is at least 1.1; `has_budget` says whether the device has
/// `VK_EXT_memory_budget`.
unsafe fn memory_of(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    has_budget: bool,
) -> (Vec<Heap>, Option<u64>) {
    let mut budget = vk::PhysicalDeviceMemoryBudgetPropertiesEXT::default();
    let mut memory = vk::PhysicalDeviceMemoryProperties2::default();
    if has_budget {
        memory = memory.push_next(&mut budget);
    }
    // SAFETY: the caller's promise.
    unsafe { instance.get_physical_device_memory_properties2(physical, &mut memory) };
    let raw = memory.memory_properties;
    let heaps: Vec<Heap> = raw.memory_heaps[..raw.memory_heap_count as usize]
        .iter()
        .map(|h| Heap { bytes: h.size, device_local: h.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL) })
        .collect();
    let largest = (0..heaps.len()).filter(|&i| heaps[i].device_local).max_by_key(|&i| heaps[i].bytes).unwrap_or(0);
    // The budget is per process and includes what the process has already allocated.
    let left = (has_budget && budget.heap_budget[largest] > 0)
        .then(|| budget.heap_budget[largest].saturating_sub(budget.heap_usage[largest]));
    (heaps, left)
}

/// Queries everything of a physical device that the engine's choices depend on.
///
/// # Safety
/// `physical` belongs to `instance`, whose API version is at least 1.1.
pub(super) unsafe fn report(instance: &ash::Instance, physical: vk::PhysicalDevice) -> Result<Reported> {
    // SAFETY: the caller's promise.
    let properties = unsafe { instance.get_physical_device_properties(physical) };
    let old = vk::api_version_major(properties.api_version) < 2 && properties.api_version < vk::API_VERSION_1_3;
    let extensions = if old {
        Vec::new()
    } else {
        // SAFETY: as above.
        let found = unsafe { instance.enumerate_device_extension_properties(physical) };
        found.unwrap_or_default().iter().map(|e| text(&e.extension_name)).collect()
    };
    let has = |name: &CStr| extensions.iter().any(|e| e.as_bytes() == name.to_bytes());
    let mut answers = Answers::default();
    if !old {
        // SAFETY: as above; the device has Vulkan 1.3.
        unsafe { answers.ask(instance, physical, has) };
    }
    // SAFETY: as above; the instance has Vulkan 1.1. An older device counts as one without extensions.
    let (heaps, budget) = unsafe { memory_of(instance, physical, has(ash::ext::memory_budget::NAME)) };
    // SAFETY: as above.
    let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
    let timestamps =
        families.iter().any(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE) && f.timestamp_valid_bits > 0);
    let texel_formats = TexelFormat::ALL.iter().all(|&format| {
        // SAFETY: as above.
        let known = unsafe { instance.get_physical_device_format_properties(physical, texel_format(format)) };
        known.buffer_features.contains(vk::FormatFeatureFlags::UNIFORM_TEXEL_BUFFER)
    });
    let (features, limits) = (answers.features(), answers.limits(&properties.limits, timestamps));
    let statistics = answers.executables.pipeline_executable_info != 0;
    let Answers { v11, v12, v13, .. } = answers;
    Ok(Reported {
        device: text(&properties.device_name),
        driver: format!("{} {}", text(&v12.driver_name), text(&v12.driver_info)).trim().to_owned(),
        kind: match properties.device_type {
            vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::Discrete,
            vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::Integrated,
            vk::PhysicalDeviceType::VIRTUAL_GPU => DeviceKind::Virtual,
            vk::PhysicalDeviceType::CPU => DeviceKind::Cpu,
            _ => DeviceKind::Other,
        },
        api: properties.api_version,
        features,
        extensions,
        statistics,
        limits,
        texel_formats,
        heaps,
        budget,
        cache_id: properties.pipeline_cache_uuid,
        subgroup: v11.subgroup_size.max(1),
        subgroup_range: (v13.min_subgroup_size.max(1), v13.max_subgroup_size.max(1)),
        required_size: v13.required_subgroup_size_stages.contains(vk::ShaderStageFlags::COMPUTE),
        max_subgroups: v13.max_compute_workgroup_subgroups,
        operations: v11.subgroup_supported_operations,
    })
}

impl Reported {
    /// Device extensions that the engine can use.
    pub(super) fn useful_extensions(&self) -> Vec<&'static CStr> {
        USEFUL_EXTENSIONS.iter().copied().filter(|name| self.has(name)).collect()
    }

    /// Whether the device has this extension.
    pub(super) fn has(&self, extension: &CStr) -> bool {
        self.extensions.iter().any(|e| e.as_bytes() == extension.to_bytes())
    }

    /// Checks that the device has every required feature.
    pub(super) fn check(&self) -> Result<()> {
        let there = [self.api >= vk::API_VERSION_1_3, self.features.synchronization2, self.features.timeline_semaphore];
        match REQUIRED.iter().zip(there).find(|(_, there)| !there) {
            None => Ok(()),
            Some(((feature, needed_for), _)) => Err(Error::MissingFeature {
                feature,
                needed_for: (*needed_for).to_owned(),
                device: self.device.clone(),
            }),
        }
    }
}
