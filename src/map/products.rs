//! The files of a map, written window by window.

use std::io::Write as _;
use std::path::Path;

use super::ground::Ground;
use super::hillshade::brightness;
use super::{Block, Bounds, Error, Grid, Photographs, Sight, Surface, Window};
use crate::format::geotiff::{GeoKeys, Kind, NO_DATA, Picture, Samples, System, TILE, Writer};
use crate::format::image_out::to_u8;
use crate::format::{self, atomic};

/// The orthophoto.
pub const ORTHOPHOTO: &str = "orthophoto.tif";
/// The surface model.
pub const SURFACE: &str = "dsm.tif";
/// Number of photographs, and expected vertical error.
pub const QUALITY: &str = "quality.tif";
/// The terrain model.
pub const TERRAIN: &str = "dtm.tif";
/// The surface model under a light.
pub const HILLSHADE: &str = "hillshade.tif";
/// The orthophoto of a local system, and its place.
pub const PICTURE: [&str; 2] = ["orthophoto.png", "orthophoto.pgw"];
/// What the files are of.
pub const ABOUT: &str = "map.json";

/// Side in cells of a window that is rendered at a time: a multiple of the side of the files' tiles.
const SIDE: u32 = 2 * TILE;

/// Files beyond those of every map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// A terrain model.
    pub terrain: bool,
    /// A hillshade of the surface model.
    pub hillshade: bool,
}

/// What a map holds.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct About {
    /// EPSG code of the reference system, if one is known.
    pub epsg: Option<u32>,
    /// Name of the reference system, or `local`.
    pub system: String,
    /// What heights are measured from.
    pub heights: String,
    /// The area.
    pub bounds: Bounds,
    /// Side of a cell in metres.
    pub gsd: f64,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Cells in which splats show a surface.
    pub opaque: u64,
    /// Cells with colour: those of a surface that a photograph sees.
    pub with_data: u64,
    /// Cells with a height: those whose place two photographs show.
    pub with_height: u64,
    /// Cells that at least two photographs see.
    pub seen_by_two: u64,
    /// Number of photographs.
    pub photographs: usize,
    /// Median of the expected vertical errors in metres, over windows the mean of their medians; `None` without any.
    pub expected_error: Option<f64>,
    /// Number of splats.
    pub splats: u32,
}

/// Writes the files of a map into a folder that exists. `done` is told how many of how many windows are rendered.
pub fn write(
    surface: &mut Surface,
    photographs: &Photographs,
    out: &Path,
    wanted: Wanted,
    done: &mut dyn FnMut(usize, usize),
) -> Result<About, Error> {
    let grid = *surface.grid();
    let keys = keys(surface);
    let begin = |name: &str, kind: Kind, bands: &[&str]| {
        let descriptions = bands.iter().map(|band| (*band).to_owned()).collect();
        let (corner, gsd) = (grid.corner(), grid.gsd);
        let picture =
            Picture { width: grid.width, height: grid.height, kind, descriptions, corner, gsd, keys: keys.clone() };
        Writer::new(&out.join(name), picture)
    };
    let mut ortho = begin(ORTHOPHOTO, Kind::Rgba8, &[])?;
    let mut heights = begin(SURFACE, Kind::Float(1), &["height in metres"])?;
    let quality = ["number of photographs", "expected vertical error in metres"];
    let mut quality = begin(QUALITY, Kind::Float(2), &quality)?;
    let mut about = about(surface, photographs);
    let mut errors = Vec::new();
    let windows: Vec<Window> = grid.windows(SIDE).collect();
    for (k, window) in windows.iter().enumerate() {
        let block = surface.render(*window)?;
        let (up, unit) = surface.up(*window);
        let sight = photographs.look(&block, up, unit);
        count(&mut about, &mut errors, &block, &sight);
        ortho.add(tiles(*window, |cell| colour(&block, &sight, cell)))?;
        heights.add(tiles_of_floats(*window, 1, |cell| height(&block, &sight, cell)))?;
        quality.add(tiles_of_floats(*window, 2, |cell| of_quality(&block, &sight, cell)))?;
        done(k + 1, windows.len());
    }
    about.expected_error = (!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64);
    if surface.placement().system().is_none() {
        plain_picture(&mut ortho, &grid, out)?;
    }
    ortho.finish()?;
    quality.finish()?;
    if wanted.terrain {
        terrain(&mut heights, begin(TERRAIN, Kind::Float(1), &["height of the ground in metres"])?)?;
    }
    if wanted.hillshade {
        hillshade(&mut heights, begin(HILLSHADE, Kind::Gray8, &[])?, grid.gsd)?;
    }
    heights.finish()?;
    let file = out.join(ABOUT);
    let text = serde_json::to_string_pretty(&about).map_err(|e| format::Error::io(&file, "write")(e.into()))?;
    atomic::write(&file, |out| writeln!(out, "{text}"))?;
    Ok(about)
}

/// The reference system of the files.
fn keys(surface: &Surface) -> GeoKeys {
    match surface.placement().system() {
        Some(system) => {
            let heights = system.vertical();
            let citation = format!("{}; heights in metres above: {heights}", system.name());
            let system = system.code().map_or_else(|| System::Wkt(system.wkt()), System::Code);
            GeoKeys { system, citation }
        }
        None => GeoKeys { system: System::Local, citation: "local engineering system".to_owned() },
    }
}

fn about(surface: &mut Surface, photographs: &Photographs) -> About {
    let grid = *surface.grid();
    let system = surface.placement().system();
    About {
        epsg: system.and_then(|system| system.code()),
        system: system.map_or_else(|| "local".to_owned(), |system| system.name().to_owned()),
        heights: system.map_or_else(|| "the dataset's origin".to_owned(), |system| system.vertical().to_string()),
        bounds: grid.bounds(),
        gsd: grid.gsd,
        width: grid.width,
        height: grid.height,
        opaque: 0,
        with_data: 0,
        with_height: 0,
        seen_by_two: 0,
        photographs: photographs.len(),
        expected_error: None,
        splats: surface.model().splats,
    }
}

fn has_data(block: &Block, sight: &Sight, cell: usize) -> bool {
    block.is_opaque(cell) && sight.count[cell] > 0
}

fn count(about: &mut About, errors: &mut Vec<f64>, block: &Block, sight: &Sight) {
    let mut of_window: Vec<f64> = Vec::new();
    for cell in (0..block.window.cells()).filter(|cell| block.is_opaque(*cell)) {
        about.opaque += 1;
        about.with_data += u64::from(sight.count[cell] > 0);
        about.with_height += u64::from(sight.measures(cell));
        about.seen_by_two += u64::from(sight.count[cell] > 1);
        of_window.extend(Some(f64::from(sight.error[cell])).filter(|error| error.is_finite()));
    }
    errors.extend(super::quantile::quantile(&mut of_window, 0.5));
}

fn colour(block: &Block, sight: &Sight, cell: usize) -> [u8; 4] {
    match has_data(block, sight, cell) {
        true => {
            let [r, g, b] = block.colour[cell].map(to_u8);
            [r, g, b, 255]
        }
        false => [0; 4],
    }
}

fn height(block: &Block, sight: &Sight, cell: usize) -> [f32; 2] {
    let known = has_data(block, sight, cell) && sight.measures(cell);
    [if known { block.height[cell] as f32 } else { NO_DATA }, NO_DATA]
}

fn of_quality(block: &Block, sight: &Sight, cell: usize) -> [f32; 2] {
    let error = Some(sight.error[cell]).filter(|error| error.is_finite()).unwrap_or(NO_DATA);
    if block.is_opaque(cell) { [f32::from(sight.count[cell]), error] } else { [NO_DATA; 2] }
}

/// The tiles of a window, from what `value` gives for the cells of the window.
fn tiles_with<T: Copy>(window: Window, empty: T, value: impl Fn(usize) -> T) -> Vec<((u32, u32), Vec<T>)> {
    let Window { left, top, width, height } = window;
    let mut out = Vec::new();
    for (y, x) in
        (0..height).step_by(TILE as usize).flat_map(|y| (0..width).step_by(TILE as usize).map(move |x| (y, x)))
    {
        let mut tile = vec![empty; (TILE * TILE) as usize];
        for row in 0..TILE.min(height - y) {
            for column in 0..TILE.min(width - x) {
                let cell = (y + row) as usize * width as usize + (x + column) as usize;
                tile[(row * TILE + column) as usize] = value(cell);
            }
        }
        out.push((((left + x) / TILE, (top + y) / TILE), tile));
    }
    out
}

fn tiles(window: Window, value: impl Fn(usize) -> [u8; 4]) -> Vec<((u32, u32), Samples)> {
    let tiles = tiles_with(window, [0; 4], value).into_iter();
    tiles.map(|(at, tile)| (at, Samples::Bytes(tile.into_flattened()))).collect()
}

/// Of the first `bands` numbers that `value` gives.
fn tiles_of_floats(window: Window, bands: usize, value: impl Fn(usize) -> [f32; 2]) -> Vec<((u32, u32), Samples)> {
    let flat = |tile: Vec<[f32; 2]>| tile.iter().flat_map(|values| values[..bands].to_vec()).collect();
    let tiles = tiles_with(window, [NO_DATA; 2], value).into_iter();
    tiles.map(|(at, tile)| (at, Samples::Floats(flat(tile)))).collect()
}

/// A tile of heights, NaN where there is no data.
fn heights_of(writer: &mut Writer, (x, y): (u32, u32)) -> Result<Vec<f32>, Error> {
    match writer.tile(x, y)? {
        Samples::Floats(values) => Ok(values.into_iter().map(|v| if v == NO_DATA { f32::NAN } else { v }).collect()),
        Samples::Bytes(_) => Ok(vec![f32::NAN; (TILE * TILE) as usize]),
    }
}

fn every_tile((across, down): (u32, u32)) -> impl Iterator<Item = (u32, u32)> {
    (0..down).flat_map(move |y| (0..across).map(move |x| (x, y)))
}

fn terrain(heights: &mut Writer, mut out: Writer) -> Result<(), Error> {
    let Picture { width, height, gsd, .. } = *heights.picture();
    let mut ground = Ground::new(width, height, gsd, TILE);
    for (x, y) in every_tile(heights.tiles()) {
        ground.take((x * TILE, y * TILE), TILE, &heights_of(heights, (x, y))?);
    }
    ground.filter();
    for (x, y) in every_tile(heights.tiles()) {
        let own = heights_of(heights, (x, y))?;
        let cell = |(k, own): (usize, &f32)| {
            let (column, row) = (x * TILE + k as u32 % TILE, y * TILE + k as u32 / TILE);
            if own.is_finite() { ground.at(column, row, *own) } else { NO_DATA }
        };
        out.add(vec![((x, y), Samples::Floats(own.iter().enumerate().map(cell).collect()))])?;
    }
    Ok(out.finish()?)
}

/// Each row of tiles needs a line of cells from the rows above and below.
fn hillshade(heights: &mut Writer, mut out: Writer, gsd: f64) -> Result<(), Error> {
    let (across, down) = heights.tiles();
    let side = TILE as usize;
    let width = across as usize * side;
    let strip = |heights: &mut Writer, y: u32| -> Result<Vec<f32>, Error> {
        let mut rows = vec![f32::NAN; width * side];
        for x in 0..across {
            for (k, line) in heights_of(heights, (x, y))?.chunks_exact(side).enumerate() {
                rows[k * width + x as usize * side..][..side].copy_from_slice(line);
            }
        }
        Ok(rows)
    };
    let none = vec![f32::NAN; width];
    let mut above = none.clone();
    let mut rows = strip(heights, 0)?;
    for y in 0..down {
        let below = if y + 1 < down { strip(heights, y + 1)? } else { none.clone() };
        let line = |row: usize| -> &[f32] {
            match row {
                0 => &above,
                row if row <= side => &rows[(row - 1) * width..][..width],
                _ => &below[..width],
            }
        };
        let of_cell = |column: usize, row: usize| {
            let at = |k: usize| {
                let column = (column + k % 3).checked_sub(1);
                column.and_then(|column| line(row + k / 3).get(column)).copied().unwrap_or(f32::NAN)
            };
            brightness(std::array::from_fn(at), gsd)
        };
        let tile =
            |x: u32| -> Vec<u8> { (0..side * side).map(|k| of_cell(x as usize * side + k % side, k / side)).collect() };
        for x in 0..across {
            out.add(vec![((x, y), Samples::Bytes(tile(x)))])?;
        }
        above.copy_from_slice(&rows[(side - 1) * width..]);
        rows = below;
    }
    Ok(out.finish()?)
}

/// Writes the orthophoto as PNG with a world file.
fn plain_picture(ortho: &mut Writer, grid: &Grid, out: &Path) -> Result<(), Error> {
    let [picture, world] = PICTURE.map(|name| out.join(name));
    let (across, down) = ortho.tiles();
    let (width, side) = (grid.width as usize, TILE as usize);
    let mut failed = None;
    atomic::write(&picture, |file| {
        let mut encoder = png::Encoder::new(file, grid.width, grid.height);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Fast);
        let mut header = encoder.write_header().map_err(std::io::Error::other)?;
        let mut stream = header.stream_writer().map_err(std::io::Error::other)?;
        for y in 0..down {
            let rows = side.min((grid.height - y * TILE) as usize);
            let mut lines = vec![0u8; 4 * width * rows];
            for x in 0..across {
                let tile = match ortho.tile(x, y) {
                    Ok(Samples::Bytes(tile)) => tile,
                    Ok(Samples::Floats(_)) => continue,
                    Err(problem) => {
                        failed = Some(problem);
                        return Err(std::io::ErrorKind::Other.into());
                    }
                };
                let left = x as usize * side;
                let columns = side.min(width - left);
                for (k, line) in tile.chunks_exact(4 * side).take(rows).enumerate() {
                    lines[4 * (k * width + left)..][..4 * columns].copy_from_slice(&line[..4 * columns]);
                }
            }
            stream.write_all(&lines)?;
        }
        stream.finish().map_err(std::io::Error::other)
    })
    .map_err(|problem| failed.take().unwrap_or(problem))?;
    let ([east, north], gsd) = (grid.centre(0, 0), grid.gsd);
    Ok(atomic::write(&world, |file| writeln!(file, "{gsd}\n0\n0\n{}\n{east}\n{north}", -gsd))?)
}
