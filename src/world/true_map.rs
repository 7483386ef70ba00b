//! The true map of a world: a surface model, a terrain model, an orthophoto and classes as GeoTIFF.

use std::path::Path;

use super::{Class, FromAbove, World, WorldError};
use crate::format::geotiff::{GeoKeys, Kind, NO_DATA, Picture, Samples, System, TILE, Writer};
use crate::geodesy::Georeference;

/// Names of the files: heights, heights of the ground, colours, and the classes of the LAS format.
pub(super) const FILES: [&str; 4] = ["dsm.tif", "dtm.tif", "orthophoto.tif", "classes.tif"];

/// Cells of a map: lines lie at multiples of their side.
struct Cells {
    gsd: f64,
    west: f64,
    north: f64,
    width: u32,
    height: u32,
}

impl Cells {
    /// Those of the whole site.
    fn of(world: &World, way: &Georeference) -> Self {
        let half = 0.5 * world.params().extent;
        let corners =
            [[-half, -half], [half, -half], [-half, half], [half, half]].map(|[x, y]| way.to_map([x, y, 0.0]));
        let gsd = world.ground_sample_distance();
        let line = |axis: usize, most: bool| {
            let values = corners.iter().map(|corner| corner[axis] / gsd);
            if most {
                values.fold(f64::NEG_INFINITY, f64::max).ceil()
            } else {
                values.fold(f64::INFINITY, f64::min).floor()
            }
        };
        let (west, north) = (line(0, false), line(1, true));
        let (width, height) = ((line(0, true) - west) as u32, (north - line(1, false)) as u32);
        Self { gsd, west: west * gsd, north: north * gsd, width: width.max(1), height: height.max(1) }
    }
}

impl World {
    /// Side in metres of what a pixel of a photograph from above shows of the ground, to two digits.
    fn ground_sample_distance(&self) -> f64 {
        let params = self.params();
        let focal = self.views().first().map_or(f64::from(params.max_side), |view| view.camera.fx);
        let exact = params.altitude * params.extent / focal;
        let digit = 10_f64.powf(exact.log10().floor() - 1.0);
        // Written out, so that no digits follow.
        format!("{:.9}", (exact / digit).ceil() * digit).parse().unwrap_or(exact)
    }

    /// Writes the true map of the site into a folder that exists, tile by tile.
    pub(super) fn write_map(&self, folder: &Path) -> Result<(), WorldError> {
        let way = self.georeference()?;
        let cells = Cells::of(self, &way);
        let system = match way.system() {
            Some(system) => match system.code() {
                Some(code) => System::Code(code),
                None => System::Wkt(system.wkt()),
            },
            None => System::Local,
        };
        let citation = way.system().map(ToString::to_string).unwrap_or_default();
        let keys = GeoKeys { system, citation };
        let begin = |name: &str, kind: Kind, description: &str| {
            let picture = Picture {
                width: cells.width,
                height: cells.height,
                kind,
                descriptions: vec![description.to_owned()],
                corner: [cells.west, cells.north],
                gsd: cells.gsd,
                keys: keys.clone(),
            };
            Writer::new(&folder.join(name), picture)
        };
        let [heights, ground, colours, classes] = FILES;
        let mut files = [
            begin(heights, Kind::Float(1), "true height in metres")?,
            begin(ground, Kind::Float(1), "true height of the ground in metres")?,
            begin(colours, Kind::Rgba8, "")?,
            begin(classes, Kind::Gray8, "class as in LAS: 2 ground, 6 building")?,
        ];
        let level = way.to_map([0.0; 3])[2];
        let (across, down) = files[0].tiles();
        for (x, y) in (0..down).flat_map(|y| (0..across).map(move |x| (x, y))) {
            let place = |column: f64, row: f64| {
                let at = |tile: u32, v: f64| cells.gsd * (f64::from(tile * TILE) + v);
                let [x, y, _] = way.to_dataset([cells.west + at(x, column), cells.north - at(y, row), level]);
                [x, y]
            };
            let (width, height) = ((cells.width - x * TILE).min(TILE), (cells.height - y * TILE).min(TILE));
            let seen = self.from_above((width, height), place);
            let middle = |k: usize| place((k % width as usize) as f64 + 0.5, (k / width as usize) as f64 + 0.5);
            let up = |k: usize, z: f32| {
                let [x, y] = middle(k);
                way.to_map([x, y, f64::from(z)])[2] as f32
            };
            let ground = |k: usize| up(k, seen.ground(self, k, middle(k)));
            for (file, samples) in files.iter_mut().zip(samples(&seen, up, ground)) {
                file.add(vec![((x, y), samples)])?;
            }
        }
        for file in files {
            file.finish()?;
        }
        Ok(())
    }
}

/// The samples of a tile in each of the files.
fn samples(seen: &FromAbove, up: impl Fn(usize, f32) -> f32, ground: impl Fn(usize) -> f32) -> [Samples; 4] {
    let (side, width) = (TILE as usize, seen.width as usize);
    let mut heights = vec![NO_DATA; side * side];
    let mut grounds = heights.clone();
    let (mut colours, mut classes) = (vec![0; 4 * side * side], vec![0; side * side]);
    for (k, class) in seen.classes.iter().enumerate() {
        let Some(class) = *class else { continue };
        let at = k / width * side + k % width;
        heights[at] = up(k, seen.heights[k]);
        grounds[at] = ground(k);
        let [r, g, b] = seen.picture.get_pixel((k % width) as u32, (k / width) as u32).0;
        colours[4 * at..4 * at + 4].copy_from_slice(&[r, g, b, 255]);
        classes[at] = Class::code(class);
    }
    [Samples::Floats(heights), Samples::Floats(grounds), Samples::Bytes(colours), Samples::Bytes(classes)]
}
