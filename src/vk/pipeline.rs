//! Compute pipelines: a kernel with its specialization constants given.

use std::sync::{Arc, OnceLock};

use ash::vk;

use super::caps::{Addresses, Caps};
use super::device::Device;
use super::error::{Error, Result};
use super::kernel::{Kernel, TexelView};
use super::pipeline_variant::{BindingMode, Form};

pub(super) struct PipelineInner {
    device: Arc<Device>,
    pub(super) kernel: Kernel,
    values: Vec<u32>,
    workgroup_size: u32,
    /// Each made when it is first needed.
    descriptors: OnceLock<Form>,
    addresses: OnceLock<Form>,
    texels: OnceLock<Form>,
    texels_by_address: OnceLock<Form>,
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

/// The constants of a kernel with the caller's values put in.
pub(super) fn constants(kernel: &Kernel, given: &[(&str, u32)]) -> Result<Vec<u32>> {
    let mut values: Vec<u32> = kernel.constants.iter().map(|c| c.default).collect();
    for (name, value) in given {
        match kernel.constants.iter().position(|c| c.name == *name) {
            Some(i) => values[i] = *value,
            None => {
                return Err(Error::Interface {
                    kernel: kernel.name,
                    what: format!("no specialization constant is called {name}"),
                });
            }
        }
    }
    Ok(values)
}

impl PipelineInner {
    fn slot(&self, reach: BindingMode) -> &OnceLock<Form> {
        match reach {
            BindingMode::Descriptors => &self.descriptors,
            BindingMode::Addresses => &self.addresses,
            BindingMode::Texels => &self.texels,
            BindingMode::TexelsByAddress => &self.texels_by_address,
        }
    }

    /// A form that [`Pipeline::make`] has made.
    pub(super) fn form(&self, reach: BindingMode) -> Option<&Form> {
        self.slot(reach).get()
    }

    /// What a variant reads as texels, where the kernel has it and the device binds as many.
    pub(super) fn texels(&self, caps: &Caps, reach: BindingMode) -> Option<&'static [TexelView]> {
        let views = reach.texels(&self.kernel)?.views;
        (views.len() as u64 <= u64::from(caps.limits.texel_buffers)).then_some(views)
    }

    /// Whether the kernel can reach its buffers by address at all.
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

    /// Checks that it is a pipeline of this device.
    pub(super) fn of(&self, device: &Arc<Device>) -> Result<()> {
        if Arc::ptr_eq(&self.inner.device, device) {
            return Ok(());
        }
        Err(Error::Foreign { what: format!("the pipeline of kernel {}", self.name()) })
    }

    /// Makes the variant that the device uses unless a buffer asks for another.
    pub(super) fn new(
        device: &Arc<Device>,
        cache: vk::PipelineCache,
        kernel: &Kernel,
        values: &[u32],
    ) -> Result<Pipeline> {
        let bad = |what: String| Error::Interface { kernel: kernel.name, what };
        let limits = &device.caps.limits;
        let workgroup_size = match kernel.local_size {
            Some(size) => size,
            None => kernel
                .constants
                .iter()
                .position(|c| c.name == "LOCAL_SIZE")
                .map(|i| values[i])
                .ok_or_else(|| bad("its workgroup size is open, but no constant is called LOCAL_SIZE".into()))?,
        };
        if workgroup_size == 0 || workgroup_size > limits.workgroup_size {
            return Err(bad(format!(
                "{workgroup_size} threads per workgroup, the device takes 1 to {}",
                limits.workgroup_size
            )));
        }
        if kernel.push_bytes > limits.push_bytes.min(128) || !kernel.push_bytes.is_multiple_of(4) {
            return Err(bad(format!("{} bytes of push constants", kernel.push_bytes)));
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

    /// Makes a form unless it is there. True when it was made.
    pub(super) fn make(&self, device: &Arc<Device>, cache: vk::PipelineCache, reach: BindingMode) -> Result<bool> {
        let PipelineInner { kernel, values, workgroup_size, .. } = &*self.inner;
        let slot = self.inner.slot(reach);
        if slot.get().is_some() {
            return Ok(false);
        }
        // Should another thread have made it meanwhile, this one is dropped.
        let form = Form::new(device, cache, kernel, values, *workgroup_size, reach)?;
        Ok(slot.set(form).is_ok())
    }
}
