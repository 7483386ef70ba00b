//! Device features: features that the engine knows, features that it requires, and how a host enables features.

use std::ffi::CStr;

use ash::vk;

/// Features enabled on an owned device, or stated as enabled on an adopted device, by their Vulkan names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Features {
    /// `synchronization2`.
    pub synchronization2: bool,
    /// `timelineSemaphore`.
    pub timeline_semaphore: bool,
    /// `maintenance4`.
    pub maintenance4: bool,
    /// `shaderBufferFloat32AtomicAdd` of `VK_EXT_shader_atomic_float`.
    pub buffer_float_atomic_add: bool,
    /// `shaderSharedFloat32AtomicAdd` of `VK_EXT_shader_atomic_float`.
    pub shared_float_atomic_add: bool,
    /// `shaderInt64`.
    pub int64: bool,
    /// `shaderBufferInt64Atomics`.
    pub buffer_int64_atomics: bool,
    /// `storageBuffer16BitAccess`.
    pub storage_16bit: bool,
    /// `shaderFloat16`.
    pub float16: bool,
    /// `shaderInt16`.
    pub int16: bool,
    /// `storageBuffer8BitAccess`.
    pub storage_8bit: bool,
    /// `shaderInt8`.
    pub int8: bool,
    /// `vulkanMemoryModel` and `vulkanMemoryModelDeviceScope`.
    pub memory_model: bool,
    /// `bufferDeviceAddress`.
    pub buffer_device_address: bool,
    /// `subgroupSizeControl` and `computeFullSubgroups`.
    pub subgroup_size_control: bool,
}

/// Features that the engine requires, with what needs each feature. Every other feature has a fallback.
pub const REQUIRED: &[(&str, &str)] = &[
    ("Vulkan 1.3", "every pass"),
    ("synchronization2", "barriers between passes"),
    ("timelineSemaphore", "steps without host waits"),
];

/// Device extensions that the engine uses if the device has them and the host enables them. None is required.
pub const USEFUL_EXTENSIONS: &[&CStr] = &[ash::ext::shader_atomic_float::NAME, ash::ext::memory_budget::NAME];

/// Features that a host has to enable on every device; no extension is required. Further features
/// ([`super::Gpu::usable_features`]) only make the engine faster or allow larger scenes.
pub fn required_features() -> Features {
    Features { synchronization2: true, timeline_semaphore: true, ..Features::default() }
}

/// Vulkan's structures for the features that the engine knows, to be chained into `VkDeviceCreateInfo`. Features that a
/// host has set in the structures stay set.
#[derive(Clone, Copy, Debug, Default)]
pub struct FeatureStructures {
    /// `VkPhysicalDeviceFeatures`, for `pEnabledFeatures` or `VkPhysicalDeviceFeatures2`.
    pub core: vk::PhysicalDeviceFeatures,
    /// Features of Vulkan 1.1.
    pub v11: vk::PhysicalDeviceVulkan11Features<'static>,
    /// Features of Vulkan 1.2.
    pub v12: vk::PhysicalDeviceVulkan12Features<'static>,
    /// Features of Vulkan 1.3.
    pub v13: vk::PhysicalDeviceVulkan13Features<'static>,
    /// Features of `VK_EXT_shader_atomic_float`. Chain this structure only when the extension is enabled.
    pub atomic_float: vk::PhysicalDeviceShaderAtomicFloatFeaturesEXT<'static>,
}

impl Features {
    /// Sets these features in `to`. Features already set stay set.
    pub fn enable(&self, to: &mut FeatureStructures) {
        let FeatureStructures { core, v11, v12, v13, atomic_float } = to;
        for (wanted, fields) in [
            (self.int64, vec![&mut core.shader_int64]),
            (self.int16, vec![&mut core.shader_int16]),
            (self.storage_16bit, vec![&mut v11.storage_buffer16_bit_access]),
            (self.timeline_semaphore, vec![&mut v12.timeline_semaphore]),
            (self.buffer_int64_atomics, vec![&mut v12.shader_buffer_int64_atomics]),
            (self.float16, vec![&mut v12.shader_float16]),
            (self.storage_8bit, vec![&mut v12.storage_buffer8_bit_access]),
            (self.int8, vec![&mut v12.shader_int8]),
            (self.memory_model, vec![&mut v12.vulkan_memory_model, &mut v12.vulkan_memory_model_device_scope]),
            (self.buffer_device_address, vec![&mut v12.buffer_device_address]),
            (self.synchronization2, vec![&mut v13.synchronization2]),
            (self.maintenance4, vec![&mut v13.maintenance4]),
            (self.subgroup_size_control, vec![&mut v13.subgroup_size_control, &mut v13.compute_full_subgroups]),
            (self.buffer_float_atomic_add, vec![&mut atomic_float.shader_buffer_float32_atomic_add]),
            (self.shared_float_atomic_add, vec![&mut atomic_float.shader_shared_float32_atomic_add]),
        ] {
            if wanted {
                fields.into_iter().for_each(|field| *field = vk::TRUE);
            }
        }
    }

    /// Features in both sets.
    pub fn and(&self, other: &Features) -> Features {
        let (a, b) = (self, other);
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

    /// The features without those whose extension is not enabled.
    pub(super) fn with_extensions(self, enabled: &[&CStr]) -> Features {
        let floats = enabled.contains(&ash::ext::shader_atomic_float::NAME);
        Features {
            buffer_float_atomic_add: self.buffer_float_atomic_add && floats,
            shared_float_atomic_add: self.shared_float_atomic_add && floats,
            ..self
        }
    }
}
