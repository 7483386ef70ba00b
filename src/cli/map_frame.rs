//! The place on a map that the files beside a model tell.

use std::path::Path;

use psrgs_vk::format::splats::placement::file_beside;
use psrgs_vk::format::{FrameFile, read_text};
use psrgs_vk::scene::MapFrame;

use super::console::Console;
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
