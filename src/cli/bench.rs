//! `psrgs-vk bench`: times the passes of training steps.

mod listing;
mod pareto;
mod scaling;
mod sort;
mod table;

use std::path::{Path, PathBuf};

use psrgs_vk::bench::{self, Options};
use psrgs_vk::dataset::{Dataset, Role};
use psrgs_vk::format::atomic;
use psrgs_vk::numbers::counted;
use psrgs_vk::scene::Frame;
use psrgs_vk::train::settings::{BlendingVariants, DeviceChoice, HostChoice, Photographs, Shortcuts, SteppingVariants};
use psrgs_vk::train::{Input, MemoryPlan, Pacing, Settings, chosen_variants, prepare};
use psrgs_vk::vk::Gpu;

use super::asked::Assignment;
use super::console::{self, Console};
use super::device;
use super::exit::Failure;

/// Time each GPU pass over warm training steps
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk bench fox --max-side 640
  psrgs-vk bench fox --max-side 640 --splats 100000 --json bench.json
  psrgs-vk bench fox --max-side 640 --init fox-model/point_cloud.ply
  psrgs-vk bench fox --max-side 160 --steps 5 --validate
  psrgs-vk bench fox --list-commands
  psrgs-vk bench --sort 16777216
  psrgs-vk bench fox --max-side 160 --split val --pareto fronts
  psrgs-vk bench --plot growth.svg bench-10k.json bench-100k.json bench-1m.json

The steps are those of `train --no-densify`. Up to 8 views, spread over the training photographs, are looked at in \
turn. Fails (exit code 7) when the results are not live: no pairs, or a loss that does not fall from the first look \
at these views to the last.")]
pub(crate) struct Args {
    /// Dataset
    #[arg(required_unless_present_any = ["sort", "plot", "pareto"])]
    pub(crate) data: Option<PathBuf>,
    /// Start from the splats of this PLY file instead of the dataset's points
    #[arg(long, value_name = "FILE.ply")]
    pub(crate) init: Option<PathBuf>,
    /// Make a model of this many splats from those: repeated, moved within themselves and made smaller, or thinned out
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) splats: Option<u32>,
    /// Steps before timing begins
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(..=1_000_000))]
    pub(crate) warm_up: u32,
    /// Steps that are timed as a whole; as many follow that are timed pass by pass
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub(crate) steps: u32,
    /// Highest degree of the spherical harmonics, all in use from the first step
    #[arg(long, value_name = "D", default_value_t = 3, value_parser = clap::value_parser!(u32).range(0..=3))]
    pub(crate) sh_degree: u32,
    /// Use the passes of deterministic training
    #[arg(long)]
    pub(crate) deterministic: bool,
    /// Longer side of the pictures in pixels: photographs that are smaller are enlarged,
    /// for times at sizes they do not have
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..=16_384))]
    pub(crate) side: Option<u32>,
    /// List the commands of a step with their buffers and barriers instead of timing it
    #[arg(long)]
    pub(crate) list_commands: bool,
    /// Sort N random keys with values instead, --steps times, and tell how many that are per second
    #[arg(long, value_name = "N", conflicts_with_all = ["data", "list_commands"], value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) sort: Option<u32>,
    /// Bits that --sort sorts by
    #[arg(long, value_name = "B", default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=32))]
    pub(crate) bits: u32,
    /// Draw time and memory of results of --json against splats or pixels, whichever differ more,
    /// and tell how they grow
    #[arg(long, num_args = 2.., value_names = ["FILE.svg", "FILE.json"], conflicts_with_all = ["data", "sort", "list_commands"])]
    pub(crate) plot: Option<Vec<PathBuf>>,
    /// Compare settings by time and error instead - trainings, pictures, gradients - and write tables, plots and JSON
    /// to this folder; without a dataset on a small world that is made there
    #[arg(long, value_name = "DIR", conflicts_with_all = ["sort", "plot", "list_commands", "splats", "side", "validate"])]
    pub(crate) pareto: Option<PathBuf>,
    /// Steps of the trainings that --pareto compares (0: none; pictures and gradients are then those of --init)
    #[arg(long, value_name = "N", default_value_t = 600, requires = "pareto")]
    pub(crate) train_steps: u32,
    /// Seed of the copies that --splats makes, and of trainings
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub(crate) seed: u64,
    /// Run under core and synchronization validation; fail on any message, or when the layer is not installed
    #[arg(long)]
    pub(crate) validate: bool,
    /// Write the results as JSON
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) photographs: Photographs,
    /// Set any key of settings.toml, as in `train`; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub(crate) set: Vec<Assignment>,
    #[command(flatten)]
    pub(crate) shortcuts: Shortcuts,
    #[command(flatten)]
    pub(crate) device: DeviceChoice,
    #[command(flatten)]
    pub(crate) host: HostChoice,
    #[command(flatten)]
    pub(crate) blending: BlendingVariants,
    #[command(flatten)]
    pub(crate) stepping: SteppingVariants,
}

/// The JSON file: how the results were made, and the results.
#[derive(serde::Serialize)]
struct ResultFile<'a, R> {
    command: String,
    version: &'static str,
    /// The commit of the build, where the build knows it.
    commit: Option<&'static str>,
    /// Whether the build has debug assertions, which slow down the host.
    debug_assertions: bool,
    /// Whether the validation layer was on. Its times say nothing.
    validated: bool,
    #[serde(flatten)]
    report: &'a R,
}

impl Args {
    fn settings(&self) -> anyhow::Result<Settings> {
        let mut settings =
            Settings { photographs: self.photographs.clone(), device: self.device.clone(), ..Settings::default() };
        settings.host = self.host.clone();
        settings.blending = self.blending.clone();
        settings.stepping = self.stepping.clone();
        settings.run.deterministic = self.deterministic;
        settings.density.no_densify = true;
        settings.run.seed = self.seed;
        settings.run.init = self.init.clone();
        settings.model.sh_degree = self.sh_degree;
        settings.shortcuts = self.shortcuts.clone();
        for Assignment { key, value } in &self.set {
            settings.set(key, value)?;
        }
        Ok(settings)
    }

    /// The photographs and splats of the steps.
    fn input(&self, data: &Path, settings: &Settings, console: &Console) -> anyhow::Result<Input> {
        let dataset = Dataset::load(data, &prepare::load_options_of(settings))?;
        let mut initial = prepare::initial(&dataset, settings)?;
        if let Some(splats) = self.splats {
            initial = bench::resized(&initial, splats, self.seed);
        }
        let mut share = prepare::host_share(&dataset, Role::Train, &self.host);
        let (train, undecoded) = prepare::views(&dataset, Role::Train, &mut share)?;
        undecoded.warning.iter().for_each(|warning| console.warn(warning));
        Ok(Input {
            train,
            held_out: Vec::new(),
            initial,
            extent: Frame::EXTENT as f32,
            optional: psrgs_vk::train::OptionalInput::default(),
        })
    }

    /// The device without guards and checks for tests: they would be timed too.
    fn open(&self, console: &Console) -> anyhow::Result<Gpu> {
        let mut options = device::options(&self.device, self.validate)?;
        options.canaries = self.validate;
        options.check_hazards = self.validate;
        device::open_with(&options, console)
    }
}

pub(crate) fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    args.json.as_deref().map(atomic::check).transpose()?;
    if let Some([picture, results @ ..]) = args.plot.as_deref() {
        return scaling::run(picture, results);
    }
    if let Some(out) = &args.pareto {
        return pareto::run(args, out, console);
    }
    match (args.sort, &args.data) {
        (Some(keys), _) => sort::run(args, keys, console),
        (None, Some(data)) => steps(args, data, console),
        (None, None) => Ok(()),
    }
}

fn steps(args: &Args, data: &Path, console: &Console) -> anyhow::Result<()> {
    let settings = args.settings()?;
    settings.check()?;
    let gpu = args.open(console)?;
    let input = args.input(data, &settings, console)?;
    let options = Options { warm_up: args.warm_up, steps: args.steps, side: args.side, copy_bytes: bench::COPY_BYTES };
    if args.list_commands {
        let commands = bench::commands(&gpu, input, &settings, &options).map_err(failure)?;
        return console::print(&listing::text(&commands));
    }
    console.say(format_args!(
        "{}, {}; {} to warm up, {} timed",
        counted(input.initial.len(), "splat"),
        counted(input.train.len(), "training photograph"),
        counted(args.warm_up, "step"),
        args.steps
    ));
    let pacing = Pacing { splat_capacity: input.initial.len() as u32, ..Pacing::default() };
    let variants = chosen_variants(&gpu, &settings)?;
    console.say(MemoryPlan::new(&gpu, &input, &settings, variants, pacing, pacing.splat_capacity)?);
    let measured = bench::measure(&gpu, input, &settings, &options);
    // Validation comes first because a message may say why the steps were not live.
    if args.validate {
        clean(&gpu)?;
    }
    let report = measured.map_err(failure)?;
    if args.validate {
        console.say("validation: no messages; the times below are those under the layer");
    }
    if let Some(file) = &args.json {
        write(file, &report, args.validate)?;
    }
    console::print(&table::text(&report))
}

/// Checks that neither the validation layer nor the guards found anything.
fn clean(gpu: &Gpu) -> anyhow::Result<()> {
    let messages = gpu.validation_messages();
    if let Some(first) = messages.first() {
        return Err(Failure::Check(format!("{} validation messages, the first: {first}", messages.len())).into());
    }
    gpu.check_canaries().map_err(|error| Failure::Check(error.to_string()).into())
}

/// Errors of the layers below are passed on without context, for their exit codes.
fn failure(error: bench::Error) -> anyhow::Error {
    match error {
        bench::Error::Train(error) => error.into(),
        bench::Error::Device(error) => error.into(),
        bench::Error::NotLive(_) => Failure::Check(error.to_string()).into(),
        _ => error.into(),
    }
}

fn write<R: serde::Serialize>(file: &Path, report: &R, validated: bool) -> anyhow::Result<()> {
    let made = ResultFile {
        command: std::iter::once("psrgs-vk".into()).chain(std::env::args().skip(1)).collect::<Vec<_>>().join(" "),
        version: env!("CARGO_PKG_VERSION"),
        commit: option_env!("PSRGS_COMMIT"),
        debug_assertions: cfg!(debug_assertions),
        validated,
        report,
    };
    let text = serde_json::to_string_pretty(&made)? + "\n";
    Ok(atomic::write(file, |out| out.write_all(text.as_bytes()))?)
}
