//! Where a training that was interrupted goes on.

use anyhow::Context as _;
use psrgs_vk::format::checkpoint;
use psrgs_vk::train::{Checkpointed, Restart, Schedule, Settings};

use crate::cli::console::Console;
use crate::cli::exit::Failure;
use crate::cli::run_folder::RunFolder;
use crate::cli::train::Plan;

/// What the last checkpoint of the run has, where it is to go on and there is one yet.
pub(super) fn restart(plan: &Plan, folder: &RunFolder, console: &Console) -> anyhow::Result<Option<Restart>> {
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
    fits_what_is_done(&plan.settings, plan.former, found.restart.step)?;
    Ok(Some(found.restart))
}

/// Another number of steps is one that the run has not passed yet, and in which no stage that is over begins again.
fn fits_what_is_done(settings: &Settings, former: Option<u32>, step: u32) -> anyhow::Result<()> {
    let iterations = settings.run.iterations;
    let wrong = |problem: String| Err(Failure::Usage(format!("--iterations {iterations}: {problem}")).into());
    if step > iterations {
        return wrong(format!("the run is at step {step} already; give at least that many"));
    }
    match former.and_then(|former| Schedule::begins_again(settings, former, step)) {
        Some(stage) => wrong(format!(
            "the run is at step {step}, and a stage that is over ({stage}) would begin again, as it is a share of all steps; give fewer, \
             or train anew from its model with --init"
        )),
        None => Ok(()),
    }
}
