//! Memory and time of a training on the dataset.

use psrgs_vk::bench;
use psrgs_vk::dataset::{Dataset, Role, Supply};
use psrgs_vk::scene::Gaussians;
use psrgs_vk::stereo::surface_of_points;
use psrgs_vk::train::prepare::FirstModel;
use psrgs_vk::train::{
    Error, Estimate, HostMemory, HostPlan, Input, MemoryPlan, Pacing, Residency, Settings, View, chosen_variants,
    prepare, splats_on_surfaces,
};
use psrgs_vk::vk::{self, Gpu};

use super::super::console::Console;
use super::super::{device, progress};

/// The part of `--json` about the training.
#[derive(serde::Serialize)]
pub(super) struct Training {
    device: String,
    /// Bytes of device memory at the start and at the peak, and the splats that fit.
    device_bytes: u64,
    device_limit: u64,
    most_splats: u32,
    /// Bytes of host memory: the budget, the part set aside for the training, the part kept for photographs, the
    /// shortfall.
    host_budget: u64,
    host_training: u64,
    host_photographs: u64,
    host_short_by: u64,
    photographs: Residency,
    estimate: Option<Estimate>,
    #[serde(skip)]
    text: [String; 2],
}

/// Plans the training. Adds its problems to `problems`. Fails with the error that prevents the training. `None` without
/// a device.
pub(super) fn plan(
    dataset: &Dataset,
    settings: &Settings,
    problems: &mut Vec<String>,
    console: &Console,
) -> anyhow::Result<Option<Training>> {
    let gpu = match device::open(&settings.device, false, console) {
        Ok(gpu) => gpu,
        Err(error) if error.downcast_ref::<vk::Error>().is_some_and(|e| !matches!(e, vk::Error::Variable { .. })) => {
            console.warn(format_args!("neither memory nor time can be told: {error}"));
            return Ok(None);
        }
        Err(error) => return Err(error),
    };
    match planned(&gpu, dataset, settings, problems) {
        Ok(training) => Ok(Some(training)),
        Err(error @ (Error::HostMemoryLimit { .. } | Error::MemoryLimit { .. } | Error::TooMany { .. })) => {
            Err(error.into())
        }
        Err(error) => {
            problems.push(error.to_string());
            Ok(None)
        }
    }
}

fn planned(gpu: &Gpu, dataset: &Dataset, settings: &Settings, problems: &mut Vec<String>) -> Result<Training, Error> {
    let memory = HostMemory::new(settings.host.host_memory.map(|bytes| bytes.0));
    let FirstModel { splats: points, left_out, .. } = prepare::first(dataset, settings)?;
    problems.extend(left_out.map(|left_out| left_out.to_string()));
    let (outline, variants) = (prepare::outline(dataset), chosen_variants(gpu, settings)?);
    // Stereo has not run: assume as many splats as it is to add, where points exist.
    let plan = |splats| MemoryPlan::of(gpu, &outline, settings, variants, Pacing::default(), splats);
    let fit = plan(points.len() as u32)?.most_splats.0;
    let known = points.len() as u32;
    let more = match settings.geometry.begins_on_surfaces() {
        true => splats_on_surfaces(known, asked_about(dataset, &points), fit, settings),
        false => 0,
    };
    let first = known.saturating_add(more).min(settings.density.max_splats.unwrap_or(u32::MAX));
    let initial = bench::resized(&points, first, settings.run.seed);
    let plan = plan(initial.len() as u32)?;
    let host = HostPlan::new(gpu, memory, dataset, &outline, &plan, settings);
    host.check()?;
    if host.short_by > 0 {
        problems.push(host.to_string());
    }
    // Two photographs are enough to time steps.
    let views: Vec<_> = dataset.views_of(Role::Train).collect();
    let mut train = Vec::new();
    for (index, view) in [views.len() / 4, 3 * views.len() / 4].into_iter().filter_map(|at| views.get(at).copied()) {
        let photograph = Supply::of(view.photograph()?.pixels);
        if let Some(camera) = dataset.scene_camera(index) {
            train.push(View { name: view.name.clone(), camera, photograph });
        }
    }
    let input = Input {
        train,
        held_out: Vec::new(),
        initial,
        extent: outline.extent,
        optional: psrgs_vk::train::OptionalInput::default(),
    };
    let estimate = Estimate::measure(gpu, &input, settings, variants)?;
    Ok(Training {
        device: gpu.caps().device.clone(),
        device_bytes: plan.at_start,
        device_limit: plan.limit,
        most_splats: plan.most_splats.0,
        host_budget: host.memory.budget,
        host_training: host.training,
        host_photographs: host.decoded.min(host.share.keep),
        host_short_by: host.short_by,
        photographs: host.pacing.photographs,
        estimate,
        text: [plan.to_string(), host.to_string()],
    })
}

/// Splats that begin on each photograph of surface, about: what local frequencies asked for on eight flights, in the
/// mean.
const SPLATS_PER_PHOTOGRAPH: f64 = 6000.0;

/// The splats that stereo will add, estimated from the reconstructed points.
fn asked_about(dataset: &Dataset, points: &Gaussians) -> f64 {
    let cameras: Vec<_> = dataset.views_of(Role::Train).filter_map(|(i, _)| dataset.scene_camera(i)).collect();
    let means: Vec<[f64; 3]> = points.means.chunks_exact(3).map(|m| [m[0], m[1], m[2]].map(f64::from)).collect();
    SPLATS_PER_PHOTOGRAPH * surface_of_points(&cameras, &means)
}

impl Training {
    /// Rows of the table.
    pub(super) fn rows(&self) -> Vec<(&'static str, String)> {
        let [device, host] = &self.text;
        let plain = |text: &str| text.split_once(": ").map_or(text, |(_, rest)| rest).to_owned();
        let mut rows =
            vec![("device", self.device.clone()), ("device memory", plain(device)), ("host memory", plain(host))];
        if let Some(estimate) = &self.estimate {
            let seconds = estimate.seconds(estimate.steps);
            rows.push(("time", format!("about {}: {estimate}", progress::duration(seconds))));
        }
        rows
    }
}
