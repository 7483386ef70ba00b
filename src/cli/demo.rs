//! `psrgs-vk demo`: a synthetic aerial scene of known geometry, and a training on it.

use std::path::PathBuf;
use std::time::Instant;

use psrgs_vk::train::Settings;
use psrgs_vk::train::settings::{BlendingVariants, DeviceChoice, HostChoice, LidarCloud, Method, SteppingVariants};
use psrgs_vk::world::{LIDAR_FILE, Stage, Summary, WorldParams, generate};

use super::console::Console;
use super::demo_world::WorldArgs;
use super::device;
use super::interrupt::Interrupt;
use super::progress::{counter, duration};
use super::train;
use psrgs_vk::numbers::counted;

/// Folder of the trained model inside the scene's folder.
const TRAINED: &str = "trained";

/// Make a small aerial scene of known geometry, train on it and leave a report
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk demo --out demo-out                       some minutes on two CPU cores
  psrgs-vk demo --out world --images 100 --max-side 640 --camera opencv --no-train
  psrgs-vk demo --out easy --effects none --no-train            nothing that is hard
  psrgs-vk demo --out a --effects exposure --no-train           exposure that changes, and nothing else
  psrgs-vk demo --out b --without wires,water --no-train        all but these

Effects: jpeg, observation-noise, outliers, pose-noise, exposure, sensor-noise, shadows, reflections, vegetation, \
vehicles, masts, wires, text, repeats, plain, water.

Written to DIR: images/, with positions in EXIF, and sparse/0/; ground control points in gcp_list.txt, and the true \
place on a map in frame.json; the truth for undistorted pictures in depth/, normal/ and clean/; offpath/ \
with views from elsewhere; the true map in truth/: dsm.tif, dtm.tif, orthophoto.tif, classes.tif; lidar.las, lidar.ply, surface.ply; world.toml with every parameter; and trained/.")]
pub(crate) struct Args {
    /// Folder for the scene; the trained model goes to DIR/trained
    #[arg(long, value_name = "DIR", default_value = "demo-out")]
    out: PathBuf,
    #[command(flatten)]
    world: WorldArgs,
    /// Training method, as in `train`
    #[arg(long, value_name = "M", default_value_t = train::METHOD)]
    method: Method,
    /// Training steps
    #[arg(long, value_name = "N", default_value_t = 2000)]
    iterations: u32,
    /// Have at most this many splats
    #[arg(long, value_name = "N", default_value_t = 40_000)]
    max_splats: u32,
    /// Only make the scene
    #[arg(long)]
    no_train: bool,
    #[command(flatten)]
    device: DeviceChoice,
    #[command(flatten)]
    host: HostChoice,
    #[command(flatten)]
    blending: BlendingVariants,
    #[command(flatten)]
    stepping: SteppingVariants,
}

pub(crate) fn run(args: &Args, interrupt: &Interrupt, console: &Console, started: Instant) -> anyhow::Result<()> {
    let params = args.world.params()?;
    if !args.no_train {
        // Fails before the minutes that the scene takes.
        device::probe(&args.device)?;
    }
    // A scene takes minutes: settings that cannot be fail before.
    let settings = settings(args, params.seed)?;
    make(args, &params, console)?;
    if args.no_train {
        return Ok(());
    }
    let out = args.out.join(TRAINED);
    train::train(
        &train::RunPlan {
            settings,
            out: out.clone(),
            resume: false,
            overwrite: true,
            preset: None,
            view: None,
            part: None,
            lose_device_at: None,
            keep_no_photographs: false,
        },
        interrupt,
        console,
        started,
    )?;
    console.say(format_args!("look at {}", std::path::absolute(out.join("report.html"))?.display()));
    Ok(())
}

fn make(args: &Args, params: &WorldParams, console: &Console) -> anyhow::Result<Summary> {
    let begin = Instant::now();
    console.say(format_args!("making a scene of {} m with {}", params.extent, counted(params.images, "photograph")));
    let bar = counter(console, params.images as usize, "photographs");
    let summary = generate(params, &args.out, &mut |progress| {
        if progress.stage == Stage::Photographs {
            bar.set_position(u64::from(progress.done));
        }
    });
    bar.finish_and_clear();
    let summary = summary?;
    console.say(format_args!(
        "{}: {} of {}x{}, {}; {} from elsewhere; {}; in {}",
        args.out.display(),
        counted(summary.images, "photograph"),
        summary.width,
        summary.height,
        counted(summary.points, "point"),
        counted(summary.offpath, "view"),
        counted(summary.lidar, "laser point"),
        duration(begin.elapsed().as_secs_f64()),
    ));
    let survey = &params.survey;
    console.say(format_args!(
        "positions in EXIF, to {} m in the plane and {} m of height; {} in gcp_list.txt, to {} m; in {}",
        survey.gps_horizontal,
        survey.gps_vertical,
        counted(summary.control_points, "ground control point"),
        survey.control_noise,
        summary.system,
    ));
    Ok(summary)
}

fn settings(args: &Args, seed: u64) -> anyhow::Result<Settings> {
    let mut settings = Settings { data: Some(std::path::absolute(&args.out)?), ..Settings::default() };
    settings.run.iterations = args.iterations;
    settings.run.scale_schedule = true;
    settings.run.seed = seed;
    settings.run.eval_every = (args.iterations / 10).max(1);
    // On images of this size more splats cost time and hardly add quality.
    settings.density.max_splats = Some(args.max_splats);
    settings.device = args.device.clone();
    settings.host = args.host.clone();
    settings.blending = args.blending.clone();
    settings.stepping = args.stepping.clone();
    if args.method == Method::Rsgs {
        settings.density.lidar = Some(LidarCloud::File(std::path::absolute(args.out.join(LIDAR_FILE))?));
    }
    args.method.apply(&mut settings, |key| ["max-splats", "iterations"].contains(&key));
    settings.check()?;
    Ok(settings)
}
