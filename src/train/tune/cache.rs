//! Variants chosen by earlier timings, in a JSON file beside the pipeline cache.

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::format::disk::System;
use crate::format::lock::Lock;
use crate::format::{Error, atomic, read_text};
use crate::raster::Variants;
use crate::train::Input;
use crate::vk::Caps;

const FILE: &str = "forms.json";
/// Held while the file is read and written again.
const LOCK: &str = "forms.lock";
/// Longest wait for the lock, which another process holds while it reads and writes a small file.
const PATIENCE: Duration = Duration::from_secs(5);
/// Most choices in the file; the oldest are dropped.
const MOST: usize = 200;

/// Size of a training in powers of four. Trainings of one class share a choice of variants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SizeClass {
    /// Half the binary logarithm of the number of splats.
    pub splats: u32,
    /// Half the binary logarithm of the pixels of the first view that a step looks at.
    pub pixels: u32,
}

impl SizeClass {
    /// The class of a training's input whose steps look at one of `bands` bands of a photograph.
    pub fn of(input: &Input, bands: u32) -> Self {
        let pixels = input.train.first().map_or(1, |v| u64::from(v.camera.width) * u64::from(v.camera.height));
        let half = |n: u64| n.max(1).ilog2() / 2;
        Self { splats: half(input.initial.len() as u64), pixels: half(pixels / u64::from(bands.max(1))) }
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct KeptChoice {
    device: String,
    driver: String,
    /// Version of this program.
    version: String,
    size: SizeClass,
    variants: Variants,
}

impl KeptChoice {
    fn new(caps: &Caps, size: SizeClass, variants: Variants) -> Self {
        let (device, driver, version) =
            (caps.device.clone(), caps.driver.clone(), env!("CARGO_PKG_VERSION").to_owned());
        Self { device, driver, version, size, variants }
    }

    fn is_for(&self, other: &Self) -> bool {
        (&self.device, &self.driver, &self.version, self.size)
            == (&other.device, &other.driver, &other.version, other.size)
    }
}

fn file(folder: &Path) -> PathBuf {
    folder.join(FILE)
}

fn read(folder: &Path) -> Result<Vec<KeptChoice>, String> {
    let path = file(folder);
    let text = match read_text(&path) {
        Ok(text) => text,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(e) => return Err(format!("{}: cannot read: {e}", path.display())),
    };
    serde_json::from_str(&text)
        .map_err(|e| format!("{}: variants of earlier timings cannot be read: {e}", path.display()))
}

/// The variants kept for a device and size. Returns a message if the file is damaged.
pub(super) fn find(folder: &Path, caps: &Caps, size: SizeClass) -> Result<Option<Variants>, String> {
    let entries = read(folder)?;
    let found = entries.iter().find(|entry| entry.is_for(&KeptChoice::new(caps, size, entry.variants)));
    Ok(found.map(|entry| entry.variants))
}

/// Keeps a choice, replacing an earlier one. A damaged file is replaced.
pub(super) fn keep(folder: &Path, caps: &Caps, size: SizeClass, variants: Variants) -> Result<(), Error> {
    add(folder, KeptChoice::new(caps, size, variants))
}

fn add(folder: &Path, new: KeptChoice) -> Result<(), Error> {
    std::fs::create_dir_all(folder).map_err(Error::io(folder, "create"))?;
    // Without the lock, a choice that another process adds meanwhile would be lost, but nothing else.
    let _held = Lock::wait(&folder.join(LOCK), &System, PATIENCE)?;
    let mut entries = read(folder).unwrap_or_default();
    entries.retain(|entry| !entry.is_for(&new));
    entries.push(new);
    let first = entries.len().saturating_sub(MOST);
    let path = file(folder);
    let text = serde_json::to_string_pretty(&entries[first..]).map_err(|e| Error::io(&path, "write")(e.into()))?;
    atomic::write(&path, |out| writeln!(out, "{text}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::{GradientSum, TileShape};

    /// Several trainings may begin at the same time.
    #[test]
    fn choices_that_are_kept_at_one_time_are_all_kept() {
        let folder = tempfile::tempdir().unwrap();
        let choice = |splats| KeptChoice {
            device: "d".into(),
            driver: "v".into(),
            version: "1".into(),
            size: SizeClass { splats, pixels: 1 },
            variants: Variants::new(TileShape::Pixel, GradientSum::Slots),
        };
        std::thread::scope(|scope| {
            for k in 0..8 {
                let path = folder.path();
                scope.spawn(move || (0..5).for_each(|i| add(path, choice(8 * i + k)).unwrap()));
            }
        });
        assert_eq!(read(folder.path()).unwrap().len(), 40);
    }
}
