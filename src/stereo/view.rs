//! A view as stereo sees it.

use super::{Error, InitialPlanes};
use crate::scene::Camera;

/// A picture with its camera, and what it is to be compared with.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The camera at the size of the picture. All views share one system of coordinates.
    pub camera: Camera,
    /// Luma from 0 to 1, row by row from the top.
    pub luma: Vec<f32>,
    /// Colours of the pixels, for the fused cloud; may be empty.
    pub colours: Vec<[u8; 3]>,
    /// Positions of the views that it is checked against, the best first, at most eight; windows are compared with the
    /// first of them ([`super::Settings::sources`]). None: it is left out.
    pub sources: Vec<usize>,
    /// Nearest and farthest depth that is possible.
    pub depths: [f64; 2],
    /// What pixels begin with.
    pub start: InitialPlanes,
    /// Which pixels are matched; `None`: all.
    pub wanted: Option<Vec<bool>>,
}

impl View {
    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.camera.width as usize * self.camera.height as usize
    }

    /// Whether everything fits together; `number` is this view's of `views`.
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
