//! Held-out photographs compared with renders of a model: scores, and panels of the report.

use psrgs_vk::eval::{ExposureScores, Exposures, ImageScore, ViewPanel};
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
        Self { gpu, console, lpips, exposed, pictures, views, images: Vec::new(), panels: Vec::new() }
    }

    /// Compares the next view's photograph with a render from its camera.
    pub(crate) fn add(&mut self, view: &View, picture: Picture) -> anyhow::Result<()> {
        let picture = self.exposed.picture(view, picture)?;
        match &self.pictures {
            Some(pictures) => {
                let mut panel = pictures.held_out(self.images.len(), view, &picture)?;
                panel.lpips_squeeze = self.lpips.measure(self.gpu, view, panel.render.as_raw(), self.console);
                self.images.push(panel.score());
                self.panels.push(panel.among(self.views));
            }
            None => {
                let rgb = picture.rgb8();
                let lpips_squeeze = self.lpips.measure(self.gpu, view, &rgb, self.console);
                self.images.push(ImageScore { lpips_squeeze, ..score(view, &*view.photograph.pixels()?, &rgb) });
            }
        }
        Ok(())
    }

    /// The result, after all views.
    pub(crate) fn end(self) -> Compared {
        Compared { images: self.images, panels: self.panels, exposures: self.exposed.scores() }
    }
}
