//! Levels of detail in files: 3D Tiles and streamed SOG, read again by other means than those that wrote them.

use std::collections::BTreeSet;
use std::convert::Infallible;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use psrgs_vk::format::ply::{self, Model};
use psrgs_vk::format::splats;
use psrgs_vk::geodesy::Georeference;
use psrgs_vk::lod::{Content, StreamedSog, TileSet, Tree};
use psrgs_vk::scene::{Coordinates, Gaussians, Geodetic, Similarity};
use serde_json::Value;

use super::compact::with_degree;
use super::readers::{SPLAT_TRANSFORM, VALIDATE, installed, run};

fn json(file: &Path) -> Value {
    serde_json::from_slice(&fs::read(file).expect("a file")).expect("JSON")
}

fn numbers(of: &Value) -> Vec<f64> {
    of.as_array().expect("a list").iter().map(|v| v.as_f64().expect("a number")).collect()
}

fn set(folder: &Path, content: Content) -> TileSet<'_> {
    TileSet { folder, content, sh_degree: 1, to_earth: None }
}

/// Visits tiles from the root on, each with the geometric error of its parent.
fn visit<'a>(tile: &'a Value, parent: f64, found: &mut Vec<(&'a Value, f64)>) {
    found.push((tile, parent));
    let own = tile["geometricError"].as_f64().expect("an error");
    tile["children"].as_array().into_iter().flatten().for_each(|child| visit(child, own, found));
}

/// Whether the centres of splats lie in a tile's box: y up of files is z up of tiles.
fn holds(tile: &Value, means: &[f32]) -> bool {
    let volume = numbers(&tile["boundingVolume"]["box"]);
    let half = [volume[3], volume[7], volume[11]];
    means.chunks_exact(3).all(|p| {
        // In the axes of models -y is up, and tiles have z up.
        let p = [p[0], p[2], -p[1]].map(f64::from);
        (0..3).all(|k| (p[k] - volume[k]).abs() <= half[k] + 1e-6)
    })
}

/// Whether the boxes of a tile's children lie in the box of the tile.
fn holds_children(tile: &Value) -> bool {
    let of = |tile: &Value| numbers(&tile["boundingVolume"]["box"]);
    let own = of(tile);
    let inside = |child: Vec<f64>| {
        [(0, 3), (1, 7), (2, 11)]
            .iter()
            .all(|(k, half)| (child[*k] - own[*k]).abs() + child[*half] <= own[*half] + 1e-6)
    };
    tile["children"].as_array().into_iter().flatten().all(|child| inside(of(child)))
}

#[test]
fn tiles_of_a_set_keep_the_rules_and_hold_every_splat() {
    let mut model = with_degree(1500, 1);
    // So small that boxes are hardly larger than the places of splats.
    model.gaussians.scales.fill(-4.0);
    for content in [Content::Glb, Content::Spz] {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let tree = set(folder.path(), content).write(&model, 100).expect("written");
        let document = json(&folder.path().join("tileset.json"));
        // Viewers draw a tile where its error comes to 16 pixels, and mass moved by one pixel may be drawn.
        let of_root = tree.root().map(|root| 16.0 * root.error).expect("a root");
        assert!((document["root"]["geometricError"].as_f64().expect("an error") - of_root).abs() < 1e-9 * of_root);
        assert_eq!(document["asset"]["version"], "1.1");
        let extension = &document["extensions"]["3DTILES_content_gltf"];
        let spz = content == Content::Spz;
        assert_eq!(extension["extensionsRequired"].as_array().map(Vec::len), Some(1 + usize::from(spz)));
        assert_eq!(document["extensionsUsed"][0], "3DTILES_content_gltf");
        let mut tiles = Vec::new();
        visit(&document["root"], document["geometricError"].as_f64().expect("an error"), &mut tiles);
        let (mut files, mut splats_in_leaves) = (BTreeSet::new(), 0);
        for (tile, parent) in &tiles {
            let error = tile["geometricError"].as_f64().expect("an error");
            assert!(error >= 0.0 && error <= *parent && (error == 0.0) == tile["children"].is_null(), "{tile}");
            let name = tile["content"]["uri"].as_str().expect("a name");
            let read = splats::read(&folder.path().join(name), true).expect("a tile");
            assert!(files.insert(name) && (1..=100).contains(&read.gaussians.len()) && read.sh_degree == 1);
            assert!(holds(tile, &read.gaussians.means) && holds_children(tile), "{tile}");
            splats_in_leaves += if tile["children"].is_null() { read.gaussians.len() } else { 0 };
        }
        assert_eq!((splats_in_leaves, document["root"]["refine"].as_str()), (1500, Some("REPLACE")));
        // A smaller set in the same folder leaves no file of the larger one, and no other file goes.
        fs::write(folder.path().join("tile_notes.glb"), "mine").expect("written");
        set(folder.path(), content).write(&with_degree(50, 1), 100).expect("written");
        let left: BTreeSet<_> =
            fs::read_dir(folder.path()).expect("a folder").flatten().map(|e| e.file_name()).collect();
        assert_eq!(left, ["tile.glb", "tile_notes.glb", "tileset.json"].map(Into::into).into());
    }
}

#[test]
fn a_tile_is_no_better_than_its_worst_child() {
    let mut g = Gaussians::zeros(160);
    // The last quarter, tiles of their own, is far apart and so faint that in the mean of all splats it does not count.
    for i in 0..160 {
        let faint = i >= 120;
        g.means[3 * i] = if faint { 10.0 * (i - 119) as f32 } else { 0.01 * i as f32 };
        g.opacities[i] = if faint { -12.0 } else { 6.0 };
    }
    g.quats.iter_mut().step_by(4).for_each(|w| *w = 1.0);
    let tree = Tree::build(&g, 10, |_, _| Ok::<(), Infallible>(())).expect("a tree");
    let root = tree.root().expect("a root");
    let mut below: Vec<f64> = root.children.iter().map(|child| tree.tiles[*child].error).collect();
    below.sort_unstable_by(f64::total_cmp);
    assert!(below.len() == 4 && below[3] > 50.0 * below[2], "{below:?}");
    assert!(root.error >= below[3], "{} for {below:?}", root.error);
}

#[test]
fn a_leaf_tile_has_the_splats_of_the_model_as_they_are() {
    let model = with_degree(80, 1);
    let folder = tempfile::tempdir().expect("a temporary folder");
    set(folder.path(), Content::Glb).write(&model, 100).expect("written");
    let read = splats::read(&folder.path().join("tile.glb"), true).expect("a tile").gaussians;
    assert_eq!(read.means, model.gaussians.means);
    let same = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
    assert!(same(&read.scales, &model.gaussians.scales) && same(&read.sh[0], &model.gaussians.sh[0]));
}

/// Metres in the axes of the Earth, by the definition of geodetic coordinates.
fn on_earth(place: Geodetic) -> [f64; 3] {
    let (a, f) = (6_378_137.0_f64, 1.0 / 298.257_223_563_f64);
    let (latitude, longitude) = (place.latitude.to_radians(), place.longitude.to_radians());
    let n = a / (1.0 - f * (2.0 - f) * latitude.sin().powi(2)).sqrt();
    let flat = (n + place.altitude) * latitude.cos();
    [flat * longitude.cos(), flat * longitude.sin(), (n * (1.0 - f).powi(2) + place.altitude) * latitude.sin()]
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn the_root_transform_puts_tiles_on_the_globe() {
    let origin = Geodetic { latitude: 51.5, longitude: -0.12, altitude: 80.0 };
    let plane = Coordinates::EastNorthUp { origin };
    let grid = Coordinates::grid("WGS84 UTM 30N", None, [699_000.0, 5_709_000.0]);
    for (coordinates, far) in [(plane, 1e-6), (grid, 0.1)] {
        let georeference = Georeference::of_coordinates(&coordinates, None).expect("a map");
        let middle = [400.0, 200.0, 30.0];
        let to_earth = georeference.to_earth_at(middle).expect("a place");
        let folder = tempfile::tempdir().expect("a temporary folder");
        let tiles = TileSet { to_earth: Some(to_earth), ..set(folder.path(), Content::Spz) };
        tiles.write(&with_degree(30, 0), 100).expect("written");
        let matrix = numbers(&json(&folder.path().join("tileset.json"))["root"]["transform"]);
        for (point, most) in [(middle, 1e-4), ([500.0, 300.0, 60.0], far)] {
            // The point in the axes of tiles; the matrix is given by columns.
            let [x, y, z] = [point[0], point[2], -point[1]];
            let found = std::array::from_fn(|r| matrix[r] * x + matrix[4 + r] * y + matrix[8 + r] * z + matrix[12 + r]);
            let known = on_earth(georeference.to_geodetic(point).expect("a place"));
            assert!(distance(found, known) < most, "{coordinates}: {found:?} for {known:?}");
        }
    }
    assert_eq!(Georeference::local().to_earth_at([0.0; 3]), None);
}

#[test]
fn errors_of_a_set_are_in_metres_where_its_place_is_known() {
    let model = with_degree(500, 0);
    let errors = |scale: f64| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let to_earth = Some(Similarity { scale, ..Similarity::IDENTITY });
        TileSet { to_earth, ..set(folder.path(), Content::Glb) }.write(&model, 100).expect("written");
        let document = json(&folder.path().join("tileset.json"));
        [&document["geometricError"], &document["root"]["geometricError"]].map(|v| v.as_f64().expect("an error"))
    };
    let (one, ten) = (errors(1.0), errors(10.0));
    // That of a tile is in the tile's units, which the transform scales.
    assert!((ten[0] - 10.0 * one[0]).abs() < 1e-6 * ten[0] && ten[1] == one[1], "{one:?} {ten:?}");
}

#[test]
fn a_packed_tile_tells_the_box_of_its_splats() {
    let model = with_degree(60, 0);
    let folder = tempfile::tempdir().expect("a temporary folder");
    set(folder.path(), Content::Spz).write(&model, 100).expect("written");
    let bytes = fs::read(folder.path().join("tile.glb")).expect("a tile");
    let length = u32::from_le_bytes(bytes[12..16].try_into().expect("four bytes")) as usize;
    let document: Value = serde_json::from_slice(&bytes[20..20 + length]).expect("JSON");
    let end = |k: usize, pick: fn(f64, f64) -> f64| {
        // y is up in files: y and z of models are negated.
        let sign = if k == 0 { 1.0 } else { -1.0 };
        let along = model.gaussians.means.iter().skip(k).step_by(3).map(|v| sign * f64::from(*v));
        along.reduce(pick).expect("a splat")
    };
    assert_eq!(numbers(&document["accessors"][0]["min"]), [0, 1, 2].map(|k| end(k, f64::min)));
    assert_eq!(numbers(&document["accessors"][0]["max"]), [0, 1, 2].map(|k| end(k, f64::max)));
}

/// Checks tilesets against the schema in a folder, and prints what is wrong with each. A schema names the others by their
/// places in the folder.
const SCHEMA: &str = r#"
import json, pathlib, sys
from jsonschema import Draft202012Validator
from referencing import Registry, Resource
from referencing.jsonschema import DRAFT202012
folder = pathlib.Path(sys.argv[1])
def resource(file):
    schema = json.loads(file.read_text())
    schema.pop("$id", None)
    return "file:///" + file.relative_to(folder).as_posix(), Resource.from_contents(schema, DRAFT202012)
registry = Registry().with_resources(resource(file) for file in folder.rglob("*.schema.json"))
validator = Draft202012Validator({"$ref": "file:///tileset.schema.json"}, registry=registry)
for file in sys.argv[2:]:
    tileset = json.loads(pathlib.Path(file).read_text())
    for error in validator.iter_errors(tileset):
        print("WRONG", file, error.json_path, error.message)
    del tileset["root"]["geometricError"]
    tileset["asset"]["version"] = 1.1
    print("BROKEN", sum(1 for _ in validator.iter_errors(tileset)))
"#;

#[test]
fn tilesets_keep_to_the_schema_of_3d_tiles() {
    let Some(python) = installed("venv/bin/python", "python3") else { return };
    let schema = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/tiles-schema/files");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let on_earth = Similarity { translation: [4e6, 5e5, 4.9e6], ..Similarity::IDENTITY };
    let mut files = Vec::new();
    let sets = [("glb", Content::Glb, None), ("spz", Content::Spz, None), ("placed", Content::Spz, Some(on_earth))];
    for (name, content, to_earth) in sets {
        let own = folder.path().join(name);
        fs::create_dir(&own).expect("a folder");
        TileSet { to_earth, ..set(&own, content) }.write(&with_degree(1500, 1), 100).expect("written");
        files.push(own.join("tileset.json"));
    }
    let said = run(Command::new(python).args(["-c", SCHEMA]).arg(schema).args(&files));
    // Each set is then broken in two places, which the schema has to notice.
    assert_eq!(said, "BROKEN 2\n".repeat(3));
}

#[test]
fn the_gltf_validator_knows_no_worse_of_packed_tiles() {
    let Some(validator) = installed("node_modules/gltf-validator", "node") else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    set(folder.path(), Content::Spz).write(&with_degree(300, 1), 100).expect("written");
    let said = run(Command::new("node").args(["-e", VALIDATE]).arg(&validator).arg(folder.path().join("tile.glb")));
    assert!(said.contains("DONE"), "{said}");
    for line in said.lines().filter(|line| !line.starts_with("DONE")) {
        // The validator does not know that the extension uses the buffer view with the packed splats.
        let known = line.starts_with("UNSUPPORTED_EXTENSION")
            || line.starts_with("UNUSED_OBJECT") && line.ends_with(" /bufferViews/0")
            || line.starts_with("MESH_PRIMITIVE_INVALID_ATTRIBUTE") && line.contains("KHR_gaussian_splatting:");
        assert!(known, "{line}");
    }
}

/// The cells of a tree.
fn cells<'a>(node: &'a Value, found: &mut Vec<&'a Value>) {
    match node["children"].as_array() {
        Some(children) => children.iter().for_each(|child| cells(child, found)),
        None => found.push(node),
    }
}

fn streamed(folder: &Path, model: &Model) -> (Value, Vec<PathBuf>) {
    StreamedSog { folder, sh_degree: 1 }.write(model, 100).expect("written");
    let meta = json(&folder.join("lod-meta.json"));
    let names = meta["filenames"].as_array().expect("names").iter();
    let files = names.map(|name| folder.join(name.as_str().expect("a name"))).collect();
    (meta, files)
}

#[test]
fn streamed_sog_has_every_cell_in_every_level() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (meta, files) = streamed(folder.path(), &with_degree(1500, 1));
    let read: Vec<Gaussians> = files.iter().map(|file| splats::read(file, true).expect("SOG").gaussians).collect();
    assert!(read.iter().all(|g| g.len() <= 400), "a file has more than four full cells");
    let mut found = Vec::new();
    cells(&meta["tree"], &mut found);
    assert_eq!((meta["lodLevels"].as_u64(), meta["version"].as_u64()), (Some(4), Some(1)));
    let mut counts = [0; 4];
    let mut covered: Vec<Vec<bool>> = read.iter().map(|g| vec![false; g.len()]).collect();
    for cell in &found {
        let bound = |side: &str| numbers(&cell["bound"][side]);
        let (low, high) = (bound("min"), bound("max"));
        let mut before: Option<usize> = None;
        for (level, count_of_level) in counts.iter_mut().enumerate() {
            let run = &cell["lods"][level.to_string()];
            let [file, offset, count] =
                ["file", "offset", "count"].map(|key| run[key].as_u64().expect("a number") as usize);
            assert_eq!(count, before.map_or(count, |before| before.div_ceil(4)));
            before = Some(count);
            *count_of_level += count;
            assert!(offset + count <= covered[file].len(), "a run of {file} is too long");
            for (i, covered) in covered[file].iter_mut().enumerate().skip(offset).take(count) {
                assert!(!std::mem::replace(covered, true), "splat {i} of {file} is in two cells");
                let at = |k: usize| f64::from(read[file].means[3 * i + k]);
                let inside = |k: usize| (low[k] - 1e-3..=high[k] + 1e-3).contains(&at(k));
                assert!((0..3).all(inside), "splat {i} of {file} is out of its cell");
            }
        }
    }
    assert!(covered.iter().flatten().all(|covered| *covered), "a splat is in no cell");
    assert_eq!((found.len(), counts[0], numbers(&meta["counts"])), (15, 1500, counts.map(|n| n as f64).to_vec()));
}

#[test]
fn playcanvas_reads_each_level_of_streamed_sog() {
    let Some(program) = installed(SPLAT_TRANSFORM, "node") else { return };
    let Some(engine) = installed("node_modules/playcanvas", "node") else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let model = with_degree(1500, 1);
    let (meta, files) = streamed(folder.path(), &model);
    let octree = octree(&engine.join(OCTREE), folder.path());
    // Level, and splats of each file, as PlayCanvas finds them in lod-meta.json.
    let mut found = vec![(0, 0); files.len()];
    for (level, runs) in octree.iter().flat_map(|cell| cell.iter().enumerate()) {
        let [file, offset, count] = *runs;
        assert!(count > 0 && (found[file].1 == 0 || found[file].0 == level), "{octree:?}");
        assert_eq!(offset, found[file].1, "the runs of file {file} do not follow each other");
        found[file] = (level, offset + count);
    }
    let mut counts = [0; 4];
    for (file, (level, splats)) in files.iter().zip(found) {
        let back = file.with_extension("ply");
        run(Command::new("node").arg(&program).args(["-q", "-w", "-g", "cpu"]).args([file, &back]));
        assert_eq!(ply::read(&back).expect("read").gaussians.len(), splats, "{}", file.display());
        counts[level] += splats;
    }
    assert_eq!(numbers(&meta["counts"]), counts.map(|n| n as f64));
    assert!(counts[0] == 1500 && counts[3] < 1500 / 40, "{counts:?}");
}

#[test]
fn streamed_sog_that_is_not_whole_has_no_list_of_cells() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    streamed(folder.path(), &with_degree(300, 1));
    fs::remove_dir_all(folder.path().join("0_0")).expect("a folder");
    fs::write(folder.path().join("0_0"), "in the way").expect("written");
    let written = StreamedSog { folder: folder.path(), sh_degree: 1 }.write(&with_degree(300, 1), 100);
    assert!(written.expect_err("no folder").to_string().contains("0_0"));
    assert!(!folder.path().join("lod-meta.json").exists());
}

/// PlayCanvas' reader of lod-meta.json.
const OCTREE: &str = "build/playcanvas/src/scene/gsplat-unified/gsplat-octree.js";

/// Prints file, first splat and number of splats of each cell in each level.
const READ_OCTREE: &str = "\
const [module, meta] = process.argv.slice(1);
import(require('url').pathToFileURL(module)).then(({ GSplatOctree }) => {
    const tree = new GSplatOctree(meta, JSON.parse(require('fs').readFileSync(meta)));
    for (const [at, file] of tree.files.entries())
        if (!require('fs').existsSync(file.url)) throw new Error(`${at}: no file ${file.url}`);
    console.log(JSON.stringify(tree.nodes.map((n) => n.lods.map((l) => [l.fileIndex, l.offset, l.count]))));
});
";

/// File, first splat and number of splats of each cell in each level, as PlayCanvas reads them.
fn octree(reader: &Path, folder: &Path) -> Vec<Vec<[usize; 3]>> {
    let said = run(Command::new("node").args(["-e", READ_OCTREE]).args([reader, &folder.join("lod-meta.json")]));
    serde_json::from_str(&said).unwrap_or_else(|error| panic!("{error}: {said}"))
}

#[test]
fn a_damaged_packed_tile_is_an_error_that_names_the_file() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    set(folder.path(), Content::Spz).write(&with_degree(60, 1), 100).expect("written");
    let file = folder.path().join("tile.glb");
    let whole = fs::read(&file).expect("a tile");
    let replaced = |from: &str, to: &str| {
        let at = whole.windows(from.len()).position(|part| part == from.as_bytes()).expect("the text");
        let mut bytes = whole.clone();
        bytes[at..at + from.len()].copy_from_slice(format!("{to:<width$}", width = from.len()).as_bytes());
        bytes
    };
    let cut = (0..whole.len()).step_by(7).map(|end| whole[..end].to_vec());
    let wrong = [replaced("\"bufferView\":0", "\"bufferView\":7"), replaced("\"byteOffset\":0", "\"byteOffset\":9")];
    for bytes in cut.chain(wrong) {
        fs::write(&file, bytes).expect("written");
        let error = splats::read(&file, true).expect_err("damaged").to_string();
        assert!(error.contains("tile.glb"), "{error}");
    }
}
