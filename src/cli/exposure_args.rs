//! Exposures for the scores of held-out photographs.

use std::path::{Path, PathBuf};

use psrgs_vk::dataset::Dataset;
use psrgs_vk::eval::{ExposureScores, Exposures, mean};
use psrgs_vk::format::{EXPOSURE_FILE, ExposureFile};
use psrgs_vk::numbers::{fraction, percent};
use psrgs_vk::raster::Picture;
use psrgs_vk::train::{View, score};

use super::console::Console;
use super::exit::Failure;

/// Options of `eval` for exposures.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct ExposureArgs {
    /// Exposures of the photographs that the model was trained on; others are exposed as those before, after and near
    /// them are [default: exposures.json beside the model, where there is one]
    #[arg(long, value_name = "FILE")]
    pub(crate) exposures: Option<PathBuf>,
    /// Score the model's own colours, whatever lies beside it
    #[arg(long, conflicts_with = "exposures")]
    pub(crate) own_colours: bool,
}

impl ExposureArgs {
    /// Reads the exposures. A default file of other photographs is ignored with a warning.
    pub(crate) fn read(&self, model: &Path, dataset: &Dataset, console: &Console) -> anyhow::Result<Option<Exposures>> {
        let beside = model.with_file_name(EXPOSURE_FILE);
        let file = match &self.exposures {
            _ if self.own_colours => return Ok(None),
            Some(file) => file,
            None if beside.is_file() => &beside,
            None => return Ok(None),
        };
        let photographs = ExposureFile::read(file)?.photographs;
        let known = (0..dataset.views.len()).filter_map(|i| {
            let (view, camera) = (dataset.views.get(i)?, dataset.scene_camera(i)?);
            Some((view.name.clone(), *photographs.get(&view.name)?, camera.center()))
        });
        let known: Vec<_> = known.collect();
        if known.is_empty() {
            let problem = format!("{}: none of its photographs is in this dataset", file.display());
            if self.exposures.is_some() {
                return Err(Failure::Input(format!("{problem}: give the file of the model's training")).into());
            }
            console.warn(format_args!("{problem}; the model is scored in its own colours"));
            return Ok(None);
        }
        Ok(Some(Exposures::new(known)))
    }
}

/// Renders with the exposures of their photographs, and the scores without exposures.
pub(crate) struct Exposed {
    exposures: Option<Exposures>,
    own_colours: Vec<f64>,
}

impl Exposed {
    pub(crate) fn new(exposures: Option<Exposures>) -> Self {
        Self { exposures, own_colours: Vec::new() }
    }

    /// A view's render with the exposure that its photograph is expected to have.
    pub(crate) fn picture(&mut self, view: &View, picture: Picture) -> anyhow::Result<Picture> {
        let Some(exposures) = &self.exposures else { return Ok(picture) };
        self.own_colours.push(score(view, &*view.photograph.pixels()?, &picture.rgb8()).psnr);
        Ok(picture.exposed(&exposures.of(&view.name, view.camera.center())))
    }

    /// The scores, after all renders.
    pub(crate) fn scores(&self) -> Option<ExposureScores> {
        let follows = self.exposures.as_ref()?.follows();
        Some(ExposureScores {
            follows_order: follows.order,
            follows_place: follows.place,
            psnr_own_colours: mean(self.own_colours.iter().copied()),
        })
    }
}

/// The scores in a line.
pub(crate) fn line(scores: &ExposureScores) -> String {
    let own = scores
        .psnr_own_colours
        .map_or_else(String::new, |psnr| format!("; {} dB in the model's own colours", fraction(psnr, 2)));
    let [order, place] = [scores.follows_order, scores.follows_place].map(|share| percent(share, 0));
    format!("exposed by {order} of the exposures before and after, and by {place} of the exposures nearby{own}")
}
