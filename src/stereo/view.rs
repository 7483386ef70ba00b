//! The input of stereo for one view.

use super::{Error, InitialPlanes};
use crate::scene::Camera;

/// A photograph with its camera and the views to compare it with.
#[derive(Clone, Debug, PartialEq)]
pub struct StereoView {
    /// The camera at the photograph's size. All views share one coordinate system.
    pub camera: Camera,
    /// Luma from 0 to 1, row by row from the top.
    pub luma: Vec<f32>,
    /// Colours of the pixels, for the fused cloud; may be empty.
    pub colours: Vec<[u8; 3]>,
    /// Indices of the views that this view is checked against, the best first, at most eight. The first
    /// [`super::Settings::sources`] are also matched. A view without sources gets no depth.
    pub sources: Vec<usize>,
    /// Nearest and farthest possible depth.
    pub depths: [f64; 2],
    /// Initial hypotheses of the pixels.
    pub start: InitialPlanes,
    /// Whether each pixel is to be matched; `None` matches all.
    pub wanted: Option<Vec<bool>>,
}

impl StereoView {
    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.camera.width as usize * self.camera.height as usize
    }

    /// Fails where sizes or sources do not fit. `number` is this view's index among `views` views.
    pub(super) fn check(&self, number: usize, views: usize) -> Result<(), Error> {
        let expected = self.pixels();
        let counted = |what, found: usize| match found == expected {
            true => Ok(()),
            false => Err(Error::Pixels { view: number, what, found, expected }),
        };
        counted("luma", self.luma.len())?;
        if !self.colours.is_empty() {
            counted("colours", self.colours.len())?;
        }
        if let Some(wanted) = &self.wanted {
            counted("wanted pixels", wanted.len())?;
        }
        if let InitialPlanes::Hypotheses(rows) = &self.start {
            counted("hypotheses", rows.len())?;
        }
        match self.sources.iter().find(|s| **s >= views || **s == number) {
            Some(&wrong) => Err(Error::Source { view: number, wrong }),
            None => Ok(()),
        }
    }
}
