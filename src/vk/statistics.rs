//! What the driver tells of its pipelines: registers, instructions, spills, by `VK_KHR_pipeline_executable_properties`.

use std::ffi::c_char;

use ash::vk;

use super::device::Device;
use super::device_query::text;
use super::error::{Error, Named, Result};
use super::gpu::Gpu;
use super::pipeline::PipelineInner;

/// What a driver tells of one program that it compiled for a pipeline.
#[derive(Clone, Debug, PartialEq)]
pub struct PipelineStatistics {
    /// Name of the kernel.
    pub kernel: &'static str,
    /// How the kernel reaches its buffers: `descriptors`, `addresses`, `texels` or `texels by address`.
    pub binding: &'static str,
    /// The specialization constants that differ from the kernel's defaults.
    pub constants: Vec<(&'static str, u32)>,
    /// Lanes of a subgroup; 0 where the driver does not say.
    pub subgroup: u32,
    /// The driver's numbers by the driver's names, in the driver's order.
    pub values: Vec<(String, f64)>,
}

impl Gpu {
    /// Statistics of every pipeline that was created so far, by the names of the kernels. Needs
    /// [`super::OpenOptions::statistics`], without which there are none.
    pub fn pipeline_statistics(&self) -> Result<Vec<PipelineStatistics>> {
        let mut all = Vec::new();
        for pipeline in self.pipelines() {
            all.extend(pipeline.inner.statistics(self.device())?);
        }
        all.sort_by(|a, b| (a.kernel, a.binding, &a.constants).cmp(&(b.kernel, b.binding, &b.constants)));
        Ok(all)
    }
}

impl PipelineInner {
    fn statistics(&self, device: &Device) -> Result<Vec<PipelineStatistics>> {
        let Some(executables) = &device.executables else { return Ok(Vec::new()) };
        let constants: Vec<_> = self
            .kernel
            .constants
            .iter()
            .zip(self.values())
            .filter(|(constant, value)| constant.default != **value)
            .map(|(constant, value)| (constant.name, *value))
            .collect();
        let mut all = Vec::new();
        for (binding, variant) in self.variants() {
            // SAFETY: the pipeline is alive and was created with the flag that captures statistics.
            for (subgroup, values) in unsafe { of_pipeline(executables, variant) }? {
                let (kernel, constants) = (self.kernel.name, constants.clone());
                all.push(PipelineStatistics { kernel, binding, constants, subgroup, values });
            }
        }
        Ok(all)
    }
}

/// Lanes of a program's subgroups, and its numbers by name.
type Told = (u32, Vec<(String, f64)>);

/// What the driver tells of each program of a pipeline.
///
/// # Safety
/// The pipeline belongs to the device of `executables` and was created with `CAPTURE_STATISTICS_KHR`.
unsafe fn of_pipeline(
    executables: &ash::khr::pipeline_executable_properties::Device,
    pipeline: vk::Pipeline,
) -> Result<Vec<Told>> {
    let of = vk::PipelineInfoKHR::default().pipeline(pipeline);
    // SAFETY: the caller's promise.
    let programs =
        unsafe { executables.get_pipeline_executable_properties(&of) }.named("vkGetPipelineExecutablePropertiesKHR")?;
    let mut all = Vec::new();
    for (index, program) in programs.iter().enumerate() {
        let of = vk::PipelineExecutableInfoKHR::default().pipeline(pipeline).executable_index(index as u32);
        // SAFETY: as above; the index is one of the programs.
        let told = unsafe { executables.get_pipeline_executable_statistics(&of) }
            .named("vkGetPipelineExecutableStatisticsKHR")?;
        all.push((program.subgroup_size, told.iter().map(|one| (text(&one.name as &[c_char]), number(one))).collect()));
    }
    Ok(all)
}

fn number(told: &vk::PipelineExecutableStatisticKHR<'_>) -> f64 {
    use vk::PipelineExecutableStatisticFormatKHR as Format;
    // SAFETY: the format says which member of the union the driver has set; every member is a plain number.
    unsafe {
        match told.format {
            Format::BOOL32 => f64::from(told.value.b32),
            Format::INT64 => told.value.i64 as f64,
            Format::UINT64 => told.value.u64 as f64,
            Format::FLOAT64 => told.value.f64,
            _ => f64::NAN,
        }
    }
}

/// The error of a device that tells nothing of its pipelines.
pub(super) fn missing(device: &str) -> Error {
    Error::MissingFeature {
        feature: "pipelineExecutableInfo of VK_KHR_pipeline_executable_properties",
        needed_for: "statistics of pipelines".into(),
        device: device.to_owned(),
    }
}
