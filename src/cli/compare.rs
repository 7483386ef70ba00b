//! `psrgs-vk compare`: trains every method on every scene and tabulates the results.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::Context as _;
use clap::{Args as _, FromArgMatches as _};
use psrgs_vk::compare::{Finished, Run, Size, csv, markdown, page};
use psrgs_vk::eval::{Geometry, Metrics};
use psrgs_vk::format::atomic;
use psrgs_vk::numbers::counted;
use psrgs_vk::train::Settings;
use psrgs_vk::train::settings::{LidarCloud, Method, Split};

use super::console::{self, Console};
use super::eval;
use super::exit::Failure;
use super::interrupt::Interrupt;
use super::run_folder::{CHECKPOINTS, METRICS, MODEL, SETTINGS};
use super::train;
use rows::Row;

mod child;
mod rows;

const EXAMPLES: &str = "\
Examples:
  psrgs-vk compare fox caliterra --methods 3dgs,lean,psrgs --seeds 3 --out compared
  psrgs-vk compare fox --methods 3dgs:start=stereo:housekeeping=lean,psrgs,psrgs:low-stage=0 --out parts
  psrgs-vk compare fox --ablate psrgs --split val --out ablation
  psrgs-vk compare fox --percent 25,50,70,100 --out by-splats -- --lr-opacities 0.05

A comparison that was stopped goes on where it was with the same command: finished runs are kept. The names of the \
datasets' folders name the runs, so that they must differ.";

/// Train several methods on several scenes and compare what they come to
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Dataset folders
    #[arg(value_name = "DATA", required = true)]
    data: Vec<PathBuf>,
    /// Folder of the runs and of the tables
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Methods, each with settings of its own where wanted, as in psrgs:start=sfm:low-stage=0. Keys are those of `train
    /// --set`. The rows are compared with 3dgs where it is one of them, else with the first
    #[arg(
        long,
        value_name = "M[:KEY=VALUE],...",
        value_delimiter = ',',
        default_value = "3dgs,absgs,gspro,rsgs,mcmc,lean,psrgs-paper,psrgs"
    )]
    methods: Vec<String>,
    /// In place of methods: one of them, whole and with each of its parts left out or replaced
    #[arg(long, value_name = "M", conflicts_with = "methods")]
    ablate: Option<String>,
    /// Seeds of each: 0 to N - 1
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..))]
    seeds: u64,
    /// Also with at most so many percent of the splats that 3dgs has made
    #[arg(long, value_name = "P,P...", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..))]
    percent: Vec<u32>,
    /// Training steps
    #[arg(long, value_name = "N", default_value_t = 1500)]
    iterations: u32,
    /// Longer side of the photographs
    #[arg(long, value_name = "PX", default_value_t = 320)]
    max_side: u32,
    /// Photographs that are held out, as in `train`
    #[arg(long, value_name = "SPLIT", default_value_t = Split::Test)]
    split: Split,
    /// The cloud for rsgs, as in `train` [default: the dataset's lidar.las, lidar.laz or lidar.ply, else mvs]
    #[arg(long, value_name = "FILE")]
    lidar: Option<LidarCloud>,
    /// Refuse datasets with a record that cannot be used, as in `train`
    #[arg(long)]
    strict: bool,
    /// Options of `train` for all runs
    #[arg(last = true, value_name = "OPTIONS")]
    options: Vec<String>,
}

/// File with the seconds of a run, beside its metrics.
const SECONDS: &str = "process_seconds.txt";
/// File with the scores of a run whose depths stereo judged too, beside its metrics.
const JUDGED: &str = "judged.json";
/// File with the options of a run, beside its metrics.
const OPTIONS: &str = "options.txt";

pub(crate) fn run(args: &Args, interrupt: &Interrupt, console: &Console) -> anyhow::Result<()> {
    let runs = runs(args)?;
    let folder = args.out.join("runs");
    fs::create_dir_all(&folder).with_context(|| Failure::Output(folder.display().to_string()))?;
    interrupt.work_begins("stopping the training, which saves; once more to stop at once");
    let mut finished: Vec<Finished> = Vec::new();
    for (number, run) in runs.iter().enumerate() {
        let at = folder.join(run.folder());
        console.say(format_args!("{} of {}: {}", number + 1, runs.len(), run.folder()));
        let options = options(args, run, &finished)?;
        same_as_before(&at, run, &options)?;
        if !at.join(METRICS).is_file() {
            // What was judged before is another model.
            let _ = fs::remove_file(at.join(JUDGED));
            train_run(run, &at, &options, interrupt)?;
        }
        if !at.join(JUDGED).is_file() {
            judge(args, run, &at, interrupt, console)?;
        }
        let one = read(run, &at)?;
        console.say(format_args!(
            "  {:.2} dB, {}, {:.0} s",
            one.metrics.psnr.unwrap_or(f64::NAN),
            counted(one.metrics.splats, "splat"),
            one.seconds
        ));
        finished.push(one);
        // Tables are written after every run, so that the user can look at them.
        write(args, &finished)?;
    }
    console::print(&markdown(&finished))?;
    console.say(format_args!("tables and page in {}", args.out.display()));
    Ok(())
}

/// The row of the published method, whose splats limit those of others.
const PUBLISHED: &str = "3dgs";

/// The runs in order: 3dgs comes before runs whose number of splats depends on it.
fn runs(args: &Args) -> anyhow::Result<Vec<Run>> {
    let rows = match &args.ablate {
        Some(method) => rows::ablated(method)?,
        None => rows::written(&args.methods)?,
    };
    if !args.percent.is_empty() {
        if rows.first().is_none_or(|row| row.label != PUBLISHED) {
            let text = "--percent: splats are counted by those of 3dgs, which must come first";
            return Err(Failure::Usage(text.into()).into());
        }
        if let Some(row) = rows.iter().find(|row| rows::sets(&row.options, "max-splats")) {
            return Err(rows::in_row(&row.label, &"--percent limits its splats, so that max-splats cannot").into());
        }
        if rows::sets(&args.options, "max-splats") {
            let text =
                "--percent limits the splats of all runs but those of 3dgs: leave --max-splats out of the options";
            return Err(Failure::Usage(text.into()).into());
        }
    }
    if args.split == Split::None {
        return Err(Failure::Usage("--split none: nothing is held out that methods could be compared by".into()).into());
    }
    let mut runs = Vec::new();
    for (k, data) in args.data.iter().enumerate() {
        if !data.is_dir() {
            return Err(Failure::Input(format!("{}: there is no such folder", data.display())).into());
        }
        if let Some(other) = args.data[..k].iter().find(|other| other.file_name() == data.file_name()) {
            return Err(Failure::Usage(format!(
                "{} and {}: runs are named after the dataset's folder, so that these would be one; rename one of \
                 them, or link to it by another name",
                other.display(),
                data.display()
            ))
            .into());
        }
        let name = data.file_name().map(|n| n.to_string_lossy().into_owned());
        let scene =
            name.ok_or_else(|| Failure::Usage(format!("{}: a folder with a name is needed", data.display())))?;
        for seed in 0..args.seeds {
            runs.extend(rows.iter().flat_map(|row| of_row(args, row, data, &scene, seed)));
        }
    }
    let mut folders = BTreeSet::new();
    if let Some(run) = runs.iter().find(|run| !folders.insert(run.folder().to_lowercase())) {
        let text =
            format!("{}: two runs would have this folder; rename a dataset's folder, or link to it", run.folder());
        return Err(Failure::Usage(text).into());
    }
    let with_settings = |run: &&Run| run.row.contains(':') && run.size == Size::Own;
    runs.iter().filter(with_settings).try_for_each(|run| can_be_made(args, run))?;
    Ok(runs)
}

/// The runs of a row with one seed: without a limit of splats, and with each.
fn of_row(args: &Args, row: &Row, data: &Path, scene: &str, seed: u64) -> Vec<Run> {
    let sizes = std::iter::once(Size::Own).chain(args.percent.iter().map(|p| Size::Percent(*p)));
    let has_cloud = rows::sets(&row.options, "lidar") || rows::sets(&args.options, "lidar");
    let (label, options) = match row.method {
        Method::Rsgs if !has_cloud => with_cloud(row, args.lidar.clone().unwrap_or_else(|| cloud_of(data))),
        _ => (row.label.clone(), row.options.clone()),
    };
    let run = |size| Run {
        scene: scene.to_owned(),
        data: data.to_owned(),
        label: label.clone(),
        row: row.label.clone(),
        method: row.method.to_string(),
        options: options.clone(),
        seed,
        size,
    };
    // 3dgs has 100 percent of its own splats anyway.
    sizes.filter(|size| !(row.label == PUBLISHED && *size == Size::Percent(100))).map(run).collect()
}

/// Refuses a row whose settings cannot be trained together, before any run. Options of all rows that are wrong by
/// themselves are for the training to tell.
fn can_be_made(args: &Args, run: &Run) -> anyhow::Result<()> {
    let mut options = options(args, run, &[])?;
    options.push(run.data.display().to_string());
    let command = train::Args::augment_args(clap::Command::new("train").no_binary_name(true));
    let Ok(matches) = command.try_get_matches_from(options) else { return Ok(()) };
    let asked = train::Args::from_arg_matches(&matches)?;
    asked.plan(&matches).map(drop).map_err(|problem| rows::in_row(&run.row, &format!("{problem:#}")).into())
}

/// The laser scan in the dataset's folder, else the surfaces of stereo.
fn cloud_of(data: &Path) -> LidarCloud {
    let files = ["lidar.las", "lidar.laz", "lidar.ply"].map(|name| data.join(name));
    files.into_iter().find(|file| file.is_file()).map_or(LidarCloud::Mvs, LidarCloud::File)
}

/// A row of rsgs. Its label says where no laser scan was found.
fn with_cloud(row: &Row, cloud: LidarCloud) -> (String, Vec<String>) {
    let mut settings = Settings::of_method(Method::Rsgs);
    let with = row.options.iter().cloned().chain(["--lidar".to_owned(), cloud.to_string()]).collect();
    settings.density.lidar = Some(cloud);
    let note = settings.method_name();
    let note = note.strip_prefix(&Method::Rsgs.to_string()).unwrap_or_default();
    (format!("{}{note}", row.label), with)
}

/// The options of `train` for a run, without the folder of its results. Those of its row win.
fn options(args: &Args, run: &Run, finished: &[Finished]) -> anyhow::Result<Vec<String>> {
    let mut options: Vec<String> =
        ["--preset", "standard", "--scale-schedule", "--tune", "off", "--eval-every", "0"].map(String::from).into();
    let mut add = |name: &str, value: String| options.extend([name.to_owned(), value]);
    add("--iterations", args.iterations.to_string());
    add("--max-side", args.max_side.to_string());
    add("--split", args.split.to_string());
    add("--seed", run.seed.to_string());
    add("--method", run.method.clone());
    if let Size::Percent(share) = run.size {
        add("--max-splats", allowed(run, share, finished)?.to_string());
    }
    options.extend(args.strict.then(|| "--strict".to_owned()));
    options = rows::without(&options, &run.options);
    options.extend(run.options.iter().cloned());
    options.extend(rows::without(&args.options, &run.options));
    Ok(options)
}

/// A run in words: dataset and options.
fn asked(run: &Run, options: &[String]) -> String {
    let data = run.data.canonicalize().unwrap_or_else(|_| run.data.clone());
    format!("{} {}", data.display(), options.join(" "))
}

/// Refuses the folder of a run with another dataset or other options. A run of which nothing is left is made anew.
fn same_as_before(at: &Path, run: &Run, options: &[String]) -> anyhow::Result<()> {
    if !at.join(METRICS).is_file() && !begun(at) {
        return Ok(());
    }
    let (Ok(before), now) = (fs::read_to_string(at.join(OPTIONS)), asked(run, options)) else { return Ok(()) };
    if before.trim_end() == now {
        return Ok(());
    }
    Err(Failure::Usage(format!(
        "{}: made of other data or with other options ({}; now {now}); choose another --out, or remove that folder to \
         train again",
        at.display(),
        before.trim_end()
    ))
    .into())
}

/// Trains in a process of its own, so that the run's seconds include everything.
fn train_run(run: &Run, at: &Path, options: &[String], interrupt: &Interrupt) -> anyhow::Result<()> {
    let program = std::env::current_exe().context("this program has no file")?;
    let mut command = Command::new(program);
    command.arg("--quiet").arg("train");
    let mut before = 0.0;
    if begun(at) {
        before = seconds(at).unwrap_or(0.0);
        command.arg("--resume").arg(at);
    } else {
        let _ = fs::remove_file(at.join(SECONDS));
        command.arg(&run.data).arg("--out").arg(at).arg("--overwrite").args(options);
    }
    let note = |name: &str, text: String| atomic::write(&at.join(name), |out| out.write_all(text.as_bytes()));
    // Before the training, which may be killed.
    fs::create_dir_all(at).with_context(|| Failure::Output(at.display().to_string()))?;
    note(OPTIONS, format!("{}\n", asked(run, options)))?;
    let started = Instant::now();
    let status = child::run(&mut command, interrupt).context("the training cannot be run")?;
    note(SECONDS, format!("{:.3}\n", before + started.elapsed().as_secs_f64()))?;
    match status.code() {
        Some(0) => Ok(()),
        Some(130) => Err(Failure::Interrupted("stopped; the same command goes on from here".into()).into()),
        code => {
            let how = code.map_or("a signal".to_owned(), |code| format!("exit code {code}"));
            let code = code.and_then(|code| u8::try_from(code).ok()).unwrap_or(1);
            Err(Failure::Ended(code, format!("{}: the training ended with {how}", run.folder())).into())
        }
    }
}

/// Has stereo of the held-out photographs judge the depths of a run too, in a process of its own. A comparison does
/// without where that fails.
fn judge(args: &Args, run: &Run, at: &Path, interrupt: &Interrupt, console: &Console) -> anyhow::Result<()> {
    let mut command = Command::new(std::env::current_exe().context("this program has no file")?);
    command.arg("--quiet").arg("eval").arg(at.join(MODEL)).arg(&run.data);
    command.arg("--judge-depths").arg("--json").arg(at.join(JUDGED));
    command.args(["--max-side", &args.max_side.to_string(), "--split", &args.split.to_string()]);
    command.args(args.strict.then_some("--strict"));
    let of_all = rows::without(&args.options, &run.options);
    command.args(eval::known_options(run.options.iter().chain(&of_all)));
    let status = child::run(command.stdout(Stdio::null()), interrupt).context("the model cannot be scored")?;
    if interrupt.asked() {
        return Err(Failure::Interrupted("stopped; the same command goes on from here".into()).into());
    }
    if !status.success() {
        console.warn(format_args!("{}: stereo does not judge the depths of this run ({status})", run.folder()));
    }
    Ok(())
}

/// The number of splats that a share of those of 3dgs comes to.
fn allowed(run: &Run, share: u32, finished: &[Finished]) -> anyhow::Result<u64> {
    let same = |f: &&Finished| {
        let of = &f.run;
        of.label == PUBLISHED && of.size == Size::Own && of.scene == run.scene && of.seed == run.seed
    };
    let base = finished.iter().find(same).context("3dgs has not been trained on this scene")?;
    Ok((base.metrics.splats as u64 * u64::from(share) / 100).max(1))
}

/// Whether a training has left a checkpoint.
fn begun(at: &Path) -> bool {
    fs::read_dir(at.join(CHECKPOINTS)).is_ok_and(|mut files| files.next().is_some())
}

fn seconds(at: &Path) -> Option<f64> {
    fs::read_to_string(at.join(SECONDS)).ok()?.trim().parse().ok()
}

fn read(run: &Run, at: &Path) -> anyhow::Result<Finished> {
    let file = at.join(METRICS);
    let text = psrgs_vk::format::read_text(&file).with_context(|| Failure::Input(file.display().to_string()))?;
    let mut metrics: Metrics =
        serde_json::from_str(&text).with_context(|| Failure::Input(file.display().to_string()))?;
    if let Ok(text) = fs::read_to_string(at.join(JUDGED)) {
        let judged: Geometry =
            serde_json::from_str(&text).with_context(|| Failure::Input(at.join(JUDGED).display().to_string()))?;
        metrics.geometry.depth_stereo_error = judged.depth_stereo_error;
        metrics.geometry.depth_stereo_error_expected = judged.depth_stereo_error_expected;
    }
    let seconds = seconds(at).unwrap_or(metrics.seconds);
    let world = run.data.join("world.toml").is_file();
    Ok(Finished { run: run.clone(), metrics, seconds, settings: settings(at), world })
}

/// The settings of a run by key. Tables are made without the settings too.
fn settings(at: &Path) -> BTreeMap<String, String> {
    let text = psrgs_vk::format::read_text(&at.join(SETTINGS)).unwrap_or_default();
    let table: toml::Table = toml::from_str(&text).unwrap_or_default();
    let values = table.into_iter().flat_map(|(key, value)| match value {
        toml::Value::Table(group) => group.into_iter().collect(),
        value => vec![(key, value)],
    });
    let word = |value: toml::Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    values.map(|(key, value)| (key, word(value))).collect()
}

fn write(args: &Args, finished: &[Finished]) -> anyhow::Result<()> {
    let title = format!("{} steps at {} px, split {}", args.iterations, args.max_side, args.split);
    let files =
        [("table.md", markdown(finished)), ("runs.csv", csv(finished)), ("compare.html", page(&title, finished))];
    for (name, text) in files {
        atomic::write(&args.out.join(name), |out| out.write_all(text.as_bytes()))?;
    }
    Ok(())
}
