//! `psrgs-vk map`: an orthophoto and a surface model of a model.

use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::Context as _;
use psrgs_vk::dataset::{Dataset, LoadOptions, Role};
use psrgs_vk::geodesy::Georeference;
use psrgs_vk::map::products::{self, About, Wanted};
use psrgs_vk::map::{self, Area, Bounds, Grid, Photographs, Placement, Surface};
use psrgs_vk::numbers::{counted, fraction, percent};
use psrgs_vk::scene::Camera;
use psrgs_vk::train::prepare;
use psrgs_vk::train::settings::{BlendingVariants, DeviceChoice, HostChoice};

use super::console::Console;
use super::exit::Failure;
use super::geo_args::{self, GeoArgs};
use super::look_args::StrictArgs;
use super::map_accuracy::{CheckArgs, Judge, WrittenMap};
use super::model_file::{DrawingArgs, ModelFile};
use super::model_frame::FrameArgs;
use super::{device, output_guard, progress};

/// Make a map of a model: a true orthophoto and a surface model as Cloud Optimized GeoTIFF
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk map site-model/point_cloud.ply --cameras site --out map
  psrgs-vk map site-model/point_cloud.ply --cameras site --out map --gsd 0.05 --crs EPSG:32632
  psrgs-vk map site-model/point_cloud.ply --cameras site --out map --gcp gcp_list.txt --dtm --hillshade")]
pub(crate) struct Args {
    /// Model: PLY, compressed PLY, SPZ, SOG, .splat or GLB
    pub(crate) model: PathBuf,
    /// Dataset that the model was trained on
    #[arg(long, value_name = "DATA")]
    pub(crate) cameras: PathBuf,
    /// Folder for orthophoto.tif, dsm.tif, quality.tif and map.json
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Ground sample distance: side of a cell in metres [default: the median of the photographs, rounded up to two
    /// digits]
    #[arg(long, value_name = "M")]
    pub(crate) gsd: Option<f64>,
    /// Area in metres of the map: west, south, east, north [default: where the reconstructed points lie]
    #[arg(long, value_name = "W,S,E,N", allow_hyphen_values = true)]
    pub(crate) bounds: Option<BoundsArg>,
    /// Also write dtm.tif: the surface without what stands on the ground
    #[arg(long)]
    pub(crate) dtm: bool,
    /// Also write hillshade.tif: the surface under a light from the north-west
    #[arg(long)]
    pub(crate) hillshade: bool,
    /// Draw as a model trained with --antialias [default: what the model file says]
    #[arg(long)]
    pub(crate) antialias: bool,
    #[command(flatten)]
    pub(crate) files: StrictArgs,
    #[command(flatten)]
    pub(crate) geo: GeoArgs,
    #[command(flatten)]
    pub(crate) check: CheckArgs,
    #[command(flatten)]
    pub(crate) frame: FrameArgs,
    #[command(flatten)]
    pub(crate) host: HostChoice,
    #[command(flatten)]
    pub(crate) device: DeviceChoice,
    #[command(flatten)]
    pub(crate) blending: BlendingVariants,
}

/// Bounds, as a user writes them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BoundsArg(Bounds);

impl FromStr for BoundsArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse::<f64>()).collect();
        match numbers.as_deref() {
            Ok(&[west, south, east, north]) => Ok(Self(Bounds { west, south, east, north })),
            _ => Err("four numbers with commas between them are wanted: west,south,east,north".to_owned()),
        }
    }
}

pub(crate) fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    if let Some(gsd) = args.gsd
        && !(gsd.is_finite() && gsd > 0.0)
    {
        return Err(map::Error::Gsd(gsd).into());
    }
    let model = ModelFile::read(&args.model, args.antialias, &args.frame, args.files.strict, console)?;
    if model.splats() == 0 {
        return Err(anyhow::Error::from(map::Error::NoSplats).context(args.model.display().to_string()));
    }
    let host_memory = args.host.host_memory.map(|bytes| bytes.0);
    let options = LoadOptions { max_side: None, strict: args.files.strict, host_memory, ..LoadOptions::default() };
    let dataset = geo_args::dataset(&args.cameras, options, console)?;
    output_guard::check(&args.out, &dataset)?;
    let georeference = args.geo.place(&dataset, console)?.georeference;
    let judge = Judge::find(&args.check, &args.cameras, &georeference)?;
    let (placement, area, grid) = plan(args, &dataset, &model, &georeference, console)?;
    fs::create_dir_all(&args.out).with_context(|| Failure::Output(args.out.display().to_string()))?;

    let gpu = device::open(&args.device, false, console)?;
    let drawn = model.surface(&gpu, &args.blending, &DrawingArgs::exact(), &dataset.frame)?;
    drop(model);
    let mut surface = Surface::new(drawn, placement, grid, &area)?;
    let share = prepare::host_share(&dataset, Role::Train, &args.host);
    let bar = progress::counter(console, dataset.views.len(), "photographs");
    let photographs = Photographs::new(&dataset, &share, surface.model(), |done| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    let bar = progress::counter(console, 0, "windows");
    let wanted = Wanted { terrain: args.dtm, hillshade: args.hillshade };
    let about = products::write(&mut surface, &photographs, &args.out, wanted, &mut |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    tell(&about, args, console);
    drop((surface, photographs));
    match judge {
        Some(judge) => {
            let files = [products::SURFACE, products::ORTHOPHOTO, products::QUALITY];
            let cells = u64::from(about.width) * u64::from(about.height);
            let terrain = args.dtm.then_some(products::TERRAIN);
            let (folder, data, georeference) = (args.out.as_path(), args.cameras.as_path(), &georeference);
            let map = WrittenMap { folder, files, terrain, cells, data, georeference };
            judge.judge(&map, args.check.check_stereo.then_some((&gpu, &args.host)), console)
        }
        None => Ok(()),
    }
}

/// Where the map lies, and its cells.
fn plan(
    args: &Args,
    dataset: &Dataset,
    model: &ModelFile,
    georeference: &Georeference,
    console: &Console,
) -> anyhow::Result<(Placement, Area, Grid)> {
    let cameras: Vec<Camera> = dataset.views.iter().map(|view| view.camera).collect();
    if cameras.is_empty() {
        return Err(anyhow::Error::from(map::Error::NoCameras).context(args.cameras.display().to_string()));
    }
    let placement = Placement::new(georeference.clone(), dataset.coordinates.as_ref(), &cameras);
    let splats = model.in_scene(&dataset.frame);
    let area = Area::of(dataset, &splats, &placement).ok_or(map::Error::Nowhere)?;
    let (gsd, from) = match args.gsd {
        Some(gsd) => (gsd, "--gsd"),
        None => {
            let found = map::ground_sample_distance(dataset, &splats, &placement).ok_or(map::Error::Nowhere)?;
            (found, "the median of the photographs; --gsd chooses another")
        }
    };
    let bounds = args.bounds.map_or(area.bounds, |BoundsArg(bounds)| bounds);
    let grid = Grid::covering(&bounds, gsd)?;
    let (width, height) = (f64::from(grid.width) * gsd, f64::from(grid.height) * gsd);
    console
        .say(format_args!("cells of {gsd} m ({from}): {} x {}, {width:.1} x {height:.1} m", grid.width, grid.height));
    Ok((placement, area, grid))
}

fn tell(about: &About, args: &Args, console: &Console) {
    let cells = (f64::from(about.width) * f64::from(about.height)).max(1.0);
    if about.with_data == 0 {
        let (model, data) = (args.model.display(), args.cameras.display());
        console.warn(format_args!(
            "no cell has data: no photograph of {data} sees a splat of {model} in these bounds. Model and dataset must \
             share one coordinate system: does --frame lead the right way?"
        ));
    }
    let error = about
        .expected_error
        .map_or_else(String::new, |error| format!("; expected error of heights {} m", fraction(error, 3)));
    console.say(format_args!(
        "colour in {} of the cells, a height in {}; two of {} see {}{error}",
        percent(about.with_data as f64 / cells, 1),
        percent(about.with_height as f64 / cells, 1),
        counted(about.photographs, "photograph"),
        percent(about.seen_by_two as f64 / cells, 1),
    ));
    console.say(format_args!("{} in {}", named(about, args), args.out.display()));
}

/// The files that were written.
fn named(about: &About, args: &Args) -> String {
    let mut files = vec![products::ORTHOPHOTO, products::SURFACE, products::QUALITY];
    files.extend(args.dtm.then_some(products::TERRAIN));
    files.extend(args.hillshade.then_some(products::HILLSHADE));
    if about.system == "local" {
        files.extend(products::PICTURE);
    }
    let all: Vec<&Path> = files.iter().map(Path::new).collect();
    let listed: Vec<String> = all.iter().map(|file| file.display().to_string()).collect();
    format!("{} and {}", listed.join(", "), products::ABOUT)
}
