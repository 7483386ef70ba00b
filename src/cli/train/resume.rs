//! Resumes an interrupted training.

use std::path::Path;

use anyhow::Context as _;
use psrgs_vk::format::checkpoint;
use psrgs_vk::train::{Checkpointed, Restart, Schedule, Settings};

use super::RunPlan;
use super::unchanged_on_resume;
use crate::cli::console::Console;
use crate::cli::exit::Failure;
use crate::cli::run_folder::RunFolder;

/// The run's last checkpoint, where the run is resumed and has one.
pub(super) fn restart(plan: &RunPlan, folder: &RunFolder, console: &Console) -> anyhow::Result<Option<Restart>> {
    if !plan.resume {
        return Ok(None);
    }
    let Some(latest) = checkpoint::latest(&folder.checkpoints())? else {
        console.warn("there is no checkpoint yet: starting from the beginning");
        return Ok(None);
    };
    for problem in &latest.damaged {
        console.warn(problem);
    }
    let found = Checkpointed::from_checkpoint(&latest.checkpoint)
        .with_context(|| Failure::Input(latest.file.display().to_string()))?;
    console.say(format_args!("going on after step {} of {}", found.restart.step, latest.file.display()));
    let former = as_it_was_saved(&plan.settings, &found.settings, &latest.file, console)?;
    fits_what_is_done(&plan.settings, former, found.restart.step)?;
    Ok(Some(found.restart))
}

/// Compares the settings with those of the checkpoint, because the settings file may have been edited. Fails for
/// changes that a resumed run cannot take, and prints the others. Returns the number of steps that the run was to have.
fn as_it_was_saved(settings: &Settings, saved: &str, file: &Path, console: &Console) -> anyhow::Result<Option<u32>> {
    let before = match Settings::from_toml(saved, file) {
        Ok(before) => before,
        Err(problem) => {
            console.warn(format_args!("settings cannot be compared with those of the checkpoint: {problem}"));
            return Ok(None);
        }
    };
    unchanged_on_resume(&before, settings, &file.display().to_string())?;
    for (key, now, was) in settings.differences(&before)? {
        console.say(format_args!("{key} is {now} from here on, and was {was}"));
    }
    Ok(Some(before.run.iterations))
}

/// Checks a changed number of steps: the run must not be past it, and no finished stage may begin again.
fn fits_what_is_done(settings: &Settings, former: Option<u32>, step: u32) -> anyhow::Result<()> {
    let iterations = settings.run.iterations;
    let wrong = |problem: String| Err(Failure::Usage(format!("--iterations {iterations}: {problem}")).into());
    if step > iterations {
        return wrong(format!("the run is at step {step} already; give at least that many"));
    }
    match former.and_then(|former| Schedule::begins_again(settings, former, step)) {
        Some(stage) => wrong(format!(
            "the run is at step {step}, and a stage that is over ({stage}) would begin again, as it is a share of all \
             steps; give fewer, or train anew from its model with --init"
        )),
        None => Ok(()),
    }
}
