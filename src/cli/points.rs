//! `psrgs-vk points`: a point cloud of a model, or of stereo, on a map.

use std::path::{Path, PathBuf};
use std::time::Instant;

use psrgs_vk::dataset::{Dataset, LoadOptions, Split};
use psrgs_vk::format::{atomic, las};
use psrgs_vk::geodesy::{Georeference, VerticalDatum};
use psrgs_vk::map::{SplatPoints, StereoPoints, steps};
use psrgs_vk::numbers::{counted, fraction, grouped};
use psrgs_vk::scene::Similarity;
use psrgs_vk::train::settings::{DeviceChoice, HostChoice};

use super::console::Console;
use super::exit::Failure;
use super::export::opacity;
use super::geo_args::{self, GeoArgs};
use super::look_args::StrictArgs;
use super::model_file::ModelFile;
use super::model_frame::{FrameArgs, ModelFrame};
use super::{device, map_frame, output_guard, stereo};

/// Positions that decide the steps of coordinates.
const SAMPLE: usize = 100_000;

/// Write a point cloud of a model, or of stereo, as LAS or LAZ on a map
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk points flight-model/point_cloud.ply --cameras flight --out flight.laz
  psrgs-vk points flight-model/point_cloud.ply --cameras flight --crs EPSG:25832 --out flight.laz
  psrgs-vk points --stereo flight --max-side 640 --out stereo.laz

A point has a colour, and as extra bytes NormalX, NormalY, NormalZ and Error: a splat's shortest axis, towards the \
cameras, and its standard deviation along the axis; for stereo, the expected error of the depth.")]
pub(crate) struct Args {
    /// Model
    #[arg(required_unless_present = "stereo")]
    pub(crate) model: Option<PathBuf>,
    /// Dataset: points of multi-view stereo of its photographs instead of a model's splats
    #[arg(long, value_name = "DATA", conflicts_with_all = ["model", "cameras", "frame", "keep_opacity"])]
    pub(crate) stereo: Option<PathBuf>,
    /// File to write: LAS, or compressed where the name ends in .laz
    #[arg(long, value_name = "FILE")]
    pub(crate) out: PathBuf,
    /// Dataset of the model: its place on a map, and the cameras that normals point to [default: the place in
    /// frame.json beside the model]
    #[arg(long, value_name = "DATA")]
    pub(crate) cameras: Option<PathBuf>,
    /// Only splats of at least this opacity, from 0 to 1
    #[arg(long, value_name = "MIN", value_parser = opacity, default_value_t = 0.2)]
    pub(crate) keep_opacity: f64,
    /// For stereo, photographs are reduced until their longer side has at most this many pixels
    #[arg(long, value_name = "PX", default_value_t = 640)]
    pub(crate) max_side: u32,
    #[command(flatten)]
    pub(crate) files: StrictArgs,
    #[command(flatten)]
    pub(crate) frame: FrameArgs,
    #[command(flatten)]
    pub(crate) geo: GeoArgs,
    #[command(flatten)]
    pub(crate) device: DeviceChoice,
    #[command(flatten)]
    pub(crate) host: HostChoice,
}

pub(crate) fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let ending = args.out.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    if !["las", "laz"].iter().any(|known| ending.eq_ignore_ascii_case(known)) {
        return Err(
            Failure::Usage(format!("--out {}: the file's name ends in .las or .laz", args.out.display())).into()
        );
    }
    atomic::check(&args.out)?;
    match (&args.stereo, &args.model) {
        (Some(data), _) => of_stereo(data, args, console),
        (None, Some(model)) => of_splats(model, args, console),
        // The parser asks for one of them.
        (None, None) => Err(Failure::Usage("a model or --stereo DATA is needed".to_owned()).into()),
    }
}

fn of_splats(file: &Path, args: &Args, console: &Console) -> anyhow::Result<()> {
    let model = ModelFile::read(file, false, &args.frame, args.files.strict, console)?;
    let same = |a: &Path, b: &Path| a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b));
    if same(file, &args.out) {
        return Err(Failure::Usage(format!("--out {}: that is the model", args.out.display())).into());
    }
    let options = LoadOptions { strict: args.files.strict, ..LoadOptions::default() };
    let dataset = args.cameras.as_deref().map(|data| geo_args::dataset(data, options, console)).transpose()?;
    if let Some(dataset) = &dataset {
        keep_out(&args.out, dataset)?;
    }
    let georeference = match &dataset {
        Some(dataset) => args.geo.place(dataset, console)?.georeference,
        None => beside(file, args, console)?,
    };
    let content = model.model();
    let to_dataset = match &model.frame {
        ModelFrame::Dataset { offset, .. } => Similarity { translation: *offset, ..Similarity::IDENTITY },
        ModelFrame::Other { to_dataset, .. } => to_dataset.after_shift(content.shift),
    };
    let eyes: Vec<[f64; 3]> = dataset.iter().flat_map(|data| data.views.iter().map(|v| v.camera.center())).collect();
    let splats = SplatPoints {
        gaussians: &content.gaussians,
        sh_degree: content.sh_degree,
        to_dataset,
        georeference: &georeference,
        eyes: &eyes,
        least_opacity: args.keep_opacity,
    };
    let every = (model.splats() / SAMPLE).max(1);
    let means = content.gaussians.means.chunks_exact(3).step_by(every);
    let sample: Vec<[f64; 3]> =
        means.map(|mean| georeference.to_map(to_dataset.point([0, 1, 2].map(|k| f64::from(mean[k]))))).collect();
    let nothing = || {
        let (least, file) = (args.keep_opacity, file.display());
        format!(
            "{file}: none of {} has an opacity of {least}; a lower --keep-opacity keeps more",
            counted(model.splats(), "splat")
        )
    };
    let enough = |logit: &f32| 1.0 / (1.0 + (-f64::from(*logit)).exp()) >= args.keep_opacity;
    if !content.gaussians.opacities.iter().any(enough) {
        return Err(Failure::Input(nothing()).into());
    }
    write(args, &georeference, &sample, splats.points(), console)
}

fn of_stereo(data: &Path, args: &Args, console: &Console) -> anyhow::Result<()> {
    let options = LoadOptions {
        max_side: Some(args.max_side),
        split: Split::None,
        host_memory: args.host.host_memory.map(|bytes| bytes.0),
        strict: args.files.strict,
        ..LoadOptions::default()
    };
    let mut dataset = Dataset::load(data, &options)?;
    dataset.warnings.iter().filter(|warning| warning.is_of_files()).for_each(|warning| console.warn(warning));
    keep_out(&args.out, &dataset)?;
    let georeference = args.geo.place(&dataset, console)?.georeference;
    let gpu = device::open(&args.device, false, console)?;
    let cloud = stereo::cloud(&mut dataset, args.max_side, &gpu, &args.host, console)?;
    if cloud.points.is_empty() {
        let text = format!("{}: no two photographs agree on any depth, so there is no point", data.display());
        return Err(Failure::Input(text).into());
    }
    let frame = &dataset.frame;
    let points = StereoPoints { points: &cloud.points, views: &cloud.views, frame, georeference: &georeference };
    let every = (cloud.points.len() / SAMPLE).max(1);
    let sample: Vec<[f64; 3]> = points.points().step_by(every).map(|point| point.position).collect();
    write(args, &georeference, &sample, points.points(), console)
}

/// Refuses a file in a folder of photographs.
fn keep_out(out: &Path, dataset: &Dataset) -> Result<(), Failure> {
    let exists = out.exists();
    match out.parent().filter(|_| exists) {
        Some(folder) => output_guard::check(folder, dataset),
        None => Ok(()),
    }
}

/// The place that a file beside a model names.
fn beside(file: &Path, args: &Args, console: &Console) -> anyhow::Result<Georeference> {
    if args.geo.crs.is_some() || args.geo.gcp.is_some() {
        let text = "--crs and --gcp need the dataset: add --cameras DATA".to_owned();
        return Err(Failure::Usage(text).into());
    }
    let known = map_frame::georeference(file)?;
    match &known {
        Some((found, by)) => {
            let system = found.system().map(ToString::to_string).unwrap_or_default();
            console.say(format_args!("map: {system}, by {}", by.display()));
        }
        None => {
            console.say(format_args!("map: none is known, so the coordinates are the dataset's; else --cameras DATA"))
        }
    }
    let found = known.map_or_else(Georeference::local, |(found, _)| found);
    Ok(match args.geo.heights {
        VerticalDatum::Ellipsoid => found,
        VerticalDatum::Stated { .. } => found.with_heights(args.geo.heights.clone()),
    })
}

fn write(
    args: &Args,
    georeference: &Georeference,
    sample: &[[f64; 3]],
    points: impl Iterator<Item = las::CloudPoint>,
    console: &Console,
) -> anyhow::Result<()> {
    let before = Instant::now();
    let wkt = georeference.system().map(|system| system.wkt_with_heights());
    let (step, offset) = steps(sample, wkt.is_some());
    let written = las::write(&args.out, &las::Coordinates { wkt: wkt.as_deref(), step, offset }, points)?;
    if written.left_out > 0 {
        console.warn(format_args!(
            "{} left out: too far away for a file whose coordinates have steps of {step}",
            counted(written.left_out as usize, "point")
        ));
    }
    let bytes = std::fs::metadata(&args.out).map(|m| m.len()).unwrap_or(0);
    console.say(format_args!(
        "{}: {} in {} bytes, coordinates in steps of {step}, written in {} s",
        args.out.display(),
        counted(written.points as usize, "point"),
        grouped(bytes),
        fraction(before.elapsed().as_secs_f64(), 1)
    ));
    Ok(())
}
