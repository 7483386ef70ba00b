//! Held-out photographs compared with pictures of a model: their scores, and what a report shows of them.

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
    /// Where pictures are written; without it views are scored alone.
    pictures: Option<Pictures>,
    /// How many views there are.
    views: usize,
    images: Vec<ImageScore>,
    panels: Vec<ViewPanel>,
}

/// What came of it.
pub(crate) struct Compared {
    /// The scores of each view.
    pub(crate) images: Vec<ImageScore>,
    /// What a report shows of each view; empty where no pictures were written.
    pub(crate) panels: Vec<ViewPanel>,
    /// How exposures had a part in the scores.
    pub(crate) exposures: Option<ExposureScores>,
}

impl<'a> Comparison<'a> {
    /// Of so many views, by these exposures. Views are added in the order in which `pictures` names them.
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

    /// Compares the next view's photograph with a picture from its camera.
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

    /// What came of it, after all views.
    pub(crate) fn end(self) -> Compared {
        Compared { images: self.images, panels: self.panels, exposures: self.exposed.scores() }
    }
}
