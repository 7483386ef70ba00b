//! 3D Tiles 1.1: `tileset.json` and a glTF file for each tile.

use std::io::Read as _;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::{Bounds, Tile, Tree};
use crate::format::ply::Model;
use crate::format::splats::gltf;
use crate::format::{Error, atomic};
use crate::scene::Similarity;

/// Name of the file of a set.
const TILESET: &str = "tileset.json";
/// Pixels of error that viewers of 3D Tiles allow by default. A tile's geometric error is so large that by default the
/// tile is drawn where merging has moved mass by at most a pixel in the mean square.
const USUAL_TOLERANCE: f64 = 16.0;

/// What tiles are written as.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Content {
    /// glTF with attributes of f32, by the extension `KHR_gaussian_splatting`.
    #[default]
    Glb,
    /// glTF with splats packed as SPZ, version 2, by a draft extension. Cesium draws splats of this form only.
    Spz,
}

/// A set of tiles in a folder.
#[derive(Clone, Debug)]
pub struct TileSet<'a> {
    /// The folder. It is there already.
    pub folder: &'a Path,
    /// The form of tiles.
    pub content: Content,
    /// Highest degree of spherical harmonics.
    pub sh_degree: u32,
    /// From the model's coordinates, [`Model::shift`] not added, to the axes of the Earth (ECEF) in metres; `None`
    /// where nothing says where the model lies.
    pub to_earth: Option<Similarity>,
}

impl TileSet<'_> {
    /// Builds the tree of a model with at most `most` splats in a tile, and writes tiles and `tileset.json`. That
    /// file is written last: without it the folder holds no set.
    pub fn write(&self, model: &Model, most: usize) -> Result<Tree, Error> {
        let shared = Model { sh_degree: model.sh_degree, antialias: model.antialias, ..Model::default() };
        self.clear()?;
        let tree = Tree::build(&model.gaussians, most, |tile, g| {
            let of_tile = Model { gaussians: g.clone(), ..shared.clone() };
            let encoded = match self.content {
                Content::Glb => gltf::encode(&of_tile, self.sh_degree),
                Content::Spz => gltf::encode_spz(&of_tile, self.sh_degree),
            };
            let file = self.folder.join(name(tile));
            let refused = |problem: String| Error::Unwritable { file: file.clone(), what: "the splats", problem };
            let bytes = encoded.map_err(|e| refused(e.to_string()))?;
            atomic::write(&file, |out| out.write_all(&bytes))
        })?;
        let text = self.document(&tree);
        atomic::write(&self.file(), |out| writeln!(out, "{text:#}"))?;
        Ok(tree)
    }

    /// Removes what an earlier set has left in the folder.
    fn clear(&self) -> Result<(), Error> {
        self.earlier()?.iter().try_for_each(|file| std::fs::remove_file(file).map_err(Error::io(file, "remove")))
    }

    /// The files of an earlier set, which [`Self::write`] removes. A file of such a name by another program is an
    /// error.
    pub fn earlier(&self) -> Result<Vec<PathBuf>, Error> {
        let is_tile = |name: &str| {
            let path = name.strip_prefix("tile").and_then(|rest| rest.strip_suffix(".glb"));
            path.is_some_and(|path| path.bytes().all(|child| child.is_ascii_digit()))
        };
        let mut found = Vec::new();
        for entry in std::fs::read_dir(self.folder).map_err(Error::io(self.folder, "list"))? {
            let file = entry.map_err(Error::io(self.folder, "list"))?.path();
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let head = if name == TILESET {
                std::fs::read(&file).map_err(Error::io(&file, "read"))?
            } else if is_tile(&name) {
                gltf_head(&file)?
            } else {
                continue;
            };
            super::by_this_program(&file, &head)?;
            found.push(file);
        }
        Ok(found)
    }

    /// The file of the set.
    pub fn file(&self) -> PathBuf {
        self.folder.join(TILESET)
    }

    /// The content of `tileset.json`.
    fn document(&self, tree: &Tree) -> Value {
        let mut used = vec!["KHR_gaussian_splatting"];
        if self.content == Content::Spz {
            used.push("KHR_gaussian_splatting_compression_spz_2");
        }
        let asset = json!({"version": "1.1", "generator": concat!("psrgs-vk ", env!("CARGO_PKG_VERSION"))});
        // Where nothing is drawn, everything is missing.
        let nothing = tree.root().map_or(0.0, |root| root.bounds.diagonal());
        let unit = self.to_earth.map_or(1.0, |to_earth| to_earth.scale);
        let root = match tree.root() {
            Some(root) => {
                let mut root = node(tree, root);
                root["refine"] = json!("REPLACE");
                root["transform"] = json!(columns(&self.root_transform()));
                root
            }
            None => json!({"boundingVolume": {"sphere": [0, 0, 0, 1]}, "geometricError": 0, "refine": "REPLACE"}),
        };
        json!({
            "asset": asset,
            "geometricError": nothing.max(geometric_error(tree.root())) * unit,
            "extensionsUsed": ["3DTILES_content_gltf"],
            "extensions": {"3DTILES_content_gltf": {"extensionsUsed": used, "extensionsRequired": used}},
            "root": root,
        })
    }

    /// From the axes of tiles to those of the Earth, or of the model turned so that its -y is up.
    fn root_transform(&self) -> Similarity {
        // Viewers turn the axes of glTF, y up, to those of tiles, z up. Files have y and z of the model negated.
        let to_model =
            Similarity { rotation: [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]], ..Similarity::IDENTITY };
        self.to_earth.map_or(Similarity::IDENTITY, |to_earth| to_model.then(&to_earth))
    }
}

/// The name of a tile's file.
fn name(tile: &Tile) -> String {
    let path: Vec<String> = tile.path.iter().map(|k| k.to_string()).collect();
    format!("tile{}.glb", path.join(""))
}

/// The JSON of a binary glTF file; nothing where the file is no such file.
fn gltf_head(file: &Path) -> Result<Vec<u8>, Error> {
    let mut start = [0; 20];
    let mut content = std::fs::File::open(file).map_err(Error::io(file, "open"))?;
    if content.read_exact(&mut start).is_err() {
        return Ok(Vec::new());
    }
    let length = u32::from_le_bytes([start[12], start[13], start[14], start[15]]);
    let mut head = Vec::new();
    content.take(length.into()).read_to_end(&mut head).map_err(Error::io(file, "read"))?;
    Ok(head)
}

fn geometric_error(tile: Option<&Tile>) -> f64 {
    tile.map_or(0.0, |tile| USUAL_TOLERANCE * tile.error)
}

/// A tile and those below.
fn node(tree: &Tree, tile: &Tile) -> Value {
    let mut out = json!({
        "boundingVolume": {"box": volume(&tile.bounds)},
        "geometricError": geometric_error(Some(tile)),
        "content": {"uri": name(tile)},
    });
    if !tile.children.is_empty() {
        let children = tile.children.iter().filter_map(|k| tree.tiles.get(*k));
        out["children"] = children.map(|child| node(tree, child)).collect();
    }
    out
}

/// Centre and half axes of a box in the axes of tiles.
fn volume(bounds: &Bounds) -> [f64; 12] {
    let middle = |k: usize| 0.5 * (bounds.low[k] + bounds.high[k]);
    let half = |k: usize| 0.5 * (bounds.high[k] - bounds.low[k]);
    [middle(0), middle(2), -middle(1), half(0), 0.0, 0.0, 0.0, half(2), 0.0, 0.0, 0.0, half(1)]
}

/// The columns of the 4x4 matrix.
fn columns(similarity: &Similarity) -> Vec<f64> {
    let rows = similarity.rows();
    (0..4).flat_map(|column| rows.map(|row| row[column])).collect()
}
