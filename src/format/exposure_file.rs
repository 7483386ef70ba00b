//! `exposures.json`: how the photographs of a training were exposed.

use std::collections::BTreeMap;
use std::path::Path;

use super::{At, Error, atomic, read_text};
use crate::scene::ExposureMatrix;

/// The name of the file, in the folder of the run.
pub const EXPOSURE_FILE: &str = "exposures.json";

/// A 3x4 matrix for each training photograph, by name: what it shows of (r, g, b, 1) of the model, colours from 0 to 1.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(transparent)]
pub struct ExposureFile {
    /// Name and matrix, row by row.
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
