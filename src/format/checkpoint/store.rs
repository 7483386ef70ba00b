//! The checkpoints of a folder: the last two are kept, and the newest readable one is loaded.

use std::fs::{self, File};
use std::io::Read as _;
use std::path::{Path, PathBuf};

use super::{Checkpoint, MAGIC};
use crate::format::{Error, atomic};

/// A checkpoint found in a folder.
#[derive(Debug)]
pub struct Latest {
    /// Step, from the file's name.
    pub step: u64,
    /// Its file.
    pub file: PathBuf,
    /// Its content.
    pub checkpoint: Checkpoint,
    /// Errors of newer checkpoints that cannot be read, for a warning.
    pub damaged: Vec<Error>,
}

/// File name of the checkpoint of a step.
pub fn file_name(step: u64) -> String {
    format!("checkpoint-{step:06}.ckpt")
}

/// Writes a checkpoint, and then removes all others except the newest of an earlier step. Checkpoints of later steps
/// belong to a replaced run and would be taken for the newest, so they are removed too. A file that only has the name
/// of a checkpoint stays. Returns the new file.
pub fn save(folder: &Path, step: u64, checkpoint: &Checkpoint) -> Result<PathBuf, Error> {
    let file = folder.join(file_name(step));
    atomic::remove_unfinished(folder);
    checkpoint.write(&file)?;
    let others = list(folder)?.into_iter().filter(|(s, file)| *s != step && is_checkpoint(file));
    let others: Vec<(u64, PathBuf)> = others.collect();
    let previous = others.iter().map(|(s, _)| *s).filter(|s| *s < step).max();
    for (_, old) in others.iter().filter(|(s, _)| Some(*s) != previous) {
        fs::remove_file(old).map_err(Error::io(old, "remove the old checkpoint"))?;
    }
    Ok(file)
}

/// The newest readable checkpoint of a folder; `None` without any checkpoint.
pub fn latest(folder: &Path) -> Result<Option<Latest>, Error> {
    let mut damaged = Vec::new();
    for (step, file) in list(folder)? {
        match Checkpoint::read(&file) {
            Ok(checkpoint) => return Ok(Some(Latest { step, file, checkpoint, damaged })),
            Err(e) => damaged.push(e),
        }
    }
    if damaged.is_empty() {
        return Ok(None);
    }
    let problems = damaged.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
    Err(Error::NoValidCheckpoint { folder: folder.to_owned(), problems })
}

/// Step and file of the newest checkpoint by name, without reading it.
pub fn newest(folder: &Path) -> Option<(u64, PathBuf)> {
    list(folder).ok()?.into_iter().next()
}

/// The files of a folder that are checkpoints by name and content, and those that are so by name only.
pub fn told_apart(folder: &Path) -> Result<(Vec<PathBuf>, Vec<PathBuf>), Error> {
    Ok(list(folder)?.into_iter().map(|(_, file)| file).partition(|file| is_checkpoint(file)))
}

/// Whether a file begins like a checkpoint. Links do not count: the target may belong to another run.
fn is_checkpoint(file: &Path) -> bool {
    let mut magic = [0; MAGIC.len()];
    let regular = file.symlink_metadata().is_ok_and(|found| found.is_file());
    regular && File::open(file).and_then(|mut opened| opened.read_exact(&mut magic)).is_ok() && magic == MAGIC
}

/// The checkpoints in descending order of the step.
fn list(folder: &Path) -> Result<Vec<(u64, PathBuf)>, Error> {
    let mut out = Vec::new();
    for entry in fs::read_dir(folder).map_err(Error::io(folder, "list"))? {
        let path = entry.map_err(Error::io(folder, "list"))?.path();
        if let Some(step) = path.file_name().and_then(|n| n.to_str()).and_then(step_of) {
            out.push((step, path));
        }
    }
    out.sort_by(|a, b| b.cmp(a));
    Ok(out)
}

fn step_of(name: &str) -> Option<u64> {
    let digits = name.strip_prefix("checkpoint-")?.strip_suffix(".ckpt")?;
    digits.bytes().all(|b| b.is_ascii_digit()).then(|| digits.parse().ok()).flatten()
}
