//! Asking a physical device what it can do, and picking capabilities from the answers.

use std::ffi::CStr;

use ash::vk;

use super::buffer::{REFERENCE_ALIGNMENT, texel_format};
use super::caps::{Addresses, Caps, Choice, DeviceKind, Heap, Limits, Subgroup};
use super::error::{Error, Result};
use super::features::{Features, REQUIRED, USEFUL_EXTENSIONS};
use super::kernel::TexelFormat;
use super::options::{FloatAtomics, OpenOptions};

/// The widest subgroup that divides every workgroup: the smallest ones of passes that use subgroups have so many
/// threads.
const WIDEST: u32 = 64;
/// The width of subgroups in shared memory.
const EMULATED: u32 = 32;

/// What a physical device reports.
pub(super) struct Reported {
    pub(super) device: String,
    pub(super) driver: String,
    pub(super) kind: DeviceKind,
    pub(super) api: u32,
    pub(super) features: Features,
    pub(super) extensions: Vec<String>,
    limits: Limits,
    /// Rows of every kind can be read as texels.
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

fn text(bytes: &[std::ffi::c_char]) -> String {
    let bytes: Vec<u8> = bytes.iter().map(|&b| b as u8).collect();
    CStr::from_bytes_until_nul(&bytes).map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Asks a physical device for everything the engine decides on.
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

    let mut v11 = vk::PhysicalDeviceVulkan11Properties::default();
    let mut v12 = vk::PhysicalDeviceVulkan12Properties::default();
    let mut v13 = vk::PhysicalDeviceVulkan13Properties::default();
    let mut f11 = vk::PhysicalDeviceVulkan11Features::default();
    let mut f12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut f13 = vk::PhysicalDeviceVulkan13Features::default();
    let mut float = vk::PhysicalDeviceShaderAtomicFloatFeaturesEXT::default();
    let mut budget = vk::PhysicalDeviceMemoryBudgetPropertiesEXT::default();
    let mut core = vk::PhysicalDeviceFeatures::default();
    let mut memory = vk::PhysicalDeviceMemoryProperties2::default();
    if !old {
        let mut chain =
            vk::PhysicalDeviceProperties2::default().push_next(&mut v11).push_next(&mut v12).push_next(&mut v13);
        let mut features =
            vk::PhysicalDeviceFeatures2::default().push_next(&mut f11).push_next(&mut f12).push_next(&mut f13);
        if has(ash::ext::shader_atomic_float::NAME) {
            features = features.push_next(&mut float);
        }
        if has(ash::ext::memory_budget::NAME) {
            memory = memory.push_next(&mut budget);
        }
        // SAFETY: the device is 1.3, so the chained structures are known to it;
        // the extension ones only where it has them.
        unsafe {
            instance.get_physical_device_properties2(physical, &mut chain);
            instance.get_physical_device_features2(physical, &mut features);
        }
        core = features.features;
    }
    // SAFETY: as above; the instance has Vulkan 1.1.
    let families = unsafe {
        instance.get_physical_device_memory_properties2(physical, &mut memory);
        instance.get_physical_device_queue_family_properties(physical)
    };
    let heaps_raw = memory.memory_properties;
    let heaps: Vec<Heap> = heaps_raw.memory_heaps[..heaps_raw.memory_heap_count as usize]
        .iter()
        .map(|h| Heap { bytes: h.size, device_local: h.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL) })
        .collect();
    let largest = (0..heaps.len()).filter(|&i| heaps[i].device_local).max_by_key(|&i| heaps[i].bytes).unwrap_or(0);
    // The budget is that of the process, and counts what it has allocated already.
    let budget = (has(ash::ext::memory_budget::NAME) && budget.heap_budget[largest] > 0)
        .then(|| budget.heap_budget[largest].saturating_sub(budget.heap_usage[largest]));
    let timestamps =
        families.iter().any(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE) && f.timestamp_valid_bits > 0);
    let l = properties.limits;
    let texel_formats = TexelFormat::ALL.iter().all(|&format| {
        // SAFETY: as above.
        let known = unsafe { instance.get_physical_device_format_properties(physical, texel_format(format)) };
        known.buffer_features.contains(vk::FormatFeatureFlags::UNIFORM_TEXEL_BUFFER)
    });
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
        features: Features {
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
        },
        extensions,
        limits: Limits {
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
            allocation: v11.max_memory_allocation_size.max(1 << 30).min(if v13.max_buffer_size > 0 {
                v13.max_buffer_size
            } else {
                u64::MAX
            }),
            timestamp_ns: if timestamps { l.timestamp_period } else { 0.0 },
        },
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
    /// Extensions of the device that the engine can use.
    pub(super) fn useful_extensions(&self) -> Vec<&'static CStr> {
        USEFUL_EXTENSIONS.iter().copied().filter(|name| self.has(name)).collect()
    }

    /// The device has this extension.
    pub(super) fn has(&self, extension: &CStr) -> bool {
        self.extensions.iter().any(|e| e.as_bytes() == extension.to_bytes())
    }

    /// The device can be used at all.
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

    /// Picks every capability, with its reason.
    pub(super) fn pick(self, options: &OpenOptions) -> Caps {
        let mut choices = Vec::new();
        let mut note = |what, picked: String, why: String| choices.push(Choice { what, picked, why });
        let mut floats = |what, native: bool, feature: &str| {
            let (picked, why) = match (options.float_atomics, native) {
                (Some(FloatAtomics::CompareAndSwap), _) => (FloatAtomics::CompareAndSwap, "forced".to_owned()),
                (_, true) => (FloatAtomics::Native, format!("{feature} is there")),
                (_, false) => (FloatAtomics::CompareAndSwap, format!("{feature} is missing")),
            };
            note(what, if picked == FloatAtomics::Native { "native" } else { "compare-and-swap" }.to_owned(), why);
            picked
        };
        let buffer_floats =
            floats("float atomics on buffers", self.features.buffer_float_atomic_add, "shaderBufferFloat32AtomicAdd");
        let shared_floats = floats(
            "float atomics on shared memory",
            self.features.shared_float_atomic_add,
            "shaderSharedFloat32AtomicAdd",
        );
        let yes = |have: bool| if have { "yes" } else { "no" }.to_owned();
        let f = self.features;
        note("int64 atomics on buffers", yes(f.int64 && f.buffer_int64_atomics), "shaderBufferInt64Atomics".into());
        note("16-bit storage", yes(f.storage_16bit), "storageBuffer16BitAccess".into());

        let needed = vk::SubgroupFeatureFlags::BASIC
            | vk::SubgroupFeatureFlags::BALLOT
            | vk::SubgroupFeatureFlags::VOTE
            | vk::SubgroupFeatureFlags::ARITHMETIC
            | vk::SubgroupFeatureFlags::SHUFFLE;
        let can_pin = f.subgroup_size_control && self.required_size;
        let (subgroup, pin_subgroup, why) = match options.emulate_subgroup {
            Some(width) => (Subgroup::Emulated(width), false, "forced".to_owned()),
            None if !self.operations.contains(needed) => {
                let why = "basic, vote, ballot, arithmetic or shuffle operations are missing";
                (Subgroup::Emulated(EMULATED), false, why.to_owned())
            }
            None => subgroup_of(self.subgroup, self.subgroup_range, can_pin),
        };
        let shown = match subgroup {
            Subgroup::Hardware(width) => format!("hardware, {width} wide"),
            Subgroup::Emulated(width) => format!("emulated in shared memory, {width} wide"),
        };
        note("subgroups", shown, why);

        let mut limits = self.limits;
        if let Some(range) = options.storage_range.filter(|range| *range < limits.storage_range) {
            limits.storage_range = range;
            note("storage buffer range", format!("{range} bytes"), "forced".to_owned());
        }
        let (addresses, why) = match (options.addresses, f.buffer_device_address) {
            (Some(false), _) => (Addresses::Never, "forced"),
            (_, false) => (Addresses::Never, "bufferDeviceAddress is missing"),
            (Some(true), true) => (Addresses::Always, "forced"),
            (None, true) => (Addresses::BeyondRange, "bufferDeviceAddress is there"),
        };
        let shown = match addresses {
            Addresses::Never => format!("never: none is larger than {} bytes", limits.storage_range),
            Addresses::BeyondRange => format!("where one is larger than {} bytes", limits.storage_range),
            Addresses::Always => "always".to_owned(),
        };
        note("buffers by address", shown, why.to_owned());
        let (texels, why) = match (options.texels, self.texel_formats) {
            (Some(false), _) => (false, "forced"),
            (_, false) => (false, "a format of texel buffers is missing"),
            (Some(true), true) => (true, "forced"),
            (None, true) if self.kind == DeviceKind::Cpu => (true, "the device is a CPU"),
            (None, true) => (false, "the device is no CPU"),
        };
        note("rows read as texels", yes(texels), why.to_owned());
        let why = match options.max_storage_buffers {
            Some(most) if most < limits.storage_buffers => {
                limits.storage_buffers = most;
                "forced"
            }
            _ => "maxPerStageDescriptorStorageBuffers",
        };
        note("storage buffers of a pass", limits.storage_buffers.to_string(), why.to_owned());
        let why = match options.max_shared_bytes {
            Some(most) if most < limits.shared_bytes => {
                limits.shared_bytes = most;
                "forced"
            }
            _ => "maxComputeSharedMemorySize",
        };
        note("shared memory of a workgroup", format!("{} bytes", limits.shared_bytes), why.to_owned());

        let (memory_limit, why) = self.memory_limit(options);
        note("device memory limit", format!("{} MiB", memory_limit >> 20), why);
        let operations = [
            (vk::SubgroupFeatureFlags::BASIC, "basic"),
            (vk::SubgroupFeatureFlags::VOTE, "vote"),
            (vk::SubgroupFeatureFlags::ARITHMETIC, "arithmetic"),
            (vk::SubgroupFeatureFlags::BALLOT, "ballot"),
            (vk::SubgroupFeatureFlags::SHUFFLE, "shuffle"),
            (vk::SubgroupFeatureFlags::SHUFFLE_RELATIVE, "shuffle relative"),
            (vk::SubgroupFeatureFlags::CLUSTERED, "clustered"),
            (vk::SubgroupFeatureFlags::QUAD, "quad"),
        ];
        Caps {
            device: self.device,
            driver: self.driver,
            kind: self.kind,
            api: (vk::api_version_major(self.api), vk::api_version_minor(self.api), vk::api_version_patch(self.api)),
            features: f,
            limits,
            buffer_floats,
            shared_floats,
            addresses,
            texels,
            subgroup,
            subgroup_range: self.subgroup_range,
            subgroup_operations: operations
                .iter()
                .filter(|(bit, _)| self.operations.contains(*bit))
                .map(|(_, name)| *name)
                .collect(),
            heaps: self.heaps,
            memory_limit,
            choices,
            cache_id: self.cache_id,
            pin_subgroup,
            max_subgroups: self.max_subgroups,
        }
    }

    fn memory_limit(&self, options: &OpenOptions) -> (u64, String) {
        if let Some(limit) = options.max_device_memory {
            return (limit, "forced".to_owned());
        }
        if self.kind == DeviceKind::Cpu {
            // Software drivers report a nominal heap: what counts is the system's memory.
            if let Some(total) = system_memory() {
                return (total / 5 * 4, "four fifths of the system's memory, as the device is a CPU".to_owned());
            }
        }
        if let Some(budget) = self.budget {
            // Pipelines, what registers spill and the rest of the allocator's blocks are counted nowhere else.
            return (
                budget / 10 * 9,
                "nine tenths of what VK_EXT_memory_budget left when the device was opened".to_owned(),
            );
        }
        let largest = self.heaps.iter().filter(|h| h.device_local).map(|h| h.bytes).max().unwrap_or(0);
        (largest / 10 * 9, "nine tenths of the largest device-local heap".to_owned())
    }
}

/// How subgroups of a device run that has all operations, whether pipelines have to ask for their width, and why: from
/// the width that it names, those that its pipelines may have, and whether they can ask for one.
fn subgroup_of(named: u32, (narrowest, widest): (u32, u32), can_pin: bool) -> (Subgroup, bool, String) {
    let one_width = narrowest == widest;
    let emulated = |why: String| (Subgroup::Emulated(EMULATED), false, why);
    match named {
        _ if !one_width && !can_pin => emulated("the driver may choose another width per pipeline".to_owned()),
        ..=WIDEST if one_width => (Subgroup::Hardware(named), false, "the only width of the device".to_owned()),
        ..=WIDEST => (Subgroup::Hardware(named), true, "pinned per pipeline".to_owned()),
        _ if narrowest <= WIDEST => (
            Subgroup::Hardware(WIDEST),
            true,
            format!("pinned per pipeline: {named} lanes are more than some workgroups have"),
        ),
        _ => emulated(format!("{named} lanes are more than some workgroups have")),
    }
}

/// Bytes of memory that this process may use: the machine's or its control group's, whichever is less.
fn system_memory() -> Option<u64> {
    let total = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| {
        let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
        line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib * 1024)
    });
    let group =
        std::fs::read_to_string("/sys/fs/cgroup/memory.max").ok().and_then(|text| text.trim().parse::<u64>().ok());
    match (total, group) {
        (Some(total), Some(group)) => Some(total.min(group)),
        (total, group) => total.or(group),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn subgroups_fit_into_the_smallest_workgroup() {
        let pick = |named, range, can_pin| {
            let (subgroup, pinned, _) = subgroup_of(named, range, can_pin);
            (subgroup, pinned)
        };
        assert_eq!(pick(32, (32, 32), false), (Subgroup::Hardware(32), false));
        assert_eq!(pick(64, (32, 64), true), (Subgroup::Hardware(64), true));
        assert_eq!(pick(64, (32, 64), false), (Subgroup::Emulated(32), false));
        // Wider than a workgroup of 64 threads: asked for narrower ones, or emulated where there are none.
        assert_eq!(pick(128, (64, 128), true), (Subgroup::Hardware(64), true));
        assert_eq!(pick(128, (64, 128), false), (Subgroup::Emulated(32), false));
        assert_eq!(pick(128, (128, 128), true), (Subgroup::Emulated(32), false));
    }
}
