//! The coordinates of an OpenDroneMap project.
//!
//! OpenSfM's reconstruction is in metres east, north and up of a reference. A run with GPS or ground control points
//! moves it into a map's grid less an offset, and keeps the original as `reconstruction.topocentric.json`. The file
//! `odm_georeferencing/coords.txt` names the grid's reference system in its first line, and easting and northing of the
//! offset in its second.
//! and offset stand in `odm_georeferencing/coords.txt`: a line with the name, a line with easting and northing.

use std::path::{Path, PathBuf};

use super::Warning;
use crate::scene::{Coordinates, Geodetic};

/// Folder of the project with the files of the grid.
const FOLDER: &str = "odm_georeferencing";
const BEFORE: &str = "reconstruction.topocentric.json";

/// The coordinates of `reconstruction`, a file of the project `dataset`. `origin` is the file's reference.
pub(super) fn coordinates(
    dataset: &Path,
    reconstruction: &Path,
    origin: Option<Geodetic>,
    warnings: &mut Vec<Warning>,
) -> Option<Coordinates> {
    let coords = dataset.join(FOLDER).join("coords.txt");
    let problem = match std::fs::read_to_string(&coords) {
        Ok(text) => match system_and_offset(&text) {
            Some((crs, offset)) => return Some(Coordinates::grid(crs, proj(dataset), offset)),
            None => "its first two lines are not the name of a reference system and two numbers".to_owned(),
        },
        Err(_) if !coords.exists() && !reconstruction.with_file_name(BEFORE).is_file() => {
            return origin.map(|origin| Coordinates::EastNorthUp { origin });
        }
        Err(problem) => problem.to_string(),
    };
    warnings.push(Warning::CoordinatesUnknown { file: coords, problem });
    None
}

/// The files of the project that say its grid.
pub(super) fn files(dataset: &Path) -> impl Iterator<Item = PathBuf> {
    ["coords.txt", "proj.txt"].map(|name| dataset.join(FOLDER).join(name)).into_iter().filter(|file| file.is_file())
}

fn system_and_offset(text: &str) -> Option<(&str, [f64; 2])> {
    let mut lines = text.trim_start_matches('\u{feff}').lines();
    let crs = lines.next()?.trim();
    let mut numbers = lines.next()?.split_whitespace().map(|word| word.parse::<f64>().ok().filter(|v| v.is_finite()));
    let offset = [numbers.next()??, numbers.next()??];
    crs.contains(char::is_alphabetic).then_some((crs, offset))
}

/// The PROJ string, if there is one.
fn proj(dataset: &Path) -> Option<String> {
    let text = std::fs::read_to_string(dataset.join(FOLDER).join("proj.txt")).ok()?;
    let text = text.trim_start_matches('\u{feff}').trim();
    (!text.is_empty()).then(|| text.to_owned())
}
