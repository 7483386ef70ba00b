//! What a training begins with: its photographs and first splats, what is known of depths, and the settings that hang on these.

use std::sync::Arc;
use std::time::Instant;

use psrgs_vk::dataset::{Dataset, Role};
use psrgs_vk::numbers::{counted, percent};
use psrgs_vk::perceptual::LpipsWeights;
use psrgs_vk::scene::Gaussians;
use psrgs_vk::train::prepare::First;
use psrgs_vk::train::settings::{DepthPrior, LidarCloud};
use psrgs_vk::train::{
    HostMemory, HostPlan, Input, MemoryPlan, Pacing, Restart, Settings, StereoReport, chosen_variants, prepare,
    take_stereo, tune,
};
use psrgs_vk::vk::Gpu;

use super::told_before;
use crate::cli::console::Console;
use crate::cli::device;
use crate::cli::exit::Failure;
use crate::cli::train::Plan;

/// What a training begins with.
pub(super) struct Beginning {
    /// As planned, with what was left to the photographs and the device.
    pub(super) settings: Settings,
    /// Photographs, first splats, and what is known besides.
    pub(super) input: Input,
    /// Where a run that was interrupted goes on.
    pub(super) restart: Option<Restart>,
    /// How the host's memory is shared.
    pub(super) host: HostPlan,
    /// What was found of depths.
    pub(super) depths: StereoReport,
    /// Seconds that finding them took.
    pub(super) stereo_seconds: f64,
}

impl Beginning {
    /// Gets everything ready, and tells of it on the way.
    pub(super) fn prepare(
        plan: &Plan,
        gpu: &Gpu,
        dataset: &Dataset,
        weights: Option<Arc<LpipsWeights>>,
        restart: Option<Restart>,
        console: &Console,
    ) -> anyhow::Result<Self> {
        let mut beginning = Self::with_photographs(plan, gpu, dataset, restart, console)?;
        beginning.take_weights(weights, console);
        beginning.look_for_depths(gpu, dataset, console)?;
        // A run that goes on has decided.
        if beginning.restart.is_none() {
            beginning.decide_by_photographs(console)?;
            choose_forms(gpu, &beginning.input, &mut beginning.settings, console)?;
        }
        Ok(beginning)
    }

    /// Takes in the photographs, as far as the host's memory keeps them, and the first splats.
    fn with_photographs(
        plan: &Plan,
        gpu: &Gpu,
        dataset: &Dataset,
        restart: Option<Restart>,
        console: &Console,
    ) -> anyhow::Result<Self> {
        let settings = &plan.settings;
        let First { splats: initial, uncoloured, left_out } = match &restart {
            // Its splats are those of the checkpoint: the file of the first ones may be gone.
            Some(_) if settings.run.init.is_some() => {
                First { splats: Gaussians::default(), uncoloured: None, left_out: None }
            }
            _ => prepare::first(dataset, settings)?,
        };
        left_out.iter().for_each(|left_out| console.warn(left_out));
        let splats = restart.as_ref().map_or(initial.len() as u32, |r| r.state.splats());
        let mut host = host_plan(gpu, dataset, settings, splats)?;
        host.check()?;
        if plan.keep_no_photographs {
            host.share.keep = 0;
        }
        console.say(host);
        let mut input = prepare::input_within(dataset, initial, host.share)?;
        input.known.left_out.iter().for_each(|warning| console.warn(warning));
        // Before depths take their time.
        if let Some(before) = restart.as_ref().and_then(|restart| restart.trained_on.as_ref()) {
            before.check_views(&input.train)?;
        }
        if let (Some(points), None) = (uncoloured, &restart) {
            points.take_colours(dataset, &mut input)?;
        }
        if input.train.is_empty() && dataset.views_of(Role::Train).next().is_some() {
            return Err(Failure::all_masked(&dataset.path, Role::Train).into());
        }
        let (settings, depths) = (settings.clone(), StereoReport::default());
        Ok(Self { settings, input, restart, host, depths, stereo_seconds: 0.0 })
    }

    /// Takes weights for the perceptual loss. Warns where it has to do without.
    fn take_weights(&mut self, weights: Option<Arc<LpipsWeights>>, console: &Console) {
        if self.settings.texture.lambda_perceptual > 0.0 && weights.is_none() {
            console.warn(
                "the perceptual loss compares by oriented filters, for want of a network's weights: --perceptual-weights names them \
                 (`psrgs-vk weights` says where to get them), --lambda-perceptual 0 leaves it out",
            );
        }
        self.input.known.perceptual = weights;
    }

    /// Takes what stereo, a cloud or the points say of depths.
    fn look_for_depths(&mut self, gpu: &Gpu, dataset: &Dataset, console: &Console) -> anyhow::Result<()> {
        let photographs = self.input.train.len();
        let begin = Instant::now();
        let matches = self.settings.geometry.depth_prior == DepthPrior::Stereo
            || self.settings.density.lidar == Some(LidarCloud::Mvs);
        if matches {
            console.say(format_args!("looking for depths in {}", counted(photographs, "photograph")));
        }
        let from_points = self.is_from_points();
        self.depths = take_stereo(gpu, dataset, &mut self.input, &self.settings, &self.host.share, from_points)?;
        self.stereo_seconds = if matches || self.depths.views > 0 { begin.elapsed().as_secs_f64() } else { 0.0 };
        told_before::depths(&self.depths, &self.settings, photographs, console);
        Ok(())
    }

    /// Decides what the settings leave to the photographs: how long splats grow, and at which size training begins.
    fn decide_by_photographs(&mut self, console: &Console) -> anyhow::Result<()> {
        if let Some(known) = prepare::grow_on(&self.input, &mut self.settings) {
            console.say(format_args!(
                "depths are known of {} of the pixels only: splats grow for longer, and from lower gradients (--grow-on)",
                percent(known, 0)
            ));
        }
        if let Some([half, quarter]) = prepare::coarse_by_spectra(&self.input, &mut self.settings)? {
            console.say(format_args!(
                "photographs of half the size keep {} of the spectrum's amplitude, of a quarter {}: reduced ones in the first \
                 {} of the steps",
                percent(half, 0),
                percent(quarter, 0),
                percent(self.settings.frequencies.coarse_steps, 0)
            ));
        }
        Ok(())
    }

    /// Whether the first splats come of the dataset's points, and of what stereo adds.
    pub(super) fn is_from_points(&self) -> bool {
        self.settings.run.init.is_none() && self.restart.is_none()
    }

    /// Number of splats that it begins or goes on with.
    pub(super) fn splats(&self) -> u32 {
        self.restart.as_ref().map_or(self.input.initial.len() as u32, |restart| restart.state.splats())
    }
}

/// How the training shares the host's memory.
fn host_plan(gpu: &Gpu, dataset: &Dataset, settings: &Settings, splats: u32) -> anyhow::Result<HostPlan> {
    let memory = HostMemory::new(settings.host.host_memory.map(|bytes| bytes.0));
    let (outline, variants) = (prepare::outline(dataset), chosen_variants(gpu, settings)?);
    let plan = MemoryPlan::of(gpu, &outline, settings, variants, Pacing::default(), splats)?;
    Ok(HostPlan::new(gpu, memory, dataset, &outline, &plan, settings))
}

/// Chooses the forms of the passes and puts them into the settings where a repetition needs them: where they belong to equal
/// bits, and where they were chosen by timing.
fn choose_forms(gpu: &Gpu, input: &Input, settings: &mut Settings, console: &Console) -> anyhow::Result<()> {
    let tuned = tune::tuned(gpu, input, settings, device::cache_folder().as_deref())?;
    if let Some(warning) = &tuned.warning {
        console.warn(warning);
    }
    let by_capability = matches!(tuned.why, tune::Why::Capability(_));
    if by_capability {
        console.detail(&tuned)
    } else {
        console.say(&tuned)
    }
    if settings.run.deterministic || !by_capability {
        settings.blending.tile_shape = Some(tuned.variants.tile);
        settings.stepping.gradient_sum = Some(tuned.variants.gradients);
        settings.stepping.backward = Some(tuned.variants.backward);
        settings.blending.culling = Some(tuned.variants.culling);
    }
    Ok(())
}
