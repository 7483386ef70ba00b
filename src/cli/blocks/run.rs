//! `psrgs-vk blocks run`: trains the blocks of a plan.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf, absolute};
use std::str::FromStr;
use std::time::Instant;

use psrgs_vk::blocks::{
    BEGUN_FILE, Block, BlockMetrics, BlockModel, BlockState, DONE_FILE, DoneFile, GLOBAL, PlanFolder,
    PlannedPhotograph, merge,
};
use psrgs_vk::format::EXPOSURE_FILE;
use psrgs_vk::numbers::counted;
use psrgs_vk::train::Settings;
use psrgs_vk::train::settings::{DeviceChoice, Exposure, HostChoice};

use super::part_run::{PartRun, changed};
use crate::cli::console::Console;
use crate::cli::exit::Failure;
use crate::cli::interrupt::Interrupt;
use crate::cli::run_folder::SETTINGS;
use crate::cli::train::{RunPlan, train};

/// Train the blocks of a plan one after the other; those that are done are left as they are
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk blocks run city-plan                 the coarse model of everything, then all blocks
  psrgs-vk blocks run city-plan --block b03
  psrgs-vk blocks run city-plan --block global  only the coarse model, before the folder is copied
  psrgs-vk blocks run city-plan --share 1/2     every second block; the other computer takes 2/2

An interrupted training goes on from its last checkpoint when the command is given again.")]
pub(crate) struct Args {
    /// Folder of the plan
    #[arg(value_name = "PLAN")]
    pub(super) plan: PathBuf,
    /// Train this block; `global` is the coarse model of everything
    #[arg(long, value_name = "ID", conflicts_with = "share")]
    pub(super) block: Option<String>,
    /// Train every N-th block, from the I-th on: for N computers, each with a copy of the plan's folder
    #[arg(long, value_name = "I/N")]
    pub(super) share: Option<Share>,
    /// Take the dataset from here [default: the folder that the plan names]
    #[arg(long, value_name = "DIR")]
    pub(super) data: Option<PathBuf>,
    /// Train blocks again whose results belong to another plan or program, or are damaged
    #[arg(long)]
    pub(super) overwrite: bool,
    #[command(flatten)]
    pub(super) device: DeviceChoice,
    #[command(flatten)]
    pub(super) host: HostChoice,
}

/// Every `of`-th block, from number `first` on, which counts from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Share {
    first: usize,
    of: usize,
}

impl FromStr for Share {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        let wrong = || "it must be I/N with I from 1 to N, such as 1/2".to_owned();
        let (number, of) = word.split_once('/').ok_or_else(wrong)?;
        let (number, of): (usize, usize) = (number.parse().map_err(|_| wrong())?, of.parse().map_err(|_| wrong())?);
        if number == 0 || number > of { Err(wrong()) } else { Ok(Self { first: number - 1, of }) }
    }
}

/// The trainings of a plan.
struct Trainings<'a> {
    args: &'a Args,
    folder: PlanFolder,
    settings: Settings,
    interrupt: &'a Interrupt,
    console: &'a Console,
    /// Trainings whose models have been compared with their `done.json`: a large model is read once.
    whole: RefCell<BTreeMap<String, DoneFile>>,
    /// Names of photographs that are handed to a training to be compared with the plan: each is read once.
    compared: RefCell<BTreeSet<String>>,
}

pub(crate) fn run(args: &Args, interrupt: &Interrupt, console: &Console, started: Instant) -> anyhow::Result<()> {
    let folder = PlanFolder::open(&args.plan)?;
    let settings = settings(args, &folder)?;
    let trainings = Trainings {
        args,
        folder,
        settings,
        interrupt,
        console,
        whole: RefCell::default(),
        compared: RefCell::default(),
    };
    let chosen = trainings.chosen()?;
    trainings.refuse_stale(&chosen)?;
    trainings.check_dataset()?;
    let global = trainings.global(started)?;
    for block in chosen {
        trainings.block(block, &global)?;
    }
    Ok(())
}

/// The settings of the plan, with the dataset, device and memory of this computer.
fn settings(args: &Args, folder: &PlanFolder) -> anyhow::Result<Settings> {
    let mut settings = folder.plan.settings()?;
    settings.data = Some(absolute(args.data.as_ref().unwrap_or(&folder.plan.dataset.path))?);
    settings.run.seed = folder.plan.seed;
    // The steps of each training are those of the plan.
    settings.run.looks = None;
    let DeviceChoice { device, max_device_memory } = args.device.clone();
    let chosen = &mut settings.device;
    *chosen = DeviceChoice {
        device: device.or_else(|| chosen.device.take()),
        max_device_memory: max_device_memory.or_else(|| chosen.max_device_memory.take()),
    };
    if args.host.host_memory.is_some() {
        settings.host = args.host.clone();
    }
    Ok(settings)
}

impl Trainings<'_> {
    /// The blocks to train, without the coarse model.
    fn chosen(&self) -> anyhow::Result<Vec<&Block>> {
        let blocks = &self.folder.plan.blocks;
        let ids = || blocks.iter().map(|block| block.id.as_str()).collect::<Vec<_>>().join(", ");
        match (self.args.block.as_deref(), self.args.share) {
            (Some(GLOBAL), _) => Ok(Vec::new()),
            (Some(id), _) => match self.folder.plan.block(id) {
                Some(block) => Ok(vec![block]),
                None => Err(Failure::Usage(format!("--block {id}: the plan has {} and {GLOBAL}", ids())).into()),
            },
            (None, Some(share)) if !matches!(self.folder.quick_state(GLOBAL), BlockState::Done(_)) => {
                let Share { first, of } = share;
                Err(Failure::Usage(format!(
                    "--share {}/{of}: blocks fit together if all have the same coarse model: train that first \
                     (psrgs-vk blocks run {} --block {GLOBAL}), then copy the plan's folder",
                    first + 1,
                    self.args.plan.display()
                ))
                .into())
            }
            (None, Some(Share { first, of })) => Ok(blocks.iter().skip(first).step_by(of).collect()),
            (None, None) => Ok(blocks.iter().collect()),
        }
    }

    /// How far a training is. The model of one that is done is compared the first time only.
    fn state(&self, id: &str) -> BlockState {
        if let Some(done) = self.whole.borrow().get(id) {
            return BlockState::Done(Box::new(done.clone()));
        }
        let state = self.folder.state(id);
        if let BlockState::Done(done) = &state {
            self.whole.borrow_mut().insert(id.to_owned(), done.as_ref().clone());
        }
        state
    }

    /// Of some photographs those that no training of this command has compared with the plan.
    fn to_compare(&self, names: &BTreeSet<String>) -> Vec<PlannedPhotograph> {
        let mut compared = self.compared.borrow_mut();
        let planned = self.folder.plan.blocks.iter().flat_map(|block| &block.photographs);
        planned.filter(|one| names.contains(&one.name) && compared.insert(one.name.clone())).cloned().collect()
    }

    /// Refuses, before any work, results that may neither be used nor be replaced.
    fn refuse_stale(&self, chosen: &[&Block]) -> anyhow::Result<()> {
        if self.args.overwrite {
            return Ok(());
        }
        for id in [GLOBAL].into_iter().chain(chosen.iter().map(|block| block.id.as_str())) {
            let folder = self.folder.folder_of(id);
            let why = match self.state(id) {
                BlockState::Stale(stale) => stale.to_string(),
                BlockState::Damaged(error) => error.to_string(),
                _ => continue,
            };
            let text = format!("{}: {why}; --overwrite trains it again", folder.display());
            return Err(Failure::Input(text).into());
        }
        Ok(())
    }

    /// Refuses a dataset that is not the one that was planned.
    fn check_dataset(&self) -> anyhow::Result<()> {
        let data = self.settings.data.as_deref().unwrap_or(Path::new(""));
        for record in &self.folder.plan.dataset.files {
            let file = data.join(&record.name);
            let (sha256, _) = psrgs_vk::blocks::sha256_of(&file)?;
            if sha256 != record.sha256 {
                return Err(changed(&file).into());
            }
        }
        Ok(())
    }

    /// Trains the coarse model of everything unless it is done. Gives the SHA-256 of the model.
    fn global(&self, started: Instant) -> anyhow::Result<String> {
        if let BlockState::Done(done) = self.state(GLOBAL) {
            return Ok(done.model_sha256);
        }
        let global = &self.folder.plan.global;
        self.console.say(format_args!(
            "coarse model of everything: {}, {}",
            counted(global.photographs.len(), "photograph"),
            counted(global.steps, "step")
        ));
        let mut settings = self.settings.clone();
        settings.shorten_to(global.steps);
        settings.photographs.max_side = settings.photographs.max_side.min(global.max_side);
        settings.density.max_splats = Some(global.max_splats);
        let names = global.photographs.iter().cloned().collect();
        let part = PartRun {
            photographs: self.to_compare(&names),
            names,
            origin: self.folder.origin(GLOBAL, None),
            within: None,
            whole_steps: global.steps,
            again: self.again(),
        };
        self.train(settings, part, started)?;
        self.done(GLOBAL).map(|done| done.model_sha256)
    }

    /// Trains a block unless it is done.
    fn block(&self, block: &Block, global: &str) -> anyhow::Result<()> {
        if let BlockState::Done(done) = self.state(&block.id) {
            self.console.say(format_args!("block {}: done, {}", block.id, counted(done.splats, "splat")));
            return Ok(());
        }
        let origin = self.folder.origin(&block.id, Some(global));
        if block.photographs.is_empty() {
            return self.empty(block, origin);
        }
        self.console.say(format_args!(
            "block {}: {}, {}",
            block.id,
            counted(block.photographs.len(), "photograph"),
            counted(block.steps, "step")
        ));
        let mut settings = self.settings.clone();
        settings.shorten_to(block.steps);
        settings.keep_rates_of(self.settings.run.iterations);
        let global = self.folder.folder_of(GLOBAL);
        // Exposures are solved once for all.
        let solved = global.join(EXPOSURE_FILE).is_file();
        settings.optimiser.exposure = if solved { Exposure::Affine } else { Exposure::Off };
        let names = block.photographs.iter().map(|photograph| photograph.name.clone()).collect();
        let part = PartRun {
            photographs: self.to_compare(&names),
            names,
            origin,
            within: Some((self.folder.region(block), block.margin, global)),
            whole_steps: self.settings.run.iterations,
            again: self.again(),
        };
        self.train(settings, part, Instant::now())?;
        let done = self.done(&block.id)?;
        self.console.say(format_args!("block {}: {}", block.id, counted(done.splats, "splat")));
        Ok(())
    }

    /// A block without photographs has the splats of the coarse model.
    fn empty(&self, block: &Block, origin: psrgs_vk::blocks::Origin) -> anyhow::Result<()> {
        self.console.say(format_args!("block {}: no photograph shows it; it has the coarse model", block.id));
        let (folder, model) = (self.folder.folder_of(&block.id), self.folder.model_of(&block.id));
        std::fs::create_dir_all(&folder).map_err(|e| Failure::Output(format!("{}: {e}", folder.display())))?;
        let number = self.folder.plan.blocks.iter().position(|other| other.id == block.id).unwrap_or(0);
        let coarse = BlockModel { block: number, file: self.folder.model_of(GLOBAL) };
        let merged = merge(&self.folder.plan, &[coarse], &model)?;
        let done = DoneFile::of_model(origin, &model, (merged.splats, 0.0), BlockMetrics::default())?;
        Ok(done.write(&folder.join(DONE_FILE))?)
    }

    /// Trains in the folder of a part: goes on with what has begun there.
    fn train(&self, settings: Settings, part: PartRun, started: Instant) -> anyhow::Result<()> {
        let out = self.folder.folder_of(&part.origin.block);
        let begun = out.join(BEGUN_FILE).is_file() && out.join(SETTINGS).is_file();
        let resume = begun && matches!(self.folder.quick_state(&part.origin.block), BlockState::Begun);
        let settings = match resume {
            true => as_begun(&out.join(SETTINGS), &settings)?,
            false => settings,
        };
        let plan =
            RunPlan { settings, out, resume, overwrite: self.args.overwrite, part: Some(part), ..RunPlan::default() };
        train(&plan, self.interrupt, self.console, started)
    }

    fn done(&self, id: &str) -> anyhow::Result<DoneFile> {
        Ok(DoneFile::read(&self.folder.folder_of(id).join(DONE_FILE))?)
    }

    /// The command that goes on.
    fn again(&self) -> String {
        let mut words = vec![format!("psrgs-vk blocks run {}", self.args.plan.display())];
        words.extend(self.args.block.as_ref().map(|id| format!("--block {id}")));
        words.extend(self.args.share.map(|Share { first, of }| format!("--share {}/{of}", first + 1)));
        words.extend(self.args.data.as_ref().map(|data| format!("--data {}", data.display())));
        words.join(" ")
    }
}

/// The settings of a training that has begun, with the dataset, device and memory of this computer.
fn as_begun(file: &Path, now: &Settings) -> anyhow::Result<Settings> {
    let before = Settings::read(file)?;
    let (data, device, host) = (now.data.clone(), now.device.clone(), now.host.clone());
    Ok(Settings { data, device, host, ..before })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_read_and_others_refused() {
        assert_eq!("2/3".parse(), Ok(Share { first: 1, of: 3 }));
        for word in ["", "1", "0/2", "3/2", "a/b", "1/0", "-1/2", "1/2/3"] {
            assert!(word.parse::<Share>().is_err(), "{word}");
        }
    }
}
