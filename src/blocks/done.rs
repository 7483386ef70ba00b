//! `done.json`: what a finished training of a block, or of the coarse model of everything, leaves behind.

use std::fmt;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::sha256_of;
use crate::format::{At, Error, atomic, read_text};

/// Name of the file in a block's folder.
pub const DONE_FILE: &str = "done.json";
/// The first word of the file.
const FORMAT: &str = "psrgs-vk block";
/// The version that is written, and the only one that is read.
const VERSION: u32 = 1;

/// A training that is done. The file is written last, when the model is in its place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DoneFile {
    /// Always the same word.
    pub format: String,
    /// Version of the layout.
    pub version: u32,
    /// What it was trained for.
    #[serde(flatten)]
    pub origin: Origin,
    /// SHA-256 of the model.
    pub model_sha256: String,
    /// Splats of the model, those outside of the cell included.
    pub splats: u64,
    /// Seconds of the training, earlier stretches included.
    pub seconds: f64,
    /// Some numbers of the training's `metrics.json`.
    pub metrics: BlockMetrics,
}

/// What a training is for. A training that has begun has this in [`BEGUN_FILE`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// Version of the program that trains.
    pub program: String,
    /// SHA-256 of the plan.
    pub plan_sha256: String,
    /// Name of the block, or [`GLOBAL`].
    pub block: String,
    /// SHA-256 of the coarse model of everything that the block is trained with; absent for that model itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub global_sha256: Option<String>,
}

/// Name of the file in a block's folder that says what its training is for.
pub const BEGUN_FILE: &str = "begun.json";

/// Name of the coarse model of everything, and of its folder.
pub const GLOBAL: &str = "global";

/// Numbers of a training, as in `metrics.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct BlockMetrics {
    /// Steps.
    pub iterations: u32,
    /// Photographs to train on.
    pub train_images: usize,
    /// PSNR of held-out photographs, if there are any.
    pub psnr: Option<f64>,
    /// PSNR of photographs trained on, which show more than the block.
    pub psnr_training: Option<f64>,
    /// Seconds of stereo.
    pub seconds_stereo: f64,
    /// Largest device memory in bytes.
    pub peak_device_bytes: u64,
}

/// Why a model may not be used for a plan.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stale {
    /// `done.json` belongs to another block.
    OtherBlock(String),
    /// It was trained for another plan.
    OtherPlan,
    /// Another version of the program trained it.
    OtherProgram(String),
    /// The model is gone.
    NoModel,
    /// The model is not the one that was trained.
    OtherModel,
}

impl fmt::Display for Stale {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OtherBlock(block) => write!(f, "it is of another block, {block}"),
            Self::OtherPlan => f.write_str("it was trained for another plan"),
            Self::OtherProgram(version) => {
                write!(f, "psrgs-vk {version} trained it, and this is {}", env!("CARGO_PKG_VERSION"))
            }
            Self::NoModel => f.write_str("its model is gone"),
            Self::OtherModel => f.write_str("its model has changed since it was trained, or was not copied whole"),
        }
    }
}

impl Origin {
    /// Of a training by this program.
    pub fn new(plan_sha256: &str, block: &str, global_sha256: Option<&str>) -> Self {
        Self {
            program: env!("CARGO_PKG_VERSION").to_owned(),
            plan_sha256: plan_sha256.to_owned(),
            block: block.to_owned(),
            global_sha256: global_sha256.map(str::to_owned),
        }
    }

    /// Reads the origin of a training that has begun.
    pub fn read(file: &Path) -> Result<Self, Error> {
        let text = read_text(file).map_err(Error::io(file, "read"))?;
        serde_json::from_str(&text).map_err(|e| {
            Error::malformed(
                file,
                "content",
                At::Line(e.line().max(1) as u64),
                format!("{e}; remove it to train again"),
            )
        })
    }

    /// Writes the origin, whole or not at all.
    pub fn write(&self, file: &Path) -> Result<(), Error> {
        write_json(self, file)
    }

    /// Why a training of this origin is none for `wanted`. Their coarse models may differ.
    pub fn stale(&self, wanted: &Self) -> Option<Stale> {
        if self.block != wanted.block {
            return Some(Stale::OtherBlock(self.block.clone()));
        }
        if self.plan_sha256 != wanted.plan_sha256 {
            return Some(Stale::OtherPlan);
        }
        (self.program != wanted.program).then(|| Stale::OtherProgram(self.program.clone()))
    }
}

fn write_json(value: &impl Serialize, file: &Path) -> Result<(), Error> {
    let text = serde_json::to_string_pretty(value).map_err(|e| Error::io(file, "write")(e.into()))?;
    atomic::write(file, |out| writeln!(out, "{text}"))
}

impl DoneFile {
    /// Of a model that lies in its place.
    pub fn of_model(
        origin: Origin,
        model: &Path,
        (splats, seconds): (u64, f64),
        metrics: BlockMetrics,
    ) -> Result<Self, Error> {
        let model_sha256 = sha256_of(model)?.0;
        Ok(Self { format: FORMAT.to_owned(), version: VERSION, origin, model_sha256, splats, seconds, metrics })
    }

    /// Reads a file. Foreign and damaged files are errors.
    pub fn read(file: &Path) -> Result<Self, Error> {
        let text = read_text(file).map_err(Error::io(file, "read"))?;
        let wrong = |field: &str, line: usize, problem: String| {
            Error::malformed(file, field, At::Line(line.max(1) as u64), format!("{problem}; remove it to train again"))
        };
        let value: serde_json::Value =
            serde_json::from_str(&text).map_err(|e| wrong("content", e.line(), format!("{e}")))?;
        if value.get("format").and_then(serde_json::Value::as_str) != Some(FORMAT) {
            return Err(wrong("format", 1, format!("it is not '{FORMAT}'")));
        }
        if value.get("version").and_then(serde_json::Value::as_u64) != Some(u64::from(VERSION)) {
            return Err(wrong("version", 1, format!("it is not {VERSION}")));
        }
        serde_json::from_value(value).map_err(|e| wrong("content", 1, format!("{e}")))
    }

    /// Writes the file, whole or not at all.
    pub fn write(&self, file: &Path) -> Result<(), Error> {
        write_json(self, file)
    }

    /// Why this is not done for `wanted`, the content of the model included.
    pub fn stale(&self, wanted: &Origin, model: &Path) -> Result<Option<Stale>, Error> {
        if let Some(stale) = self.origin.stale(wanted) {
            return Ok(Some(stale));
        }
        if !model.is_file() {
            return Ok(Some(Stale::NoModel));
        }
        Ok((sha256_of(model)?.0 != self.model_sha256).then_some(Stale::OtherModel))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn wanted() -> Origin {
        Origin::new("aa", "b01", Some("cc"))
    }

    fn done(folder: &Path) -> DoneFile {
        let model = folder.join("point_cloud.ply");
        fs::write(&model, "splats").unwrap();
        DoneFile::of_model(wanted(), &model, (7, 2.5), BlockMetrics { iterations: 40, ..BlockMetrics::default() })
            .unwrap()
    }

    #[test]
    fn a_done_file_is_read_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let (written, file) = (done(folder.path()), folder.path().join(DONE_FILE));
        written.write(&file).unwrap();
        assert_eq!(DoneFile::read(&file).unwrap(), written);
    }

    #[test]
    fn each_way_to_be_stale_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("point_cloud.ply");
        let good = done(folder.path());
        let stale = |done: &DoneFile| done.stale(&wanted(), &model).unwrap();
        assert_eq!(stale(&good), None);
        let other = |change: fn(&mut DoneFile)| {
            let mut done = good.clone();
            change(&mut done);
            done
        };
        for (changed, expected) in [
            (other(|d| d.origin.block = "b02".into()), Stale::OtherBlock("b02".into())),
            (other(|d| d.origin.plan_sha256 = "bb".into()), Stale::OtherPlan),
            (other(|d| d.origin.program = "0.0.9".into()), Stale::OtherProgram("0.0.9".into())),
            (other(|d| d.model_sha256 = "ff".into()), Stale::OtherModel),
        ] {
            assert_eq!(stale(&changed), Some(expected));
        }
        fs::write(&model, "splat").unwrap();
        assert_eq!(stale(&good), Some(Stale::OtherModel));
        fs::remove_file(&model).unwrap();
        assert_eq!(stale(&good), Some(Stale::NoModel));
    }

    #[test]
    fn foreign_and_truncated_files_are_refused_with_their_name() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join(DONE_FILE);
        done(folder.path()).write(&file).unwrap();
        let whole = fs::read_to_string(&file).unwrap();
        let foreign = ["{}", "[1]", "done", r#"{"format": "psrgs-vk blocks", "version": 1}"#].map(str::to_owned);
        let version = whole.replace("\"version\": 1", "\"version\": 9");
        let cut = (0..whole.len() - 2).step_by(7).map(|bytes| whole[..bytes].to_owned());
        for text in cut.chain(foreign).chain([version, whole.replace("\"splats\": 7", "\"splats\": -7")]) {
            fs::write(&file, &text).unwrap();
            let problem = DoneFile::read(&file).unwrap_err().to_string();
            assert!(problem.contains(DONE_FILE) && problem.contains("remove it"), "{text}: {problem}");
        }
    }
}
