//! `blocks.json`: the plan of a training in blocks.

mod check;
#[cfg(test)]
mod tests;

pub use check::is_inside;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{Cell, FileRecord, Ground};
use crate::format::{At, Error, atomic, read_text};
use crate::train::Settings;
use crate::train::settings::SettingsError;

/// Name of the plan in its folder.
pub const PLAN_FILE: &str = "blocks.json";
/// Name of the drawing beside it.
pub const PLAN_PICTURE: &str = "plan.svg";
/// The first word of a plan.
pub const FORMAT: &str = "psrgs-vk blocks";
/// The version that is written, and the only one that is read.
pub const VERSION: u32 = 1;

/// The plan of a training in blocks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanFile {
    /// [`FORMAT`].
    pub format: String,
    /// [`VERSION`].
    pub version: u32,
    /// Version of the program that wrote the plan.
    pub program: String,
    /// The dataset that the plan was made from.
    pub dataset: DatasetRecord,
    /// Settings of the training of the whole, as in a run folder's `settings.toml`.
    pub settings: String,
    /// Seed of the training.
    pub seed: u64,
    /// The ground on which the cells lie.
    pub ground: Ground,
    /// The coarse model of everything.
    pub global: GlobalModel,
    /// The blocks. Their cells are a partition of the ground.
    pub blocks: Vec<Block>,
}

/// The dataset that a plan was made from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DatasetRecord {
    /// Its folder.
    pub path: PathBuf,
    /// SHA-256 of the model's files together: of a line `SHA256  NAME` for each, sorted.
    pub model_sha256: String,
    /// Number of photographs, held-out ones included.
    pub photographs: usize,
    /// The model's files: those that say cameras and points.
    pub files: Vec<FileRecord>,
}

/// The coarse model of everything: far background of each block, and where exposures are solved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GlobalModel {
    /// Names of the photographs to train on.
    pub photographs: Vec<String>,
    /// Longer side of the photographs, in pixels.
    pub max_side: u32,
    /// Steps.
    pub steps: u32,
    /// Most splats.
    pub max_splats: u32,
}

/// A block: a cell, and the photographs to train on for it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Block {
    /// Name: `b` and digits.
    pub id: String,
    /// The part of the ground whose splats are those of this block.
    pub cell: Cell,
    /// How far outside of the cell the block is trained as finely as inside, in dataset units.
    pub margin: f64,
    /// The photographs to train on.
    pub photographs: Vec<PlannedPhotograph>,
    /// Steps.
    pub steps: u32,
    /// Splats that cell and margin are expected to need.
    pub predicted_splats: u64,
    /// Bytes of device memory that the training is expected to take.
    pub predicted_memory: u64,
    /// Seconds that the training is expected to take, if that is known.
    pub predicted_seconds: Option<f64>,
}

/// A photograph of a block.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannedPhotograph {
    /// Name of the view.
    pub name: String,
    /// Path inside the dataset's folder, with `/` between its parts; `None` where the photograph lies elsewhere.
    pub file: Option<String>,
    /// SHA-256 of the file, in lower-case hexadecimal digits.
    pub sha256: String,
    /// Length of the file in bytes.
    pub bytes: u64,
    /// Share of the photograph that sees cell and margin, from 0 to 1.
    pub share: f64,
    /// Its mask, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<FileRecord>,
}

/// What tells a plan from other files, read first: a foreign file lacks everything else too.
#[derive(Deserialize)]
struct Head {
    format: Option<String>,
    version: Option<u64>,
    program: Option<String>,
}

impl PlanFile {
    /// Reads and checks a plan. Foreign and damaged files, other versions, numbers that cannot be, and names that lead
    /// out of a folder are errors.
    pub fn read(file: &Path) -> Result<Self, Error> {
        let text = read_text(file).map_err(Error::io(file, "read"))?;
        Self::parse(&text, file)
    }

    /// As [`Self::read`], of a text. `file` is named in errors.
    pub fn parse(text: &str, file: &Path) -> Result<Self, Error> {
        let broken = |error: serde_json::Error| {
            let what = match error.classify() {
                serde_json::error::Category::Eof => "the plan ends too early: copy it whole, or plan anew".to_owned(),
                _ => format!("{error}; plan anew"),
            };
            Error::malformed(file, "plan", At::Line(error.line().max(1) as u64), what)
        };
        let head: Head = serde_json::from_str(text).map_err(broken)?;
        let refused = |field: &str, problem: String| Err(Error::malformed(file, field, At::Line(1), problem));
        match (head.format.as_deref(), head.version) {
            (Some(FORMAT), Some(version)) if version == u64::from(VERSION) => {}
            (Some(FORMAT), Some(version)) => {
                let by = head.program.unwrap_or_else(|| "?".to_owned());
                let problem =
                    format!("it is {version}, of psrgs-vk {by}, and this program reads {VERSION}: plan anew with it");
                return refused("version", problem);
            }
            (Some(FORMAT), None) => return refused("version", "there is none: plan anew".to_owned()),
            (Some(other), _) => return refused("format", format!("it is '{other}': this is no plan of blocks")),
            (None, _) => return refused("format", "there is none: this is no plan of blocks".to_owned()),
        }
        let plan: Self = serde_json::from_str(text).map_err(broken)?;
        match plan.problem() {
            None => Ok(plan),
            Some(problem) => {
                Err(Error::malformed(file, problem.field, At::Line(line_of(text, &problem.near)), problem.what))
            }
        }
    }

    /// Writes the plan, whole or not at all. A plan that could not be read again is an error.
    pub fn write(&self, file: &Path) -> Result<(), Error> {
        if let Some(problem) = self.problem() {
            let problem = format!("{}: {}", problem.field, problem.what);
            return Err(Error::Unwritable { file: file.to_owned(), what: "the plan", problem });
        }
        // No newline at the end: without its last byte the file is known to be cut off.
        atomic::write(file, |out| Ok(serde_json::to_writer_pretty(out, self)?))
    }

    /// The settings of the training of the whole.
    pub fn settings(&self) -> Result<Settings, SettingsError> {
        Settings::from_toml(&self.settings, Path::new(PLAN_FILE))
    }

    /// The block with a name.
    pub fn block(&self, id: &str) -> Option<&Block> {
        self.blocks.iter().find(|block| block.id == id)
    }

    /// Position of the block whose cell has a dataset point. `None` where the point is no number.
    pub fn owner(&self, point: [f64; 3]) -> Option<usize> {
        let place = self.ground.place(point);
        self.blocks.iter().position(|block| block.cell.contains(place))
    }
}

/// Line of the first place of a text, from 1.
fn line_of(text: &str, near: &str) -> u64 {
    let before = text.find(near).map_or("", |at| &text[..at]);
    1 + before.bytes().filter(|b| *b == b'\n').count() as u64
}
