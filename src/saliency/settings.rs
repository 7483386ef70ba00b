//! Settings of maps and masks.

use serde::{Deserialize, Serialize};

use super::Error;

/// How an image continues beyond its border.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Border {
    /// Its reflection, fading to the mean: for photographs.
    #[default]
    Reflect,
    /// The image again: for periodic patterns.
    Periodic,
}

/// How a map and a mask are made of an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Photographs are reduced until their shorter side has this many pixels.
    pub side: u32,
    /// How an image continues beyond its border.
    pub border: Border,
    /// Width of the fading reflection on each side, as a share of the side.
    pub pad: f64,
    /// Amplitudes below this share of their mean count as noise.
    pub epsilon: f64,
    /// Standard deviation of the blur of a map, in pixels of an image whose shorter side has 256.
    pub blur: f64,
    /// Mean of a mask: how much of an image counts as texture.
    pub share: f64,
    /// Width of the step of a mask, in units of the map's natural logarithm.
    pub softness: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            side: 256,
            border: Border::Reflect,
            pad: 1.0 / 16.0,
            epsilon: 1e-3,
            blur: 2.5,
            share: 0.3,
            softness: 0.25,
        }
    }
}

impl Settings {
    /// Refuses values outside their range.
    pub fn check(&self) -> Result<(), Error> {
        let one = |name, value: f64, fits: bool, want| {
            if fits { Ok(()) } else { Err(Error::Setting { name, want, value }) }
        };
        one("side", f64::from(self.side), (1..=4096).contains(&self.side), "from 1 to 4096")?;
        one("pad", self.pad, (0.0..=1.0).contains(&self.pad), "from 0 to 1")?;
        one("epsilon", self.epsilon, self.epsilon > 0.0 && self.epsilon <= 1.0, "above 0 and at most 1")?;
        one("blur", self.blur, (0.0..=64.0).contains(&self.blur), "from 0 to 64")?;
        one("share", self.share, (0.001..=0.999).contains(&self.share), "from 0.001 to 0.999")?;
        one("softness", self.softness, (0.01..=100.0).contains(&self.softness), "from 0.01 to 100")
    }

    /// Refuses a sigma outside 0 to 1000.
    pub fn check_sigma(sigma: f64) -> Result<(), Error> {
        let want = "from 0 to 1000";
        if (0.0..=1000.0).contains(&sigma) { Ok(()) } else { Err(Error::Setting { name: "sigma", want, value: sigma }) }
    }

    /// The blur of a map in pixels of an image of this size.
    pub(super) fn blur_of(&self, width: u32, height: u32) -> f64 {
        self.blur * f64::from(width.min(height)) / 256.0
    }
}
