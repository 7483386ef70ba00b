//! A training from the open run folder to the last file, with its messages.

use std::time::Instant;

use anyhow::Context as _;
use psrgs_vk::dataset::Dataset;
use psrgs_vk::train::prepare::{Setup, SetupRequest};
use psrgs_vk::train::{Trainer, prepare};
use psrgs_vk::view::{Server, State};

use super::RunPlan;
use super::watched::{self, Watched};
use super::{resume, run_loop, startup_log};
use crate::cli::console::Console;
use crate::cli::exit::Failure;
use crate::cli::finished::Finished;
use crate::cli::interrupt::Interrupt;
use crate::cli::lpips::Lpips;
use crate::cli::outputs;
use crate::cli::run_folder::{self, RunFolder};
use crate::cli::{device, output_guard};

/// Trains as planned. `started` is the start of the process.
pub(crate) fn train(plan: &RunPlan, interrupt: &Interrupt, console: &Console, started: Instant) -> anyhow::Result<()> {
    interrupt.ends_at_once("stopped before the first step: there is nothing to save".to_owned());
    if let Some(address) = &plan.view {
        Server::check(address).map_err(|error| Failure::Usage(error.to_string()))?;
    }
    let mut dataset = load(plan, console)?;
    if let Some(part) = &plan.part {
        part.compare(&dataset)?;
    }
    if !plan.resume {
        output_guard::check(&plan.out, &dataset)?;
    }
    // The folder is created after the dataset is found, so that a wrong path leaves no folder behind.
    let folder = RunFolder::open(plan)?;
    folder.warnings().iter().for_each(|warning| console.warn(warning));
    startup_log::dataset(&dataset, console);
    let mut lpips = Lpips::find(&plan.settings.scoring, console)?;
    let restart = resume::restart(plan, &folder, console)?;
    let gpu = device::open(&plan.settings.device, false, console)?;
    let cache = device::cache_folder();
    let request = SetupRequest {
        settings: &plan.settings,
        dataset: &dataset,
        weights: lpips.weights(),
        restart,
        part: plan.part.as_ref().map(|part| part.of(&dataset, &plan.settings)).transpose()?,
        keep_no_photographs: plan.keep_no_photographs,
        cache: cache.as_deref(),
    };
    let setup = Setup::prepare(&gpu, request, &mut |event| startup_log::event(&event, console))?;
    dataset.leave_out(&setup.input.optional.undecoded);
    startup_log::setup(&setup, &dataset, console);
    startup_log::demands(&setup, &gpu, console)?;

    let Setup { settings, input, restart, host, stereo_seconds, .. } = setup;
    let (done, earlier_seconds) = restart.as_ref().map_or((0, 0.0), |r| (r.step, r.seconds));
    let (left_out, undecoded) = (input.optional.left_out.clone(), input.optional.undecoded.clone());
    let scene = plan.view.as_ref().map(|_| watched::scene(plan, &dataset, &input));
    let mut trainer = Trainer::new(&gpu, input, &settings, host.pacing, restart)?;
    interrupt.work_begins("stopping after this step and saving; once more to stop at once");
    trainer.give_up_scoring_when({
        let interrupt = interrupt.clone();
        move || interrupt.asked()
    });
    // An address that cannot be had costs nothing of an earlier run.
    let mut page = match (&plan.view, scene) {
        (Some(address), Some(scene)) => Some(Watched::begin(address, scene, (&trainer, &gpu), console)?),
        _ => None,
    };
    if let Some(part) = &plan.part {
        part.forget(&folder)?;
    }
    folder.begin(&settings)?;
    if let Some(part) = &plan.part {
        part.begin(&folder)?;
    }
    trainer.keep_checkpoints(&folder.checkpoints());
    let mut to_the_end = || {
        let training_seconds = run_loop::follow(&mut trainer, plan, &gpu, (console, interrupt), done, page.as_mut())?;
        if let Some(page) = &page {
            page.tell(State::Writing);
        }
        // The last checkpoint has the whole training, and files are written whole or not at all.
        interrupt.ends_at_once(format!(
            "stopped before all results were written; the training is done and saved: {} writes them",
            plan.again()
        ));
        interrupt.end_if_asked()?;
        if let Some(streaming) = trainer.streaming() {
            console.detail(format_args!("photographs: {streaming}"));
        }
        let finished = Finished {
            settings: &settings,
            folder: &folder,
            dataset: &dataset,
            gpu: &gpu,
            whole: plan.part.is_none(),
            started,
            training_seconds,
            earlier_seconds,
            stereo_seconds,
            left_out: &left_out,
            undecoded: &undecoded,
        };
        outputs::write(&finished, &mut trainer, &mut lpips, console)?;
        if let Some(part) = &plan.part {
            part.publish(&folder)?;
        }
        if let Some(page) = &mut page {
            page.stay(&mut trainer, &gpu, (interrupt, console));
        }
        Ok(())
    };
    to_the_end().map_err(|error| folder.with_resume_hint(error))
}

/// Loads the dataset. For a resumed run, an error says what to do if the dataset has moved.
fn load(plan: &RunPlan, console: &Console) -> anyhow::Result<Dataset> {
    let settings = &plan.settings;
    let data = settings.data.as_deref().context("no dataset")?;
    if let Some(preset) = &plan.preset {
        console.say(preset);
    }
    let options = prepare::load_options_of(settings);
    if let Some(part) = &plan.part {
        return Ok(Dataset::load_part(data, &options, &part.names)?);
    }
    Dataset::load(data, &options).map_err(|error| match plan.resume {
        true => run_folder::with_dataset_hint(&plan.out, error.into()),
        false => error.into(),
    })
}
