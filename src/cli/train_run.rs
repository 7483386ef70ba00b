//! A training from the open run folder to the last file, with what is told on the way.

use std::path::Path;
use std::time::Instant;

use anyhow::Context as _;
use indicatif::HumanCount;
use psrgs_vk::dataset::{Dataset, Role};
use psrgs_vk::format::checkpoint;
use psrgs_vk::raster::Variants;
use psrgs_vk::train::settings::DepthPrior;
use psrgs_vk::train::{
    Checkpointed, Estimate, HostMemory, HostPlan, Input, MemoryPlan, Message, Pacing, Schedule, Settings, StereoReport,
    Trainer, chosen_variants, prepare, take_stereo, tune,
};
use psrgs_vk::vk::Gpu;

use super::console::Console;
use super::device;
use super::exit::Failure;
use super::interrupt::Interrupt;
use super::lpips::Lpips;
use super::outputs::{self, Finished};
use super::progress::{Progress, duration};
use super::run_folder::{self, RunFolder};
use super::train::Plan;

/// Steps of a training from which on a few more are taken before it to tell its time.
const WORTH_TIMING: u32 = 1000;

/// Share of the first splats near a cloud below which it may be shifted.
const FEW_NEAR: f64 = 0.1;

/// Trains as planned; the process is counted from `started`.
pub(crate) fn train(plan: &Plan, console: &Console, started: Instant) -> anyhow::Result<()> {
    let interrupt = Interrupt::listen()?;
    let settings = &plan.settings;
    let data = settings.data.as_deref().context("no dataset")?;
    if let Some(preset) = &plan.preset {
        console.say(preset);
    }
    let options = prepare::load_options(&settings.photographs, settings.model.background.evaluated());
    let dataset = Dataset::load(data, &options).map_err(|error| match plan.resume {
        true => run_folder::with_way_back(&plan.out, error.into()),
        false => error.into(),
    })?;
    // Not before: a wrong name of the dataset leaves no folder behind.
    let folder = RunFolder::open(plan)?;
    tell(&dataset, console);
    let mut lpips = Lpips::find(&settings.scoring, console)?;
    let before = if plan.resume { resumed(&folder, console)? } else { None };
    if let Some(before) = &before {
        fits_what_is_done(settings, plan.former, before.restart.step)?;
    }
    let gpu = device::open(&settings.device, false, console)?;
    let mut settings = settings.clone();
    let initial = prepare::initial(&dataset, &settings)?;
    let splats = before.as_ref().map_or(initial.len() as u32, |b| b.restart.state.splats());
    let host = host_plan(&gpu, &dataset, &settings, splats)?;
    console.say(host);
    let mut input = prepare::input_within(&dataset, initial, host.share)?;
    if input.train.is_empty() && dataset.views_of(Role::Train).next().is_some() {
        return Err(all_masked(data).into());
    }
    input.known.perceptual = lpips.weights();
    if settings.texture.lambda_perceptual > 0.0 && input.known.perceptual.is_none() {
        console.warn(
            "the perceptual loss compares by oriented filters, for want of a network's weights: --perceptual-weights names them \
             (`psrgs-vk weights` says where to get them), --lambda-perceptual 0 leaves it out",
        );
    }
    let begins = settings.run.init.is_none() && before.is_none();
    let before_stereo = Instant::now();
    if settings.geometry.depth_prior == DepthPrior::Stereo {
        console.say(format_args!("looking for depths in {} photographs", input.train.len()));
    }
    let found = take_stereo(&gpu, &dataset, &mut input, &settings, &host.share, begins)?;
    let stereo_seconds = if found.views > 0 { before_stereo.elapsed().as_secs_f64() } else { 0.0 };
    tell_stereo(&found, &settings, input.train.len(), console);
    if before.is_none() {
        if let Some(known) = prepare::grow_on(&input, &mut settings) {
            console.say(format_args!(
                "depths are known of {:.0} % of the pixels only: splats grow for longer, and from lower gradients (--grow-on)",
                100.0 * known
            ));
        }
        let coarse = prepare::coarse_by_spectra(&input, &mut settings)?;
        if let Some([half, quarter]) = coarse {
            console.say(format_args!(
                "photographs of half the size keep {:.0} % of the spectrum's amplitude, of a quarter {:.0} %: reduced ones in the first \
                 {:.0} % of the steps",
                100.0 * half,
                100.0 * quarter,
                100.0 * settings.frequencies.coarse_steps
            ));
        }
        choose_forms(&gpu, &input, &mut settings, console)?;
    }
    let settings = &settings;
    for (role, views) in [(Role::Train, &input.train), (Role::HeldOut, &input.held_out)] {
        prepare::left_out(&dataset, role, views).iter().for_each(|warning| console.warn(warning));
    }
    console.say(format_args!(
        "{}, {} steps, seed {}, {} splats to begin with",
        settings.method_name(),
        HumanCount(settings.run.iterations.into()),
        settings.run.seed,
        HumanCount(before.as_ref().map_or(input.initial.len(), |b| b.restart.state.ids.len()) as u64),
    ));
    if before.is_none() && !input.sees_any() {
        console.warn(
            "no camera sees a splat to begin with: the points, or the model of --init, must be in the coordinates of the dataset's cameras",
        );
    }
    if let Some(most) =
        settings.density.max_splats.filter(|most| before.is_none() && input.initial.len() > *most as usize)
    {
        console.warn(format_args!(
            "--max-splats {most}: the model of --init has {} splats, which stay; none are added",
            HumanCount(input.initial.len() as u64)
        ));
    }
    let points = input.initial.len().saturating_sub(found.splats);
    if begins && points < dataset.points.len() {
        console.say(format_args!(
            "of {} points {} are taken, evenly, for the sake of --max-splats",
            HumanCount(dataset.points.len() as u64),
            HumanCount(points as u64)
        ));
    }
    let restart = before.map(|b| b.restart);
    let variants = match &restart {
        Some(restart) => restart.variants,
        None => chosen_variants(&gpu, settings)?,
    };
    let splats = restart.as_ref().map_or(input.initial.len() as u32, |r| r.state.splats());
    console.say(MemoryPlan::new(&gpu, &input, settings, variants, host.pacing, splats)?);
    let done = restart.as_ref().map_or(0, |r| r.step);
    // Timed with the splats to begin with: of a model that has grown it says nothing.
    if restart.is_none() && settings.run.iterations >= WORTH_TIMING {
        estimate(&gpu, &input, settings, variants, console);
    }
    let earlier_seconds = restart.as_ref().map_or(0.0, |r| r.seconds);
    let mut trainer = Trainer::new(&gpu, input, settings, host.pacing, restart)?;
    interrupt.work_begins();
    folder.begin(settings)?;
    trainer.keep_checkpoints(&folder.checkpoints());
    let mut to_the_end = || {
        let training_seconds = follow(&mut trainer, plan, &gpu, console, &interrupt, done)?;
        if let Some(streaming) = trainer.streaming() {
            console.detail(format_args!("photographs: {streaming}"));
        }
        let finished = Finished {
            plan,
            folder: &folder,
            dataset: &dataset,
            gpu: &gpu,
            started,
            training_seconds,
            earlier_seconds,
            stereo_seconds,
        };
        outputs::write(&finished, &mut trainer, &mut lpips, console)
    };
    to_the_end().map_err(|error| folder.with_way_on(error))
}

/// That a dataset has no pixel to train on.
pub(crate) fn all_masked(data: &Path) -> Failure {
    Failure::Input(format!(
        "{}: every photograph to train on is masked all over, by its mask or by its transparency (--mask-ignores says which colour of a mask \
         leaves out, --transparent what transparent pixels are)",
        data.display()
    ))
}

/// Tells the time that the training takes, as far as it can be told before it begins. That it cannot does no harm.
fn estimate(gpu: &Gpu, input: &Input, settings: &Settings, variants: Variants, console: &Console) {
    if let Ok(Some(estimate)) = Estimate::measure(gpu, input, settings, variants) {
        let seconds = estimate.seconds(settings.run.iterations);
        console.say(format_args!("time: about {}: {estimate}", duration(seconds)));
    }
}

/// How the training shares the host's memory.
pub(crate) fn host_plan(gpu: &Gpu, dataset: &Dataset, settings: &Settings, splats: u32) -> anyhow::Result<HostPlan> {
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

/// What depths there are to train with.
fn tell_stereo(found: &StereoReport, settings: &Settings, views: usize, console: &Console) {
    let prior = settings.geometry.depth_prior;
    if let (Some(cloud), Some(lidar)) = (&found.cloud, &settings.density.lidar) {
        console.say(format_args!(
            "cloud from {lidar}: {} points; splats grow within {:.3} of it, as {:.1} % of the first ones are",
            HumanCount(cloud.points as u64),
            cloud.within,
            100.0 * cloud.near
        ));
        if cloud.near < FEW_NEAR {
            console.warn(format_args!(
                "few of the first splats are near the cloud: a shift against the cameras (of heights, say) would show so; \
                 --lidar-distance widens what counts as near"
            ));
        }
    }
    if prior == DepthPrior::None {
        return;
    }
    let splats = match found.splats {
        0 => String::new(),
        n => format!("; {} splats more to begin with", HumanCount(n as u64)),
    };
    let splats = match found.surface {
        Some(surface) => format!("; their surfaces would fill {surface:.1} photographs{splats}"),
        None => splats,
    };
    let smaller =
        found.reduced_to.map_or(String::new(), |side| format!(" at {side} pixels, which fits --stereo-share"));
    if prior == DepthPrior::Propagation {
        console.say(format_args!("depths are propagated in {} of {views} photographs while training", found.views));
    } else {
        console.say(format_args!(
            "depths from {prior}: {} of {views} photographs{smaller}, {:.1} % of their pixels{splats}",
            found.views,
            100.0 * found.share
        ));
    }
    if let [first, rest @ ..] = found.skipped.as_slice() {
        let more = if rest.is_empty() { String::new() } else { format!(" and {} more", rest.len()) };
        console.warn(format_args!(
            "no depth is known of '{first}'{more}: no other photograph sees enough of the same from another place"
        ));
    }
}

/// What the dataset holds, and its warnings.
fn tell(dataset: &Dataset, console: &Console) {
    let count = |role| dataset.views_of(role).count();
    let size = dataset.views.first().map_or((0, 0), |v| (v.camera.width, v.camera.height));
    let images = dataset.images.as_ref().map(|f| f.path.display().to_string()).unwrap_or_default();
    console.say(format_args!(
        "{}: {} dataset, {} photographs to train on, {} held out, {}x{} from {images}, {} points",
        dataset.path.display(),
        dataset.format,
        count(Role::Train),
        count(Role::HeldOut),
        size.0,
        size.1,
        HumanCount(dataset.points.len() as u64),
    ));
    if let Some(masks) = &dataset.masks {
        console.say(format_args!("masks: {} of {} (from {})", masks.matched, masks.of, masks.place.display()));
    }
    for line in dataset.deep_photographs() {
        console.say(line);
    }
    for problem in dataset.problems(&dataset.sights()) {
        console.warn(problem);
    }
}

fn resumed(folder: &RunFolder, console: &Console) -> anyhow::Result<Option<Checkpointed>> {
    let Some(latest) = checkpoint::latest(&folder.checkpoints())? else {
        console.warn("there is no checkpoint yet: starting from the beginning");
        return Ok(None);
    };
    for problem in &latest.damaged {
        console.warn(problem);
    }
    let found = Checkpointed::from_checkpoint(&latest.checkpoint)
        .with_context(|| Failure::Input(latest.file.display().to_string()))?;
    console.say(format_args!("going on after step {} of {}", found.restart.step, latest.file.display()));
    Ok(Some(found))
}

/// Another number of steps is one that the run has not passed yet, and in which no stage that is over begins again.
fn fits_what_is_done(settings: &Settings, former: Option<u32>, step: u32) -> anyhow::Result<()> {
    let iterations = settings.run.iterations;
    let wrong = |problem: String| Err(Failure::Usage(format!("--iterations {iterations}: {problem}")).into());
    if step > iterations {
        return wrong(format!("the run is at step {step} already; give at least that many"));
    }
    match former.and_then(|former| Schedule::begins_again(settings, former, step)) {
        Some(stage) => wrong(format!(
            "the run is at step {step}, and a stage that is over ({stage}) would begin again, as it is a share of all steps; give fewer, \
             or train anew from its model with --init"
        )),
        None => Ok(()),
    }
}

/// Pulls messages until the end; gives the seconds of training.
fn follow(
    trainer: &mut Trainer,
    plan: &Plan,
    gpu: &Gpu,
    console: &Console,
    interrupt: &Interrupt,
    done: u32,
) -> anyhow::Result<f64> {
    let run = &plan.settings.run;
    let mut progress = Progress::new(console, done, run.iterations);
    let mut seconds = 0.0;
    while let Some(message) = trainer.next_message()? {
        match message {
            Message::Step { step, loss, splats, seconds: now, .. } => {
                seconds = now;
                progress.step(step, loss, splats, now);
                if plan.lose_device_at == Some(step) {
                    gpu.pretend_lost();
                }
                if progress.wants_estimate(step) {
                    progress.estimate(step, now, gpu.memory_use().current, !run.no_densify);
                }
                if interrupt.asked() && step < run.iterations {
                    progress.finish();
                    let (step, file) = trainer.save_checkpoint()?;
                    return Err(Failure::Interrupted(format!(
                        "stopped after step {step}, saved {}; go on with: psrgs-vk train --resume {}",
                        file.display(),
                        plan.out.display()
                    ))
                    .into());
                }
            }
            Message::Density { step, cloned, split, pruned, splats } => progress
                .detail(format_args!("step {step}: {cloned} cloned, {split} split, {pruned} pruned: {splats} splats")),
            Message::Sigma { step, learned } => progress.detail(format_args!(
                "step {step}: sigma {:.2} for photograph {} (loss {:.4})",
                learned.sigma, learned.view, learned.loss
            )),
            Message::Propagated { step, added, share, splats } => progress.detail(format_args!(
                "step {step}: depths of {:.1} % of a photograph propagated, {added} splats added: {splats} splats",
                100.0 * share
            )),
            Message::Skirted { step, added, splats } => progress
                .detail(format_args!("step {step}: {added} splats added where no photograph looks: {splats} splats")),
            Message::Pruned { step, dropped, splats } => progress.detail(format_args!(
                "step {step}: {dropped} splats dropped for their weight or size: {splats} splats"
            )),
            Message::HarmonicsSettled { step, full, splats } => progress
                .detail(format_args!("step {step}: {full} of {splats} splats have spherical harmonics above degree 1")),
            Message::OpacityReset { step } => progress.detail(format_args!("step {step}: opacities reset")),
            Message::Grown { what, capacity, replay_from } => {
                progress.detail(format_args!("room for {capacity} {what}; going on from step {replay_from}"));
            }
            Message::Evaluated { step, quality, splats, .. } => {
                progress.evaluated(step, quality.psnr, quality.ssim, splats);
            }
            Message::Checkpoint { step, path } => {
                progress.detail(format_args!("step {step}: saved {}", path.display()));
            }
            Message::Warning(text) => progress.warn(text),
            Message::Finished { seconds: now, .. } => seconds = now,
        }
    }
    progress.finish();
    Ok(seconds)
}
