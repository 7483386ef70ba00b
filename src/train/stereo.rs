//! What stereo and the reconstructed points say of the views of a training.

use super::Error;
use super::input::Input;
use super::settings::{DepthPrior, Settings};
use crate::dataset::{Dataset, Role};
use crate::scene::init;
use crate::stereo::{Matcher, Observations, Prior, Scene, View, fuse};
use crate::vk::Gpu;

/// What was found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StereoReport {
    /// Views of which something is known.
    pub views: usize,
    /// Share of their pixels that have a depth.
    pub share: f64,
    /// Splats that the model begins with besides those of the reconstructed points.
    pub splats: usize,
    /// Names of views of which nothing is known.
    pub skipped: Vec<String>,
}

/// Fills in the depths and normals that the settings ask for, and splats on them, no more than there may be. The same for the same photographs, on the same
/// device. `dataset` is that of the input. `begins` is false where the model comes from elsewhere.
pub fn take_stereo(
    gpu: &Gpu,
    dataset: &Dataset,
    input: &mut Input,
    training: &Settings,
    begins: bool,
) -> Result<StereoReport, Error> {
    let settings = &training.geometry;
    if settings.depth_prior == DepthPrior::None {
        return Ok(StereoReport::default());
    }
    let wanted = settings.stereo();
    let index = |name: &str| dataset.views_of(Role::Train).find(|(_, view)| view.name == name).map(|(i, _)| i);
    let chosen: Vec<usize> = input.train.iter().filter_map(|view| index(&view.name)).collect();
    let seen = Observations::of(dataset, &chosen, wanted.seed.into());
    let pixels = input.train.iter().map(|view| view.photograph.pixels()).collect::<Result<Vec<_>, _>>()?;
    let pictures = input.train.iter().zip(&pixels).map(|(v, p)| (v.name.as_str(), &v.camera, p.as_ref()));
    let scene = Scene::new(pictures, &seen, &wanted);
    drop(pixels);
    let priors = match settings.depth_prior {
        DepthPrior::Stereo => Matcher::new(gpu, &wanted)?.run(&scene.views, |_| ())?,
        _ => sparse(&scene.views, &seen),
    };
    let mut report = StereoReport::default();
    let allowed = training.density.max_splats.map_or(u32::MAX, |most| most.saturating_sub(input.initial.len() as u32));
    let more = settings.stereo_splats.min(allowed) as usize;
    if begins && more > 0 {
        let cloud = fuse(&scene.views, &priors, &wanted);
        let step = cloud.len().div_ceil(more).max(1);
        let found = cloud.iter().step_by(step).map(|p| (dataset.frame.to_dataset(p.position), p.color));
        let reconstructed = dataset.points.iter().map(|p| (p.position, p.color));
        let points: Vec<_> = reconstructed.chain(found).collect();
        report.splats = points.len() - dataset.points.len();
        if report.splats > 0 {
            input.initial = init::from_points(&points, &dataset.frame)?;
        }
    }
    let known = |prior: &Prior| prior.depth.iter().any(|d| *d > 0.0);
    report.views = priors.iter().filter(|p| known(p)).count();
    report.share = priors.iter().map(Prior::share).sum::<f64>() / report.views.max(1) as f64;
    let unknown = scene.names.iter().zip(&priors).filter(|(_, prior)| !known(prior));
    report.skipped = unknown.map(|(name, _)| name.clone()).collect();
    input.known.priors = priors.into_iter().map(|prior| known(&prior).then_some(prior)).collect();
    Ok(report)
}

/// Depths at the points that three views and more see; nothing between them.
fn sparse(views: &[View], seen: &Observations) -> Vec<Prior> {
    const LEAST_VIEWS: usize = 3;
    let observed = seen.observed_by(views, LEAST_VIEWS);
    let one = |(view, points): (&View, Vec<[f64; 3]>)| {
        let (width, height) = (view.camera.width, view.camera.height);
        let pixels = view.pixels();
        let (mut depth, mut confidence) = (vec![0.0_f32; pixels], vec![0.0; pixels]);
        for [u, v, z] in points {
            let at = (v as usize).min(height as usize - 1) * width as usize + (u as usize).min(width as usize - 1);
            // The nearest of those that share a pixel.
            if depth[at] == 0.0 || (z as f32) < depth[at] {
                (depth[at], confidence[at]) = (z as f32, 1.0);
            }
        }
        Prior { width, height, depth, normals: vec![[0.0; 3]; pixels], confidence }
    };
    views.iter().zip(observed).map(one).collect()
}
