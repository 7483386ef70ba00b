//! The place on a map that the files beside a model tell.

use std::path::{Path, PathBuf};

use psrgs_vk::format::splats::placement::file_beside;
use psrgs_vk::format::{FRAME_FILE, FrameFile, read_text};
use psrgs_vk::geodesy::Georeference;
use psrgs_vk::scene::MapFrame;

use super::console::Console;
use super::exit::Failure;
use super::model_frame::FrameArgs;

/// A part of the file beside an exported model.
#[derive(serde::Deserialize)]
struct Beside {
    map: Option<MapFrame>,
}

/// The place on a map of the dataset that a model was trained on: by the file beside an exported model, else by
/// `frame.json`. `None` where neither says so, or the model's coordinates are given otherwise.
pub(crate) fn of_model(model: &Path, frame: &FrameArgs, console: &Console) -> Option<MapFrame> {
    if frame.frame.is_some() {
        return None;
    }
    let beside = file_beside(model);
    if beside.is_file() {
        let text = read_text(&beside).ok()?;
        return serde_json::from_str::<Beside>(&text).ok()?.map;
    }
    match FrameFile::beside(model) {
        Ok(found) => found.and_then(|found| found.map),
        Err(problem) => {
            console.warn(format_args!("{problem}; the place on a map is not passed on"));
            None
        }
    }
}

/// The way to the map from the dataset that a model was trained on, and the file beside the model that tells the way:
/// that of an export, else `frame.json`.
pub(crate) fn georeference(model: &Path) -> anyhow::Result<Option<(Georeference, PathBuf)>> {
    let beside = file_beside(model);
    let (record, file) = if beside.is_file() {
        let failed = |problem: &dyn std::fmt::Display| Failure::Input(format!("{}: {problem}", beside.display()));
        let text = read_text(&beside).map_err(|problem| failed(&problem))?;
        let told: Beside = serde_json::from_str(&text).map_err(|problem| failed(&problem))?;
        (told.map.map(|map| (map, None)), beside)
    } else {
        let told = FrameFile::beside(model)?;
        let file = model.with_file_name(FRAME_FILE);
        (told.and_then(|told| Some((told.map?, told.coordinates))), file)
    };
    let Some((map, coordinates)) = record else { return Ok(None) };
    let found = Georeference::of_record(&map, coordinates.as_ref())
        .map_err(|problem| Failure::Input(format!("{}: {problem}", file.display())))?;
    Ok(Some((found, file)))
}
