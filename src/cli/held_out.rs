//! Held-out photographs compared with renders of a model: scores, and panels of the report; and what stereo knows of
//! their depths.

use std::sync::Arc;

use psrgs_vk::dataset::{self, Dataset, Pixels, Role};
use psrgs_vk::eval::geometry::Judge;
use psrgs_vk::eval::{ExposureScores, Exposures, ImageScore, SeenPixels, ViewPanel};
use psrgs_vk::raster::Picture;
use psrgs_vk::stereo::{Matcher, Prior, Scene, Settings};
use psrgs_vk::train::settings::HostChoice;
use psrgs_vk::train::{View, prepare, score};
use psrgs_vk::vk::Gpu;

use super::console::Console;
use super::exposure_args::Exposed;
use super::lpips::Lpips;
use super::pictures::Pictures;
use super::progress;

/// A comparison under way, one view after the other.
pub(crate) struct Comparison<'a> {
    gpu: &'a Gpu,
    console: &'a Console,
    lpips: &'a mut Lpips,
    exposed: Exposed,
    /// Where renders are written. Without a folder, views are only scored.
    pictures: Option<Pictures>,
    /// Which pixels are seen; where that is not known, nothing is told of them.
    seen: Option<SeenPixels>,
    /// Number of views.
    views: usize,
    images: Vec<ImageScore>,
    panels: Vec<ViewPanel>,
}

/// The result of a comparison.
pub(crate) struct Compared {
    /// The scores of each view.
    pub(crate) images: Vec<ImageScore>,
    /// The panel of each view in the report; empty where no renders were written.
    pub(crate) panels: Vec<ViewPanel>,
    /// How exposures changed the scores.
    pub(crate) exposures: Option<ExposureScores>,
}

impl<'a> Comparison<'a> {
    /// Starts a comparison of `views` views with these exposures. Views are added in the order of their names in
    /// `pictures`.
    pub(crate) fn new(
        gpu: &'a Gpu,
        lpips: &'a mut Lpips,
        exposures: Option<Exposures>,
        pictures: Option<Pictures>,
        views: usize,
        console: &'a Console,
    ) -> Self {
        let exposed = Exposed::new(exposures);
        Self { gpu, console, lpips, exposed, pictures, seen: None, views, images: Vec::new(), panels: Vec::new() }
    }

    /// With scores of what is seen too.
    pub(crate) fn with_seen(self, seen: Option<SeenPixels>) -> Self {
        Self { seen, ..self }
    }

    /// Compares the next view's photograph with a render from its camera.
    pub(crate) fn add(&mut self, view: &View, picture: Picture) -> anyhow::Result<()> {
        let picture = self.exposed.picture(view, picture)?;
        match &self.pictures {
            Some(pictures) => {
                let mut panel = pictures.held_out(self.images.len(), view, &picture)?;
                panel.lpips_squeeze = self.lpips.measure(self.gpu, view, panel.render.as_raw(), self.console);
                let score = self.of_seen(panel.score(), view, panel.render.as_raw())?;
                if let (Some(seen), true) = (&self.seen, score.seen.is_some_and(|share| share < 1.0)) {
                    let size = (view.camera.width, view.camera.height);
                    pictures.seen(self.images.len(), size, &seen.of_photograph(&view.name, size))?;
                }
                self.images.push(score);
                self.panels.push(panel.among(self.views));
            }
            None => {
                let rgb = picture.rgb8();
                let lpips_squeeze = self.lpips.measure(self.gpu, view, &rgb, self.console);
                let score = ImageScore { lpips_squeeze, ..score(view, &*view.photograph.pixels()?, &rgb) };
                self.images.push(self.of_seen(score, view, &rgb)?);
            }
        }
        Ok(())
    }

    /// A score with that of what is seen.
    fn of_seen(&self, score: ImageScore, view: &View, rgb: &[u8]) -> anyhow::Result<ImageScore> {
        let Some(seen) = &self.seen else { return Ok(score) };
        let size = (view.camera.width, view.camera.height);
        Ok(seen.with_score(score, size, &*view.photograph.pixels()?, rgb))
    }

    /// The result, after all views.
    pub(crate) fn end(self) -> Compared {
        Compared { images: self.images, panels: self.panels, exposures: self.exposed.scores() }
    }
}

/// Pixels on the longer side of the photographs as they are matched, at most.
const LONGER_SIDE: u32 = 320;

/// Depths of a lower confidence do not judge.
const CONFIDENT: f32 = 0.5;

/// Depths of the held-out photographs where stereo is confident of them. Stereo compares all photographs, those that
/// were trained on too, but none that is left to other splits.
pub(crate) fn depths_by_stereo(
    dataset: &Dataset,
    host: &HostChoice,
    gpu: &Gpu,
    console: &Console,
) -> anyhow::Result<Vec<Judge>> {
    let settings = Settings { max_side: LONGER_SIDE, ..Settings::default() };
    let share = prepare::host_share(dataset, Role::Train, host);
    let used = |(k, view): (usize, &dataset::View)| (view.role != Role::Unused).then_some(k);
    let chosen: Vec<usize> = dataset.views.iter().enumerate().filter_map(used).collect();
    // A photograph that cannot be decoded agrees with no other.
    let scene = Scene::of_views(dataset, &chosen, &settings, &share, |view| {
        Ok(view.photograph().map_or_else(|_| Arc::new(Pixels::Rgba8(Vec::new())), |read| Arc::new(read.pixels)))
    })?;
    let bar = progress::counter(console, scene.views.len(), "photographs");
    let done = |done: f64| bar.set_position((done * scene.views.len() as f64) as u64);
    let priors = Matcher::new(gpu, &settings)?.run(&scene.views, done)?;
    bar.finish_and_clear();
    let held_out = chosen.iter().zip(&priors).filter(|(k, _)| dataset.views[**k].role == Role::HeldOut);
    let judges = held_out.filter_map(|(k, prior)| {
        let camera = dataset.scene_camera(*k)?;
        Some(Judge { camera, places: places(prior, (camera.width, camera.height)) })
    });
    Ok(judges.filter(|judge| !judge.places.is_empty()).collect())
}

/// Middles of the confident pixels, in pixels of a picture of another size, with their depths.
fn places(prior: &Prior, (width, height): (u32, u32)) -> Vec<[f64; 3]> {
    let at = |k: u32, from: u32, to: u32| (f64::from(k) + 0.5) * f64::from(to) / f64::from(from);
    let confident = |pixel: &u32| {
        let known = *pixel as usize;
        prior.depth[known] > 0.0 && prior.confidence[known] >= CONFIDENT
    };
    let place = |pixel: u32| {
        let (x, y) = (pixel % prior.width, pixel / prior.width);
        [at(x, prior.width, width), at(y, prior.height, height), f64::from(prior.depth[pixel as usize])]
    };
    (0..prior.width * prior.height).filter(confident).map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_middles_of_confident_pixels() {
        let prior = Prior {
            width: 2,
            height: 2,
            depth: vec![1.0, 2.0, 0.0, 4.0],
            confidence: vec![0.4, 0.5, 0.9, 0.9],
            ..Prior::default()
        };
        assert_eq!(places(&prior, (8, 4)), [[6.0, 1.0, 2.0], [6.0, 3.0, 4.0]]);
    }
}
