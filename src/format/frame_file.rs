//! `frame.json`: the scene's frame beside a model.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::{At, Error, atomic, read_text};
use crate::scene::{Coordinates, Frame, MapFrame};

/// Name of the file in the model's folder.
pub const FRAME_FILE: &str = "frame.json";

/// The relation between the coordinates of the scene, of model files and of the dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameFile {
    /// scene = (dataset - offset) * scale.
    #[serde(flatten)]
    pub frame: Frame,
    /// Positions in model files are dataset coordinates minus this shift.
    pub shift: [f64; 3],
    /// Where on Earth the dataset's coordinates lie, if the dataset says so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coordinates: Option<Coordinates>,
    /// The way from the dataset to a map, if one is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<MapFrame>,
}

impl FrameFile {
    /// The frame of a dataset, with the shift of its model files.
    pub fn new(frame: Frame, coordinates: Option<Coordinates>) -> Self {
        Self { frame, shift: frame.shift(), coordinates, map: None }
    }

    /// The same with the way to a map.
    pub fn with_map(self, map: Option<MapFrame>) -> Self {
        Self { map, ..self }
    }

    /// Writes the file.
    pub fn write(&self, file: &Path) -> Result<(), Error> {
        let text = serde_json::to_string_pretty(self).map_err(|e| Error::io(file, "write")(e.into()))?;
        atomic::write(file, |out| writeln!(out, "{text}"))
    }

    /// Reads the file.
    pub fn read(file: &Path) -> Result<Self, Error> {
        let text = read_text(file).map_err(Error::io(file, "read"))?;
        let read: Self = serde_json::from_str(&text)
            .map_err(|e| Error::malformed(file, "frame", At::Line(e.line().max(1) as u64), e))?;
        let usable = read.frame.scale.is_finite() && read.frame.scale > 0.0;
        if !(usable && read.frame.offset.iter().chain(&read.shift).all(|v| v.is_finite())) {
            return Err(Error::malformed(file, "frame", At::Line(1), "the scale must be positive, all numbers finite"));
        }
        Ok(read)
    }

    /// Reads the file beside a model, if it exists.
    pub fn beside(model: &Path) -> Result<Option<Self>, Error> {
        let file = model.with_file_name(FRAME_FILE);
        if file.is_file() { Self::read(&file).map(Some) } else { Ok(None) }
    }
}
