//! The coordinates of an OpenDroneMap project.
//!
//! A run with GPS or ground control moves the reconstruction, which OpenSfM leaves east, north and up of a place, into
//! the grid of a map, less an offset; what it was before stays beside it as `reconstruction.topocentric.json`. System
//! and offset stand in `odm_georeferencing/coords.txt`: a line with the name, a line with easting and northing.

use std::path::Path;

use super::Warning;
use crate::scene::{Coordinates, Geodetic};

/// The folder of a project that has both files.
const FOLDER: &str = "odm_georeferencing";
const BEFORE: &str = "reconstruction.topocentric.json";

/// The coordinates of `reconstruction`, a file of the project `dataset`; `origin` is the place that it names.
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

fn system_and_offset(text: &str) -> Option<(&str, [f64; 2])> {
    let mut lines = text.trim_start_matches('\u{feff}').lines();
    let crs = lines.next()?.trim();
    let mut numbers = lines.next()?.split_whitespace().map(|word| word.parse::<f64>().ok().filter(|v| v.is_finite()));
    let offset = [numbers.next()??, numbers.next()??];
    crs.contains(char::is_alphabetic).then_some((crs, offset))
}

/// The PROJ string, where there is one.
fn proj(dataset: &Path) -> Option<String> {
    let text = std::fs::read_to_string(dataset.join(FOLDER).join("proj.txt")).ok()?;
    let text = text.trim_start_matches('\u{feff}').trim();
    (!text.is_empty()).then(|| text.to_owned())
}
