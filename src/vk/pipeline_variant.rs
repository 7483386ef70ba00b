//! Variants of a pipeline: one kernel, compiled for one way of reaching its buffers.

use std::ffi::CString;
use std::sync::Arc;

use ash::vk;

use super::device::Device;
use super::error::{Error, Named, Result};
use super::features::Features;
use super::kernel::{self, Kernel, TexelView, Texels};
use super::shared_memory;

/// How a kernel reaches its buffers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BindingMode {
    /// A descriptor per buffer.
    Descriptors,
    /// One descriptor, for a table of addresses.
    Addresses,
    /// Per buffer a storage-buffer descriptor, a texel-buffer descriptor, or both.
    Texels,
    /// A descriptor per texel buffer, and one for a table of addresses.
    TexelsByAddress,
}

impl BindingMode {
    pub(super) const ALL: [Self; 4] = [Self::Descriptors, Self::Addresses, Self::Texels, Self::TexelsByAddress];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Descriptors => "descriptors",
            Self::Addresses => "addresses",
            Self::Texels => "texels",
            Self::TexelsByAddress => "texels by address",
        }
    }

    /// Whether a dispatch binds a table of addresses.
    pub(super) fn by_address(self) -> bool {
        matches!(self, Self::Addresses | Self::TexelsByAddress)
    }

    /// Module and texel views of a kernel for this mode; `None` for a mode without texels or a kernel without the
    /// variant.
    pub(super) fn texels(self, kernel: &Kernel) -> Option<Texels> {
        match self {
            Self::Texels => kernel.spirv.texels,
            Self::TexelsByAddress => kernel.spirv.texels_by_address,
            Self::Descriptors | Self::Addresses => None,
        }
    }
}

/// Vulkan objects of one variant of a pipeline.
pub(super) struct PipelineVariant {
    device: Arc<Device>,
    pub(super) raw: vk::Pipeline,
    pub(super) layout: vk::PipelineLayout,
    pub(super) set_layout: vk::DescriptorSetLayout,
}

impl PipelineVariant {
    /// `values` are the values of the kernel's constants. Push constants and workgroup size were checked.
    pub(super) fn new(
        device: &Arc<Device>,
        cache: vk::PipelineCache,
        kernel: &Kernel,
        values: &[u32],
        workgroup_size: u32,
        mode: BindingMode,
    ) -> Result<PipelineVariant> {
        let module = Module::of(kernel, mode)?;
        module.check_limits(device, kernel, values)?;
        let capabilities = capabilities(&module.words);
        check_features(device, kernel, &capabilities)?;
        let subgroups = SubgroupDemand::of(device, kernel, &capabilities, workgroup_size)?;

        let mut made = UnfinishedPipeline { device, set_layout: None, layout: None, module: None };
        let (set_layout, layout) = made.layouts(&module, kernel.push_bytes)?;
        let raw = made.pipeline(cache, &module.words, &Specialized { kernel, values, subgroups, layout })?;
        (made.set_layout, made.layout) = (None, None);
        drop(made);
        let shown: Vec<String> = kernel.constants.iter().zip(values).map(|(c, v)| format!("{}={v}", c.name)).collect();
        device.name(raw, &format!("{} {}", kernel.name, shown.join(" ")));
        if let Ok(name) = CString::new(kernel.name) {
            device.name(set_layout, &name.to_string_lossy());
            device.name(layout, &name.to_string_lossy());
        }
        Ok(PipelineVariant { device: device.clone(), raw, layout, set_layout })
    }
}

fn unfit(kernel: &Kernel, what: String) -> Error {
    Error::Interface { kernel: kernel.name, what }
}

/// The SPIR-V of a variant, with its descriptors.
struct Module {
    words: Vec<u32>,
    /// Number of descriptors, including texel buffers.
    descriptors: u32,
    /// The descriptors that are texel buffers.
    views: &'static [TexelView],
}

impl Module {
    fn of(kernel: &Kernel, mode: BindingMode) -> Result<Self> {
        let mut views: &[TexelView] = &[];
        let (spirv, descriptors) = match mode {
            BindingMode::Descriptors => (kernel.spirv.descriptors, kernel.bindings.len() as u32),
            BindingMode::Addresses => {
                let none = || unfit(kernel, "it has no variant by address".into());
                (kernel.spirv.addresses.ok_or_else(none)?, 1)
            }
            BindingMode::Texels | BindingMode::TexelsByAddress => {
                let none = || unfit(kernel, "it has no variant with texels".into());
                let texels = mode.texels(kernel).ok_or_else(none)?;
                views = texels.views;
                (texels.spirv, if mode.by_address() { 1 } else { kernel.bindings.len() as u32 })
            }
        };
        Ok(Self { words: kernel::words(spirv), descriptors, views })
    }

    /// Checks descriptors and shared memory against the device's limits.
    fn check_limits(&self, device: &Device, kernel: &Kernel, values: &[u32]) -> Result<()> {
        let limits = &device.caps.limits;
        let descriptors = self.descriptors;
        if descriptors > limits.storage_buffers {
            let most = limits.storage_buffers;
            return Err(unfit(kernel, format!("{descriptors} storage buffers, but the device allows {most}")));
        }
        let given = |id| kernel.constants.iter().zip(values).find(|(c, _)| c.id == id).map(|(_, value)| *value);
        let shared = shared_memory::bytes(&self.words, given).unwrap_or(0);
        if shared > u64::from(limits.shared_bytes) {
            let most = limits.shared_bytes;
            let what = format!("{shared} bytes of shared memory, but the device allows {most} for a workgroup");
            return Err(unfit(kernel, what));
        }
        Ok(())
    }

    /// Bindings of the descriptor set.
    fn slots(&self) -> Vec<vk::DescriptorSetLayoutBinding<'static>> {
        let buffers = (0..self.descriptors).filter(|binding| !self.views.iter().any(|view| view.at == *binding));
        let texels = self.views.iter().map(|view| (view.at, vk::DescriptorType::UNIFORM_TEXEL_BUFFER));
        buffers
            .map(|binding| (binding, vk::DescriptorType::STORAGE_BUFFER))
            .chain(texels)
            .map(|(binding, kind)| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding)
                    .descriptor_type(kind)
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
            })
            .collect()
    }
}

/// Checks that the device has every feature that a module's capabilities need.
fn check_features(device: &Device, kernel: &Kernel, capabilities: &[u32]) -> Result<()> {
    for &capability in capabilities {
        if let Some((feature, there)) = needed_feature(capability, &device.caps.features)
            && !there
        {
            return Err(Error::MissingFeature {
                feature,
                needed_for: format!("kernel {}", kernel.name),
                device: device.caps.device.clone(),
            });
        }
    }
    Ok(())
}

/// Subgroup requirements of a pipeline.
#[derive(Clone, Copy)]
struct SubgroupDemand {
    /// Lanes of a subgroup.
    width: u32,
    /// Whether the pipeline requires this width.
    pinned: bool,
    /// Whether the pipeline requires full subgroups.
    full: bool,
}

impl SubgroupDemand {
    fn of(device: &Device, kernel: &Kernel, capabilities: &[u32], workgroup_size: u32) -> Result<Self> {
        let used = capabilities.iter().any(|c| (61..=68).contains(c));
        let width = device.caps.subgroup.width();
        let hardware = used && matches!(device.caps.subgroup, super::Subgroup::Hardware(_));
        let pinned = hardware && device.caps.pin_subgroup;
        let most = device.caps.max_subgroups;
        if pinned && workgroup_size > width.saturating_mul(most) {
            let what = format!("{workgroup_size} threads are more than {most} subgroups of {width}");
            return Err(unfit(kernel, what));
        }
        let controlled = hardware && device.caps.features.subgroup_size_control;
        Ok(Self { width, pinned, full: controlled && workgroup_size.is_multiple_of(width) })
    }
}

/// Inputs of pipeline creation, without the module.
struct Specialized<'a> {
    kernel: &'a Kernel,
    /// Values of the kernel's constants.
    values: &'a [u32],
    subgroups: SubgroupDemand,
    layout: vk::PipelineLayout,
}

impl Drop for PipelineVariant {
    fn drop(&mut self) {
        // SAFETY: submits in flight hold a handle of the pipeline that owns this variant, so no submit uses the variant
        // any more.
        unsafe {
            self.device.raw.destroy_pipeline(self.raw, None);
            self.device.raw.destroy_pipeline_layout(self.layout, None);
            self.device.raw.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

/// Objects to destroy when pipeline creation fails. The module is destroyed in any case.
struct UnfinishedPipeline<'a> {
    device: &'a Device,
    set_layout: Option<vk::DescriptorSetLayout>,
    layout: Option<vk::PipelineLayout>,
    module: Option<vk::ShaderModule>,
}

impl UnfinishedPipeline<'_> {
    /// Creates the layouts of the descriptor set and of the pipeline.
    fn layouts(&mut self, module: &Module, push_bytes: u32) -> Result<(vk::DescriptorSetLayout, vk::PipelineLayout)> {
        let slots = module.slots();
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&slots);
        // SAFETY: valid description, live device.
        let set_layout = unsafe { self.device.raw.create_descriptor_set_layout(&info, None) }
            .named("vkCreateDescriptorSetLayout")?;
        self.set_layout = Some(set_layout);
        let ranges = [vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::COMPUTE).size(push_bytes)];
        let set_layouts = [set_layout];
        let info = vk::PipelineLayoutCreateInfo::default()
            .set_layouts(&set_layouts)
            .push_constant_ranges(if push_bytes == 0 { &[] } else { &ranges });
        // SAFETY: the set layout was made above.
        let layout = unsafe { self.device.raw.create_pipeline_layout(&info, None) }.named("vkCreatePipelineLayout")?;
        self.layout = Some(layout);
        Ok((set_layout, layout))
    }

    /// Creates the pipeline from the SPIR-V words of a module.
    fn pipeline(&mut self, cache: vk::PipelineCache, words: &[u32], of: &Specialized<'_>) -> Result<vk::Pipeline> {
        let Specialized { kernel, values, subgroups, layout } = of;
        let info = vk::ShaderModuleCreateInfo::default().code(words);
        // SAFETY: the words are SPIR-V compiled by glslang at build time.
        let module = unsafe { self.device.raw.create_shader_module(&info, None) }.named("vkCreateShaderModule")?;
        self.module = Some(module);
        let entries: Vec<vk::SpecializationMapEntry> = kernel
            .constants
            .iter()
            .enumerate()
            .map(|(i, c)| vk::SpecializationMapEntry { constant_id: c.id, offset: 4 * i as u32, size: 4 })
            .collect();
        let special =
            vk::SpecializationInfo::default().map_entries(&entries).data(bytemuck::cast_slice::<u32, u8>(values));
        let mut required =
            vk::PipelineShaderStageRequiredSubgroupSizeCreateInfo::default().required_subgroup_size(subgroups.width);
        let mut stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main")
            .specialization_info(&special);
        if subgroups.pinned {
            stage = stage.push_next(&mut required);
        }
        if subgroups.full {
            stage = stage.flags(vk::PipelineShaderStageCreateFlags::REQUIRE_FULL_SUBGROUPS);
        }
        let mut info = vk::ComputePipelineCreateInfo::default().stage(stage).layout(*layout);
        if self.device.executables.is_some() {
            info = info.flags(vk::PipelineCreateFlags::CAPTURE_STATISTICS_KHR);
        }
        // SAFETY: module and layout were made above; constants and features were checked against the device.
        let created = unsafe { self.device.raw.create_compute_pipelines(cache, &[info], None) };
        let made = created.map_err(|(_, result)| result).named("vkCreateComputePipelines")?;
        Ok(made.into_iter().next().unwrap_or_default())
    }
}

impl Drop for UnfinishedPipeline<'_> {
    fn drop(&mut self) {
        let raw = &self.device.raw;
        // SAFETY: the remaining objects were created from this device and have no user.
        unsafe {
            self.module.into_iter().for_each(|module| raw.destroy_shader_module(module, None));
            self.layout.into_iter().for_each(|layout| raw.destroy_pipeline_layout(layout, None));
            self.set_layout.into_iter().for_each(|layout| raw.destroy_descriptor_set_layout(layout, None));
        }
    }
}

/// Operands of every `OpCapability` of a module.
fn capabilities(words: &[u32]) -> Vec<u32> {
    const OP_CAPABILITY: u32 = 17;
    let mut found = Vec::new();
    let mut rest = words.get(5..).unwrap_or(&[]);
    // Capabilities come before everything else.
    while let [first, operand, ..] = rest {
        if first & 0xffff != OP_CAPABILITY {
            break;
        }
        found.push(*operand);
        rest = &rest[2..];
    }
    found
}

/// The device feature that a SPIR-V capability needs, and whether the feature is enabled; `None` when every device has
/// the capability.
fn needed_feature(capability: u32, f: &Features) -> Option<(&'static str, bool)> {
    // Numbers from the SPIR-V specification, section 3.2.31.
    Some(match capability {
        9 => ("shaderFloat16", f.float16),
        11 => ("shaderInt64", f.int64),
        12 => ("shaderBufferInt64Atomics", f.buffer_int64_atomics),
        22 => ("shaderInt16", f.int16),
        39 => ("shaderInt8", f.int8),
        4433 => ("storageBuffer16BitAccess", f.storage_16bit),
        4448 => ("storageBuffer8BitAccess", f.storage_8bit),
        5345 | 5346 => ("vulkanMemoryModel", f.memory_model),
        5347 => ("bufferDeviceAddress", f.buffer_device_address),
        6033 => (
            "shaderBufferFloat32AtomicAdd or shaderSharedFloat32AtomicAdd",
            f.buffer_float_atomic_add || f.shared_float_atomic_add,
        ),
        10 => ("shaderFloat64", false),
        _ => return None,
    })
}
