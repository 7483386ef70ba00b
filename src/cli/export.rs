//! `psrgs-vk export`: a model in the format of a viewer, and what the format costs.

mod options;
mod page;
mod scores;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context as _;
use psrgs_vk::dataset::{Dataset, Role};
use psrgs_vk::format::splats::placement::{Turned, file_beside};
use psrgs_vk::format::splats::spz::Version;
use psrgs_vk::format::splats::{self, Choice, Format};
use psrgs_vk::format::{atomic, ply};
use psrgs_vk::numbers::{counted, fraction, grouped};
use psrgs_vk::scene::{self, Camera, MapFrame};
use psrgs_vk::train::settings::HostChoice;

use super::console::{self, Console};
use super::exit::Failure;
use super::look_args::{SceneArgs, StrictArgs};
use super::map_frame;
use super::model_file::ModelFile;
use super::model_frame::ModelFrame;
pub(crate) use options::opacity;
use options::{Crop, Kind, Up};
use scores::{Row, Scorer};

/// Write a model in the format of a viewer: an HTML page, compressed PLY, SPZ, SOG, .splat or glTF
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk export fox-model/point_cloud.ply --cameras fox --out fox.html     one file that any browser shows
  psrgs-vk export fox-model/point_cloud.ply --out fox.sog
  psrgs-vk export fox-model/point_cloud.ply --out fox.spz --sh-degree 1 --max-splats 200000
  psrgs-vk export flight.ply --out flight.glb --center --up z
  psrgs-vk export fox-model/point_cloud.ply --out formats --format all --cameras fox     sizes against errors")]
pub(crate) struct Args {
    /// Model: PLY, compressed PLY, SPZ, SOG, .splat or GLB
    pub(crate) model: PathBuf,
    /// File to write; a folder with --format all
    #[arg(long, value_name = "FILE")]
    pub(crate) out: PathBuf,
    /// Format [default: by the ending of --out]
    #[arg(long, value_enum)]
    pub(crate) format: Option<Kind>,
    /// Only splats with centres in this box: least x, y, z, then largest, in the dataset's coordinates
    #[arg(long, value_name = "X0,Y0,Z0,X1,Y1,Z1", allow_hyphen_values = true)]
    pub(crate) crop: Option<Crop>,
    /// Only splats of at least this opacity, from 0 to 1
    #[arg(long, value_name = "MIN", value_parser = opacity, default_value_t = 0.0)]
    pub(crate) keep_opacity: f64,
    /// Highest degree of spherical harmonics in the file [default: that of the model]
    #[arg(long, value_name = "D", value_parser = clap::value_parser!(u32).range(..=3))]
    pub(crate) sh_degree: Option<u32>,
    /// Only the splats that cover most of pictures, at most this many
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) max_splats: Option<u32>,
    /// Move the middle of the splats to the origin
    #[arg(long)]
    pub(crate) center: bool,
    /// Axis of the model that points up, which viewers then show as up: x, y, z, -x, -y, -z, or auto (by the cameras)
    /// [default: the model is not turned, and viewers take -y as up]
    #[arg(long, value_enum, value_name = "AXIS", allow_hyphen_values = true)]
    pub(crate) up: Option<Up>,
    /// Version of SPZ files: 2, 3 or 4
    #[arg(long, value_name = "V", default_value_t = 4, value_parser = clap::value_parser!(u32).range(2..=4))]
    pub(crate) spz_version: u32,
    /// Dataset: read the file again, and tell what held-out photographs lose by the export; for an HTML file, where to
    /// look from
    #[arg(long, value_name = "DATA")]
    pub(crate) cameras: Option<PathBuf>,
    /// Write sizes, times and losses as JSON
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) scene: SceneArgs,
    /// Photographs of --cameras are reduced until their longer side has at most this many pixels
    #[arg(long, value_name = "PX", default_value_t = 1600)]
    pub(crate) max_side: u32,
    #[command(flatten)]
    pub(crate) files: StrictArgs,
    #[command(flatten)]
    pub(crate) host: HostChoice,
}

pub(crate) fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    if page::wanted(args) {
        return page::run(args, console);
    }
    let files = files(args)?;
    args.json.as_deref().map(atomic::check).transpose()?;
    let model = ModelFile::read(&args.model, false, &args.scene.frame, args.files.strict, console)?;
    let dataset = args.cameras.as_deref().map(|folder| scores::dataset(args, folder)).transpose()?;
    let up = up(args, &model, dataset.as_ref())?;
    let chosen = chosen(args, &model, console)?;
    let turned = Turned::new(&chosen, &model.dataset_to_model(), args.center, up);
    let map = map_frame::of_model(&args.model, &args.scene.frame, console);
    make_folders(args, &files)?;
    let degree = args.sh_degree.unwrap_or(3).min(chosen.sh_degree);
    let mut rows = Vec::new();
    for (format, file) in &files {
        rows.push(written(&turned, map.as_ref(), *format, file, degree, console)?);
    }
    if let Some(dataset) = dataset {
        let mut scorer = Scorer::new(args, dataset, console)?;
        let original = scorer.score(&model)?;
        for row in &mut rows {
            let before = Instant::now();
            let again = splats::read_placed(&row.file, args.files.strict)?;
            row.seconds_read = Some(before.elapsed().as_secs_f64());
            row.lost(&original, &scorer.score(&model.in_dataset(again.model))?);
        }
    }
    console::print(&scores::table(&rows))?;
    match &args.json {
        Some(file) => scores::write_json(file, &args.model, &rows),
        None => Ok(()),
    }
}

/// The formats and files to write.
fn files(args: &Args) -> Result<Vec<(Format, PathBuf)>, Failure> {
    let version = match args.spz_version {
        2 => Version::Two,
        3 => Version::Three,
        _ => Version::Four,
    };
    let with_version = |format: Format| if let Format::Spz(_) = format { Format::Spz(version) } else { format };
    let files = match args.format {
        Some(Kind::All) => {
            let stem = args.model.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let named = |format: Format| args.out.join(format!("{stem}.{}", format.extension()));
            Kind::FORMATS.map(|format| (with_version(format), named(format))).to_vec()
        }
        Some(kind) => kind.format().map(|format| vec![(with_version(format), args.out.clone())]).unwrap_or_default(),
        None => {
            let format = Format::of_name(&args.out).ok_or_else(|| {
                Failure::Usage(format!(
                    "--out {}: the ending names no format; end the name with .ply, .compressed.ply, .spz, .sog, .splat, \
                     .glb or .html, or name the format with --format",
                    args.out.display()
                ))
            })?;
            vec![(with_version(format), args.out.clone())]
        }
    };
    files.iter().try_for_each(|(_, file)| not_the_model(args, file))?;
    Ok(files)
}

/// Refuses to write over the model.
fn not_the_model(args: &Args, file: &Path) -> Result<(), Failure> {
    if file.canonicalize().is_ok_and(|file| args.model.canonicalize().is_ok_and(|model| model == file)) {
        let text = format!("--out {}: that is the model itself; choose another name", file.display());
        return Err(Failure::Usage(text));
    }
    Ok(())
}

/// Fails where a file could not be written, before long work.
fn make_folders(args: &Args, files: &[(Format, PathBuf)]) -> anyhow::Result<()> {
    if args.format == Some(Kind::All) {
        std::fs::create_dir_all(&args.out).with_context(|| Failure::Output(args.out.display().to_string()))?;
    }
    files.iter().try_for_each(|(_, file)| Ok(atomic::check(file)?))
}

/// The model with the splats that the options leave.
fn chosen(args: &Args, model: &ModelFile, console: &Console) -> Result<ply::Model, Failure> {
    let choice = Choice {
        within: args.crop.map(|crop| (crop.low, crop.high)),
        least_opacity: args.keep_opacity,
        most: args.max_splats.map(|most| most as usize),
    };
    let (chosen, model) = (choice.of(model.model(), &model.dataset_to_model().inverse()), model.model());
    let (kept, all) = (chosen.gaussians.len(), model.gaussians.len());
    if kept == 0 && all > 0 {
        return Err(Failure::Usage(format!(
            "none of {} is left: is --crop in the dataset's coordinates, and --keep-opacity low enough?",
            counted(all, "splat")
        )));
    }
    if kept < all {
        console.say(format_args!("{} of {} are kept", grouped(kept), counted(all, "splat")));
    }
    Ok(chosen)
}

/// The direction in the model's coordinates that is turned up.
fn up(args: &Args, model: &ModelFile, dataset: Option<&Dataset>) -> Result<Option<[f64; 3]>, Failure> {
    match (args.up, dataset) {
        (None, _) => Ok(None),
        (Some(Up::Auto), None) => {
            Err(Failure::Usage("--up auto goes by the cameras of a dataset: name it with --cameras".to_owned()))
        }
        (Some(Up::Auto), Some(dataset)) => {
            let used = |(k, view): (usize, &psrgs_vk::dataset::View)| {
                (view.role != Role::Unused).then(|| dataset.scene_camera(k)).flatten()
            };
            let cameras: Vec<Camera> = dataset.views.iter().enumerate().filter_map(used).collect();
            let Some(up) = scene::up_of(&cameras) else { return Ok(None) };
            Ok(Some(match &model.frame {
                ModelFrame::Dataset { .. } => up,
                // Transposed: from the dataset's axes to the model's.
                ModelFrame::Other { to_dataset, .. } => {
                    std::array::from_fn(|j| (0..3).map(|i| to_dataset.rotation[i][j] * up[i]).sum())
                }
            }))
        }
        (Some(axis), _) => Ok(axis.direction()),
    }
}

/// Writes a file, and tells its size and where its coordinates are.
fn written(
    turned: &Turned,
    map: Option<&MapFrame>,
    format: Format,
    file: &Path,
    degree: u32,
    console: &Console,
) -> anyhow::Result<Row> {
    let before = Instant::now();
    format.write(file, &turned.model, degree)?;
    let seconds_write = before.elapsed().as_secs_f64();
    let beside = turned.write_beside(file, format.holds_shift(), map)?;
    let splats = turned.model.gaussians.len();
    let bytes = std::fs::metadata(file).map(|m| m.len()).unwrap_or(0);
    let degree = if format == Format::Splat { 0 } else { degree };
    let row = Row::new(format, file, splats, bytes, degree, seconds_write);
    console.say(format_args!(
        "{}: {} in {} bytes, {} a splat, spherical harmonics of degree {degree}, written in {} s",
        file.display(),
        counted(splats, "splat"),
        grouped(bytes),
        fraction(row.bytes_per_splat, 1),
        fraction(seconds_write, 1),
    ));
    if beside {
        tell_beside(file, map, console);
    } else if turned.model.shift != [0.0; 3] {
        let [x, y, z] = turned.model.shift;
        console.say(format_args!("coordinates are the dataset's less {x} {y} {z}, which the file tells"));
    }
    Ok(row)
}

/// Tells of the file beside a model.
fn tell_beside(model: &Path, map: Option<&MapFrame>, console: &Console) {
    let frame = file_beside(model);
    console.say(format_args!("where the model belongs is told by {}: keep it beside the model", frame.display()));
    if let Some(map) = map {
        let code = map.epsg.map(|code| format!(" (EPSG:{code})")).unwrap_or_default();
        console.say(format_args!("with the matrix to {}{code}, heights above: {}", map.system, map.heights));
    }
}
