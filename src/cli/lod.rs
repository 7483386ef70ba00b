//! `psrgs-vk lod`: levels of detail of a model, for viewers that load what a view needs.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context as _;
use psrgs_vk::format::atomic;
use psrgs_vk::lod::{Content, StreamedSog, TileSet, Tree};
use psrgs_vk::numbers::{counted, fraction};
use psrgs_vk::scene::Similarity;

use super::console::Console;
use super::exit::Failure;
use super::look_args::StrictArgs;
use super::map_frame;
use super::model_file::ModelFile;
use super::model_frame::{FrameArgs, ModelFrame};

/// Most splats of a tile: Cesium draws millions of splats in tiles of this size, and leaves larger tiles blank.
const MOST: u32 = 50_000;

/// Forms of the result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Form {
    /// 3D Tiles 1.1: tileset.json, and glTF files with KHR_gaussian_splatting
    Tiles,
    /// 3D Tiles 1.1 whose splats are packed as SPZ, version 2: smaller, and the only form that Cesium draws
    TilesSpz,
    /// Streamed SOG: lod-meta.json, for PlayCanvas and SuperSplat
    Sog,
}

/// Write levels of detail of a model: 3D Tiles for globes, or streamed SOG
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk lod flight-model/point_cloud.ply --out tiles --format tiles-spz --sh-degree 1     for Cesium
  psrgs-vk lod flight-model/point_cloud.ply --out stream --format sog

Coarse levels have a quarter of the splats of the next finer level: neighbours that look alike are merged. Where \
frame.json beside the model tells the place on a map, the tiles lie there on the globe.")]
pub(crate) struct Args {
    /// Model: PLY, compressed PLY, SPZ, SOG, .splat or GLB
    pub(crate) model: PathBuf,
    /// Folder to write
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Form of the result
    #[arg(long, value_enum, default_value = "tiles")]
    pub(crate) format: Form,
    /// Most splats of a tile; small tiles load sooner, and there are more of them
    #[arg(long, value_name = "N", default_value_t = MOST)]
    #[arg(value_parser = clap::value_parser!(u32).range(100..=i64::from(MOST)))]
    pub(crate) tile_splats: u32,
    /// Highest degree of spherical harmonics in the tiles [default: that of the model]
    #[arg(long, value_name = "D", value_parser = clap::value_parser!(u32).range(..=3))]
    pub(crate) sh_degree: Option<u32>,
    #[command(flatten)]
    pub(crate) frame: FrameArgs,
    #[command(flatten)]
    pub(crate) files: StrictArgs,
}

pub(crate) fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let before = Instant::now();
    let model = ModelFile::read(&args.model, false, &args.frame, args.files.strict, console)?;
    if model.splats() == 0 {
        let text = format!("{}: the model has no splats, so there are no tiles to write", args.model.display());
        return Err(Failure::Input(text).into());
    }
    std::fs::create_dir_all(&args.out).with_context(|| Failure::Output(args.out.display().to_string()))?;
    atomic::check(&args.out.join("tileset.json"))?;
    let degree = args.sh_degree.unwrap_or(3).min(model.model().sh_degree);
    match args.format {
        Form::Tiles => tiles(args, &model, Content::Glb, degree, console)?,
        Form::TilesSpz => tiles(args, &model, Content::Spz, degree, console)?,
        Form::Sog => sog(args, &model, degree, console)?,
    }
    console.say(format_args!("written in {} s", fraction(before.elapsed().as_secs_f64(), 1)));
    Ok(())
}

/// Refuses a model that is one of the files to replace.
fn keep_model(model: &Path, replaced: &[PathBuf]) -> Result<(), Failure> {
    let whole = |file: &Path| file.canonicalize().ok();
    if replaced.iter().any(|file| whole(file).is_some_and(|file| Some(file) == whole(model))) {
        let text = "the model is one of the files of --out that are replaced; choose another folder";
        return Err(Failure::Usage(format!("{}: {text}", model.display())));
    }
    Ok(())
}

fn tiles(args: &Args, model: &ModelFile, content: Content, sh_degree: u32, console: &Console) -> anyhow::Result<()> {
    let to_earth = place(&args.model, model, console)?;
    let set = TileSet { folder: &args.out, content, sh_degree, to_earth };
    keep_model(&args.model, &set.earlier()?)?;
    let tree = set.write(model.model(), args.tile_splats as usize)?;
    levels(&tree, console);
    console.say(format_args!("{}: {}", set.file().display(), counted(tree.tiles.len(), "tile")));
    Ok(())
}

/// Tells tiles, splats and errors of each level.
fn levels(tree: &Tree, console: &Console) {
    for level in 0..tree.levels() {
        let tiles = || tree.tiles.iter().filter(|tile| tile.path.len() == level);
        let splats: usize = tiles().map(|tile| tile.splats).sum();
        let error = tiles().map(|tile| tile.error).fold(0.0, f64::max);
        console.say(format_args!(
            "level {level}: {}, {}, moved by up to {error:.3} units",
            counted(tiles().count(), "tile"),
            counted(splats, "splat"),
        ));
    }
}

fn sog(args: &Args, model: &ModelFile, sh_degree: u32, console: &Console) -> anyhow::Result<()> {
    let set = StreamedSog { folder: &args.out, sh_degree };
    keep_model(&args.model, &set.earlier()?)?;
    let written = set.write(model.model(), args.tile_splats as usize)?;
    for (level, splats) in written.counts.iter().enumerate() {
        console.say(format_args!("level {level}: {}", counted(*splats, "splat")));
    }
    let (cells, files) = (counted(written.cells, "cell"), counted(written.files, "folder"));
    console.say(format_args!("{}: {cells} in {files}", set.file().display()));
    Ok(())
}

/// The way from the model's coordinates to the axes of the Earth about the middle of its splats, where a file
/// beside the model tells the place.
fn place(file: &Path, model: &ModelFile, console: &Console) -> anyhow::Result<Option<Similarity>> {
    let content = model.model();
    let to_dataset = match &model.frame {
        ModelFrame::Dataset { offset, .. } => Similarity { translation: *offset, ..Similarity::IDENTITY },
        ModelFrame::Other { to_dataset, .. } => to_dataset.after_shift(content.shift),
    };
    let Some((georeference, by)) = map_frame::georeference(file)? else {
        console.say(format_args!(
            "place: none is known, so the tiles keep the model's coordinates, with -y of the model up"
        ));
        return Ok(None);
    };
    let n = content.gaussians.len() as f64;
    let mean = |k: usize| content.gaussians.means.iter().skip(k).step_by(3).map(|v| f64::from(*v)).sum::<f64>() / n;
    let middle = to_dataset.point([mean(0), mean(1), mean(2)]);
    let to_earth = georeference.to_earth_at(middle).map(|to_earth| to_dataset.then(&to_earth));
    let system = georeference.system().map(ToString::to_string).unwrap_or_default();
    console.say(format_args!("place: on the globe, by {} ({system})", by.display()));
    Ok(to_earth)
}
