//! What stereo and a cloud say of the views of a training.

use std::sync::Arc;

use super::spread;
use super::stereo_cost::{leave_out_texture, stereo_settings};
use crate::dataset::{Dataset, HostShare, Role};
use crate::format::LeftOut;
use crate::scene::{Camera, Frame, Gaussians, init};
use crate::stereo::{
    self, FusedPoint, Matcher, Observations, Pending, Prior, Scene, Skipped, SkirtPoint, WithoutDepth, fuse,
};
use crate::train::Error;
use crate::train::cloud::{self, ProximityIndex};
use crate::train::input::{self, Input, Outline};
use crate::train::memory::MemoryPlan;
use crate::train::pacing::Pacing;
use crate::train::settings::{DepthPrior, Geometry, LidarCloud, Settings};
use crate::train::tune::chosen_variants;
use crate::vk::Gpu;

/// Standard deviation of a splat of a skirt, as a share of the distance to its neighbours: so that they cover what is between them.
const SKIRT_WIDTH: f64 = 0.75;
const SKIRT_OPACITY: f64 = 0.9;

/// What was found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StereoReport {
    /// Views of which something is known, or will be where depths are propagated.
    pub views: usize,
    /// Share of their pixels that have a depth.
    pub share: f64,
    /// Pixels on the longer side of the photographs as they were matched, where `--stereo-share` made these smaller than `--stereo-side`.
    pub reduced_to: Option<u32>,
    /// Area of the surfaces of which depths are known, in units of a photograph (see [`stereo::surface`]), where the number of splats goes by it.
    pub surface: Option<f64>,
    /// Splats that the model begins with besides those of the reconstructed points.
    pub splats: usize,
    /// Views of which nothing is known, by their positions among those that are trained on.
    pub skipped: Vec<Skipped>,
    /// The cloud that growth keeps to.
    pub cloud: Option<CloudReport>,
    /// Points that were left out of the file of the cloud.
    pub left_out: Option<LeftOut>,
}

/// A cloud that growth keeps to.
#[derive(Clone, Debug, PartialEq)]
pub struct CloudReport {
    /// Its points.
    pub points: usize,
    /// How near splats have to be, in the dataset's units.
    pub within: f64,
    /// Share of the splats to begin with that are.
    pub near: f64,
}

/// Fills in the depths and normals that the settings ask for, splats on them, up to half of those there may be, and the cloud that growth keeps
/// to. The same for the same photographs, on the same device. `dataset` is that of the input. Photographs that are not kept decoded are
/// decoded in turns, as `share` has room for them. `begins` is false where the model comes from elsewhere.
pub fn compute_stereo_priors(
    gpu: &Gpu,
    dataset: &Dataset,
    input: &mut Input,
    training: &Settings,
    share: &HostShare,
    begins: bool,
) -> Result<StereoReport, Error> {
    let settings = &training.geometry;
    let mut report = StereoReport::default();
    // What is wrong with a file is told before stereo takes its time.
    let mut cloud = match &training.density.lidar {
        Some(LidarCloud::File(file)) => {
            let (positions, left_out) = cloud::read_with(file, training.photographs.strict)?;
            report.left_out = left_out;
            Some(cloud::place(file, positions, dataset)?)
        }
        _ => None,
    };
    let made = training.density.lidar == Some(LidarCloud::Mvs);
    let mut wanted = settings.stereo();
    let matched = match settings.depth_prior == DepthPrior::Stereo || made {
        true => {
            let whole = sizes(input).map(|(width, height)| width.max(height)).max().unwrap_or(0).min(wanted.max_side);
            wanted = stereo_settings(training, sizes(input));
            report.reduced_to = (wanted.max_side < whole).then_some(wanted.max_side);
            Some(Stereo::matched(gpu, dataset, input, training, &wanted, share)?)
        }
        false => None,
    };
    if let Some(stereo) = &matched {
        let more = match begins && settings.begins_on_surfaces() {
            true => more_on_surfaces(gpu, input, training, stereo, &mut report)?,
            false => 0,
        };
        if made || more > 0 {
            let mut fused = fuse(&stereo.scene.views, &stereo.priors, &wanted);
            if settings.stereo_alone > 0 {
                fused.extend(stereo::extend(&stereo.scene.views, &stereo.priors, settings.stereo_alone as usize));
            }
            if more > 0 {
                report.splats = begin_on(&fused, more, training, dataset, input)?;
            }
            if made {
                cloud = Some(fused.iter().map(|p| p.position).collect());
            }
        }
    }
    if let Some(Stereo { scene, priors }) = matched.as_ref().filter(|_| settings.stereo_skirt > 0.0) {
        let points = stereo::skirt(&scene.views, priors, settings.stereo_skirt);
        input.optional.skirt = skirt_splats(&points, settings.stereo_thickness)?.map(Arc::new);
    }
    let stereo = matched.is_some();
    let matched_alone = matched.as_ref().map(|stereo| stereo.scene.skipped.clone());
    let priors = priors_of(settings, input, matched, cloud.as_deref());
    if let Some(cloud) = &cloud {
        report.cloud = Some(keep_growth_to(cloud, dataset, input, training)?);
    }
    report.views = priors.iter().filter(|prior| is_known(prior)).count();
    report.share = priors.iter().map(Prior::share).sum::<f64>() / report.views.max(1) as f64;
    let alone = matched_alone.unwrap_or_default();
    let otherwise = if stereo { WithoutDepth::NoAgreement } else { WithoutDepth::NothingInView };
    report.skipped = without_depth(input, &priors, &alone, otherwise);
    if settings.depth_prior == DepthPrior::Propagation {
        let scene = scene(dataset, input, &wanted, share)?;
        report.views = scene.views.len() - scene.skipped.len();
        report.skipped = scene.skipped.clone();
        input.optional.scene = Some(Arc::new(scene));
    }
    let kept = priors.into_iter().zip(&input.train).map(|(prior, view)| {
        let (width, height) = settings.prior_size(view.camera.width, view.camera.height);
        is_known(&prior).then(|| prior.at_size(width, height))
    });
    input.optional.priors = kept.collect();
    Ok(report)
}

/// How many splats to add on the surfaces that stereo has found.
fn more_on_surfaces(
    gpu: &Gpu,
    input: &Input,
    training: &Settings,
    found: &Stereo,
    report: &mut StereoReport,
) -> Result<usize, Error> {
    let points = input.initial.len() as u32;
    let measured = training.geometry.stereo_density > 0;
    report.surface = measured.then(|| stereo::surface(&found.scene.views, &found.priors));
    let variants = chosen_variants(gpu, training)?;
    let fit = MemoryPlan::new(gpu, input, training, variants, Pacing::default(), points)?.most_splats.0;
    let side = longer_side(sizes(input));
    Ok(splats_on_surfaces(points, report.surface.unwrap_or(0.0), side, fit, training) as usize)
}

/// Depths and normals of the views to train with, from what stereo has found, or else from the cloud.
fn priors_of(settings: &Geometry, input: &Input, found: Option<Stereo>, cloud: Option<&[[f64; 3]]>) -> Vec<Prior> {
    match (settings.depth_prior, found, cloud) {
        (DepthPrior::None | DepthPrior::Propagation, ..) => Vec::new(),
        (DepthPrior::Lidar, None, Some(cloud)) => {
            let reduced = |c: &Camera| {
                let (width, height) = settings.prior_size(c.width, c.height);
                c.resized(width, height)
            };
            cloud::maps(&input.train.iter().map(|view| reduced(&view.camera)).collect::<Vec<_>>(), cloud)
        }
        (DepthPrior::Stereo | DepthPrior::Lidar, found, _) => found.map(|stereo| stereo.priors).unwrap_or_default(),
    }
}

/// Has growth keep to a cloud.
fn keep_growth_to(
    cloud: &[[f64; 3]],
    dataset: &Dataset,
    input: &mut Input,
    training: &Settings,
) -> Result<CloudReport, Error> {
    let within = training.density.lidar_distance * f64::from(input.extent);
    let gate = ProximityIndex::new(cloud, within).ok_or(Error::NoCloud)?;
    let near = gate.near(&input.initial.means);
    input.optional.gate = Some(Arc::new(gate));
    Ok(CloudReport {
        points: cloud.len(),
        within: within / dataset.frame.scale,
        near: near.iter().filter(|n| **n).count() as f64 / near.len().max(1) as f64,
    })
}

/// The views without a depth: those that stereo has left out, with its reason, and the others with this one.
fn without_depth(input: &Input, priors: &[Prior], left_out: &[Skipped], otherwise: WithoutDepth) -> Vec<Skipped> {
    let unknown = input.train.iter().zip(priors).enumerate().filter(|(_, (_, prior))| !is_known(prior));
    let named = |(view, (of, _)): (usize, (&input::View, _))| {
        let why = left_out.iter().find(|skipped| skipped.view == view).map_or(otherwise, |skipped| skipped.why);
        Skipped { view, name: of.name.clone(), why }
    };
    unknown.map(named).collect()
}

/// Whether a view has any depth.
fn is_known(prior: &Prior) -> bool {
    prior.depth.iter().any(|d| *d > 0.0)
}

/// Sizes of the photographs that are trained on.
fn sizes(input: &Input) -> impl Iterator<Item = (u32, u32)> {
    input.train.iter().map(|view| (view.camera.width, view.camera.height))
}

/// Under `--max-splats`, the share of it that reconstructed points leave to splats on surfaces, if they have to.
const SURFACES_UNDER_A_LIMIT: f64 = 0.5;

/// The most splats that stereo adds on a [`stereo::surface`] to `points` before the first step. `side` is the [`longer_side`] of the
/// photographs. Where their size or the surface asks for many, room is left to grow among the splats that `fit` into memory.
///
/// `--max-splats` leaves no such room where the lightest splats give theirs to growth (`--recycle-share`): those that begin where the
/// surface is are worth more than what would grow in their place. Points go first where both are too many.
pub fn splats_on_surfaces(points: u32, surface: f64, side: f64, fit: u32, settings: &Settings) -> u32 {
    let geometry = &settings.geometry;
    let times = |count: u32, factor: f64| (f64::from(count) * factor).round() as u32;
    let larger = match geometry.stereo_splats_for {
        0 => 1.0,
        reference => (side / f64::from(reference)).min(learned_in(settings.run.iterations)).max(1.0),
    };
    let at_least = |factor: f64| {
        let densest = match geometry.stereo_densest {
            0 => u32::MAX,
            densest => times(densest, surface * factor),
        };
        times(geometry.stereo_splats, factor).min(densest)
    };
    let asked = at_least(larger).max(times(geometry.stereo_density, surface * larger));
    let wanted = asked.min(at_least(1.0).max((fit / 2).saturating_sub(points)));
    let room = settings.density.max_splats.map_or(u32::MAX, |most| match settings.density.recycle_share > 0.0 {
        true => most.saturating_sub(points).max((SURFACES_UNDER_A_LIMIT * f64::from(most)) as u32),
        false => (most / 2).saturating_sub(points),
    });
    wanted.min(room)
}

/// How many times the splats of a training of 1,750 steps one of so many may begin with. What other methods grow is the fewer the shorter
/// they train, at any size of the photographs, and surfaces are to begin with less than that.
fn learned_in(steps: u32) -> f64 {
    (f64::from(steps) / 1750.0).sqrt()
}

/// Pixels on the longer side of photographs of these sizes, in the mean.
pub fn longer_side(photographs: impl IntoIterator<Item = (u32, u32)>) -> f64 {
    let (mut views, mut pixels) = (0_u32, 0.0);
    for (width, height) in photographs {
        views += 1;
        pixels += f64::from(width.max(height));
    }
    pixels / f64::from(views.max(1))
}

/// What the training views see, and which of them can be compared.
fn scene(dataset: &Dataset, input: &Input, wanted: &stereo::Settings, share: &HostShare) -> Result<Scene, Error> {
    let seen = observations(dataset, input, wanted);
    let bytes = |view: &input::View| {
        view.photograph.decoding_bytes() + Outline::bytes(&[(view.camera, view.photograph.depth())])
    };
    let pending: Vec<Pending<'_>> =
        input.train.iter().map(|view| Pending { name: &view.name, camera: view.camera, bytes: bytes(view) }).collect();
    Ok(Scene::new(&pending, &seen, wanted, share, |k| input.train[k].photograph.pixels())?)
}

fn observations(dataset: &Dataset, input: &Input, wanted: &stereo::Settings) -> Observations {
    let index = |name: &str| dataset.views_of(Role::Train).find(|(_, view)| view.name == name).map(|(i, _)| i);
    let chosen: Vec<usize> = input.train.iter().filter_map(|view| index(&view.name)).collect();
    Observations::of(dataset, &chosen, wanted.seed.into())
}

/// The views and what stereo found of them.
struct Stereo {
    scene: Scene,
    priors: Vec<Prior>,
}

impl Stereo {
    fn matched(
        gpu: &Gpu,
        dataset: &Dataset,
        input: &Input,
        training: &Settings,
        wanted: &stereo::Settings,
        share: &HostShare,
    ) -> Result<Self, Error> {
        let mut scene = scene(dataset, input, wanted, share)?;
        leave_out_texture(&mut scene, training)?;
        let priors = Matcher::new(gpu, wanted)?.run(&scene.views, |_| ())?;
        Ok(Self { scene, priors })
    }
}

/// Adds `more` splats on surfaces, or as many as there are points, to those that a model begins with, as wide, flat and opaque as is
/// asked for; gives how many. With them there are no more than `--max-splats`.
fn begin_on(
    fused: &[FusedPoint],
    more: usize,
    settings: &Settings,
    dataset: &Dataset,
    input: &mut Input,
) -> Result<usize, Error> {
    let chosen = spread(fused, more);
    if chosen.is_empty() {
        return Ok(0);
    }
    let room = settings.density.max_splats.map_or(usize::MAX, |most| most as usize).saturating_sub(chosen.len());
    let kept = spread(dataset.usable_points(), room);
    // Points without colours of their own have been given some.
    let painted = input.optional.coloured.as_ref().map(|coloured| spread(&coloured.colours, room));
    let colour = |k: usize| painted.as_ref().and_then(|all| all.get(k)).map_or(kept[k].colour, |colour| **colour);
    let reconstructed = kept.iter().enumerate().map(|(k, p)| (p.position, colour(k)));
    let found = chosen.iter().map(|p| (dataset.frame.to_dataset(p.position), p.colour));
    input.initial = init::from_points(&reconstructed.chain(found).collect::<Vec<_>>(), &dataset.frame)?;
    let normals: Vec<[f32; 3]> = chosen.iter().map(|p| p.normal).collect();
    let geometry = &settings.geometry;
    init::lay_flat(&mut input.initial, kept.len(), &normals, geometry.stereo_thickness);
    init::widen(&mut input.initial, kept.len(), geometry.stereo_width);
    init::make_opaque(&mut input.initial, kept.len(), geometry.stereo_opacity);
    Ok(chosen.len())
}

/// Splats that cover what lies between points of a skirt.
fn skirt_splats(points: &[SkirtPoint], thickness: f64) -> Result<Option<Gaussians>, Error> {
    if points.is_empty() {
        return Ok(None);
    }
    let coloured: Vec<_> = points.iter().map(|p| (p.point.position, p.point.colour)).collect();
    let normals: Vec<[f32; 3]> = points.iter().map(|p| p.point.normal).collect();
    let mut out = init::from_points(&coloured, &Frame::IDENTITY)?;
    for (scales, point) in out.scales.chunks_exact_mut(3).zip(points) {
        scales.fill((SKIRT_WIDTH * point.spacing).ln() as f32);
    }
    init::lay_flat(&mut out, 0, &normals, thickness);
    init::make_opaque(&mut out, 0, SKIRT_OPACITY);
    Ok(Some(out))
}
