//! The training of a block, or of the coarse model of everything, as a training in a folder of its own.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use psrgs_vk::blocks::{BEGUN_FILE, BlockMetrics, DONE_FILE, DoneFile, Origin, PlannedPhotograph, changed_photograph};
use psrgs_vk::dataset::{Dataset, LoadOptions, Role};
use psrgs_vk::eval::Exposures;
use psrgs_vk::format::ply::{self, Splats};
use psrgs_vk::format::{EXPOSURE_FILE, ExposureFile, atomic};
use psrgs_vk::scene::{Camera, ExposureMatrix, Region};
use psrgs_vk::train::{Part, Settings, prepare};

use crate::cli::exit::Failure;
use crate::cli::run_folder::{METRICS, MODEL, RunFolder};

/// What a training of a part has besides settings and a folder.
#[derive(Debug)]
pub(crate) struct PartRun {
    /// Names of the photographs.
    pub(crate) names: BTreeSet<String>,
    /// Those that are compared with the plan before the training.
    pub(super) photographs: Vec<PlannedPhotograph>,
    /// What the training is for.
    pub(super) origin: Origin,
    /// Cell and margin in dataset units, and the folder of the coarse model; `None` for the coarse model itself.
    pub(super) within: Option<(Region, f64, PathBuf)>,
    /// Steps of the whole, of which those of a block are a share.
    pub(super) whole_steps: u32,
    /// The command that goes on with the training.
    pub(crate) again: String,
}

/// A file of the dataset that is not the one of the plan.
pub(super) fn changed(file: &Path) -> Failure {
    Failure::Input(format!(
        "{}: this file has changed since the plan was made: put the former file there, plan anew, or name the dataset \
         of the plan with --data",
        file.display()
    ))
}

impl PartRun {
    /// Refuses photographs other than those of the plan.
    pub(crate) fn compare(&self, dataset: &Dataset) -> anyhow::Result<()> {
        match changed_photograph(dataset, &self.photographs)? {
            Some(file) => Err(changed(&file).into()),
            None => Ok(()),
        }
    }

    /// The part of the scene to train.
    pub(crate) fn of(&self, dataset: &Dataset, settings: &Settings) -> anyhow::Result<Part> {
        let Some((cell, margin, global)) = &self.within else { return Ok(Part::default()) };
        let trained_on = dataset.views_of(Role::Train).filter_map(|(index, _)| dataset.scene_camera(index));
        let cameras: Vec<Camera> = trained_on.collect();
        let coarse = ply::read(&global.join(MODEL))?.in_scene(&dataset.frame);
        let frame = &dataset.frame;
        let part = Part::new(cell.in_scene(frame), margin * frame.scale, &coarse, &cameras);
        let exposures = exposures(global, dataset, settings)?;
        Ok(Part { exposures, whole_steps: Some(self.whole_steps), ..part })
    }

    /// Results of an earlier training in the folder count no more from here on.
    pub(crate) fn forget(&self, folder: &RunFolder) -> anyhow::Result<()> {
        Ok(atomic::remove(&folder.file(DONE_FILE))?)
    }

    /// Says in the folder what is trained there, when nothing of an earlier training is left.
    pub(crate) fn begin(&self, folder: &RunFolder) -> anyhow::Result<()> {
        Ok(self.origin.write(&folder.file(BEGUN_FILE))?)
    }

    /// Says in the folder that the training is done, after all its results are in their places.
    pub(crate) fn publish(&self, folder: &RunFolder) -> anyhow::Result<()> {
        let (metrics, seconds) = numbers(&folder.file(METRICS))?;
        let model = folder.file(MODEL);
        let splats = Splats::open(&model)?.count;
        let done = DoneFile::of_model(self.origin.clone(), &model, (splats, seconds), metrics)?;
        Ok(done.write(&folder.file(DONE_FILE))?)
    }
}

/// Numbers of a training, and its seconds.
fn numbers(file: &Path) -> anyhow::Result<(BlockMetrics, f64)> {
    let text = fs::read_to_string(file).with_context(|| Failure::Output(file.display().to_string()))?;
    let metrics = serde_json::from_str(&text).with_context(|| file.display().to_string())?;
    let all: serde_json::Value = serde_json::from_str(&text).with_context(|| file.display().to_string())?;
    Ok((metrics, all.get("seconds").and_then(serde_json::Value::as_f64).unwrap_or(0.0)))
}

/// The exposures of the photographs to train on: as the coarse model has solved them, or, of a photograph that it has
/// not looked at, as those of its neighbours say. `None` where the coarse model has none.
fn exposures(
    global: &Path,
    dataset: &Dataset,
    settings: &Settings,
) -> anyhow::Result<Option<BTreeMap<String, ExposureMatrix>>> {
    let file = global.join(EXPOSURE_FILE);
    if !file.is_file() {
        return Ok(None);
    }
    let mut solved = ExposureFile::read(&file)?.photographs;
    let trained_on = || dataset.views_of(Role::Train).map(|(_, view)| view);
    let unsolved: Vec<_> = trained_on().filter(|view| !solved.contains_key(&view.name)).collect();
    if !unsolved.is_empty() {
        let options = LoadOptions { photographs: false, ..prepare::load_options_of(settings) };
        let whole = Dataset::load(&dataset.path, &options)?;
        let centre = |camera: &Camera| whole.frame.camera_to_scene(camera).center();
        let known = whole.views.iter();
        let known = known.filter_map(|v| Some((v.name.clone(), *solved.get(&v.name)?, centre(&v.camera))));
        let expected = Exposures::new(known);
        let more: Vec<_> = unsolved.iter().map(|v| (v.name.clone(), expected.of(&v.name, centre(&v.camera)))).collect();
        solved.extend(more);
    }
    Ok(Some(solved))
}
