//! `psrgs-vk eval`: scores of a model on held-out photographs.

mod results;

use std::path::PathBuf;
use std::time::Instant;

use clap::{Args as _, Command};
use psrgs_vk::dataset::{Dataset, LoadOptions, Role, Warning};
use psrgs_vk::eval::geometry::{self, JudgedDepth};
use psrgs_vk::eval::{Geometry, SeenPixels};
use psrgs_vk::format::atomic;
use psrgs_vk::numbers::{counted, grouped, of_count};
use psrgs_vk::train::settings::{DeviceChoice, HostChoice, Photographs, Scoring, Split};
use psrgs_vk::train::{View, prepare};
use psrgs_vk::vk::Gpu;

use super::console::{self, Console};
use super::exit::Failure;
use super::exposure_args::{self, ExposureArgs};
use super::held_out::{self, Compared, Comparison};
use super::look_args::LookArgs;
use super::lpips::Lpips;
use super::model_file::{Drawn, ModelFile};
use super::pictures::Pictures;
use super::resize_args::SizeArgs;
use super::run_folder::{REPORT, SETTINGS};
use super::{output_guard, progress, settings_mismatch};
use results::Scored;

/// Score a model on the held-out photographs of a dataset
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk eval fox-model/point_cloud.ply fox
  psrgs-vk eval other-trainer.ply fox --max-side 640 --json scores.json
  psrgs-vk eval splat.ply fox --frame dataparser_transforms.json --downscale 2 --rounding down
  psrgs-vk eval fox-model/point_cloud.ply fox --out scored      pictures and report.html")]
pub(crate) struct Args {
    /// Model of this or another trainer: PLY, compressed PLY, SPZ, SOG, .splat or GLB
    pub(crate) model: PathBuf,
    /// Dataset
    pub(crate) data: PathBuf,
    /// Write the scores, for each photograph too, as JSON
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
    /// Write renders, photographs, depth and normals into this folder, and a report.html
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Judge depths also by stereo of the held-out photographs, which takes as long as stereo of a training
    #[arg(long)]
    pub(crate) judge_depths: bool,
    #[command(flatten)]
    pub(crate) exposure: ExposureArgs,
    #[command(flatten)]
    pub(crate) photographs: Photographs,
    #[command(flatten)]
    pub(crate) size: SizeArgs,
    #[command(flatten)]
    pub(crate) scoring: Scoring,
    #[command(flatten)]
    pub(crate) look: LookArgs,
    #[command(flatten)]
    pub(crate) host: HostChoice,
}

/// What the caller adds to the results.
#[derive(Debug, Default)]
pub(crate) struct Beside {
    /// The report's file, in place of that in the folder of pictures.
    pub(crate) report: Option<PathBuf>,
    /// A drawing in SVG for the report, with its caption.
    pub(crate) drawing: Option<(String, String)>,
    /// Values for the JSON file.
    pub(crate) values: serde_json::Map<String, serde_json::Value>,
}

pub(crate) fn run(args: &Args, console: &Console, started: Instant) -> anyhow::Result<()> {
    score(args, &Beside::default(), console, started)
}

/// Scores a model, writes the results that the options ask for, and adds what the caller has.
pub(crate) fn score(args: &Args, beside: &Beside, console: &Console, started: Instant) -> anyhow::Result<()> {
    may_be_written(args)?;
    let model = model_with_splats(args, console)?;
    let options = args.size.apply(prepare::load_options(&args.photographs, args.look.scene.background.rgb));
    let options = LoadOptions { host_memory: args.host.host_memory.map(|bytes| bytes.0), ..options };
    let mut dataset = dataset_with_held_out(args, &options)?;
    let exposures = args.exposure.read(&args.model, &dataset, console)?;
    let views = held_out_views(args, &mut dataset, console)?;
    tell(args, &dataset, &views, console);
    warn_of_differences(args, &options, &dataset, console);
    let mut lpips = Lpips::find(&args.scoring, console)?;
    let gpu = args.look.scene.open(console)?;
    let mut drawn = args.look.upload(&gpu, &model, &dataset.frame)?;
    let pictures = match &args.out {
        Some(folder) => Some(Pictures::new(folder, views.iter().map(|v| v.name.as_str()), dataset.frame.scale)?),
        None => None,
    };
    // Which photographs a training leaves out for their pixels is known to a training alone.
    let share = prepare::host_share(&dataset, Role::Train, &args.host);
    let seen = SeenPixels::of(&dataset, &share, |_| true)?;
    let mut comparison =
        Comparison::new(&gpu, &mut lpips, exposures, pictures, views.len(), console).with_seen(Some(seen));
    let bar = progress::counter(console, views.len(), "photographs");
    for view in &views {
        // Depth and normals are rendered only where they are written.
        comparison.add(view, drawn.picture(&view.camera, args.out.is_some())?)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    drawn.warn_if_unseen(&args.model, &args.data, console);
    let compared = comparison.end();
    let geometry = known_geometry(&dataset, &options, &model, &mut drawn)?;
    let geometry = match args.judge_depths {
        true => judged_by_stereo(args, geometry, &dataset, &mut drawn, &gpu, console)?,
        false => geometry,
    };
    tell_scores(&compared, &geometry, console)?;

    let size = views.first().map_or((0, 0), |v| (v.camera.width, v.camera.height));
    let scored = Scored { args, beside, model: &model, dataset: &dataset, gpu: &gpu, size, compared, geometry };
    if let Some(file) = &args.json {
        scored.write_json(file)?;
    }
    if let Some(folder) = &args.out {
        let report = beside.report.clone().unwrap_or_else(|| folder.join(REPORT));
        scored.write_report(&report, started)?;
        console.say(format_args!("pictures and report in {}", folder.display()));
    }
    Ok(())
}

/// Of options of `train` those that say the same to `eval`: which photographs there are, and what computes.
pub(crate) fn known_options<'a>(options: impl Iterator<Item = &'a String>) -> Vec<String> {
    let known = Photographs::augment_args(HostChoice::augment_args(DeviceChoice::augment_args(Command::new("eval"))));
    let (mut kept, mut values) = (Vec::new(), 0);
    for word in options {
        let name =
            word.strip_prefix("--").map(|name| name.split_once('=').map_or((name, false), |(name, _)| (name, true)));
        if let Some((name, with_value)) = name {
            let arg = known.get_arguments().find(|arg| arg.get_long() == Some(name));
            values = arg.map_or(0, |arg| 1 + usize::from(arg.get_action().takes_values() && !with_value));
        }
        if values > 0 {
            values -= 1;
            kept.push(word.clone());
        }
    }
    kept
}

/// Checks that the results can be written and replace no training, before any work is done.
fn may_be_written(args: &Args) -> anyhow::Result<()> {
    args.json.as_deref().map(atomic::check).transpose()?;
    match args.out.as_deref().filter(|folder| folder.join(SETTINGS).is_file()) {
        Some(folder) => Err(Failure::Usage(format!(
            "--out {}: that is the folder of a training, whose report and renders would be replaced; choose another \
             folder",
            folder.display()
        ))
        .into()),
        None => Ok(()),
    }
}

/// Reads the model and refuses one without splats.
fn model_with_splats(args: &Args, console: &Console) -> anyhow::Result<ModelFile> {
    let model = args.look.read(&args.model, args.photographs.strict, console)?;
    if model.splats() == 0 {
        let text = format!("{}: the model has no splats: there is nothing to score", args.model.display());
        return Err(Failure::Input(text).into());
    }
    Ok(model)
}

/// Loads the dataset. Refuses one without held-out photographs, and an output folder inside the dataset.
fn dataset_with_held_out(args: &Args, options: &LoadOptions) -> anyhow::Result<Dataset> {
    let dataset = Dataset::load(&args.data, options)?;
    args.out.as_deref().map(|out| output_guard::check(out, &dataset)).transpose()?;
    if dataset.views_of(Role::HeldOut).next().is_none() {
        return Err(nothing_held_out(args, &dataset));
    }
    Ok(dataset)
}

/// The held-out photographs. Warns of photographs that are left out and of pixels that do not count.
fn held_out_views(args: &Args, dataset: &mut Dataset, console: &Console) -> anyhow::Result<Vec<View>> {
    let mut share = prepare::host_share(dataset, Role::HeldOut, &args.host);
    let (views, undecoded) = prepare::views(dataset, Role::HeldOut, &mut share)?;
    dataset.leave_out(&undecoded);
    undecoded.warning.iter().for_each(|warning| console.warn(warning));
    if dataset.views_of(Role::HeldOut).next().is_none() {
        return Err(nothing_held_out(args, dataset));
    }
    if views.is_empty() {
        return Err(psrgs_vk::train::Error::AllMasked { dataset: dataset.path.clone(), role: Role::HeldOut }.into());
    }
    prepare::left_out(dataset, Role::HeldOut, &views).iter().for_each(|warning| console.warn(warning));
    Ok(views)
}

/// Prints which photographs are scored.
fn tell(args: &Args, dataset: &Dataset, views: &[View], console: &Console) {
    let images = dataset.images.as_ref().map(|f| f.path.display().to_string()).unwrap_or_default();
    let mut sizes: Vec<String> = views.iter().map(|v| format!("{}x{}", v.camera.width, v.camera.height)).collect();
    sizes.sort();
    sizes.dedup();
    let sizes = if sizes.len() > 3 { format!("{} sizes", sizes.len()) } else { sizes.join(", ") };
    console.say(format_args!(
        "{} of {} of {images} {} scored (--split {}), at {sizes}, background {}",
        grouped(views.len()),
        counted(dataset.views.len(), "photograph"),
        of_count(views.len(), "is", "are"),
        args.photographs.split,
        args.look.scene.background
    ));
    for line in dataset.deep_photographs() {
        console.say(format_args!("{line}; scores are those of 8 bits"));
    }
    for warning in warnings(dataset) {
        console.warn(warning);
    }
}

/// The warnings that matter without a training.
fn warnings(dataset: &Dataset) -> impl Iterator<Item = &Warning> {
    dataset.warnings.iter().filter(|warning| !warning.is_of_training())
}

/// Why no photograph is held out.
fn nothing_held_out(args: &Args, dataset: &Dataset) -> anyhow::Error {
    if args.photographs.split == Split::None {
        return Failure::Usage("--split none holds no photograph out: there is nothing to score".into()).into();
    }
    let views = counted(dataset.views.len(), "photograph");
    Failure::Input(format!("{}: with {views} none is held out to be scored", args.data.display())).into()
}

/// Warns where the model is scored with other settings than those of its training.
fn warn_of_differences(args: &Args, options: &LoadOptions, dataset: &Dataset, console: &Console) {
    let held_out = dataset.views_of(Role::HeldOut).map(|(_, view)| view.size_on_disk.0.max(view.size_on_disk.1));
    let longest = held_out.max().filter(|_| options.sizing.is_none());
    for line in settings_mismatch::differences(&args.model, &args.photographs, args.look.scene.background.rgb, longest)
    {
        console.warn(line);
    }
}

/// Compares the model with the dataset's ground truth and reconstructed points, as far as there are any.
fn known_geometry(
    dataset: &Dataset,
    options: &LoadOptions,
    model: &ModelFile,
    drawn: &mut Drawn,
) -> anyhow::Result<Geometry> {
    geometry::measure_by(dataset, options, &model.in_scene(&dataset.frame), |camera, known| {
        Ok((drawn.picture(camera, true)?, drawn.probe(camera, known)?))
    })
}

/// Judges the depths of the model by stereo of the held-out photographs too.
fn judged_by_stereo(
    args: &Args,
    geometry: Geometry,
    dataset: &Dataset,
    drawn: &mut Drawn,
    gpu: &Gpu,
    console: &Console,
) -> anyhow::Result<Geometry> {
    let judges = held_out::depths_by_stereo(dataset, &args.host, gpu, console)?;
    if judges.is_empty() {
        console.warn("stereo is confident of no depth of a held-out photograph: it judges none");
    }
    let stereo = JudgedDepth::of(&judges, |camera, known| {
        anyhow::Ok((drawn.picture(camera, true)?, drawn.probe(camera, known)?))
    })?;
    Ok(Geometry { depth_stereo_error: stereo.median, depth_stereo_error_expected: stereo.expected, ..geometry })
}

/// Prints the scores.
fn tell_scores(compared: &Compared, geometry: &Geometry, console: &Console) -> anyhow::Result<()> {
    console::print(&results::scores_table(&compared.images))?;
    if let Some(scores) = &compared.exposures {
        console.say(exposure_args::line(scores));
    }
    if *geometry != Geometry::default() {
        console::print(&results::geometry_table(geometry))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #[test]
    fn eval_is_handed_the_options_that_it_knows() {
        let options = ["--lr-means", "0.1", "--split=val", "--strict", "--sh-degree=2", "--images", "half", "--masks"];
        let options: Vec<String> = options.map(str::to_owned).into();
        let kept = super::known_options(options.iter());
        assert_eq!(kept, ["--split=val", "--strict", "--images", "half"]);
    }
}
