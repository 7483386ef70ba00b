//! `psrgs-vk train`: chooses the settings and runs the training.

mod resume;
mod run;
mod run_loop;
mod startup_log;
mod watched;

pub(crate) use run::train;

use std::path::{Path, PathBuf, absolute};
use std::time::Instant;

use anyhow::Context as _;
use psrgs_vk::format::names;
use psrgs_vk::train::Settings;
use psrgs_vk::train::settings::{LidarCloud, Method};
use psrgs_vk::view::Address;

use crate::cli::asked::Asked;
use crate::cli::blocks::PartRun;
use crate::cli::console::{self, Console};
use crate::cli::exit::Failure;
use crate::cli::interrupt::Interrupt;
use crate::cli::{live_page, presets, run_folder};

/// Settings that may change on resume, because no finished step depends on them.
const FREE_ON_RESUME: [&str; 8] = [
    "iterations",
    "checkpoint-every",
    "eval-every",
    "tune",
    "perceptual-weights",
    "device",
    "max-device-memory",
    "host-memory",
];

/// Heading of the options that most trainings need.
const MOST_USED: &str = "Most used";

/// Train a model on posed photographs
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk train fox --out fox-model
  psrgs-vk train fox --out quick --preset quick
  psrgs-vk train fox --out small --max-side 640 --iterations 2000
  psrgs-vk train fox --out again --config fox-model/settings.toml --seed 1
  psrgs-vk train --resume fox-model

Defaults are those of the method 3dgs; other methods, --preset and --scale-schedule change some: --print-settings \
prints the values that hold. Every other setting is a key for --set: `psrgs-vk options` lists the keys, their values \
and their effects.")]
pub(crate) struct Args {
    /// Write results to this folder [default: DATA's name followed by the method, as in fox-psrgs]
    #[arg(long, value_name = "DIR", help_heading = MOST_USED, display_order = 0)]
    pub(crate) out: Option<PathBuf>,
    /// Go on with an interrupted run from its last checkpoint, in the same folder; DATA says where its dataset is now
    #[arg(
        long, value_name = "DIR", conflicts_with_all = ["out", "config", "overwrite"], help_heading = MOST_USED, display_order = 1
    )]
    pub(crate) resume: Option<PathBuf>,
    /// Replace the results of an earlier run in the --out folder
    #[arg(long, help_heading = MOST_USED, display_order = 2)]
    pub(crate) overwrite: bool,
    /// Read settings from a file; named options and --set win over it
    #[arg(long, value_name = "FILE", help_heading = "Run")]
    pub(crate) config: Option<PathBuf>,
    /// Print the settings that would hold, as a settings file, and stop
    #[arg(long, help_heading = "Run")]
    pub(crate) print_settings: bool,
    /// Show the training on a page in the browser, and then until Ctrl-C
    #[arg(
        long, value_name = "ADDR", num_args = 0..=1, default_missing_value = live_page::ADDRESS, help_heading = MOST_USED,
        display_order = 3
    )]
    pub(crate) view: Option<Address>,
    /// For tests: the device is as if lost after this step
    #[cfg(debug_assertions)]
    #[arg(long, value_name = "STEP", hide = true)]
    pub(crate) lose_device_at: Option<u32>,
    /// For tests: each photograph is read again in each step that looks at it, as where memory holds none
    #[cfg(debug_assertions)]
    #[arg(long, hide = true)]
    pub(crate) keep_no_photographs: bool,
    #[command(flatten)]
    pub(crate) asked: Asked,
}

/// A training run.
#[derive(Debug, Default)]
pub(crate) struct RunPlan {
    /// Every setting, with absolute paths.
    pub(crate) settings: Settings,
    /// Folder of the results.
    pub(crate) out: PathBuf,
    /// Whether to resume from the checkpoint in `out`.
    pub(crate) resume: bool,
    /// Whether `out` may hold an earlier run, which is replaced.
    pub(crate) overwrite: bool,
    /// Message about the preset.
    pub(crate) preset: Option<String>,
    /// Where the training is shown.
    pub(crate) view: Option<Address>,
    /// The part of a scene that is trained, for a plan of blocks.
    pub(crate) part: Option<PartRun>,
    /// For tests: the step after which the device counts as lost.
    pub(crate) lose_device_at: Option<u32>,
    /// For tests: whether every step decodes its photographs again.
    pub(crate) keep_no_photographs: bool,
}

impl RunPlan {
    /// The command that goes on with the run.
    pub(crate) fn again(&self) -> String {
        match &self.part {
            Some(part) => part.again.clone(),
            None => format!("psrgs-vk train --resume {}", self.out.display()),
        }
    }
}

/// Keys of a settings file that a preset named beside the file replaces.
const DECIDED_BY_PRESETS: [&str; 5] = ["preset", "max-side", "iterations", "looks", "scale-schedule"];

/// The default method.
pub(crate) const METHOD: Method = Method::Psrgs;

impl Args {
    /// The run that the options describe. `matches` says which options were given by name.
    pub(crate) fn plan(&self, matches: &clap::ArgMatches) -> anyhow::Result<RunPlan> {
        let (asked, named) = self.asked.settings(matches)?;
        let given = |key: &str| named.has(key);
        can_be_kept(&asked)?;
        let mut preset = None;
        let mut settings = match (&self.resume, &self.config) {
            (Some(run), _) => {
                let before = Settings::read(&run.join(run_folder::SETTINGS))
                    .with_context(|| Failure::Input(format!("{}: no run to resume", run.display())))?;
                let mut resumed = asked.over(&before, given)?;
                make_absolute(&mut resumed)?;
                unchanged_on_resume(&before, &resumed, run_folder::SETTINGS)?;
                resumed
            }
            (None, config) => {
                let begun = begun(asked, config.as_deref(), given)?;
                preset = begun.1;
                begun.0
            }
        };
        if given("iterations") || given("preset") && !given("looks") {
            settings.run.looks = None;
        }
        match &self.config {
            Some(file) => settings.check().with_context(|| format!("{}, with the options given", file.display()))?,
            None => settings.check()?,
        }
        let Some(data) = &settings.data else {
            if let Some(run) = &self.resume {
                let file = run.join(run_folder::SETTINGS);
                return Err(Failure::Input(format!("{}: it names no dataset (data)", file.display())).into());
            }
            return Err(Failure::Usage(
                "no dataset: name its folder (psrgs-vk train DATA --out DIR), or --resume DIR, or a --config that has \
                 data"
                    .into(),
            )
            .into());
        };
        let out = self.resume.clone().or_else(|| self.out.clone()).unwrap_or_else(|| default_out(data, &settings));
        make_absolute(&mut settings)?;
        #[cfg(debug_assertions)]
        let (lose_device_at, keep_no_photographs) = (self.lose_device_at, self.keep_no_photographs);
        #[cfg(not(debug_assertions))]
        let (lose_device_at, keep_no_photographs) = (None, false);
        let (overwrite, resume, view) = (self.overwrite, self.resume.is_some(), self.view.clone());
        Ok(RunPlan { settings, out, resume, overwrite, preset, view, part: None, lose_device_at, keep_no_photographs })
    }
}

/// The settings of a training that begins: those asked for, over those of a file if one is given, with what preset and
/// method set. With the message about the preset. `given` says which keys were named.
fn begun(
    asked: Settings,
    config: Option<&Path>,
    given: impl Fn(&str) -> bool,
) -> anyhow::Result<(Settings, Option<String>)> {
    let Some(file) = config else {
        let mut settings = asked;
        let preset = presets::apply(&mut settings, given)?;
        return Ok((settings, preset));
    };
    let mut settings = asked.over(&Settings::read(file)?, &given)?;
    let mut written = Settings::keys(file)?;
    if given("preset") {
        written.retain(|key| !DECIDED_BY_PRESETS.contains(&key.as_str()));
    }
    let set = |key: &str| given(key) || written.iter().any(|k| k == key);
    if let Some(chosen) = settings.run.preset {
        chosen.apply(&mut settings, false, set);
    }
    if !set("method") {
        settings.run.method = METHOD;
    }
    settings.run.method.apply(&mut settings, set);
    Ok((settings, None))
}

/// Makes the paths of settings independent of the folder that the program runs in.
fn make_absolute(settings: &mut Settings) -> anyhow::Result<()> {
    settings.data = settings.data.as_ref().map(absolute).transpose()?;
    settings.run.init = settings.run.init.as_ref().map(absolute).transpose()?;
    if let Some(LidarCloud::File(file)) = &mut settings.density.lidar {
        *file = absolute(&file)?;
    }
    let weights = &mut settings.scoring.perceptual_weights;
    *weights = weights.as_ref().map(absolute).transpose()?;
    Ok(())
}

/// The settings of a training of blocks, with the message about the preset: those of a training that begins.
pub(crate) fn settings_to_plan(
    asked: &Asked,
    config: Option<&Path>,
    matches: &clap::ArgMatches,
) -> anyhow::Result<(Settings, Option<String>)> {
    let (asked, named) = asked.settings(matches)?;
    let given = |key: &str| named.has(key);
    can_be_kept(&asked)?;
    let (mut settings, preset) = begun(asked, config, given)?;
    if given("iterations") || given("preset") && !given("looks") {
        settings.run.looks = None;
    }
    settings.check()?;
    make_absolute(&mut settings)?;
    Ok((settings, preset))
}

/// Refuses paths that a settings file cannot hold, because it is text.
fn can_be_kept(settings: &Settings) -> Result<(), Failure> {
    let paths = [&settings.data, &settings.run.init, &settings.scoring.perceptual_weights];
    match paths.into_iter().flatten().find(|path| path.to_str().is_none()) {
        Some(path) => Err(Failure::Usage(format!(
            "{}: this name is not UTF-8, and {} could not hold it; rename it, or name it by a link",
            path.display(),
            run_folder::SETTINGS
        ))),
        None => Ok(()),
    }
}

fn default_out(data: &Path, settings: &Settings) -> PathBuf {
    let name = absolute(data).ok().and_then(|p| p.file_name().map(|n| n.to_string_lossy().into_owned()));
    let ending = format!("-{}", settings.run.method);
    PathBuf::from(names::bounded(name.as_deref().unwrap_or("model"), 255 - ending.len()) + &ending)
}

/// Fails where a resumed run has settings that would change its finished steps. `before` are the settings of the run,
/// and `place` says where they are from.
pub(crate) fn unchanged_on_resume(before: &Settings, resumed: &Settings, place: &str) -> anyhow::Result<()> {
    // Weights of a loss change the training, while weights of a score do not.
    let learned_from = |key: &str| key == "perceptual-weights" && before.texture.lambda_perceptual > 0.0;
    // The checkpoint checks that the dataset is the same, wherever it lies now.
    let free = |key: &str| key == "data" || FREE_ON_RESUME.contains(&key) && !learned_from(key);
    let differences: Vec<String> = resumed
        .differences(before)?
        .into_iter()
        .filter(|(key, ..)| !free(key))
        .map(|(key, now, was)| format!("{key} is {now} and was {was}"))
        .collect();
    if !differences.is_empty() {
        return Err(Failure::Usage(format!(
            "--resume goes on with the settings of the run: {} in {place}; only these can be changed: --{}",
            differences.join(", "),
            FREE_ON_RESUME.into_iter().filter(|key| free(key)).collect::<Vec<_>>().join(", --")
        ))
        .into());
    }
    if before.run.scale_schedule && before.run.iterations != resumed.run.iterations {
        return Err(Failure::Usage(
            "--iterations cannot change on --resume where the schedule was scaled to it: train anew from its model \
             with --init, or begin such a run with --scale-schedule=false"
                .into(),
        )
        .into());
    }
    Ok(())
}

pub(crate) fn run(
    args: &Args,
    matches: &clap::ArgMatches,
    interrupt: &Interrupt,
    console: &Console,
    started: Instant,
) -> anyhow::Result<()> {
    let plan = args.plan(matches)?;
    if args.print_settings {
        return console::print(&plan.settings.to_toml()?);
    }
    train(&plan, interrupt, console, started)
}
