//! Choices among capabilities, from the device's report and the options, each with its reason.

use ash::vk;

use super::Reported;
use crate::vk::caps::{Addresses, Caps, Choice, DeviceKind, Limits, Subgroup};
use crate::vk::options::{FloatAtomics, OpenOptions};

/// The widest subgroup that divides every workgroup: the smallest workgroup of a pass with subgroup operations has 64
/// threads.
const WIDEST: u32 = 64;
/// Width of emulated subgroups.
const EMULATED: u32 = 32;

/// Subgroup operations that the passes need.
const NEEDED_OPERATIONS: vk::SubgroupFeatureFlags = vk::SubgroupFeatureFlags::from_raw(
    vk::SubgroupFeatureFlags::BASIC.as_raw()
        | vk::SubgroupFeatureFlags::BALLOT.as_raw()
        | vk::SubgroupFeatureFlags::VOTE.as_raw()
        | vk::SubgroupFeatureFlags::ARITHMETIC.as_raw()
        | vk::SubgroupFeatureFlags::SHUFFLE.as_raw(),
);

/// Subgroup operations, with their names.
const OPERATIONS: [(vk::SubgroupFeatureFlags, &str); 8] = [
    (vk::SubgroupFeatureFlags::BASIC, "basic"),
    (vk::SubgroupFeatureFlags::VOTE, "vote"),
    (vk::SubgroupFeatureFlags::ARITHMETIC, "arithmetic"),
    (vk::SubgroupFeatureFlags::BALLOT, "ballot"),
    (vk::SubgroupFeatureFlags::SHUFFLE, "shuffle"),
    (vk::SubgroupFeatureFlags::SHUFFLE_RELATIVE, "shuffle relative"),
    (vk::SubgroupFeatureFlags::CLUSTERED, "clustered"),
    (vk::SubgroupFeatureFlags::QUAD, "quad"),
];

/// The choices made so far, in display order.
#[derive(Default)]
struct Choices(Vec<Choice>);

impl Choices {
    fn note(&mut self, what: &'static str, picked: impl Into<String>, why: impl Into<String>) {
        self.0.push(Choice { what, picked: picked.into(), why: why.into() });
    }
}

impl Reported {
    /// Chooses every capability, with its reason.
    pub(in crate::vk) fn pick(self, options: &OpenOptions) -> Caps {
        let f = self.features;
        let mut choices = Choices::default();
        let (native, feature) = (f.buffer_float_atomic_add, "shaderBufferFloat32AtomicAdd");
        let buffer_floats = float_atomics(&mut choices, "float atomics on buffers", native, feature, options);
        let (native, feature) = (f.shared_float_atomic_add, "shaderSharedFloat32AtomicAdd");
        let shared_floats = float_atomics(&mut choices, "float atomics on shared memory", native, feature, options);
        let atomics = yes_or_no(f.int64 && f.buffer_int64_atomics);
        choices.note("int64 atomics on buffers", atomics, "shaderBufferInt64Atomics");
        choices.note("16-bit storage", yes_or_no(f.storage_16bit), "storageBuffer16BitAccess");
        let (subgroup, pin_subgroup) = self.pick_subgroup(&mut choices, options);
        let mut limits = self.limits;
        limit_range(&mut choices, &mut limits, options);
        let addresses = self.pick_addresses(&mut choices, &limits, options);
        let texels = self.pick_texels(&mut choices, options);
        limit_workgroups(&mut choices, &mut limits, options);
        let (memory_limit, why) = self.memory_limit(options);
        choices.note("device memory limit", format!("{} MiB", memory_limit >> 20), why);
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
            subgroup_operations: OPERATIONS
                .iter()
                .filter(|(bit, _)| self.operations.contains(*bit))
                .map(|(_, name)| *name)
                .collect(),
            heaps: self.heaps,
            memory_limit,
            choices: choices.0,
            cache_id: self.cache_id,
            pin_subgroup,
            max_subgroups: self.max_subgroups,
        }
    }

    /// How subgroup operations run, and whether pipelines have to require the subgroup width.
    fn pick_subgroup(&self, choices: &mut Choices, options: &OpenOptions) -> (Subgroup, bool) {
        let can_pin = self.features.subgroup_size_control && self.required_size;
        let (narrowest, widest) = self.subgroup_range;
        let (subgroup, pin, why) = match options.emulate_subgroup {
            Some(width) => (Subgroup::Emulated(width), false, "forced".to_owned()),
            None if !self.operations.contains(NEEDED_OPERATIONS) => {
                let why = "basic, vote, ballot, arithmetic or shuffle operations are missing";
                (Subgroup::Emulated(EMULATED), false, why.to_owned())
            }
            None => subgroup_of(self.subgroup, narrowest, widest, can_pin),
        };
        let shown = match subgroup {
            Subgroup::Hardware(width) => format!("hardware, {width} wide"),
            Subgroup::Emulated(width) => format!("emulated in shared memory, {width} wide"),
        };
        choices.note("subgroups", shown, why);
        (subgroup, pin)
    }

    /// When passes reach buffers by address.
    fn pick_addresses(&self, choices: &mut Choices, limits: &Limits, options: &OpenOptions) -> Addresses {
        let (addresses, why) = match (options.addresses, self.features.buffer_device_address) {
            (Some(false), _) => (Addresses::Never, "forced"),
            (_, false) => (Addresses::Never, "bufferDeviceAddress is missing"),
            (Some(true), true) => (Addresses::Always, "forced"),
            (None, true) => (Addresses::BeyondRange, "bufferDeviceAddress is supported"),
        };
        let shown = match addresses {
            Addresses::Never => format!("never: no binding may exceed {} bytes", limits.storage_range),
            Addresses::BeyondRange => format!("in dispatches with a binding above {} bytes", limits.storage_range),
            Addresses::Always => "always".to_owned(),
        };
        choices.note("buffers by address", shown, why);
        addresses
    }

    /// Whether rows of buffers are read as texels.
    fn pick_texels(&self, choices: &mut Choices, options: &OpenOptions) -> bool {
        let (texels, why) = match (options.texels, self.texel_formats) {
            (Some(false), _) => (false, "forced"),
            (_, false) => (false, "a format of texel buffers is missing"),
            (Some(true), true) => (true, "forced"),
            (None, true) if self.kind == DeviceKind::Cpu => (true, "the device is a CPU"),
            (None, true) => (false, "the device is not a CPU"),
        };
        choices.note("rows read as texels", yes_or_no(texels), why);
        texels
    }

    fn memory_limit(&self, options: &OpenOptions) -> (u64, String) {
        if let Some(limit) = options.max_device_memory {
            return (limit, "forced".to_owned());
        }
        if self.kind == DeviceKind::Cpu {
            // Software drivers report a nominal heap; the real limit is the system's memory.
            if let Some(total) = system_memory() {
                return (total / 5 * 4, "four fifths of the system's memory, as the device is a CPU".to_owned());
            }
        }
        if let Some(budget) = self.budget {
            // The last tenth is for pipelines, spilled registers and unused space in the allocator's blocks, which no
            // other count includes.
            return (
                budget / 10 * 9,
                "nine tenths of what VK_EXT_memory_budget left when the device was opened".to_owned(),
            );
        }
        let largest = self.heaps.iter().filter(|h| h.device_local).map(|h| h.bytes).max().unwrap_or(0);
        (largest / 10 * 9, "nine tenths of the largest device-local heap".to_owned())
    }
}

fn yes_or_no(have: bool) -> &'static str {
    if have { "yes" } else { "no" }
}

/// How floats are added atomically. `native` says whether the device has `feature`, the feature for atomic addition.
fn float_atomics(
    choices: &mut Choices,
    what: &'static str,
    native: bool,
    feature: &str,
    options: &OpenOptions,
) -> FloatAtomics {
    let (picked, why) = match (options.float_atomics, native) {
        (Some(FloatAtomics::CompareAndSwap), _) => (FloatAtomics::CompareAndSwap, "forced".to_owned()),
        (_, true) => (FloatAtomics::Native, format!("{feature} is supported")),
        (_, false) => (FloatAtomics::CompareAndSwap, format!("{feature} is missing")),
    };
    choices.note(what, if picked == FloatAtomics::Native { "native" } else { "compare-and-swap" }, why);
    picked
}

/// Lowers the range of a storage-buffer descriptor to the option's value.
fn limit_range(choices: &mut Choices, limits: &mut Limits, options: &OpenOptions) {
    if let Some(range) = options.storage_range.filter(|range| *range < limits.storage_range) {
        limits.storage_range = range;
        choices.note("storage buffer range", format!("{range} bytes"), "forced");
    }
}

/// Lowers the storage buffers of a pass and the shared memory of a workgroup to the options' values.
fn limit_workgroups(choices: &mut Choices, limits: &mut Limits, options: &OpenOptions) {
    let why = lowered(&mut limits.storage_buffers, options.max_storage_buffers);
    let why = why.unwrap_or("maxPerStageDescriptorStorageBuffers");
    choices.note("storage buffers of a pass", limits.storage_buffers.to_string(), why);
    let why = lowered(&mut limits.shared_bytes, options.max_shared_bytes).unwrap_or("maxComputeSharedMemorySize");
    choices.note("shared memory of a workgroup", format!("{} bytes", limits.shared_bytes), why);
}

/// Lowers a limit to `most`. Returns a reason when the limit has changed.
fn lowered(limit: &mut u32, most: Option<u32>) -> Option<&'static str> {
    *limit = most.filter(|most| *most < *limit)?;
    Some("forced")
}

/// How subgroup operations run on a device that has all of them, whether pipelines have to require the width, and why.
/// `named` is the default width of the device, `narrowest` and `widest` bound the widths of its pipelines, and
/// `can_pin` says whether a pipeline can require a width.
fn subgroup_of(named: u32, narrowest: u32, widest: u32, can_pin: bool) -> (Subgroup, bool, String) {
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

/// Bytes of memory that this process may use: the lesser of the machine's memory and the control group's limit.
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
        let pick = |named, (narrowest, widest), can_pin| {
            let (subgroup, pinned, _) = subgroup_of(named, narrowest, widest, can_pin);
            (subgroup, pinned)
        };
        assert_eq!(pick(32, (32, 32), false), (Subgroup::Hardware(32), false));
        assert_eq!(pick(64, (32, 64), true), (Subgroup::Hardware(64), true));
        assert_eq!(pick(64, (32, 64), false), (Subgroup::Emulated(32), false));
        // Wider than a workgroup of 64 threads: narrower subgroups are required, or emulated when the device has none.
        assert_eq!(pick(128, (64, 128), true), (Subgroup::Hardware(64), true));
        assert_eq!(pick(128, (64, 128), false), (Subgroup::Emulated(32), false));
        assert_eq!(pick(128, (128, 128), true), (Subgroup::Emulated(32), false));
    }
}
