//! Recognises the files of a run by their content. No other file is ever removed or replaced.

use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use psrgs_vk::eval::is_report;
use psrgs_vk::format::checkpoint;
use psrgs_vk::format::{EXPOSURE_FILE, ExposureFile, FRAME_FILE, FrameFile};

use super::{CHECKPOINTS, METRICS, MODEL, RENDERS, REPORT, SETTINGS};
use crate::cli::stages::SIGMA_FILE;

/// Files that a run writes under fixed names.
const FIXED: [&str; 7] = [SETTINGS, MODEL, METRICS, REPORT, FRAME_FILE, EXPOSURE_FILE, SIGMA_FILE];
/// Bytes at the start of a file that are searched.
const BEGINNING: u64 = 1 << 16;

/// A file that the run would replace and that this program did not write.
pub(super) fn first_foreign(folder: &Path) -> Option<PathBuf> {
    let there = FIXED.iter().map(|name| folder.join(name)).filter(|file| file.symlink_metadata().is_ok());
    there.into_iter().find(|file| !is_ours(file))
}

/// A file in a folder without a run that has the name of a checkpoint, or lies in the folder of renders.
pub(super) fn first_stray(folder: &Path) -> Option<PathBuf> {
    let checkpoints = checkpoint::told_apart(&folder.join(CHECKPOINTS)).map_or(Vec::new(), |(_, others)| others);
    let of_a_run = [SETTINGS, METRICS].iter().any(|name| is_ours(&folder.join(name)));
    let mut renders = fs::read_dir(folder.join(RENDERS)).into_iter().flatten().flatten().filter(|_| !of_a_run);
    checkpoints.into_iter().next().or_else(|| renders.next().map(|entry| entry.path()))
}

/// Whether this program wrote a file under one of the fixed names. It never writes links.
pub(super) fn is_ours(file: &Path) -> bool {
    let name = file.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let regular = file.symlink_metadata().is_ok_and(|found| found.is_file());
    regular
        && match name {
            SETTINGS => is_settings(file),
            MODEL => is_model(file),
            REPORT => is_report(&beginning(file).unwrap_or_default()),
            METRICS => has_keys(file, &["method", "iterations", "splats", "seconds_per_iteration"]),
            SIGMA_FILE => has_keys(file, &["photographs", "curves"]),
            FRAME_FILE => FrameFile::read(file).is_ok(),
            EXPOSURE_FILE => ExposureFile::read(file).is_ok(),
            _ => false,
        }
}

/// Recognised by the first line, or in an edited file by the groups.
fn is_settings(file: &Path) -> bool {
    let Ok(text) = fs::read_to_string(file) else { return false };
    let has_run = |table: toml::Table| table.get("run").and_then(|run| run.get("method")).is_some();
    text.starts_with("# Reproduces this run: psrgs-vk ") || toml::from_str(&text).is_ok_and(has_run)
}

/// Recognised by the comments of the header.
fn is_model(file: &Path) -> bool {
    let Ok(text) = beginning(file) else { return false };
    let header = text.split("end_header").next().unwrap_or_default();
    header.starts_with("ply") && header.contains("\ncomment psrgs-vk ")
}

fn has_keys(file: &Path, keys: &[&str]) -> bool {
    let Ok(opened) = File::open(file) else { return false };
    let read: Result<serde_json::Value, _> = serde_json::from_reader(io::BufReader::new(opened));
    read.is_ok_and(|value| keys.iter().all(|key| value.get(key).is_some()))
}

/// The first bytes of a file as text.
fn beginning(file: &Path) -> io::Result<String> {
    let mut bytes = Vec::new();
    File::open(file)?.take(BEGINNING).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_others_under_the_names_of_results_are_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in [
            (SETTINGS, "[server]\nport = 80\n"),
            (MODEL, "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 0\nend_header\ncomment psrgs-vk \n"),
            (METRICS, "{\"accuracy\": 0.9}"),
            (REPORT, "<!doctype html><title>Quarterly report</title>"),
            (FRAME_FILE, "{\"frame\": 3}"),
            (EXPOSURE_FILE, "[1, 2]"),
            (SIGMA_FILE, "{\"sigma\": 0.5}"),
        ] {
            let file = folder.path().join(name);
            fs::write(&file, text).unwrap();
            assert!(!is_ours(&file), "{name}");
            assert_eq!(first_foreign(folder.path()).as_ref(), Some(&file));
            fs::remove_file(file).unwrap();
        }
        assert_eq!(first_foreign(folder.path()), None);
    }
}
