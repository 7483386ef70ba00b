//! Streamed SOG: `lod-meta.json` and folders of unpacked SOG, as PlayCanvas loads them. Space is divided into cells,
//! the leaves of the tree of tiles. A cell has a run of splats in a file of each level: level 0 has all splats, each
//! further level a quarter of those before.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::Splats;
use super::tree::{Bounds, parts};
use crate::format::ply::Model;
use crate::format::splats::sog;
use crate::format::{Error, atomic};
use crate::scene::Gaussians;

/// Number of levels.
pub const LEVELS: usize = 4;
/// Splats of a level for each splat of the next one.
const FEWER: usize = 4;
/// Full cells that a file has room for.
const CELLS: usize = 4;
/// Name of the file that says where cells are.
const META: &str = "lod-meta.json";

/// A model in a folder.
#[derive(Clone, Debug)]
pub struct StreamedSog<'a> {
    /// The folder. It is there already.
    pub folder: &'a Path,
    /// Highest degree of spherical harmonics.
    pub sh_degree: u32,
}

/// What was written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Streamed {
    /// Splats of each level.
    pub counts: [usize; LEVELS],
    /// Number of cells.
    pub cells: usize,
    /// Number of folders with splats.
    pub files: usize,
}

/// The run of a cell's splats in a file.
struct Run {
    file: usize,
    offset: usize,
    count: usize,
}

/// The files of a level, of which the last one is being filled.
#[derive(Default)]
struct Level {
    files: usize,
    number: usize,
    splats: Vec<Gaussians>,
    count: usize,
    cells: usize,
}

impl StreamedSog<'_> {
    /// Writes a model with at most `most` splats in a cell. `lod-meta.json` is written last: without that file the
    /// folder holds no model.
    pub fn write(&self, model: &Model, most: usize) -> Result<Streamed, Error> {
        self.earlier()?;
        let meta = self.file();
        atomic::remove(&meta)?;
        let most = most.max(1);
        let mut writer = Writer { set: self, model, most, levels: Default::default(), names: Vec::new() };
        let mut rows: Vec<u32> = (0..model.gaussians.len() as u32).collect();
        let (tree, _) = writer.cells(&mut rows)?;
        (0..LEVELS).try_for_each(|level| writer.finish(level))?;
        let written = Streamed {
            counts: std::array::from_fn(|level| writer.levels[level].count),
            cells: writer.levels[0].cells,
            files: writer.names.len(),
        };
        let document = json!({
            "version": 1,
            "asset": {"generator": concat!("psrgs-vk ", env!("CARGO_PKG_VERSION"))},
            "count": written.counts.iter().sum::<usize>(),
            "counts": written.counts,
            "lodLevels": LEVELS,
            "filenames": writer.names,
            "tree": tree,
        });
        atomic::write(&meta, |out| writeln!(out, "{document}"))?;
        Ok(written)
    }

    /// The files of an earlier model that [`Self::write`] may replace. A `lod-meta.json` by another program is an
    /// error.
    pub fn earlier(&self) -> Result<Vec<PathBuf>, Error> {
        let meta = self.file();
        if !meta.is_file() {
            return Ok(Vec::new());
        }
        let content = std::fs::read(&meta).map_err(Error::io(&meta, "read"))?;
        let document = super::by_this_program(&meta, &content)?;
        let names = document["filenames"].as_array().into_iter().flatten().filter_map(Value::as_str);
        Ok(names.map(|name| self.folder.join(name)).chain([meta]).collect())
    }

    /// The file that says where cells are.
    pub fn file(&self) -> PathBuf {
        self.folder.join(META)
    }
}

struct Writer<'a> {
    set: &'a StreamedSog<'a>,
    model: &'a Model,
    most: usize,
    levels: [Level; LEVELS],
    names: Vec<String>,
}

impl Writer<'_> {
    /// Writes the cells of some rows. The result is their node of the tree, and where they are drawn.
    fn cells(&mut self, rows: &mut [u32]) -> Result<(Value, Bounds), Error> {
        let cells = rows.len().div_ceil(self.most);
        if cells <= 1 {
            return self.cell(rows);
        }
        let (mut children, mut bounds) = (Vec::new(), Bounds::EMPTY);
        for part in parts(&self.model.gaussians, rows, cells) {
            let (child, of_child) = self.cells(part)?;
            children.push(child);
            bounds = bounds.with(&of_child);
        }
        Ok((json!({"bound": bound(&bounds), "children": children}), bounds))
    }

    fn cell(&mut self, rows: &mut [u32]) -> Result<(Value, Bounds), Error> {
        rows.sort_unstable();
        let finest = self.model.gaussians.rows(rows).in_morton_order();
        let (mut bounds, mut lods) = (Bounds::EMPTY, serde_json::Map::new());
        let mut splats = Splats::of(&finest);
        for level in 0..LEVELS {
            let g = if level == 0 {
                finest.clone()
            } else {
                splats.merge(splats.len().div_ceil(FEWER));
                splats.gaussians()
            };
            bounds = bounds.with(&Bounds::of(&g));
            if !g.is_empty() {
                let Run { file, offset, count } = self.add(level, g)?;
                lods.insert(level.to_string(), json!({"file": file, "offset": offset, "count": count}));
            }
        }
        Ok((json!({"bound": bound(&bounds), "lods": lods}), bounds))
    }

    /// Puts the splats of a cell into the file that is being filled.
    fn add(&mut self, level: usize, g: Gaussians) -> Result<Run, Error> {
        let in_file = |of: &Level| of.splats.iter().map(Gaussians::len).sum::<usize>();
        if in_file(&self.levels[level]) + g.len() > CELLS * self.most {
            self.finish(level)?;
        }
        let of = &mut self.levels[level];
        if of.splats.is_empty() {
            of.number = self.names.len();
            self.names.push(format!("{level}_{}/meta.json", of.files));
        }
        let run = Run { file: of.number, offset: in_file(of), count: g.len() };
        of.count += g.len();
        of.cells += 1;
        of.splats.push(g);
        Ok(run)
    }

    /// Writes the file that is being filled.
    fn finish(&mut self, level: usize) -> Result<(), Error> {
        let of = &mut self.levels[level];
        if of.splats.is_empty() {
            return Ok(());
        }
        let folder = self.set.folder.join(format!("{level}_{}", of.files));
        of.files += 1;
        let mut gaussians = Gaussians::default();
        std::mem::take(&mut of.splats).iter().for_each(|g| gaussians.append(g));
        let model = Model {
            gaussians,
            sh_degree: self.model.sh_degree,
            antialias: self.model.antialias,
            shift: self.model.shift,
            ..Model::default()
        };
        std::fs::create_dir_all(&folder).map_err(Error::io(&folder, "create"))?;
        let refused = |problem: String| Error::Unwritable { file: folder.clone(), what: "the splats", problem };
        for (name, bytes) in sog::files(&model, self.set.sh_degree).map_err(|e| refused(e.to_string()))? {
            atomic::write(&folder.join(name), |out| out.write_all(&bytes))?;
        }
        Ok(())
    }
}

/// A box as the tree has it.
fn bound(bounds: &Bounds) -> Value {
    json!({"min": bounds.low, "max": bounds.high})
}
