//! Depths, normals and first splats from stereo or a cloud.

use std::sync::Arc;

use super::shapes::{Shape, shapes};
use super::spacing::{Chosen, Densities, leave_out_texture};
use super::spread;
use super::stereo_cost::stereo_settings;
use crate::dataset::{Dataset, HostShare, Role};
use crate::format::LeftOut;
use crate::scene::{Camera, Frame, Gaussians, init};
use crate::stereo::{
    self, FusedPoint, Matcher, Observations, PendingPhotograph, Prior, Scene, SkippedView, SkirtPoint, WithoutDepth,
    fuse,
};
use crate::train::Error;
use crate::train::cloud::{self, ProximityIndex};
use crate::train::input::{self, Input, Outline};
use crate::train::memory::MemoryPlan;
use crate::train::pacing::Pacing;
use crate::train::settings::{DepthPrior, Frequencies, Geometry, LidarCloud, Settings, Spacing};
use crate::train::tune::chosen_variants;
use crate::vk::Gpu;

/// Standard deviation of a splat of a skirt over the distance to its neighbours, so that splats cover the gaps between
/// them.
const SKIRT_WIDTH: f64 = 0.75;
const SKIRT_OPACITY: f64 = 0.9;

/// Depths and splats found by stereo or in a cloud.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StereoReport {
    /// Views with depths, or views that can get depths by propagation.
    pub views: usize,
    /// Share of the pixels of those views that have a depth.
    pub share: f64,
    /// Pixels on the longer side of the matched photographs, if `stereo-share` made them smaller than `stereo-side`.
    pub reduced_to: Option<u32>,
    /// First splats on surfaces, besides those of the reconstructed points.
    pub splats: usize,
    /// Reconstructed points that are left out because most photographs see another surface there.
    pub contradicted: usize,
    /// Training views without a depth.
    pub skipped: Vec<SkippedView>,
    /// The cloud that growth keeps to.
    pub cloud: Option<CloudReport>,
    /// Points that were left out of the file of the cloud.
    pub left_out: Option<LeftOut>,
}

/// A cloud that growth keeps to.
#[derive(Clone, Debug, PartialEq)]
pub struct CloudReport {
    /// Points of the cloud.
    pub points: usize,
    /// Distance within which splats may grow, in the dataset's units.
    pub within: f64,
    /// Share of the first splats within that distance.
    pub near: f64,
}

/// Adds to `input` the depths and normals that the settings ask for, splats on surfaces, and the cloud that growth
/// keeps to. Reproducible for the same photographs on the same device. `dataset` is that of the input. Photographs that
/// are not kept decoded are decoded in turns, as many at a time as `share` has room for. `begins` is false if the model
/// comes from a file or a checkpoint; then no splats are added.
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
    // A faulty file is an error before stereo, which takes long.
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
    let starts = begins && settings.begins_on_surfaces();
    let matched = match settings.depth_prior == DepthPrior::Stereo || made || starts || settings.stereo_skirt > 0.0 {
        true => {
            let whole = sizes(input).map(|(width, height)| width.max(height)).max().unwrap_or(0).min(wanted.max_side);
            wanted = stereo_settings(training, sizes(input));
            report.reduced_to = (wanted.max_side < whole).then_some(wanted.max_side);
            Some(MatchedViews::matched(gpu, dataset, input, training, &wanted, share)?)
        }
        false => None,
    };
    if let Some(stereo) = matched.as_ref().filter(|_| made || starts) {
        let (fused, here) = of_part(stereo.fused(settings, &wanted), input);
        if starts {
            let chosen = chosen_on_surfaces(gpu, input, training, stereo, (&fused, here))?;
            let shapes = match settings.stereo_axes > 0.0 {
                true => shapes(&stereo.scene.views, &chosen)?,
                false => Vec::new(),
            };
            let agrees =
                |at: [f64; 3]| !contradicted(at, stereo.scene.views.iter().map(|v| &v.camera).zip(&stereo.priors));
            let places = || dataset.usable_points().iter().map(|p| dataset.frame.to_scene(p.position));
            let agreeing: Vec<bool> = places().map(|at| is_of_part(input, at) && agrees(at)).collect();
            let elsewhere = places().filter(|at| !is_of_part(input, *at)).count();
            report.splats = begin_on(&chosen, &shapes, &agreeing, training, dataset, input)?;
            let left_out = agreeing.iter().filter(|agrees| report.splats > 0 && !**agrees).count();
            report.contradicted = left_out.saturating_sub(elsewhere);
        }
        if made {
            cloud = Some(fused.iter().map(|p| p.position).collect());
        }
    }
    if let Some(MatchedViews { scene, priors }) = matched.as_ref().filter(|_| settings.stereo_skirt > 0.0) {
        let points = stereo::skirt(&scene.views, priors, settings.stereo_skirt);
        input.optional.skirt = skirt_splats(&points, settings.stereo_thickness)?.map(Arc::new);
    }
    let stereo = matched.is_some();
    let matched_alone = matched.as_ref().map(|stereo| stereo.scene.skipped.clone());
    let priors = priors_of(settings, input, matched, cloud.as_deref().filter(|_| !made));
    if let Some(cloud) = &cloud {
        report.cloud = Some(keep_growth_to(cloud, dataset, input, training)?);
    }
    report.views = priors.iter().filter(|prior| is_known(prior)).count();
    report.share = priors.iter().map(Prior::share).sum::<f64>() / report.views.max(1) as f64;
    let alone = matched_alone.unwrap_or_default();
    let otherwise = if stereo { WithoutDepth::NoAgreement } else { WithoutDepth::NothingInView };
    report.skipped = without_depth(input, &priors, &alone, otherwise);
    if settings.depth_prior == DepthPrior::Propagation {
        // At full size, also where stereo for the start was made cheaper: the loss takes priors of that size alone.
        let scene = scene(dataset, input, &settings.stereo(), share)?;
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

/// The points on surfaces inside of the part that is trained, and their share of all.
fn of_part(mut fused: Vec<FusedPoint>, input: &Input) -> (Vec<FusedPoint>, f64) {
    let all = fused.len().max(1) as f64;
    fused.retain(|point| is_of_part(input, point.position));
    let share = fused.len() as f64 / all;
    (fused, share)
}

fn is_of_part(input: &Input, place: [f64; 3]) -> bool {
    input.optional.part.as_ref().is_none_or(|part| part.has(place))
}

/// The points of stereo's surfaces at which splats begin. `here` is their share of all surfaces.
fn chosen_on_surfaces<'a>(
    gpu: &Gpu,
    input: &Input,
    training: &Settings,
    matched: &MatchedViews,
    (fused, here): (&'a [FusedPoint], f64),
) -> Result<Vec<Chosen<'a>>, Error> {
    let background = input.optional.part.as_ref().map_or(0, |part| part.background.len());
    let points = (input.initial.len() + background) as u32;
    let variants = chosen_variants(gpu, training)?;
    let fit = MemoryPlan::new(gpu, input, training, variants, Pacing::default(), points)?.most_splats.0;
    let MatchedViews { scene, priors } = matched;
    // The number is the same for all methods and masks.
    let (gate, sigma) = (Frequencies::default().gate, Frequencies::default().sigma);
    let densities = Densities::by_frequency(scene, training, gate, sigma)?;
    // Views see the same surface several times, and not all of their pixels become one point.
    let pixels = scene.views.iter().map(|view| view.pixels() as f64).sum::<f64>() / scene.views.len().max(1) as f64;
    let surface = stereo::surface(&scene.views, priors) * pixels * here;
    let steps = input.optional.part.as_ref().and_then(|part| part.whole_steps).unwrap_or(training.run.iterations);
    let asked = surface * densities.mean(fused) * finer(longer_side(sizes(input)), steps);
    let count = splats_on_surfaces(points, asked, fit, training) as usize;
    let spacing = match training.geometry.stereo_spacing {
        Spacing::Frequency if (training.frequencies.gate, training.frequencies.sigma) == (gate, sigma) => densities,
        Spacing::Frequency => {
            Densities::by_frequency(scene, training, training.frequencies.gate, training.frequencies.sigma)?
        }
        Spacing::Uniform => Densities::uniform(scene),
    };
    let cameras: Vec<Camera> = scene.views.iter().map(|view| view.camera).collect();
    // Where no surface is known, a point is a pixel.
    let layers = if surface > 0.0 { fused.len() as f64 / surface } else { 1.0 };
    Ok(spacing.choose(fused, &cameras, count, layers))
}

/// Depths and normals of the training views, from stereo or else from the cloud.
fn priors_of(
    settings: &Geometry,
    input: &Input,
    found: Option<MatchedViews>,
    cloud: Option<&[[f64; 3]]>,
) -> Vec<Prior> {
    match (settings.depth_prior, found, cloud) {
        (DepthPrior::None | DepthPrior::Propagation, ..) => Vec::new(),
        (DepthPrior::Lidar, _, Some(cloud)) => {
            let reduced = |c: &Camera| {
                let (width, height) = settings.prior_size(c.width, c.height);
                c.resized(width, height)
            };
            cloud::maps(&input.train.iter().map(|view| reduced(&view.camera)).collect::<Vec<_>>(), cloud)
        }
        (DepthPrior::Stereo | DepthPrior::Lidar, found, _) => found.map(|stereo| stereo.priors).unwrap_or_default(),
    }
}

/// Limits growth to places near a cloud.
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

/// The views without a depth: those that stereo left out, with the reason of stereo, and the others with `otherwise`.
fn without_depth(
    input: &Input,
    priors: &[Prior],
    left_out: &[SkippedView],
    otherwise: WithoutDepth,
) -> Vec<SkippedView> {
    let unknown = input.train.iter().zip(priors).enumerate().filter(|(_, (_, prior))| !is_known(prior));
    let named = |(view, (of, _)): (usize, (&input::View, _))| {
        let why = left_out.iter().find(|skipped| skipped.view == view).map_or(otherwise, |skipped| skipped.why);
        SkippedView { view, name: of.name.clone(), why }
    };
    unknown.map(named).collect()
}

/// Whether a view has any depth.
fn is_known(prior: &Prior) -> bool {
    prior.depth.iter().any(|d| *d > 0.0)
}

/// Sizes of the training photographs.
fn sizes(input: &Input) -> impl Iterator<Item = (u32, u32)> {
    input.train.iter().map(|view| (view.camera.width, view.camera.height))
}

/// Longer side of the photographs, in pixels, that spacings by frequency are for.
const REFERENCE_SIDE: f64 = 320.0;
/// Steps that learn the splats of such photographs.
const REFERENCE_STEPS: f64 = 1750.0;
/// Share of `max-splats` that is left to splats on surfaces if there are more reconstructed points.
const SURFACES_UNDER_A_LIMIT: f64 = 0.5;

/// Number of splats that stereo adds to `points` before the first step: the number of the settings, or else `asked`,
/// which local frequencies ask for. Half of the splats that `fit` into memory are left for growth.
///
/// Half of `max-splats` is left for growth too, but not with `recycle-share`: the lightest splats then make room for
/// growth, and splats that begin on a surface are worth more than splats grown later. If points and splats on surfaces
/// are too many together, points are left out first.
pub fn splats_on_surfaces(points: u32, asked: f64, fit: u32, settings: &Settings) -> u32 {
    let wanted = match settings.geometry.stereo_splats {
        0 => (asked.round() as u32).min((fit / 2).saturating_sub(points)),
        splats => splats,
    };
    let room = settings.density.max_splats.map_or(u32::MAX, |most| match settings.density.recycle_share > 0.0 {
        true => most.saturating_sub(points).max((SURFACES_UNDER_A_LIMIT * f64::from(most)) as u32),
        false => (most / 2).saturating_sub(points),
    });
    wanted.min(room)
}

/// Factor for the first splats, relative to photographs of [`REFERENCE_SIDE`]. Larger photographs show finer detail of
/// the same surface, but a short training learns fewer splats.
pub(crate) fn finer(side: f64, steps: u32) -> f64 {
    (side / REFERENCE_SIDE).min((f64::from(steps) / REFERENCE_STEPS).sqrt()).max(1.0)
}

/// Mean number of pixels on the longer side of photographs of these sizes.
pub fn longer_side(photographs: impl IntoIterator<Item = (u32, u32)>) -> f64 {
    let (mut views, mut pixels) = (0_u32, 0.0);
    for (width, height) in photographs {
        views += 1;
        pixels += f64::from(width.max(height));
    }
    pixels / f64::from(views.max(1))
}

/// The training views for stereo, and which views can be compared with which.
fn scene(dataset: &Dataset, input: &Input, wanted: &stereo::Settings, share: &HostShare) -> Result<Scene, Error> {
    let seen = observations(dataset, input, wanted);
    let bytes = |view: &input::View| {
        view.photograph.decoding_bytes() + Outline::bytes(&[(view.camera, view.photograph.depth())])
    };
    let pending: Vec<PendingPhotograph<'_>> = input
        .train
        .iter()
        .map(|view| PendingPhotograph { name: &view.name, camera: view.camera, bytes: bytes(view) })
        .collect();
    Ok(Scene::new(&pending, &seen, wanted, share, |k| input.train[k].photograph.pixels())?)
}

fn observations(dataset: &Dataset, input: &Input, wanted: &stereo::Settings) -> Observations {
    let index = |name: &str| dataset.views_of(Role::Train).find(|(_, view)| view.name == name).map(|(i, _)| i);
    let chosen: Vec<usize> = input.train.iter().filter_map(|view| index(&view.name)).collect();
    Observations::of(dataset, &chosen, wanted.seed.into())
}

/// The matched views, with their depths and normals.
struct MatchedViews {
    scene: Scene,
    priors: Vec<Prior>,
}

impl MatchedViews {
    /// One cloud from all depths, with surfaces continued to places that few views see where the settings ask for that.
    fn fused(&self, geometry: &Geometry, settings: &stereo::Settings) -> Vec<FusedPoint> {
        let mut fused = fuse(&self.scene.views, &self.priors, settings);
        if geometry.stereo_alone > 0 {
            fused.extend(stereo::extend(&self.scene.views, &self.priors, geometry.stereo_alone as usize));
        }
        fused
    }

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

/// Share of a depth by which a reconstructed point is off a surface that hides it, or that it hides, for certain. Stereo
/// is off by less even at the edges of thin things.
const CONTRADICTED: f64 = 0.2;

/// Whether stereo knows a depth at `point`, in scene units, in some photographs, and in most of them another one.
fn contradicted<'a>(point: [f64; 3], views: impl Iterator<Item = (&'a Camera, &'a Prior)>) -> bool {
    let (mut known, mut off) = (0, 0);
    for (camera, prior) in views {
        let Some([u, v, z]) = camera.placed(point) else { continue };
        let depth = prior.depth.get(v as usize * prior.width as usize + u as usize).copied().unwrap_or(0.0);
        known += usize::from(depth > 0.0);
        off += usize::from(depth > 0.0 && (z / f64::from(depth) - 1.0).abs() > CONTRADICTED);
    }
    2 * off > known
}

/// Adds splats on surfaces at the `chosen` places to the first model, and returns how many. Width, thickness and opacity
/// are those of the settings; `shapes` has one shape for each splat, or none at all. Of the reconstructed points those
/// stay that are `agreeing`, at most as many as `max-splats` leaves room for.
fn begin_on(
    chosen: &[Chosen<'_>],
    shapes: &[Shape],
    agreeing: &[bool],
    settings: &Settings,
    dataset: &Dataset,
    input: &mut Input,
) -> Result<usize, Error> {
    if chosen.is_empty() {
        return Ok(0);
    }
    let room = settings.density.max_splats.map_or(usize::MAX, |most| most as usize).saturating_sub(chosen.len());
    // Points without colours have got colours from photographs.
    let painted = input.optional.coloured.as_ref().map(|coloured| &coloured.colours);
    let colour = |k: usize, own: [u8; 3]| painted.and_then(|all| all.get(k)).copied().unwrap_or(own);
    let points = dataset.usable_points().iter().enumerate().map(|(k, p)| (p.position, colour(k, p.colour)));
    let agreeing: Vec<_> = points.zip(agreeing).filter_map(|(point, agrees)| agrees.then_some(point)).collect();
    let kept = spread(&agreeing, room);
    let reconstructed = kept.iter().map(|point| **point);
    let found = chosen.iter().map(|c| (dataset.frame.to_dataset(c.point.position), c.point.colour));
    input.initial = init::from_points(&reconstructed.chain(found).collect::<Vec<_>>(), &dataset.frame)?;
    let normals: Vec<[f32; 3]> = chosen.iter().map(|c| c.point.normal).collect();
    let geometry = &settings.geometry;
    init::make_opaque(&mut input.initial, 0, geometry.first_opacity);
    init::widen(&mut input.initial, 0..kept.len(), geometry.first_width);
    init::lay_flat(&mut input.initial, kept.len(), &normals, geometry.stereo_thickness);
    if geometry.stereo_axes > 0.0 {
        let along = |shape: &Shape| (shape.along, shape.ratio.powf(geometry.stereo_axes));
        init::stretch(&mut input.initial, kept.len(), &shapes.iter().map(along).collect::<Vec<_>>());
    }
    init::widen(&mut input.initial, kept.len()..kept.len() + chosen.len(), geometry.stereo_width);
    init::make_opaque(&mut input.initial, kept.len(), geometry.stereo_opacity);
    Ok(chosen.len())
}

/// Splats on the points of a skirt that cover the gaps between them.
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

#[cfg(test)]
mod tests {
    use super::contradicted;
    use crate::scene::Camera;
    use crate::stereo::Prior;

    /// A camera 20 pixels wide that looks along z from the origin, and its prior of one depth.
    fn view(depth: f32) -> (Camera, Prior) {
        let camera = Camera {
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.0; 3],
            fx: 20.0,
            fy: 20.0,
            cx: 10.0,
            cy: 10.0,
            width: 20,
            height: 20,
        };
        let prior = Prior {
            width: 20,
            height: 20,
            depth: vec![depth; 400],
            normals: vec![[0.0, 0.0, -1.0]; 400],
            confidence: vec![1.0; 400],
        };
        (camera, prior)
    }

    #[test]
    fn points_off_the_surface_of_most_photographs_are_contradicted() {
        let among = |depths: &[f32], z: f64| {
            let views: Vec<_> = depths.iter().map(|depth| view(*depth)).collect();
            contradicted([0.1, -0.2, z], views.iter().map(|(camera, prior)| (camera, prior)))
        };
        assert!(among(&[10.0, 10.0, 10.0], 13.0) && among(&[10.0], 7.0), "behind and in front");
        assert!(!among(&[10.0, 10.0], 11.5) && !among(&[10.0, 10.0], 8.5), "near the surface");
        assert!(!among(&[10.0, 13.0], 13.0), "hidden in one of two");
        assert!(among(&[10.0, 10.0, 13.0], 13.0), "hidden in two of three");
        assert!(!among(&[0.0, 0.0], 13.0) && !among(&[], 13.0), "nothing is known");
        assert!(among(&[10.0, 0.0, 0.0], 13.0), "views that know nothing do not count");
        assert!(!among(&[10.0], -5.0), "behind the camera");
    }
}
