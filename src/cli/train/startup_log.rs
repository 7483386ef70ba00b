//! Messages before the first step of a training.

use psrgs_vk::dataset::{Dataset, Role};
use psrgs_vk::numbers::{counted, grouped, percent};
use psrgs_vk::raster::Variants;
use psrgs_vk::train::prepare::{Setup, SetupEvent};
use psrgs_vk::train::settings::DepthPrior;
use psrgs_vk::train::{Estimate, Input, MemoryPlan, Settings, StereoReport, chosen_variants, prepare};
use psrgs_vk::vk::Gpu;

use crate::cli::console::Console;
use crate::cli::progress::duration;
use crate::cli::stereo::without_depth;

/// From this number of steps on, a few extra steps are timed before the training to estimate its time.
const WORTH_TIMING: u32 = 1000;

/// Below this share of first splats near the cloud, the cloud may be shifted.
const FEW_NEAR: f64 = 0.1;

/// Prints the contents of the dataset, and its warnings.
pub(super) fn dataset(dataset: &Dataset, console: &Console) {
    let count = |role| dataset.views_of(role).count();
    let size = dataset.views.first().map_or((0, 0), |v| (v.camera.width, v.camera.height));
    let images = dataset.images.as_ref().map(|f| f.path.display().to_string()).unwrap_or_default();
    console.say(format_args!(
        "{}: {} dataset, {} to train on, {} held out, {}x{} from {images}, {}",
        dataset.path.display(),
        dataset.format,
        counted(count(Role::Train), "photograph"),
        grouped(count(Role::HeldOut)),
        size.0,
        size.1,
        counted(dataset.points.len(), "point"),
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

/// Prints an event of the setup.
pub(super) fn event(event: &SetupEvent<'_>, console: &Console) {
    match event {
        SetupEvent::ModelLeftOut(left_out) => console.warn(left_out),
        SetupEvent::HostMemory(plan) => console.say(plan),
        SetupEvent::PhotographLeftOut(warning) => console.warn(warning),
        SetupEvent::StepsChosen(chosen) => console.say(chosen),
        SetupEvent::NoPerceptualWeights => console.warn(
            "the perceptual loss compares by oriented filters, for want of a network's weights: --perceptual-weights \
             names them (`psrgs-vk weights` says where to get them), --lambda-perceptual 0 leaves it out",
        ),
        SetupEvent::StereoBegins { photographs } => {
            console.say(format_args!("looking for depths in {}", counted(*photographs, "photograph")));
        }
        SetupEvent::Depths { found, settings, photographs } => depths(found, settings, *photographs, console),
        SetupEvent::ExposuresDecided(evidence) => console.say(evidence),
        SetupEvent::GrowthLimited { most } => {
            console.detail(format_args!("growth ends at {} (growth-room)", counted(*most, "splat")));
        }
        SetupEvent::Variants(tuned) => {
            tuned.warning.iter().for_each(|warning| console.warn(warning));
            if tuned.is_by_capability() {
                console.detail(tuned);
            } else {
                console.say(tuned);
            }
        }
    }
}

/// Prints which depths the training uses.
fn depths(found: &StereoReport, settings: &Settings, views: usize, console: &Console) {
    let prior = settings.geometry.depth_prior;
    found.left_out.iter().for_each(|left_out| console.warn(left_out));
    if let (Some(cloud), Some(lidar)) = (&found.cloud, &settings.density.lidar) {
        console.say(format_args!(
            "cloud from {lidar}: {}; splats grow within {:.3} of it, as {} of the first ones are",
            counted(cloud.points, "point"),
            cloud.within,
            percent(cloud.near, 1)
        ));
        if cloud.near < FEW_NEAR {
            console.warn(format_args!(
                "few of the first splats are near the cloud: a shift against the cameras (of heights, say) would show \
                 so; `lidar-distance` widens what counts as near"
            ));
        }
    }
    if found.contradicted > 0 {
        console.say(format_args!(
            "stereo: {} left out, where most photographs see another surface",
            counted(found.contradicted, "point")
        ));
    }
    if prior == DepthPrior::None {
        if found.splats > 0 {
            console.say(format_args!("stereo: {} on surfaces to begin with", counted(found.splats, "splat")));
        }
        return;
    }
    let splats = match found.splats {
        0 => String::new(),
        n => format!("; {} on surfaces to begin with", counted(n, "splat")),
    };
    let views = counted(views, "photograph");
    let smaller =
        found.reduced_to.map_or(String::new(), |side| format!(" at {side} pixels, which fits `stereo-share`"));
    if prior == DepthPrior::Propagation {
        console.say(format_args!("depths are propagated in {} of {views} while training", found.views));
    } else {
        console.say(format_args!(
            "depths from {prior}: {} of {views}{smaller}, {} of their pixels{splats}",
            grouped(found.views),
            percent(found.share, 1)
        ));
    }
    without_depth(&found.skipped, console);
}

/// Prints the method and the first splats of the training.
pub(super) fn setup(setup: &Setup, dataset: &Dataset, console: &Console) {
    let (settings, input) = (&setup.settings, &setup.input);
    for (role, views) in [(Role::Train, &input.train), (Role::HeldOut, &input.held_out)] {
        let told = prepare::left_out_besides(dataset, role, views, &input.optional.left_out);
        told.iter().for_each(|warning| console.warn(warning));
    }
    console.say(format_args!(
        "{}, {}, seed {}, {} to begin with",
        settings.method_name(),
        counted(settings.run.iterations, "step"),
        settings.run.seed,
        counted(setup.splats(), "splat"),
    ));
    if setup.restart.is_none() {
        first_splats(setup, dataset, console);
    }
}

/// Prints notes about the first splats of a training that is not resumed.
fn first_splats(setup: &Setup, dataset: &Dataset, console: &Console) {
    let (settings, input) = (&setup.settings, &setup.input);
    if let Some(coloured) = &input.optional.coloured {
        // The message about the dataset's points says so already.
        if !coloured.of_dataset {
            console.warn(&coloured.colourless);
        }
        console.say(format_args!(
            "{} of {} with the colours of photographs that see them",
            grouped(coloured.seen),
            counted(coloured.points, "point")
        ));
    }
    if !input.sees_any() {
        console.warn(
            "no camera sees a splat to begin with: the points, or the model of --init, must be in the coordinates of \
             the dataset's cameras",
        );
    }
    if let Some(most) = settings.density.max_splats.filter(|most| input.initial.len() > *most as usize) {
        console.warn(format_args!(
            "--max-splats {most}: the model of --init has {}, all of which stay; none are added",
            counted(input.initial.len(), "splat")
        ));
    }
    let points = input.initial.len().saturating_sub(setup.depths.splats);
    let usable = dataset.usable_points().len().saturating_sub(setup.depths.contradicted);
    if setup.is_from_points() && points < usable {
        console.say(format_args!(
            "of {} {} are taken, evenly, for the sake of `max-splats`",
            counted(usable, "point"),
            grouped(points)
        ));
    }
}

/// Prints the device memory and the time that the training takes.
pub(super) fn demands(setup: &Setup, gpu: &Gpu, console: &Console) -> anyhow::Result<()> {
    let Setup { settings, input, host, restart, .. } = setup;
    let variants = match restart {
        Some(restart) => restart.variants,
        None => chosen_variants(gpu, settings)?,
    };
    console.say(MemoryPlan::new(gpu, input, settings, variants, host.pacing, setup.splats())?);
    // The first splats are timed. Their time says nothing about a resumed model that has grown.
    if restart.is_none() && settings.run.iterations >= WORTH_TIMING {
        estimate(gpu, input, settings, variants, console);
    }
    Ok(())
}

/// Prints an estimate of the training time. A failed estimate is ignored.
fn estimate(gpu: &Gpu, input: &Input, settings: &Settings, variants: Variants, console: &Console) {
    if let Ok(Some(estimate)) = Estimate::measure(gpu, input, settings, variants) {
        let seconds = estimate.seconds(settings.run.iterations);
        console.say(format_args!("time: about {}: {estimate}", duration(seconds)));
    }
}
