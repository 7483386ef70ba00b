//! How accurate a written map is: against the truth of a made-up world, or against a file of the user.

use std::path::{Path, PathBuf};

use psrgs_vk::dataset::{Dataset, LoadOptions};
use psrgs_vk::format::georaster::GeoRaster;
use psrgs_vk::format::{atomic, las, ply, read_text};
use psrgs_vk::geodesy::Georeference;
use psrgs_vk::map::StereoPoints;
use psrgs_vk::map::accuracy::{
    Cells, CheckPoints, FILE, Known, PointReport, Report, Surface, at_points, brightness, gridded,
};
use psrgs_vk::numbers::grouped;
use psrgs_vk::train::settings::HostChoice;
use psrgs_vk::vk::Gpu;
use psrgs_vk::world::{World, WorldParams};

use super::console::Console;
use super::exit::Failure;
use super::stereo;

/// The file of a made-up world's parameters.
const WORLD: &str = "world.toml";
/// Most cells on which a world is looked at from above unasked.
const MOST_CELLS: u64 = 1 << 24;
/// Longer side of photographs for stereo.
const STEREO_SIDE: u32 = 640;

/// The options for the comparison of a map.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = "Accuracy")]
pub(crate) struct CheckArgs {
    /// Compare the map with this file, in the map's reference system, and write accuracy.json: a surface model
    /// (GeoTIFF), a point cloud (LAS, LAZ, PLY), or check points (CSV of name, easting, northing, height; gcp_list.txt).
    /// With --dtm the terrain is compared with the same file [default: the truth where the dataset is a world of `demo`]
    #[arg(long, value_name = "FILE")]
    pub(crate) check: Option<PathBuf>,
    /// Also compare the cloud of stereo, on the same cells; this takes as long as stereo of a training
    #[arg(long)]
    pub(crate) check_stereo: bool,
}

/// A map that was written.
pub(crate) struct WrittenMap<'a> {
    /// Its folder.
    pub(crate) folder: &'a Path,
    /// Names of the surface model, the orthophoto and the quality layer.
    pub(crate) files: [&'a str; 3],
    /// Name of the terrain model, if one was made.
    pub(crate) terrain: Option<&'a str>,
    /// How many cells it has.
    pub(crate) cells: u64,
    /// The dataset.
    pub(crate) data: &'a Path,
    /// From the dataset to the map.
    pub(crate) georeference: &'a Georeference,
}

/// The layers of a map.
struct Layers {
    cells: Cells,
    corner: [f64; 2],
    heights: Vec<f32>,
    picture: Vec<f32>,
    seen: Vec<u16>,
    /// Heights of the terrain model, where one was made.
    terrain: Option<Vec<f32>>,
}

/// What a map is compared with.
enum Against {
    World(Box<World>),
    Raster(Box<GeoRaster>),
    Cloud(Vec<[f64; 3]>),
    Points(CheckPoints),
}

/// What the map will be compared with; nothing where nothing is known. Call this before the map is made, so that a file
/// that cannot be read costs no time.
pub(crate) struct Judge {
    against: Against,
    name: String,
}

impl Judge {
    /// Reads the file of the user, or the parameters of a world.
    pub(crate) fn find(args: &CheckArgs, data: &Path, georeference: &Georeference) -> anyhow::Result<Option<Self>> {
        let Some(file) = &args.check else {
            let file = data.join(WORLD);
            let params = read_text(&file).ok().and_then(|text| toml::from_str::<WorldParams>(&text).ok());
            return Ok(match params {
                Some(params) => {
                    let world = Box::new(World::new(&params)?);
                    Some(Self { against: Against::World(world), name: "the made-up world itself".to_owned() })
                }
                None if args.check_stereo => {
                    let text = "--check-stereo needs --check FILE, or a dataset that `demo` has made".to_owned();
                    return Err(Failure::Usage(text).into());
                }
                None => None,
            });
        };
        let ending = file.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        let against = match ending.as_str() {
            "tif" | "tiff" => Against::Raster(Box::new(raster(file, georeference)?)),
            "las" | "laz" => Against::Cloud(las::read(file)?),
            "ply" => Against::Cloud(ply::Cloud::read(file)?.positions),
            "csv" | "txt" => Against::Points(CheckPoints::read(file, georeference.system())?),
            _ => {
                let text = format!("--check {}: a .tif, .las, .laz, .ply, .csv or .txt is needed", file.display());
                return Err(Failure::Usage(text).into());
            }
        };
        Ok(Some(Self { against, name: file.display().to_string() }))
    }

    /// Compares the map that was written, prints the figures and writes `accuracy.json`.
    pub(crate) fn judge(
        self,
        map: &WrittenMap<'_>,
        stereo: Option<(&Gpu, &HostChoice)>,
        console: &Console,
    ) -> anyhow::Result<()> {
        if let (Against::World(_), Some(why)) = (&self.against, untold(map)) {
            console.say(format_args!("accuracy: not told {why}"));
            return Ok(());
        }
        let Some(layers) = Layers::read(map, console) else { return Ok(()) };
        let Layers { cells, corner, .. } = layers;
        let out = map.folder.join(FILE);
        let known = match self.against {
            Against::Points(points) => {
                let errors = at_points(cells, corner, &layers.heights, &points.places);
                let terrain = layers.terrain.as_ref().map(|heights| at_points(cells, corner, heights, &points.places));
                let (reference, names) = (self.name, points.names);
                let report = PointReport { reference, gsd: cells.gsd, names, points: errors, terrain };
                report.lines().iter().for_each(|line| console.say(line));
                return write(&out, &report);
            }
            Against::World(world) => Known::of_world(&world, cells, corner, map.georeference.system())?,
            Against::Raster(raster) => Known::of_raster(&raster, cells, corner),
            Against::Cloud(points) => Known::of_heights(gridded(cells, corner, points)),
        };
        let cloud = stereo.map(|(gpu, host)| stereo_heights(map, &layers, gpu, host, console)).transpose()?;
        let surface = Surface { heights: &layers.heights, picture: Some(&layers.picture), seen: Some(&layers.seen) };
        let mut report = Report::of(self.name, cells, &known, &surface, cloud.as_deref());
        if let Some(terrain) = &layers.terrain {
            report = report.with_terrain(&known, terrain, Some(&layers.seen));
        }
        report.lines().iter().for_each(|line| console.say(line));
        report.warnings().iter().for_each(|line| console.warn(line));
        write(&out, &report)
    }
}

/// Why a map is not compared with its world.
fn untold(map: &WrittenMap<'_>) -> Option<String> {
    if map.georeference.system().is_none() {
        return Some("for a map in a local system".to_owned());
    }
    let (count, most) = (grouped(map.cells), grouped(MOST_CELLS));
    (map.cells > MOST_CELLS).then(|| format!("for {count} cells, at most {most} are traced"))
}

/// A surface model in the map's system.
fn raster(file: &Path, georeference: &Georeference) -> anyhow::Result<GeoRaster> {
    let raster = GeoRaster::read(file)?;
    let own = georeference.system().and_then(|system| system.code());
    match (own, raster.epsg) {
        (Some(own), Some(theirs)) if own != theirs => {
            let file = file.display();
            let text = format!("{file}: is in EPSG:{theirs}, the map in EPSG:{own}: choose --crs EPSG:{theirs}");
            Err(Failure::Input(text).into())
        }
        _ => Ok(raster),
    }
}

impl Layers {
    /// Reads the files of a map; nothing where the map is too large.
    fn read(map: &WrittenMap<'_>, console: &Console) -> Option<Self> {
        let read = |name: &str| match GeoRaster::read(&map.folder.join(name)) {
            Ok(raster) => Some(raster),
            Err(problem) => {
                console.warn(format_args!("the accuracy is not told: {problem}"));
                None
            }
        };
        let [surface, orthophoto, quality] = map.files;
        let (surface, quality) = (read(surface)?, read(quality)?);
        let picture = brightness(&read(orthophoto)?);
        let cells = Cells { width: surface.width, height: surface.height, gsd: surface.pixel[0] };
        let count = |values: &[f32]| values.first().filter(|v| v.is_finite()).map_or(0, |v| *v as u16);
        let seen = quality.values.chunks_exact(quality.bands).map(count).collect();
        let terrain = map.terrain.and_then(read).map(|raster| raster.values);
        Some(Self { cells, corner: surface.corner, heights: surface.values, picture, seen, terrain })
    }
}

/// The cloud of stereo of the photographs that a training takes, gridded on the map's cells.
fn stereo_heights(
    map: &WrittenMap<'_>,
    layers: &Layers,
    gpu: &Gpu,
    host: &HostChoice,
    console: &Console,
) -> anyhow::Result<Vec<f32>> {
    let host_memory = host.host_memory.map(|bytes| bytes.0);
    let options = LoadOptions { max_side: Some(STEREO_SIDE), host_memory, ..LoadOptions::default() };
    let mut dataset = Dataset::load(map.data, &options)?;
    let cloud = stereo::cloud(&mut dataset, STEREO_SIDE, gpu, host, console)?;
    let (frame, georeference) = (&dataset.frame, map.georeference);
    let points = StereoPoints { points: &cloud.points, views: &cloud.views, frame, georeference };
    Ok(gridded(layers.cells, layers.corner, points.points().map(|point| point.position)))
}

fn write(out: &Path, report: &impl serde::Serialize) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(report)?;
    Ok(atomic::write(out, |file| writeln!(file, "{text}"))?)
}
