//! The checkpoints of a folder: the last two are kept, the newest that can be read is taken.

use std::fs;
use std::path::{Path, PathBuf};

use super::Checkpoint;
use crate::format::{Error, atomic};

/// A checkpoint found in a folder.
#[derive(Debug)]
pub struct Latest {
    /// Its step, from its name.
    pub step: u64,
    /// Its file.
    pub file: PathBuf,
    /// Its content.
    pub checkpoint: Checkpoint,
    /// Newer ones that cannot be read, and why: the user should be told.
    pub damaged: Vec<Error>,
}

/// The name of the checkpoint after a step.
pub fn file_name(step: u64) -> String {
    format!("checkpoint-{step:06}.ckpt")
}

/// Writes a checkpoint and then removes the others but the newest of the steps before it. A checkpoint of a later step goes
/// too: it belongs to a run that this one has replaced, and would otherwise be taken for the newest. Gives the file.
pub fn save(folder: &Path, step: u64, checkpoint: &Checkpoint) -> Result<PathBuf, Error> {
    let file = folder.join(file_name(step));
    atomic::remove_unfinished(folder, "checkpoint-");
    checkpoint.write(&file)?;
    let others: Vec<(u64, PathBuf)> = list(folder)?.into_iter().filter(|(s, _)| *s != step).collect();
    let previous = others.iter().map(|(s, _)| *s).filter(|s| *s < step).max();
    for (_, old) in others.iter().filter(|(s, _)| Some(*s) != previous) {
        fs::remove_file(old).map_err(Error::io(old, "remove the old checkpoint"))?;
    }
    Ok(file)
}

/// The newest checkpoint of a folder that can be read; `None` when there are none at all.
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

/// Step and file of the newest checkpoint of a folder by its name; its content is not looked at.
pub fn newest(folder: &Path) -> Option<(u64, PathBuf)> {
    list(folder).ok()?.into_iter().next()
}

/// The checkpoints by descending step.
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
