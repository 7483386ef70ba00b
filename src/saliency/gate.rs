//! Ways to separate texture from the rest of an image, for comparison with one another.

use std::fmt;
use std::str::FromStr;

use super::blur::{at, gaussian};
use super::{Error, Map, Plane, Settings, Spectrum};
use crate::scene::random::Random;

/// How a mask is computed. All gates aim at the same mean of the mask, [`Settings::share`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Gate {
    /// `spectral`: the residual of the spectrum.
    #[default]
    Spectral,
    /// `phase`: the phase of the spectrum alone, independent of sigma.
    Phase,
    /// `gradient`: the squared gradient.
    Gradient,
    /// `random`: smooth noise, independent of the image.
    Random,
    /// `off`: [`Settings::share`] at every pixel.
    Off,
}

/// A map and its mask.
#[derive(Clone, Debug, PartialEq)]
pub struct Saliency {
    /// Saliency per pixel: not negative, with a mean of 1 or all 0.
    pub map: Plane,
    /// Texture per pixel, from 0 (none) to 1.
    pub mask: Plane,
}

impl Gate {
    /// All gates.
    pub const ALL: [Self; 5] = [Self::Spectral, Self::Phase, Self::Gradient, Self::Random, Self::Off];

    /// Map and mask of an image (luma), at the image's size. `sigma` (see [`Spectrum::map`]) affects `Spectral` alone,
    /// `seed` affects `Random` alone.
    pub fn mask(self, image: &Plane, sigma: f64, seed: u64, settings: &Settings) -> Result<Saliency, Error> {
        settings.check()?;
        Settings::check_sigma(sigma)?;
        let energy = match self {
            Self::Spectral => return Ok(Saliency::of(&Spectrum::new(image, settings)?.map(sigma)?)),
            Self::Phase => return Ok(Saliency::of(&Spectrum::new(image, settings)?.map(0.0)?)),
            Self::Gradient => squared_gradient(image, settings),
            Self::Random => smooth_noise(image, seed, settings),
            Self::Off => {
                let pixels = image.values().len();
                let all = |value: f64| Plane::of(image.width(), image.height(), std::iter::repeat_n(value, pixels));
                return Ok(Saliency { map: all(1.0), mask: all(settings.share) });
            }
        };
        let still = vec![0.0; energy.len()];
        Ok(Saliency::of(&Map::new((image.width(), image.height()), energy, still, settings)))
    }
}

impl Saliency {
    fn of(map: &Map) -> Self {
        Self { map: map.plane(), mask: map.mask(0.0).plane() }
    }
}

fn squared_gradient(image: &Plane, settings: &Settings) -> Vec<f64> {
    let (w, h) = (image.width() as usize, image.height() as usize);
    let value =
        |x: isize, y: isize| f64::from(image.values()[at(y, h, settings.border) * w + at(x, w, settings.border)]);
    let square = |i: usize| {
        let (x, y) = ((i % w) as isize, (i / w) as isize);
        (value(x + 1, y) - value(x - 1, y)).powi(2) + (value(x, y + 1) - value(x, y - 1)).powi(2)
    };
    let squares = (0..w * h).map(square).collect();
    gaussian(squares, (w, h), settings.blur_of(image.width(), image.height()), settings.border)
}

/// Noise whose logarithm is blurred white noise of standard deviation 1: about as uneven as the maps of photographs.
fn smooth_noise(image: &Plane, seed: u64, settings: &Settings) -> Vec<f64> {
    let (w, h) = (image.width() as usize, image.height() as usize);
    let mut random = Random::new(seed);
    let white = (0..w * h).map(|_| random.symmetric()).collect();
    let smooth = gaussian(white, (w, h), settings.blur_of(image.width(), image.height()), settings.border);
    let n = smooth.len() as f64;
    let mean = smooth.iter().sum::<f64>() / n;
    let deviation = (smooth.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt().max(f64::MIN_POSITIVE);
    smooth.iter().map(|v| ((v - mean) / deviation).exp()).collect()
}

impl fmt::Display for Gate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Spectral => "spectral",
            Self::Phase => "phase",
            Self::Gradient => "gradient",
            Self::Random => "random",
            Self::Off => "off",
        })
    }
}

impl FromStr for Gate {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(|gate| gate.to_string()).join(", ");
        Self::ALL
            .into_iter()
            .find(|gate| gate.to_string() == word)
            .ok_or_else(|| format!("unknown gate `{word}`; the gates are {}", known()))
    }
}

impl serde::Serialize for Gate {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> serde::Deserialize<'de> for Gate {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}
