//! Held-out photographs compared with renders of a model: scores, and panels of the report.

use psrgs_vk::eval::{ExposureScores, Exposures, ImageScore, SeenPixels, ViewPanel};
use psrgs_vk::raster::Picture;
use psrgs_vk::train::{View, score};
use psrgs_vk::vk::Gpu;

use super::console::Console;
use super::exposure_args::Exposed;
use super::lpips::Lpips;
use super::pictures::Pictures;

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
