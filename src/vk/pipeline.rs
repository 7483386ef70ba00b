//! Compute pipelines: a kernel with given specialization constants.

use std::sync::{Arc, OnceLock};

use ash::vk;

use super::caps::{Addresses, Caps};
use super::device::Device;
use super::error::{Error, Result};
use super::kernel::{Kernel, TexelView};
use super::pipeline_variant::{BindingMode, PipelineVariant};

pub(super) struct PipelineInner {
    device: Arc<Device>,
    pub(super) kernel: Kernel,
    values: Vec<u32>,
    workgroup_size: u32,
    /// Each variant is created when first needed.
    descriptors: OnceLock<PipelineVariant>,
    addresses: OnceLock<PipelineVariant>,
    texels: OnceLock<PipelineVariant>,
    texels_by_address: OnceLock<PipelineVariant>,
}

/// A compute pipeline. Cheap to clone.
#[derive(Clone)]
pub struct Pipeline {
    pub(super) inner: Arc<PipelineInner>,
}

impl std::fmt::Debug for Pipeline {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Pipeline({})", self.inner.kernel.name)
    }
}

/// Values of a kernel's constants: the caller's values, else the defaults.
pub(super) fn constants(kernel: &Kernel, given: &[(&str, u32)]) -> Result<Vec<u32>> {
    let mut values: Vec<u32> = kernel.constants.iter().map(|c| c.default).collect();
    for (name, value) in given {
        match kernel.constants.iter().position(|c| c.name == *name) {
            Some(i) => values[i] = *value,
            None => {
                return Err(Error::Interface {
                    kernel: kernel.name,
                    what: format!("the kernel has no specialization constant {name}"),
                });
            }
        }
    }
    Ok(values)
}

impl PipelineInner {
    fn slot(&self, mode: BindingMode) -> &OnceLock<PipelineVariant> {
        match mode {
            BindingMode::Descriptors => &self.descriptors,
            BindingMode::Addresses => &self.addresses,
            BindingMode::Texels => &self.texels,
            BindingMode::TexelsByAddress => &self.texels_by_address,
        }
    }

    /// A variant that [`Pipeline::make`] has created.
    pub(super) fn variant(&self, mode: BindingMode) -> Option<&PipelineVariant> {
        self.slot(mode).get()
    }

    /// Values of the kernel's constants.
    pub(super) fn values(&self) -> &[u32] {
        &self.values
    }

    /// The variants that exist, by how they reach their buffers.
    pub(super) fn variants(&self) -> impl Iterator<Item = (&'static str, vk::Pipeline)> {
        BindingMode::ALL.into_iter().filter_map(|mode| Some((mode.name(), self.variant(mode)?.raw)))
    }

    /// Texel views of a variant; `None` when the kernel lacks the variant or the device cannot bind as many texel
    /// buffers.
    pub(super) fn texels(&self, caps: &Caps, mode: BindingMode) -> Option<&'static [TexelView]> {
        let views = mode.texels(&self.kernel)?.views;
        (views.len() as u64 <= u64::from(caps.limits.texel_buffers)).then_some(views)
    }

    /// Whether the kernel has a variant that reaches buffers by address.
    pub(super) fn by_address(&self) -> bool {
        self.kernel.spirv.addresses.is_some() && !self.kernel.bindings.is_empty()
    }
}

impl Pipeline {
    /// Threads of a workgroup.
    pub fn workgroup_size(&self) -> u32 {
        self.inner.workgroup_size
    }

    /// Name of the kernel.
    pub fn name(&self) -> &'static str {
        self.inner.kernel.name
    }

    /// Checks that the pipeline belongs to `device`.
    pub(super) fn of(&self, device: &Arc<Device>) -> Result<()> {
        if Arc::ptr_eq(&self.inner.device, device) {
            return Ok(());
        }
        Err(Error::Foreign { what: format!("the pipeline of kernel {}", self.name()) })
    }

    /// Creates a pipeline with its default variant.
    pub(super) fn new(
        device: &Arc<Device>,
        cache: vk::PipelineCache,
        kernel: &Kernel,
        values: &[u32],
    ) -> Result<Pipeline> {
        let bad = |what: String| Error::Interface { kernel: kernel.name, what };
        let limits = &device.caps.limits;
        let workgroup_size =
            match kernel.local_size {
                Some(size) => size,
                None => kernel.constants.iter().position(|c| c.name == "LOCAL_SIZE").map(|i| values[i]).ok_or_else(
                    || bad("its workgroup size is not fixed, but it has no specialization constant LOCAL_SIZE".into()),
                )?,
            };
        if workgroup_size == 0 || workgroup_size > limits.workgroup_size {
            return Err(bad(format!(
                "{workgroup_size} threads per workgroup, but the device allows 1 to {}",
                limits.workgroup_size
            )));
        }
        let most = limits.push_bytes.min(128);
        if kernel.push_bytes > most || !kernel.push_bytes.is_multiple_of(4) {
            return Err(bad(format!(
                "{} bytes of push constants, but at most {most} in words of 4 are allowed",
                kernel.push_bytes
            )));
        }
        let inner = PipelineInner {
            device: device.clone(),
            kernel: *kernel,
            values: values.to_vec(),
            workgroup_size,
            descriptors: OnceLock::new(),
            addresses: OnceLock::new(),
            texels: OnceLock::new(),
            texels_by_address: OnceLock::new(),
        };
        let always = device.caps.addresses == Addresses::Always && inner.by_address();
        let first = match () {
            () if always => BindingMode::Addresses,
            () if device.caps.texels && inner.texels(&device.caps, BindingMode::Texels).is_some() => {
                BindingMode::Texels
            }
            () => BindingMode::Descriptors,
        };
        let pipeline = Pipeline { inner: Arc::new(inner) };
        pipeline.make(device, cache, first)?;
        Ok(pipeline)
    }

    /// Creates a variant unless it exists. Returns whether the variant was created.
    pub(super) fn make(&self, device: &Arc<Device>, cache: vk::PipelineCache, mode: BindingMode) -> Result<bool> {
        let PipelineInner { kernel, values, workgroup_size, .. } = &*self.inner;
        let slot = self.inner.slot(mode);
        if slot.get().is_some() {
            return Ok(false);
        }
        // If another thread has created the variant meanwhile, this variant is dropped.
        let variant = PipelineVariant::new(device, cache, kernel, values, *workgroup_size, mode)?;
        Ok(slot.set(variant).is_ok())
    }
}
