//! `psrgs-vk blocks plan`: cuts a scene into blocks.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use psrgs_vk::blocks::{self, Count, Limit, PLAN_FILE, PLAN_PICTURE, PlanFile, PlanRequest, Planned};
use psrgs_vk::dataset::{Dataset, Role};
use psrgs_vk::format::atomic;
use psrgs_vk::numbers::{counted, grouped};
use psrgs_vk::train::{Settings, prepare};

use crate::cli::asked::{Asked, named};
use crate::cli::console::{self, Console};
use crate::cli::exit::Failure;
use crate::cli::{device, output_guard, train};

/// Cut a scene into blocks of about equal work: writes blocks.json and a drawing
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk blocks plan flight --out flight-plan --blocks 4
  psrgs-vk blocks plan flight --out flight-plan --max-splats 4000000 --max-side 3200
  psrgs-vk blocks plan flight --out flight-plan --max-device-memory 8GiB

The other options are those of `train`: the plan keeps them for the training of all blocks. Steps are those of the \
whole; each block takes its share, so that every photograph is looked at as often. Without --blocks, --max-splats or \
--max-device-memory says how many blocks there are: the fewest of which none is expected to take more.")]
pub(crate) struct Args {
    /// Folder of the plan
    #[arg(long, value_name = "PLAN")]
    out: PathBuf,
    /// Number of blocks [default: the fewest that keep to --max-splats and --max-device-memory]
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..=4096))]
    blocks: Option<u32>,
    /// Train each block so much wider than its cell, as a share of the cell's side
    #[arg(long, value_name = "SHARE", default_value_t = 0.1, value_parser = margin)]
    margin: f64,
    /// Replace the plan in the folder; what was trained by it is of no use then
    #[arg(long)]
    overwrite: bool,
    /// Read settings from a file; named options and --set win over it
    #[arg(long, value_name = "FILE", help_heading = "Run")]
    config: Option<PathBuf>,
    #[command(flatten)]
    asked: Asked,
}

fn margin(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err("it is a share of the cell's side, from 0 to 1, such as 0.1".to_owned()),
    }
}

pub(super) fn run(args: &Args, matches: &clap::ArgMatches, console: &Console) -> anyhow::Result<()> {
    let (mut settings, preset) = train::settings_to_plan(&args.asked, args.config.as_deref(), matches)?;
    let Some(data) = settings.data.clone() else {
        return Err(Failure::Usage("no dataset: psrgs-vk blocks plan DATA --out PLAN --blocks K".to_owned()).into());
    };
    let count = count(args, &settings, matches)?;
    preset.iter().for_each(|message| console.say(message));
    let dataset = Dataset::load(&data, &prepare::load_options_of(&settings))?;
    output_guard::check(&args.out, &dataset)?;
    check_folder(&args.out, args.overwrite)?;
    dataset.warnings.iter().for_each(|warning| console.warn(warning));
    let gpu = device::open(&settings.device, false, console)?;
    let photographs = dataset.views_of(Role::Train).count();
    if let Some(steps) = settings.choose_steps(photographs, gpu.caps().kind) {
        console.say(format_args!("{steps}"));
    }
    let share = prepare::host_share(&dataset, Role::Train, &settings.host);
    let request =
        PlanRequest { dataset: &dataset, settings: &settings, count, margin: args.margin, share, timed: true };
    let planned = blocks::plan(&gpu, &request)?;
    fs::create_dir_all(&args.out).with_context(|| Failure::Output(args.out.display().to_string()))?;
    atomic::write(&args.out.join(PLAN_PICTURE), |out| out.write_all(blocks::picture(&planned).as_bytes()))?;
    // The plan comes last: what is there with it is whole.
    planned.file.write(&args.out.join(PLAN_FILE))?;
    tell(args, &planned, console)
}

/// How many blocks the options ask for.
fn count(args: &Args, settings: &Settings, matches: &clap::ArgMatches) -> Result<Count, Failure> {
    if let Some(blocks) = args.blocks {
        return Ok(Count::Blocks(blocks as usize));
    }
    let splats = settings.density.max_splats.map(u64::from);
    let memory = settings.device.max_device_memory.map(|bytes| bytes.0);
    match (splats, memory) {
        (Some(splats), None) => Ok(Count::Within(Limit::Splats(splats))),
        (None, Some(bytes)) => Ok(Count::Within(Limit::Memory(bytes))),
        (Some(splats), Some(_)) if !named(matches, "max_device_memory") => Ok(Count::Within(Limit::Splats(splats))),
        (Some(_), Some(_)) => Err(Failure::Usage(
            "--max-splats and --max-device-memory both say how many blocks there are: give one of them, or --blocks"
                .to_owned(),
        )),
        (None, None) => Err(Failure::Usage(
            "how many blocks? --blocks K says it, or --max-splats N or --max-device-memory BYTES, what a block may take"
                .to_owned(),
        )),
    }
}

/// Refuses a folder whose plan or drawing would be lost.
fn check_folder(out: &Path, overwrite: bool) -> anyhow::Result<()> {
    let (file, picture) = (out.join(PLAN_FILE), out.join(PLAN_PICTURE));
    let is_there = |file: &Path| file.symlink_metadata().is_ok();
    let refused = |text: String| Err(Failure::Usage(format!("--out {}: {text}", out.display())).into());
    let ours = PlanFile::read(&file).is_ok();
    if is_there(&file) && !ours {
        return refused(format!(
            "{PLAN_FILE} there is no plan of this version: choose another folder, or move that file"
        ));
    }
    if is_there(&file) && !overwrite {
        return refused("there is a plan already; --overwrite replaces it".to_owned());
    }
    if is_there(&picture) && !ours {
        return refused(format!("psrgs-vk did not write the {PLAN_PICTURE} there: choose another folder, or move it"));
    }
    Ok(())
}

/// The plan as a table.
fn tell(args: &Args, planned: &Planned, console: &Console) -> anyhow::Result<()> {
    if let Some(asked) = args.blocks.map(|count| count as usize).filter(|asked| *asked > planned.file.blocks.len()) {
        console.warn(format_args!(
            "{} instead of {asked}: points lie in no more places",
            counted(planned.file.blocks.len(), "block")
        ));
    }
    if planned.blind > 0 {
        console.warn(format_args!(
            "{} in no block: nothing is known that they see",
            counted(planned.blind, "photograph to train on")
        ));
    }
    let global = &planned.file.global;
    console.say(format_args!(
        "about {} in all; coarse model of everything: {} px, {}, at most {}",
        counted(planned.splats as u64, "splat"),
        global.max_side,
        counted(global.steps, "step"),
        counted(global.max_splats, "splat")
    ));
    console::print(&blocks::table(&planned.file))?;
    let looks: usize = planned.file.blocks.iter().map(|block| block.photographs.len()).sum();
    console.say(format_args!(
        "{} in all blocks together, of {}; written to {}",
        grouped(looks as u64),
        counted(global.photographs.len(), "photograph"),
        args.out.display()
    ));
    Ok(())
}
