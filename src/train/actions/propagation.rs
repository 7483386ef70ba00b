//! Depths and normals found while training: a view's render begins a search for planes that its neighbours agree with, and where what
//! they agree on is far from what is rendered, splats are added (GaussianPro, Cheng et al. 2024).

use std::sync::Arc;

use crate::raster::Picture;
use crate::scene::{Camera, Frame, Gaussians, init};
use crate::stereo::{self, InitialPlanes, Matcher, Prior, Scene, View, lifted_pixel};
use crate::train::Error;
use crate::train::density::logit;
use crate::train::settings::Geometry;
use crate::vk::Gpu;

/// Views that a view is compared with.
const SOURCES: usize = 4;
/// Sweeps over all pixels: renders are farther from the truth than reconstructed points are.
const SWEEPS: u32 = 2;
/// Splats are added in every so many-th row and column of the photograph ...
const GRID: f64 = 8.0;
/// ... where more pixels of it than this have another depth.
const LEAST_PIXELS: f64 = 100.0;
/// Opacity of the splats that are added. The publication's is 1, which has no logit.
const OPACITY: f64 = 0.99;

/// What a training needs to propagate depths.
pub(super) struct Propagation {
    matcher: Matcher,
    scene: Arc<Scene>,
    /// Sizes of the photographs.
    sizes: Vec<(u32, u32)>,
}

/// What came of a view.
pub(super) struct Propagated {
    /// What its neighbours agree with.
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

    /// A view and those that it is compared with; nothing where there are none.
    pub(super) fn together(&self, view: usize) -> Vec<usize> {
        match self.scene.views.get(view) {
            Some(found) if !found.sources.is_empty() => {
                std::iter::once(view).chain(found.sources.iter().copied().take(SOURCES)).collect()
            }
            _ => Vec::new(),
        }
    }

    /// The camera of a view at the size that is matched.
    pub(super) fn camera(&self, view: usize) -> Option<Camera> {
        self.scene.views.get(view).map(|v| v.camera)
    }

    /// What is found of the first of views that belong together, from renders of all of them with depth and normals. Splats are added
    /// where depths differ by more than `ratio` of what is found.
    pub(super) fn found(&self, together: &[usize], renders: &[Picture], ratio: f64) -> Result<Propagated, Error> {
        let views: Vec<View> = (0..together.len())
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

    /// A view that begins with its render, compared with the others of `count` that belong together.
    fn begun(&self, view: &View, number: usize, count: usize, render: &Picture) -> View {
        let (depth, normals) = (render.depth().unwrap_or_default(), render.normals().unwrap_or_default());
        let whole = depth.len() == view.pixels() && normals.len() == view.pixels();
        View {
            sources: (0..count).filter(|k| *k != number).collect(),
            start: if whole { InitialPlanes::from_maps(&view.camera, &depth, &normals) } else { InitialPlanes::Random },
            ..view.clone()
        }
    }
}

/// Points with colours where a view's rendered depth is wrong: on a grid, if there are enough such pixels. The rendered depth is the
/// sum of weighted depths, which is less than a depth where little is rendered.
fn wrong(view: &View, prior: &Prior, aux: &[f32], ratio: f64, size: (u32, u32)) -> Vec<([f64; 3], [u8; 3])> {
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
