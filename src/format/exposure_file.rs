//! `exposures.json`: the exposures of the training photographs.

use std::collections::BTreeMap;
use std::path::Path;

use super::{At, Error, atomic, read_text};
use crate::scene::ExposureMatrix;

/// Name of the file in the run's folder.
pub const EXPOSURE_FILE: &str = "exposures.json";

/// A 3x4 matrix per training photograph, which maps the model's colour (r, g, b, 1) to the photograph's. Colours are
/// from 0 to 1.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(transparent)]
pub struct ExposureFile {
    /// Matrix (row by row) by the photograph's name.
    pub photographs: BTreeMap<String, ExposureMatrix>,
}

impl ExposureFile {
    /// Writes the file.
    pub fn write(&self, file: &Path) -> Result<(), Error> {
        let text = serde_json::to_string_pretty(self).map_err(|e| Error::io(file, "write")(e.into()))?;
        atomic::write(file, |out| writeln!(out, "{text}"))
    }

    /// Reads the file.
    pub fn read(file: &Path) -> Result<Self, Error> {
        let text = read_text(file).map_err(Error::io(file, "read"))?;
        serde_json::from_str(&text)
            .map_err(|e| Error::malformed(file, "exposures", At::Line(e.line().max(1) as u64), e))
    }
}
