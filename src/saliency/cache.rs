//! Maps and masks of a set of images, computed on demand and kept until sigma changes.

use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use super::{Error, Gate, Plane, Saliency, Settings};

/// Keeps the last map and mask of each image, in memory only. Image, gate, sigma and seed determine the mask, so a
/// resumed run computes equal bits again, in the time of a few steps.
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
    /// From images (luma) at the size of their masks: see [`Plane::reduced`].
    pub fn new(images: Vec<Plane>, gate: Gate, seed: u64, settings: &Settings) -> Result<Self, Error> {
        settings.check()?;
        let entries = images.into_iter().map(|image| Entry { image, kept: Mutex::new(None) }).collect();
        Ok(Self { gate, seed, settings: settings.clone(), entries })
    }

    /// The images.
    pub fn images(&self) -> impl ExactSizeIterator<Item = &Plane> {
        self.entries.iter().map(|entry| &entry.image)
    }

    /// Map and mask of an image, and a version number that grows whenever the mask changes, so that a caller can tell
    /// whether a copy is out of date.
    pub fn get(&self, index: usize, sigma: f64) -> Result<(Arc<Saliency>, u64), Error> {
        let images = self.entries.len();
        let entry = self.entries.get(index).ok_or(Error::NoImage { index, images })?;
        // The value is replaced as a whole, so a lock poisoned by a panic still holds a valid value.
        let mut kept = entry.kept.lock().unwrap_or_else(PoisonError::into_inner);
        // Only the spectral gate depends on sigma.
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

    /// The masks of all images, in parallel.
    pub fn masks(&self, sigma: f64) -> Result<Vec<Plane>, Error> {
        let of = |index| Ok(self.get(index, sigma)?.0.mask.clone());
        (0..self.entries.len()).into_par_iter().map(of).collect()
    }

    /// Computes the masks of all images in parallel. `sigmas` holds one sigma per image.
    pub fn prepare(&self, sigmas: &[f64]) -> Result<(), Error> {
        Error::check("sigma", sigmas.len(), self.entries.len())?;
        sigmas.par_iter().enumerate().try_for_each(|(index, sigma)| self.get(index, *sigma).map(drop))
    }
}
