//! Maps of a made-up model: windows, turned datasets, files and what independent readers find in them.

// Nothing of a test binary is reachable from outside.
#![allow(unreachable_pub)]

mod common;

use std::path::{Path, PathBuf};
use std::process::Command;

use common::skipped;
use common::splats::{seeded, vector};
use psrgs_vk::format::geotiff::{GeoKeys, Kind, NO_DATA, Picture, Samples, System, TILE, Writer};
use psrgs_vk::geodesy::{Georeference, ReferenceSystem};
use psrgs_vk::map::{Area, Block, Bounds, Grid, Placement, Surface, SurfaceModel};
use psrgs_vk::pass::camera::Projection;
use psrgs_vk::raster::Viewer;
use psrgs_vk::scene::{Coordinates, Frame, Gaussians, Geodetic, Similarity, turn};
use psrgs_vk::twin::splat::Splat;
use psrgs_vk::vk::Gpu;

/// Ground of 20 x 20 m at a height of 0 with a block of 6 x 6 m and a height of 2 m in its middle; z is up.
const HALF: f64 = 10.0;
const BLOCK: f64 = 3.0;
const ROOF: f64 = 2.0;
/// How far heights are off, in metres.
const ROUGH: f64 = 0.05;

fn site() -> Gaussians {
    let mut random = seeded(7);
    let mut splats = Vec::new();
    let steps = 60;
    for k in 0..steps * steps {
        let at = |k: u32| 2.0 * HALF * ((f64::from(k) + 0.5) / f64::from(steps) - 0.5);
        let (x, y) = (at(k % steps), at(k / steps));
        let z = if x.abs().max(y.abs()) < BLOCK { ROOF } else { 0.0 };
        // No two splats have the same height, so that rounding does not choose their order.
        let z = z + ROUGH * random.symmetric();
        splats.push(Splat {
            mean: [x, y, z],
            quat: [1.0, 0.0, 0.0, 0.0],
            log_scale: [0.22f64.ln(), 0.2f64.ln(), 0.004f64.ln()],
            logit: 6.0,
            sh: std::array::from_fn(|k| vector(&mut random).map(|v| v * if k == 0 { 1.2 } else { 0.1 })),
        });
    }
    let mut model = Gaussians::zeros(splats.len());
    splats.iter().enumerate().for_each(|(i, splat)| splat.store(&mut model, i));
    model
}

const AREA: Area =
    Area { bounds: Bounds { west: -HALF, south: -HALF, east: HALF, north: HALF }, bottom: -2.0, top: 4.0 };

/// The scene is a tenth of the dataset.
fn surface(gpu: &Gpu, dataset: &Gaussians, placement: Placement, of: (Grid, Area)) -> Surface {
    surface_about(gpu, (dataset, [1.0, -2.0, 0.5]), placement, of)
}

fn surface_about(
    gpu: &Gpu,
    (dataset, offset): (&Gaussians, [f64; 3]),
    placement: Placement,
    (grid, area): (Grid, Area),
) -> Surface {
    let frame = Frame { offset, scale: 0.1 };
    let viewer = Viewer::new(gpu);
    let planes = viewer.upload(&frame.gaussians_to_scene(dataset, [0.0; 3])).unwrap();
    let projection = Projection { antialias: true, ..Projection::default() };
    let model = SurfaceModel { viewer, planes, splats: dataset.len() as u32, projection, frame };
    Surface::new(model, placement, grid, &area).unwrap()
}

/// One pixel of bits: colour, opacity and height.
fn bits(block: &Block, cell: usize) -> [u64; 5] {
    let [r, g, b] = block.colour[cell].map(|v| u64::from(v.to_bits()));
    [r, g, b, u64::from(block.alpha[cell].to_bits()), block.height[cell].to_bits()]
}

#[track_caller]
fn assert_same_bits(surface: &mut Surface, sides: &[u32]) {
    let grid = *surface.grid();
    let whole = surface.render(grid.whole()).unwrap();
    let opaque = (0..whole.window.cells()).filter(|cell| whole.is_opaque(*cell)).count();
    assert!(10 * opaque > 9 * whole.window.cells(), "{opaque} opaque cells");
    for side in sides {
        for window in grid.windows(*side) {
            let block = surface.render(window).unwrap();
            for k in 0..window.cells() as u32 {
                let (x, y) = (window.left + k % window.width, window.top + k / window.width);
                let (got, want) = (bits(&block, k as usize), bits(&whole, (y * grid.width + x) as usize));
                assert_eq!(got, want, "windows of {side}: cell {x} {y}");
            }
        }
    }
}

#[test]
fn windows_of_any_size_have_the_bits_of_one_picture() {
    let Some(gpu) = common::gpu() else { return };
    let grid = Grid::covering(&AREA.bounds, 0.1).unwrap();
    let turned = turn([0.2, -0.1, 1.0], [0.0, 0.0, 1.0]);
    let placement = Similarity { rotation: turned, scale: 1.0, translation: [0.03, 0.01, 0.2] };
    let mut local = surface(&gpu, &site(), Placement::Local(placement), (grid, AREA));
    assert_same_bits(&mut local, &[128, 64, 37]);
    common::assert_no_messages(&gpu);
}

/// On Earth, where squares of the map have similarities of their own: the grid lies over the corner of four squares.
#[test]
fn squares_of_the_earth_do_not_depend_on_windows() {
    let Some(gpu) = common::gpu() else { return };
    let origin = Geodetic { latitude: 47.3, longitude: 8.1, altitude: 400.0 };
    let of = |coordinates: &Coordinates| Georeference::of_coordinates(coordinates, None).unwrap();
    let georeference = of(&Coordinates::EastNorthUp { origin });
    assert_eq!(georeference.system().and_then(ReferenceSystem::code), Some(32_632));
    let [east, north, height] = georeference.to_map([0.0; 3]);
    let gsd = 0.25;
    let corner = |v: f64| (v / gsd / 4096.0).round() * 4096.0 * gsd;
    // The dataset is moved, so that the corner of four squares lies in its middle.
    let (to_east, to_north) = (corner(east) - east, corner(north) - north);
    let there = georeference.to_dataset([east + to_east, north + to_north, height]);
    let mut model = site();
    model.means.chunks_exact_mut(3).for_each(|p| (0..3).for_each(|k| p[k] += there[k] as f32));
    let (e, n) = (corner(east), corner(north));
    let bounds = Bounds { west: e - HALF, south: n - HALF, east: e + HALF, north: n + HALF };
    let area = Area { bounds, bottom: height - 2.0, top: height + 4.0 };
    let grid = Grid::covering(&bounds, gsd).unwrap();
    let placement = Placement::Earth(Box::new(georeference));
    let mut on_earth = surface_about(&gpu, (&model, there), placement.clone(), (grid, area));
    assert_same_bits(&mut on_earth, &[40, 17]);
    // No seam where the squares meet: the ground is even, at the height that the georeference gives.
    let whole = on_earth.render(grid.whole()).unwrap();
    let flat = placement.to_map([there[0] + 8.0, there[1], there[2]])[2];
    for (x, y) in [(4, 39), (4, 40), (75, 39), (75, 40), (39, 4), (40, 4), (39, 75), (40, 75)] {
        let found = whole.height[y * 80 + x];
        assert!((found - flat).abs() < ROUGH + 0.01, "{found} for {flat} at {x} {y}");
    }
}

#[test]
fn heights_are_those_of_ground_and_roof() {
    let Some(gpu) = common::gpu() else { return };
    let grid = Grid::covering(&AREA.bounds, 0.1).unwrap();
    let mut local = surface(&gpu, &site(), Placement::Local(Similarity::IDENTITY), (grid, AREA));
    let block = local.render(grid.whole()).unwrap();
    for cell in 0..grid.cells() as u32 {
        let [x, y] = grid.centre(cell % grid.width, cell / grid.width);
        let out = x.abs().max(y.abs());
        if (out - BLOCK).abs() < 0.7 || out > HALF - 0.5 {
            continue;
        }
        let want = if out < BLOCK { ROOF } else { 0.0 };
        let found = block.height[cell as usize];
        assert!((found - want).abs() < ROUGH + 0.01, "{found} for {want} at {x} {y}");
    }
    // Beyond the ground nothing is opaque, and what floats above the area is left out.
    let wide = Bounds { west: -12.0, east: 12.0, ..AREA.bounds };
    let grid = Grid::covering(&wide, 0.1).unwrap();
    let low = Area { top: 1.0, ..AREA };
    let mut lower = surface(&gpu, &site(), Placement::Local(Similarity::IDENTITY), (grid, low));
    let block = lower.render(grid.whole()).unwrap();
    let at = |x: f64| (100 * grid.width + ((x + 12.0) / 0.1) as u32) as usize;
    assert!(!block.is_opaque(at(-11.5)) && block.height[at(-11.5)].is_nan(), "beyond the ground");
    assert!(block.is_opaque(at(-8.0)) && !block.is_opaque(at(0.0)), "above the area");
}

/// A dataset in other axes and units whose placement undoes both has the same map.
#[test]
fn turned_and_scaled_datasets_have_the_same_map() {
    let Some(gpu) = common::gpu() else { return };
    let grid = Grid::covering(&AREA.bounds, 0.1).unwrap();
    let mut plain = surface(&gpu, &site(), Placement::Local(Similarity::IDENTITY), (grid, AREA));
    let want = plain.render(grid.whole()).unwrap();
    let by =
        Similarity { rotation: turn([0.3, -0.8, 0.4], [0.1, 0.2, -1.0]), scale: 3.7, translation: [5.0, -7.0, 2.0] };
    let mut turned = surface(&gpu, &by.gaussians(&site()), Placement::Local(by.inverse()), (grid, AREA));
    let got = turned.render(grid.whole()).unwrap();
    let (mut off, mut compared) = (0, 0);
    for cell in (0..grid.cells() as usize).filter(|cell| want.is_opaque(*cell)) {
        compared += 1;
        let colours = (0..3).map(|k| (got.colour[cell][k] - want.colour[cell][k]).abs()).fold(0.0, f32::max);
        let heights = (got.height[cell] - want.height[cell]).abs();
        off += usize::from(colours > 2.0 / 255.0 || heights > 0.002 || heights.is_nan());
    }
    // A splat at which nearly half of the light is stopped is on one side or the other.
    assert!(compared > 30_000 && off * 500 < compared, "{off} of {compared} cells differ");
}

#[test]
fn bits_of_cells_do_not_depend_on_the_bounds() {
    let Some(gpu) = common::gpu() else { return };
    let model = site();
    let render = |bounds: &Bounds| {
        let grid = Grid::covering(bounds, 0.1).unwrap();
        let mut local = surface(&gpu, &model, Placement::Local(Similarity::IDENTITY), (grid, AREA));
        (grid, local.render(grid.whole()).unwrap())
    };
    let (wide, all) = render(&AREA.bounds);
    let (grid, some) = render(&Bounds { west: -2.33, south: -4.0, east: 3.9, north: 1.21 });
    for cell in 0..grid.cells() as u32 {
        let (x, y) = (cell % grid.width, cell / grid.width);
        let column = (grid.west - wide.west) as u32 + x;
        let row = (wide.north - grid.north) as u32 + y;
        assert_eq!(bits(&some, cell as usize), bits(&all, (row * wide.width + column) as usize), "{x} {y}");
    }
}

/// A picture of two bands, three tiles wide, with a hole.
fn write(file: &Path, kind: Kind, system: System) {
    let keys = GeoKeys { system, citation: "a test".into() };
    let (width, height) = (1300, 900);
    let descriptions = (0..kind.samples()).map(|k| format!("band {k}")).collect();
    let picture = Picture { width, height, kind, descriptions, corner: [500_000.5, 5_200_000.0], gsd: 0.25, keys };
    let mut writer = Writer::new(file, picture).unwrap();
    let (across, down) = writer.tiles();
    for (x, y) in (0..down).flat_map(|y| (0..across).map(move |x| (x, y))) {
        let pixels = (0..TILE * TILE).map(|k| (x * TILE + k % TILE, y * TILE + k / TILE));
        let hole = |x: u32, y: u32| x < 40 && y < 30;
        let samples = match kind {
            Kind::Float(_) => Samples::Floats(
                pixels.flat_map(|(x, y)| if hole(x, y) { [NO_DATA; 2] } else { [x as f32 / 4.0, y as f32] }).collect(),
            ),
            _ => Samples::Bytes(
                pixels
                    .flat_map(|(x, y)| if hole(x, y) { [0; 4] } else { [(x / 8) as u8, (y / 8) as u8, 77, 255] })
                    .collect(),
            ),
        };
        writer.add(vec![((x, y), samples)]).unwrap();
    }
    writer.finish().unwrap();
}

/// Python with rasterio and rio-cogeo in the folder of readers.
fn python() -> Option<PathBuf> {
    let usual = || Path::new(env!("CARGO_MANIFEST_DIR")).join("target/readers");
    let folder = std::env::var_os("PSRGS_READERS").map_or_else(usual, PathBuf::from);
    let program = folder.join("venv/bin/python");
    let knows = |program: &Path| {
        let output = Command::new(program).args(["-c", "import rasterio, rio_cogeo"]).output();
        output.is_ok_and(|output| output.status.success())
    };
    let known = knows(&program);
    if !known {
        skipped(format_args!("{} does not know rasterio and rio_cogeo (tools/readers)", program.display()));
    }
    known.then_some(program)
}

const LOOK: &str = "
import sys, rasterio
from rio_cogeo.cogeo import cog_validate
valid, errors, warnings = cog_validate(sys.argv[1], quiet=True)
with rasterio.open(sys.argv[1]) as f:
    crs = f.crs
    print(valid, errors, warnings)
    print(f.count, f.width, f.height, f.dtypes[0], f.nodata, f.overviews(1))
    print(list(f.transform)[:6])
    print('projected', crs.is_projected, crs.to_epsg())
    print('names', crs.to_wkt()[:60])
    print('bands', f.descriptions)
    print('flags', [str(m) for m in f.mask_flag_enums[0]])
    a = f.read()
    print('values', a[:, 0, 0].tolist(), a[:, 899, 1299].tolist(), a[:, 20, 600].tolist())
    b = f.read(out_shape=(f.count, 225, 325))
    print('overview', b[:, 0, 0].tolist(), b[:, 100, 200].tolist())
";

#[test]
fn rasterio_and_rio_cogeo_read_what_is_written() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let look = |kind: Kind, system: System| {
        let file = folder.path().join("a.tif");
        write(&file, kind, system);
        let output = Command::new(&python).args(["-c", LOOK]).arg(&file).output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
        println!("{said}");
        said
    };
    let has = |said: &str, parts: &[&str]| parts.iter().for_each(|part| assert!(said.contains(part), "{part}: {said}"));
    let colours = look(Kind::Rgba8, System::Code(32_632));
    has(
        &colours,
        &[
            "True [] []",
            "4 1300 900 uint8 None [2, 4]",
            "[0.25, 0.0, 500000.5, 0.0, -0.25, 5200000.0]",
            "projected True 32632",
            "flags ['2', '4']",
            "values [0, 0, 0, 0] [162, 112, 77, 255] [75, 2, 77, 255]",
        ],
    );
    let heights = look(Kind::Float(2), System::Code(32_732));
    has(
        &heights,
        &[
            "True [] []",
            "2 1300 900 float32 -9999.0 [2, 4]",
            "projected True 32732",
            "('band 0', 'band 1')",
            "values [-9999.0, -9999.0] [324.75, 899.0] [150.0, 20.0]",
            "overview [-9999.0, -9999.0] [200.375, 401.5]",
        ],
    );
    has(&look(Kind::Rgba8, System::Local), &["True [] []", "projected False None", "a test"]);
    let proj = "+proj=tmerc +lat_0=0 +lon_0=8 +k=1 +x_0=500000 +y_0=0 +ellps=GRS80 +units=m +no_defs";
    let wkt = ReferenceSystem::parse(proj).unwrap().wkt();
    has(&look(Kind::Float(2), System::Wkt(wkt)), &["True [] []", "projected True None"]);
}
