//! Depths and normals found during training (GaussianPro, Cheng et al. 2024). The render of a view begins a search for
//! planes that neighbouring views agree with. Splats are added where the planes found are far from the rendered depth.

use std::sync::Arc;

use crate::raster::Picture;
use crate::scene::{Camera, Frame, Gaussians, init};
use crate::stereo::{self, InitialPlanes, Matcher, Prior, Scene, StereoView, lifted_pixel};
use crate::train::Error;
use crate::train::density::logit;
use crate::train::settings::Geometry;
use crate::vk::Gpu;

/// Most views that a view is compared with.
const SOURCES: usize = 4;
/// Sweeps over all pixels: renders are farther from the truth than reconstructed points are.
const SWEEPS: u32 = 2;
/// Splats are added at every eighth row and column of the photograph ...
const GRID: f64 = 8.0;
/// ... if more than this many pixels of the photograph have another depth.
const LEAST_PIXELS: f64 = 100.0;
/// Opacity of the splats that are added. The paper has 1, which has no logit.
const OPACITY: f64 = 0.99;

/// What a training needs to propagate depths.
pub(super) struct Propagation {
    matcher: Matcher,
    scene: Arc<Scene>,
    /// Sizes of the photographs.
    sizes: Vec<(u32, u32)>,
}

/// What was found for a view.
pub(super) struct Propagated {
    /// Depths and normals that the neighbouring views agree with.
    pub(super) prior: Prior,
    /// Splats to add, in scene coordinates.
    pub(super) splats: Gaussians,
}

impl Propagation {
    /// For the views of a scene, whose photographs have these sizes.
    pub(super) fn new(
        gpu: &Gpu,
        scene: Arc<Scene>,
        sizes: Vec<(u32, u32)>,
        settings: &Geometry,
    ) -> Result<Self, Error> {
        let settings = stereo::Settings { iterations: SWEEPS, sources: SOURCES as u32, ..settings.stereo() };
        Ok(Self { matcher: Matcher::new(gpu, &settings)?, scene, sizes })
    }

    /// The indices of a view and the views that it is compared with; empty if there are none to compare with.
    pub(super) fn together(&self, view: usize) -> Vec<usize> {
        match self.scene.views.get(view) {
            Some(found) if !found.sources.is_empty() => {
                std::iter::once(view).chain(found.sources.iter().copied().take(SOURCES)).collect()
            }
            _ => Vec::new(),
        }
    }

    /// The camera of a view at the size at which views are matched.
    pub(super) fn camera(&self, view: usize) -> Option<Camera> {
        self.scene.views.get(view).map(|v| v.camera)
    }

    /// Depths and splats for the first of the views `together`, from renders of all of them with depth and normals.
    /// Splats are added where the rendered depth differs from the depth found by more than `ratio` times the latter.
    pub(super) fn found(&self, together: &[usize], renders: &[Picture], ratio: f64) -> Result<Propagated, Error> {
        let views: Vec<StereoView> = (0..together.len())
            .filter_map(|k| {
                Some(self.begun(self.scene.views.get(*together.get(k)?)?, k, together.len(), renders.get(k)?))
            })
            .collect();
        let prior = self.matcher.run(&views, |_| ())?.into_iter().next().unwrap_or_default();
        let (Some(view), Some(aux)) = (views.first(), renders.first().and_then(|r| r.aux.as_ref())) else {
            return Ok(Propagated { prior, splats: Gaussians::default() });
        };
        let size = together
            .first()
            .and_then(|v| self.sizes.get(*v))
            .copied()
            .unwrap_or((view.camera.width, view.camera.height));
        let points = wrong(view, &prior, aux, ratio, size);
        let splats =
            if points.is_empty() { Gaussians::default() } else { init::from_points(&points, &Frame::IDENTITY)? };
        Ok(Propagated { prior, splats: Gaussians { opacities: vec![logit(OPACITY); splats.len()], ..splats } })
    }

    /// The view to match: it begins with its render and is compared with the others of `count` views.
    fn begun(&self, view: &StereoView, number: usize, count: usize, render: &Picture) -> StereoView {
        let (depth, normals) = (render.depth().unwrap_or_default(), render.normals().unwrap_or_default());
        let whole = depth.len() == view.pixels() && normals.len() == view.pixels();
        StereoView {
            sources: (0..count).filter(|k| *k != number).collect(),
            start: if whole { InitialPlanes::from_maps(&view.camera, &depth, &normals) } else { InitialPlanes::Random },
            ..view.clone()
        }
    }
}

/// Points with colours at pixels on a grid where the rendered depth is wrong, if enough pixels of the view are wrong.
/// The rendered depth is a sum of weighted depths, so it is too small where the splats cover little.
fn wrong(view: &StereoView, prior: &Prior, aux: &[f32], ratio: f64, size: (u32, u32)) -> Vec<([f64; 3], [u8; 3])> {
    let (width, height) = (view.camera.width as usize, view.camera.height as usize);
    let reduced = width as f64 / f64::from(size.0.max(1));
    let differs = |pixel: usize| {
        let (found, rendered) = (f64::from(prior.depth[pixel]), f64::from(aux[4 * pixel]));
        found > 0.0 && (found - rendered).abs() > ratio * found
    };
    let pixels: Vec<usize> = (0..width * height).filter(|p| differs(*p)).collect();
    if (pixels.len() as f64) <= LEAST_PIXELS * reduced * reduced {
        return Vec::new();
    }
    let step = ((GRID * reduced).round() as usize).max(1);
    let on_grid = |p: &usize| (p % width).is_multiple_of(step) && (p / width).is_multiple_of(step);
    let point = |p: usize| {
        let point = lifted_pixel(view, prior, p);
        (point.position, point.colour)
    };
    pixels.into_iter().filter(on_grid).map(point).collect()
}
