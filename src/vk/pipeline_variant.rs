//! A kernel as the device has it: module, layouts and pipeline, in one of its variants.

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
    /// A descriptor per buffer, or per buffer of texels, or both.
    Texels,
    /// A descriptor per buffer of texels, and one for a table of addresses.
    TexelsByAddress,
}

impl BindingMode {
    /// Whether there is a table of addresses.
    pub(super) fn by_address(self) -> bool {
        matches!(self, Self::Addresses | Self::TexelsByAddress)
    }

    /// What this variant of a kernel reads as texels, with its module, where it has it.
    pub(super) fn texels(self, kernel: &Kernel) -> Option<Texels> {
        match self {
            Self::Texels => kernel.spirv.texels,
            Self::TexelsByAddress => kernel.spirv.texels_by_address,
            Self::Descriptors | Self::Addresses => None,
        }
    }
}

/// One variant of a pipeline.
pub(super) struct Form {
    device: Arc<Device>,
    pub(super) raw: vk::Pipeline,
    pub(super) layout: vk::PipelineLayout,
    pub(super) set_layout: vk::DescriptorSetLayout,
}

impl Form {
    /// `values` are those of the kernel's constants; push constants and workgroup size were checked.
    pub(super) fn new(
        device: &Arc<Device>,
        cache: vk::PipelineCache,
        kernel: &Kernel,
        values: &[u32],
        workgroup_size: u32,
        reach: BindingMode,
    ) -> Result<Form> {
        let bad = |what: String| Error::Interface { kernel: kernel.name, what };
        let mut views: &[TexelView] = &[];
        let (spirv, descriptors) = match reach {
            BindingMode::Descriptors => (kernel.spirv.descriptors, kernel.bindings.len() as u32),
            BindingMode::Addresses => {
                let spirv = kernel.spirv.addresses.ok_or_else(|| bad("it has no form by address".into()))?;
                (spirv, 1)
            }
            BindingMode::Texels | BindingMode::TexelsByAddress => {
                let texels = reach.texels(kernel).ok_or_else(|| bad("it has no form with texels".into()))?;
                views = texels.views;
                (texels.spirv, if reach.by_address() { 1 } else { kernel.bindings.len() as u32 })
            }
        };
        let limits = &device.caps.limits;
        if descriptors > limits.storage_buffers {
            let most = limits.storage_buffers;
            return Err(bad(format!("{descriptors} storage buffers, the device takes {most}")));
        }
        let words = kernel::words(spirv);
        let given = |id| kernel.constants.iter().zip(values).find(|(c, _)| c.id == id).map(|(_, value)| *value);
        let shared = shared_memory::bytes(&words, given).unwrap_or(0);
        if shared > u64::from(limits.shared_bytes) {
            let most = limits.shared_bytes;
            return Err(bad(format!("{shared} bytes of shared memory, the device has {most} for a workgroup")));
        }
        let capabilities = capabilities(&words);
        for &capability in &capabilities {
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
        let subgroups = capabilities.iter().any(|c| (61..=68).contains(c));
        let width = device.caps.subgroup.width();
        let hardware = subgroups && matches!(device.caps.subgroup, super::Subgroup::Hardware(_));
        let pin = hardware && device.caps.pin_subgroup;
        if pin && workgroup_size > width.saturating_mul(device.caps.max_subgroups) {
            return Err(bad(format!(
                "{workgroup_size} threads are more than {} subgroups of {width}",
                device.caps.max_subgroups
            )));
        }

        let mut made = Partial { device, set_layout: None, layout: None, module: None };
        let buffers = (0..descriptors).filter(|binding| !views.iter().any(|view| view.at == *binding));
        let texels = views.iter().map(|view| (view.at, vk::DescriptorType::UNIFORM_TEXEL_BUFFER));
        let slots: Vec<vk::DescriptorSetLayoutBinding<'_>> = buffers
            .map(|binding| (binding, vk::DescriptorType::STORAGE_BUFFER))
            .chain(texels)
            .map(|(binding, kind)| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding)
                    .descriptor_type(kind)
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
            })
            .collect();
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&slots);
        // SAFETY: valid description, live device; so for the calls below.
        let set_layout =
            unsafe { device.raw.create_descriptor_set_layout(&info, None) }.named("vkCreateDescriptorSetLayout")?;
        made.set_layout = Some(set_layout);
        let ranges =
            [vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::COMPUTE).size(kernel.push_bytes)];
        let set_layouts = [set_layout];
        let info = vk::PipelineLayoutCreateInfo::default()
            .set_layouts(&set_layouts)
            .push_constant_ranges(if kernel.push_bytes == 0 { &[] } else { &ranges });
        // SAFETY: the set layout was made above.
        let layout = unsafe { device.raw.create_pipeline_layout(&info, None) }.named("vkCreatePipelineLayout")?;
        made.layout = Some(layout);
        let info = vk::ShaderModuleCreateInfo::default().code(&words);
        // SAFETY: the words are SPIR-V that glslang compiled at build time.
        let module = unsafe { device.raw.create_shader_module(&info, None) }.named("vkCreateShaderModule")?;
        made.module = Some(module);

        let entries: Vec<vk::SpecializationMapEntry> = kernel
            .constants
            .iter()
            .enumerate()
            .map(|(i, c)| vk::SpecializationMapEntry { constant_id: c.id, offset: 4 * i as u32, size: 4 })
            .collect();
        let special =
            vk::SpecializationInfo::default().map_entries(&entries).data(bytemuck::cast_slice::<u32, u8>(values));
        let mut required =
            vk::PipelineShaderStageRequiredSubgroupSizeCreateInfo::default().required_subgroup_size(width);
        let mut stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main")
            .specialization_info(&special);
        if pin {
            stage = stage.push_next(&mut required);
        }
        if hardware && device.caps.features.subgroup_size_control && workgroup_size.is_multiple_of(width) {
            stage = stage.flags(vk::PipelineShaderStageCreateFlags::REQUIRE_FULL_SUBGROUPS);
        }
        let info = vk::ComputePipelineCreateInfo::default().stage(stage).layout(layout);
        // SAFETY: module and layout were made above; constants and features were checked against the device.
        let created = unsafe { device.raw.create_compute_pipelines(cache, &[info], None) };
        let raw = created
            .map_err(|(_, result)| result)
            .named("vkCreateComputePipelines")?
            .into_iter()
            .next()
            .unwrap_or_default();
        (made.set_layout, made.layout) = (None, None);
        drop(made);
        let shown: Vec<String> = kernel.constants.iter().zip(values).map(|(c, v)| format!("{}={v}", c.name)).collect();
        device.name(raw, &format!("{} {}", kernel.name, shown.join(" ")));
        if let Ok(name) = CString::new(kernel.name) {
            device.name(set_layout, &name.to_string_lossy());
            device.name(layout, &name.to_string_lossy());
        }
        Ok(Form { device: device.clone(), raw, layout, set_layout })
    }
}

impl Drop for Form {
    fn drop(&mut self) {
        // SAFETY: submits in flight hold a handle of the pipeline that owns this variant, so none uses it any more.
        unsafe {
            self.device.raw.destroy_pipeline(self.raw, None);
            self.device.raw.destroy_pipeline_layout(self.layout, None);
            self.device.raw.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

/// Objects to destroy when building a pipeline stops half-way, and the module in any case.
struct Partial<'a> {
    device: &'a Device,
    set_layout: Option<vk::DescriptorSetLayout>,
    layout: Option<vk::PipelineLayout>,
    module: Option<vk::ShaderModule>,
}

impl Drop for Partial<'_> {
    fn drop(&mut self) {
        let raw = &self.device.raw;
        // SAFETY: whatever is still here was created from this device and is used by nothing.
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

/// The device feature behind a SPIR-V capability and whether it is enabled; `None` for those that every device has.
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
