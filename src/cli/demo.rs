//! `psrgs-vk demo`: a made-up aerial scene of known geometry, trained.

use std::path::PathBuf;
use std::time::Instant;

use indicatif::HumanCount;
use psrgs_vk::train::Settings;
use psrgs_vk::train::settings::DeviceChoice;
use psrgs_vk::world::{Stage, Summary, WorldParams, generate};

use super::console::Console;
use super::exit::Failure;
use super::progress::{counter, duration};
use super::{train, train_run};

/// Folder of the trained model inside the scene's.
const TRAINED: &str = "trained";

/// Make a small aerial scene of known geometry, train on it and leave a report
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk demo --out demo-out                       about five minutes on two CPU cores
  psrgs-vk demo --out world --images 100 --max-side 640 --no-train

Written to DIR: images/, sparse/0/, depth/ (ground truth along the camera's axis, EXR), world.toml, and trained/.")]
pub(crate) struct Args {
    /// Folder for the scene; the trained model goes to DIR/trained
    #[arg(long, value_name = "DIR", default_value = "demo-out")]
    out: PathBuf,
    /// Photographs
    #[arg(long, value_name = "N", default_value_t = 64)]
    images: u32,
    /// Longer side of a photograph in pixels
    #[arg(long, value_name = "PX", default_value_t = WorldParams::default().max_side)]
    max_side: u32,
    /// Side of the square site in metres
    #[arg(long, value_name = "M", default_value_t = WorldParams::default().extent)]
    extent: f64,
    /// Seed of the scene and of training
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u64,
    /// Training steps
    #[arg(long, value_name = "N", default_value_t = 2000)]
    iterations: u32,
    /// Stop growing at this many splats
    #[arg(long, value_name = "N", default_value_t = 40_000)]
    max_splats: u32,
    /// Only make the scene
    #[arg(long)]
    no_train: bool,
    #[command(flatten)]
    device: DeviceChoice,
}

pub(crate) fn run(args: &Args, console: &Console, started: Instant) -> anyhow::Result<()> {
    make(args, console)?;
    if args.no_train {
        return Ok(());
    }
    let out = args.out.join(TRAINED);
    train_run::train(
        &train::Plan { settings: settings(args)?, out: out.clone(), resume: false, overwrite: true },
        console,
        started,
    )?;
    console.say(format_args!("look at {}", std::path::absolute(out.join("report.html"))?.display()));
    Ok(())
}

fn make(args: &Args, console: &Console) -> anyhow::Result<Summary> {
    // A folder that holds something else is left alone: photographs of another scene would be trained on.
    let taken = args.out.join("images").exists() && !args.out.join("world.toml").exists();
    if taken {
        return Err(Failure::Usage(format!(
            "{}: holds photographs that no demo made; choose another --out",
            args.out.display()
        ))
        .into());
    }
    let params = WorldParams {
        images: args.images,
        max_side: args.max_side,
        extent: args.extent,
        seed: args.seed,
        ..WorldParams::default()
    };
    let begin = Instant::now();
    console.say(format_args!("making a scene of {} m with {} photographs", params.extent, params.images));
    let bar = counter(console, params.images as usize, "photographs");
    let summary = generate(&params, &args.out, &mut |progress| {
        if progress.stage == Stage::Photographs {
            bar.set_position(u64::from(progress.done));
        }
    });
    bar.finish_and_clear();
    let summary = summary?;
    console.say(format_args!(
        "{}: {} photographs of {}x{}, {} points, in {}",
        args.out.display(),
        summary.images,
        summary.width,
        summary.height,
        HumanCount(summary.points as u64),
        duration(begin.elapsed().as_secs_f64()),
    ));
    Ok(summary)
}

fn settings(args: &Args) -> anyhow::Result<Settings> {
    let mut settings = Settings { data: Some(std::path::absolute(&args.out)?), ..Settings::default() };
    settings.run.iterations = args.iterations;
    settings.run.scale_schedule = true;
    settings.run.seed = args.seed;
    settings.run.eval_every = (args.iterations / 10).max(1);
    // More would show on pictures of this size as time, hardly as quality.
    settings.density.max_splats = Some(args.max_splats);
    settings.device = args.device.clone();
    settings.check()?;
    Ok(settings)
}
