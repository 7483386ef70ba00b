//! The masks of a set of images, made when they are asked for and kept while sigma stays.

use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use super::{Error, Gate, Plane, Saliency, Settings};

/// Keeps the last map and mask of each image. In memory only: they follow from image, gate, sigma and seed, so a
/// resumed run makes them again, to the same bits, in the time of a few steps.
pub struct Cache {
    gate: Gate,
    seed: u64,
    settings: Settings,
    entries: Vec<Entry>,
}

struct Entry {
    image: Plane,
    kept: Mutex<Option<Kept>>,
}

struct Kept {
    sigma: f64,
    version: u64,
    saliency: Arc<Saliency>,
}

impl Cache {
    /// For images (luma) at the size of their masks: see [`Plane::reduced`].
    pub fn new(images: Vec<Plane>, gate: Gate, seed: u64, settings: &Settings) -> Result<Self, Error> {
        settings.check()?;
        let entries = images.into_iter().map(|image| Entry { image, kept: Mutex::new(None) }).collect();
        Ok(Self { gate, seed, settings: settings.clone(), entries })
    }

    /// The images.
    pub fn images(&self) -> impl ExactSizeIterator<Item = &Plane> {
        self.entries.iter().map(|entry| &entry.image)
    }

    /// Map and mask of an image, and their version: a number that grows when they change,
    /// so that copies elsewhere know their age.
    pub fn get(&self, index: usize, sigma: f64) -> Result<(Arc<Saliency>, u64), Error> {
        let images = self.entries.len();
        let entry = self.entries.get(index).ok_or(Error::NoImage { index, images })?;
        // What is kept is whole at any time, so that a panic elsewhere leaves nothing half made behind.
        let mut kept = entry.kept.lock().unwrap_or_else(PoisonError::into_inner);
        // Other gates do not look at sigma.
        let same = |k: &Kept| k.sigma.to_bits() == sigma.to_bits() || self.gate != Gate::Spectral;
        if let Some(k) = kept.as_ref().filter(|k| same(k)) {
            return Ok((Arc::clone(&k.saliency), k.version));
        }
        let seed = self.seed ^ (index as u64).wrapping_mul(0xd1b5_4a32_d192_ed03);
        let saliency = Arc::new(self.gate.mask(&entry.image, sigma, seed, &self.settings)?);
        let version = kept.as_ref().map_or(0, |k| k.version) + 1;
        *kept = Some(Kept { sigma, version, saliency: Arc::clone(&saliency) });
        Ok((saliency, version))
    }

    /// Makes those of all images in parallel, a sigma for each.
    pub fn prepare(&self, sigmas: &[f64]) -> Result<(), Error> {
        Error::check("sigma", sigmas.len(), self.entries.len())?;
        sigmas.par_iter().enumerate().try_for_each(|(index, sigma)| self.get(index, *sigma).map(drop))
    }
}
