//! `psrgs-vk blocks merge`: one model from the blocks of a plan, with scores and a report.

use std::fs;
use std::path::{Path, PathBuf, absolute};
use std::time::Instant;

use clap::{Args as _, Command, FromArgMatches as _};
use psrgs_vk::blocks::{BlockModel, BlockState, DoneFile, GLOBAL, Merged, PLAN_PICTURE, PlanFolder, merge};
use psrgs_vk::dataset::{Dataset, HostShare};
use psrgs_vk::format::{EXPOSURE_FILE, ExposureFile, FRAME_FILE, FrameFile, atomic};
use psrgs_vk::numbers::counted;
use psrgs_vk::train::settings::{DeviceChoice, HostChoice, Split};
use psrgs_vk::train::{HostMemory, Settings, prepare};

use crate::cli::console::Console;
use crate::cli::eval;
use crate::cli::exit::{self, Failure};
use crate::cli::geo_args::GeoArgs;
use crate::cli::run_folder::{METRICS, MODEL, RENDERS, REPORT};

/// Bytes of host memory that scoring takes for a splat: the splats as the file has them, in the scene, and as the page
/// in the report has them. Measured on a processor, where those of the device come on top: 1,500.
const SCORED: u64 = 1000;

/// Make one model of the blocks of a plan, and score it on the held-out photographs of the whole scene
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Folder of the plan
    #[arg(value_name = "PLAN")]
    pub(super) plan: PathBuf,
    /// Take the dataset from here [default: the folder that the plan names]
    #[arg(long, value_name = "DIR")]
    pub(super) data: Option<PathBuf>,
    /// Write the model only: neither scores nor a report
    #[arg(long)]
    pub(super) no_scores: bool,
    #[command(flatten)]
    pub(super) device: DeviceChoice,
    #[command(flatten)]
    pub(super) host: HostChoice,
}

pub(crate) fn run(args: &Args, console: &Console, started: Instant) -> anyhow::Result<()> {
    let folder = PlanFolder::open(&args.plan)?;
    let settings = folder.plan.settings()?;
    let done = finished(&folder)?;
    tell_coarse_models(&done, console);
    let file = folder.path.join(MODEL);
    let models = (0..).zip(&folder.plan.blocks);
    let models: Vec<BlockModel> =
        models.map(|(block, planned)| BlockModel { block, file: folder.model_of(&planned.id) }).collect();
    // Results of an earlier merge would not fit the new model if this one ends early.
    [METRICS, REPORT].into_iter().try_for_each(|name| atomic::remove(&folder.path.join(name)))?;
    let merged = merge(&folder.plan, &models, &file)?;
    console.say(format_args!("{} in {}", counted(merged.splats, "splat"), file.display()));
    if args.no_scores {
        return Ok(());
    }
    let data = absolute(args.data.as_ref().unwrap_or(&folder.plan.dataset.path))?;
    files_beside(&folder, &data, &settings)?;
    if settings.photographs.split == Split::None {
        console.say("the plan holds no photographs out: the model is not scored");
        return Ok(());
    }
    let scoring = scoring(args, &file, &data, &settings)?;
    let drawing = fs::read_to_string(folder.path.join(PLAN_PICTURE)).ok();
    let caption = format!("The plan: {}", counted(folder.plan.blocks.len(), "block"));
    let beside = eval::Beside {
        report: Some(folder.path.join(REPORT)),
        drawing: drawing.map(|svg| (svg, caption)),
        values: values(&folder, &done, &merged)?,
    };
    let scored = has_room(merged.splats, &scoring.host).and_then(|()| eval::score(&scoring, &beside, console, started));
    match scored {
        Err(error) if exit::is_of_memory(&error) => console.warn(unscored(&error, &folder, &data)),
        scored => {
            scored?;
            console.say(format_args!("report: {}", folder.path.join(REPORT).display()));
        }
    }
    Ok(())
}

/// Fails where scoring so many splats takes more host memory than may be used: reading them would end the process.
fn has_room(splats: u64, host: &HostChoice) -> anyhow::Result<()> {
    let share = HostShare { keep: 0, decoding: splats.saturating_mul(SCORED), threads: 1 };
    Ok(HostMemory::new(host.host_memory.map(|bytes| bytes.0)).check(&share)?)
}

/// Why the merged model has no scores, and how to get some.
fn unscored(error: &anyhow::Error, folder: &PlanFolder, data: &Path) -> String {
    format!(
        "the merged model is whole, and is not scored: {}. Copy {} and {FRAME_FILE} beside it to a computer with more \
         memory, and give psrgs-vk eval {MODEL} {} there; or raise --max-device-memory or --host-memory; psrgs-vk blocks status has \
         the scores of each block",
        exit::message(error),
        folder.path.join(MODEL).display(),
        data.display()
    )
}

/// What the blocks left behind. Fails, and names all of them, where some may not be used.
fn finished(folder: &PlanFolder) -> anyhow::Result<Vec<DoneFile>> {
    let (mut done, mut problems) = (Vec::new(), Vec::new());
    for block in &folder.plan.blocks {
        let problem = match folder.state(&block.id) {
            BlockState::Done(found) => {
                done.push(*found);
                continue;
            }
            BlockState::Waiting => "not trained".to_owned(),
            BlockState::Begun => "not trained to the end".to_owned(),
            BlockState::Stale(stale) => stale.to_string(),
            BlockState::Damaged(error) => error.to_string(),
        };
        problems.push(format!("block {}: {problem}", block.id));
    }
    match problems.is_empty() {
        true => Ok(done),
        false => Err(Failure::Input(format!(
            "{}: {} cannot be merged: {}; psrgs-vk blocks run trains what is missing, with --overwrite what is stale \
             too",
            folder.path.display(),
            counted(problems.len(), "block"),
            problems.join("; ")
        ))
        .into()),
    }
}

/// Warns where blocks were trained with different coarse models.
fn tell_coarse_models(done: &[DoneFile], console: &Console) {
    let own = |done: &DoneFile| done.origin.global_sha256.clone();
    let Some(first) = done.first() else { return };
    let others: Vec<&str> =
        done.iter().filter(|other| own(other) != own(first)).map(|other| other.origin.block.as_str()).collect();
    if !others.is_empty() {
        console.warn(format_args!(
            "{}: of one coarse model, {} of another: colours may differ at the seams; train {GLOBAL} first and copy \
             the plan's folder then",
            first.origin.block,
            others.join(", ")
        ));
    }
}

/// Writes what lies beside a trained model: its place on Earth, and the exposures of the coarse model.
fn files_beside(folder: &PlanFolder, data: &Path, settings: &Settings) -> anyhow::Result<()> {
    // Photographs say where they were taken.
    let dataset = Dataset::load(data, &prepare::load_options_of(settings))?;
    let map = GeoArgs::default().placed(&dataset)?.georeference.record(dataset.frame.offset);
    let frame = FrameFile::new(dataset.frame, dataset.coordinates.clone()).with_map(map);
    frame.write(&folder.path.join(FRAME_FILE))?;
    let solved = folder.folder_of(GLOBAL).join(EXPOSURE_FILE);
    if solved.is_file() {
        ExposureFile::read(&solved)?.write(&folder.path.join(EXPOSURE_FILE))?;
    }
    Ok(())
}

/// The options of `eval` that score the merged model as a training would.
fn scoring(args: &Args, model: &Path, data: &Path, settings: &Settings) -> anyhow::Result<eval::Args> {
    let [red, green, blue] = settings.model.background.evaluated();
    let background = format!("{red},{green},{blue}");
    let words = [Path::new("eval"), model, data, Path::new("--background"), Path::new(&background)];
    let matches = eval::Args::augment_args(Command::new("eval")).try_get_matches_from(words)?;
    let mut scoring = eval::Args::from_arg_matches(&matches)?;
    let folder = model.parent().unwrap_or(Path::new(""));
    scoring.json = Some(folder.join(METRICS));
    scoring.out = Some(folder.join(RENDERS));
    scoring.photographs = settings.photographs.clone();
    scoring.scoring = settings.scoring.clone();
    scoring.host = HostChoice { host_memory: args.host.host_memory.or(settings.host.host_memory) };
    scoring.look.scene.device = DeviceChoice {
        device: args.device.device.clone().or_else(|| settings.device.device.clone()),
        max_device_memory: args.device.max_device_memory.or(settings.device.max_device_memory),
    };
    Ok(scoring)
}

/// What `metrics.json` says of the blocks.
fn values(
    folder: &PlanFolder,
    done: &[DoneFile],
    merged: &Merged,
) -> anyhow::Result<serde_json::Map<String, serde_json::Value>> {
    let global = DoneFile::read(&folder.folder_of(GLOBAL).join(psrgs_vk::blocks::DONE_FILE)).ok();
    let blocks: Vec<serde_json::Value> = done
        .iter()
        .zip(&merged.of_blocks)
        .map(|(done, [kept, left_out])| {
            serde_json::json!({
                "block": done.origin.block,
                "splats": kept,
                "splats_of_others": left_out,
                "seconds": done.seconds,
                "peak_device_bytes": done.metrics.peak_device_bytes,
                "steps": done.metrics.iterations,
                "train_images": done.metrics.train_images,
            })
        })
        .collect();
    let mut values = serde_json::Map::new();
    let seconds: f64 = done.iter().map(|done| done.seconds).sum();
    values.insert("seconds_blocks".to_owned(), seconds.into());
    values.insert("seconds_global".to_owned(), global.map(|done| done.seconds).into());
    values.insert("blocks".to_owned(), blocks.into());
    Ok(values)
}
