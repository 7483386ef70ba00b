//! Choices of earlier timings: a JSON file beside the pipeline cache.

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
/// The longest that a process waits for another one, which holds the lock for the time of a small file.
const PATIENCE: Duration = Duration::from_secs(5);
/// More are not kept: the oldest go.
const MOST: usize = 200;

/// How large a training is, in powers of four: within one the same form is taken to be the best.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SizeClass {
    /// Half the binary logarithm of the number of splats.
    pub splats: u32,
    /// Half the binary logarithm of the pixels that a step looks at, of the first view.
    pub pixels: u32,
}

impl SizeClass {
    /// Of a training's input, whose photographs are looked at in so many bands.
    pub fn of(input: &Input, bands: u32) -> Self {
        let pixels = input.train.first().map_or(1, |v| u64::from(v.camera.width) * u64::from(v.camera.height));
        let half = |n: u64| n.max(1).ilog2() / 2;
        Self { splats: half(input.initial.len() as u64), pixels: half(pixels / u64::from(bands.max(1))) }
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Entry {
    device: String,
    driver: String,
    /// Of this program.
    version: String,
    size: SizeClass,
    variants: Variants,
}

impl Entry {
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

fn read(folder: &Path) -> Result<Vec<Entry>, String> {
    let path = file(folder);
    let text = match read_text(&path) {
        Ok(text) => text,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(e) => return Err(format!("{}: cannot read: {e}", path.display())),
    };
    serde_json::from_str(&text)
        .map_err(|e| format!("{}: variants of earlier timings cannot be read: {e}", path.display()))
}

/// The variants kept for a device and size; an error in words where the file is damaged.
pub(super) fn find(folder: &Path, caps: &Caps, size: SizeClass) -> Result<Option<Variants>, String> {
    let entries = read(folder)?;
    let found = entries.iter().find(|entry| entry.is_for(&Entry::new(caps, size, entry.variants)));
    Ok(found.map(|entry| entry.variants))
}

/// Keeps a choice in place of an earlier one; a damaged file is replaced.
pub(super) fn keep(folder: &Path, caps: &Caps, size: SizeClass, variants: Variants) -> Result<(), Error> {
    add(folder, Entry::new(caps, size, variants))
}

fn add(folder: &Path, new: Entry) -> Result<(), Error> {
    std::fs::create_dir_all(folder).map_err(Error::io(folder, "create"))?;
    // Else what another process adds meanwhile would be lost. Without locks, or where one is not let go of, that is all that is lost.
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

    /// As several trainings do that begin at the same time.
    #[test]
    fn choices_that_are_kept_at_one_time_are_all_kept() {
        let folder = tempfile::tempdir().unwrap();
        let choice = |splats| Entry {
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
