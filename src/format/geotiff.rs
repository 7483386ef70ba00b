//! Cloud Optimized GeoTIFF, written from tiles in any order with bounded memory.
//!
//! Tiles go compressed into a temporary file, and their averages into the overviews, of which only the tiles that
//! still wait for parts are in memory. [`Writer::finish`] writes header, directories and tiles in the order that
//! readers over a network want: overviews before the full picture. A reader finds the whole file or none.

mod directory;
mod keys;
mod levels;
mod pack;

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::{Error, atomic};
use directory::Directory;
pub use keys::{GeoKeys, System};
use levels::{Level, Pending};
pub use pack::Samples;

/// Width and height of a tile in pixels.
pub const TILE: u32 = 512;
/// The value of cells without data in pictures of floats.
pub const NO_DATA: f32 = -9999.0;

/// What the samples of a picture are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Red, green, blue and alpha in 8 bits, not multiplied. Alpha is 255, or 0 where there is no data.
    Rgba8,
    /// Brightness in 8 bits; 0 where there is no data.
    Gray8,
    /// Floats of this many bands; [`NO_DATA`] where there is none.
    Float(u16),
}

impl Kind {
    /// Samples of a pixel.
    pub fn samples(self) -> usize {
        match self {
            Self::Rgba8 => 4,
            Self::Gray8 => 1,
            Self::Float(bands) => usize::from(bands),
        }
    }

    /// Bytes of a pixel.
    fn bytes(self) -> usize {
        match self {
            Self::Rgba8 => 4,
            Self::Gray8 => 1,
            Self::Float(bands) => 4 * usize::from(bands),
        }
    }
}

/// A picture to write.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// What the samples are.
    pub kind: Kind,
    /// What each band is, if said.
    pub descriptions: Vec<String>,
    /// Easting and northing of the upper left corner.
    pub corner: [f64; 2],
    /// Side of a pixel in metres.
    pub gsd: f64,
    /// The reference system.
    pub keys: GeoKeys,
}

/// Where a compressed tile lies in the temporary file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Place {
    offset: u64,
    bytes: u32,
}

/// Writes a picture tile by tile.
pub struct Writer {
    file: PathBuf,
    picture: Picture,
    store: File,
    written: u64,
    levels: Vec<Level>,
    pending: HashMap<(usize, u32, u32), Pending>,
}

impl Writer {
    /// Begins a picture. The temporary file is in the file's folder, and has no name where the system allows.
    pub fn new(file: &Path, picture: Picture) -> Result<Self, Error> {
        let problem = match (picture.width, picture.height) {
            (0, _) | (_, 0) => Some("it has no pixels"),
            (width, height) if width.max(height) > i32::MAX as u32 => Some("a side is longer than 2^31 pixels"),
            _ => None,
        };
        if let Some(problem) = problem {
            let (file, problem) = (file.to_owned(), problem.to_owned());
            return Err(Error::Unwritable { file, what: "the GeoTIFF", problem });
        }
        atomic::check(file)?;
        let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let store = tempfile::tempfile_in(folder).map_err(Error::io(file, "create a temporary file beside it"))?;
        let levels = Level::all(picture.width, picture.height);
        Ok(Self { file: file.to_owned(), picture, store, written: 0, levels, pending: HashMap::new() })
    }

    /// The picture.
    pub fn picture(&self) -> &Picture {
        &self.picture
    }

    /// Columns and rows of tiles.
    pub fn tiles(&self) -> (u32, u32) {
        self.levels.first().map_or((0, 0), |level| (level.across, level.down))
    }

    /// Adds tiles at (column, row), each once. A tile has [`TILE`] rows of [`TILE`] pixels; those beyond the picture
    /// are not looked at.
    pub fn add(&mut self, tiles: Vec<((u32, u32), Samples)>) -> Result<(), Error> {
        let mut level = 0;
        let mut tiles = tiles;
        while !tiles.is_empty() {
            let size = (self.levels[level].width, self.levels[level].height);
            let kind = self.picture.kind;
            let ready = |((x, y), mut samples): ((u32, u32), Samples)| {
                samples.blank_beyond(kind, left_of(size.0, x), left_of(size.1, y));
                let packed = samples.packed(kind);
                ((x, y), samples.halved(kind), packed)
            };
            let packed: Vec<_> = tiles.into_par_iter().map(ready).collect();
            let mut parents = Vec::new();
            for ((x, y), half, packed) in packed {
                self.keep(level, (x, y), &packed)?;
                parents.extend(self.join(level, (x, y), &half));
            }
            (tiles, level) = (parents, level + 1);
        }
        Ok(())
    }

    /// Stores a compressed tile.
    fn keep(&mut self, level: usize, (x, y): (u32, u32), packed: &[u8]) -> Result<(), Error> {
        let offset = self.written;
        self.store.seek(SeekFrom::Start(offset)).map_err(Error::io(&self.file, "write"))?;
        self.store.write_all(packed).map_err(Error::io(&self.file, "write"))?;
        self.written += packed.len() as u64;
        let level = &mut self.levels[level];
        let at = (y * level.across + x) as usize;
        level.places[at] = Place { offset, bytes: packed.len() as u32 };
        Ok(())
    }

    /// Puts a halved tile into that of the next overview; returns the latter where it is complete.
    fn join(&mut self, level: usize, (x, y): (u32, u32), half: &Samples) -> Option<((u32, u32), Samples)> {
        let (across, down) = (self.levels[level].across, self.levels[level].down);
        self.levels.get(level + 1)?;
        let kind = self.picture.kind;
        let key = (level + 1, x / 2, y / 2);
        let parts = |at: u32, of: u32| (of - 2 * (at / 2)).min(2);
        let pending = self
            .pending
            .entry(key)
            .or_insert_with(|| Pending { samples: Samples::empty(kind), missing: parts(x, across) * parts(y, down) });
        pending.samples.put_quarter(kind, half, (x % 2, y % 2));
        pending.missing = pending.missing.saturating_sub(1);
        if pending.missing > 0 {
            return None;
        }
        self.pending.remove(&key).map(|whole| ((x / 2, y / 2), whole.samples))
    }

    /// A tile of the full picture that was added before; one without data where it was not.
    pub fn tile(&mut self, x: u32, y: u32) -> Result<Samples, Error> {
        let kind = self.picture.kind;
        let place = self.levels.first().filter(|level| x < level.across && y < level.down);
        let place = place.map_or_else(Place::default, |level| level.places[(y * level.across + x) as usize]);
        if place.bytes == 0 {
            return Ok(Samples::empty(kind));
        }
        let mut packed = vec![0; place.bytes as usize];
        self.store.seek(SeekFrom::Start(place.offset)).map_err(Error::io(&self.file, "read"))?;
        self.store.read_exact(&mut packed).map_err(Error::io(&self.file, "read"))?;
        Samples::unpacked(kind, &packed).map_err(Error::io(&self.file, "read"))
    }

    /// Writes the file. Tiles that were not added have no data.
    pub fn finish(mut self) -> Result<(), Error> {
        self.fill()?;
        let header = Header::new(&self.picture, &self.levels);
        self.write_beside()?;
        let (file, levels, mut store) = (&self.file, &self.levels, self.store);
        atomic::write(file, |out| {
            out.write_all(&header.bytes)?;
            for level in levels.iter().rev() {
                level.places.iter().try_for_each(|place| copy(&mut store, *place, out))?;
            }
            Ok(())
        })
    }

    /// A system without a code stands in a file beside, which GDAL reads first. Such a file of a former picture goes.
    fn write_beside(&self) -> Result<(), Error> {
        let mut name = self.file.clone().into_os_string();
        name.push(".aux.xml");
        let beside = PathBuf::from(name);
        match &self.picture.keys.system {
            System::Wkt(wkt) => {
                let escaped = directory::escaped(wkt);
                let text = format!("<PAMDataset>\n  <SRS>{escaped}</SRS>\n</PAMDataset>\n");
                atomic::write(&beside, |out| out.write_all(text.as_bytes()))
            }
            _ => atomic::remove(&beside),
        }
    }

    /// Adds empty tiles where none were added.
    fn fill(&mut self) -> Result<(), Error> {
        let (across, down) = self.tiles();
        for y in 0..down {
            let places = &self.levels[0].places;
            let missing = |x: &u32| places[(y * across + x) as usize].bytes == 0;
            let absent: Vec<u32> = (0..across).filter(missing).collect();
            for some in absent.chunks(16) {
                let empty = |x: &u32| ((*x, y), Samples::empty(self.picture.kind));
                let tiles = some.iter().map(empty).collect();
                self.add(tiles)?;
            }
        }
        Ok(())
    }
}

/// Pixels of a side that lie in the tile with this number.
fn left_of(side: u32, tile: u32) -> u32 {
    side.saturating_sub(tile * TILE).min(TILE)
}

fn copy(store: &mut File, place: Place, out: &mut dyn Write) -> io::Result<()> {
    store.seek(SeekFrom::Start(place.offset))?;
    let copied = io::copy(&mut Read::take(store, u64::from(place.bytes)), out)?;
    if copied == u64::from(place.bytes) { Ok(()) } else { Err(io::ErrorKind::UnexpectedEof.into()) }
}

/// What GDAL reads of a file's layout before its directories.
const LAYOUT: &str = "LAYOUT=IFDS_BEFORE_DATA\nBLOCK_ORDER=ROW_MAJOR\nKNOWN_INCOMPATIBLE_EDITION=NO\n ";
/// The largest file of the classic format, less what the directories may take.
const CLASSIC: u64 = u32::MAX as u64 - (1 << 24);

/// All that lies before the tiles.
struct Header {
    bytes: Vec<u8>,
}

impl Header {
    fn new(picture: &Picture, levels: &[Level]) -> Self {
        let tiles: u64 = levels.iter().map(|level| level.places.len() as u64).sum();
        let data: u64 = levels.iter().flat_map(|level| &level.places).map(|place| u64::from(place.bytes)).sum();
        let big = data + 16 * tiles > CLASSIC;
        // The offsets do not change the size, so the first round finds where the tiles begin.
        let first = Self::with_offsets(picture, levels, big, 0).len() as u64;
        Self { bytes: Self::with_offsets(picture, levels, big, first) }
    }

    /// The bytes, where the tiles begin at `data`.
    fn with_offsets(picture: &Picture, levels: &[Level], big: bool, data: u64) -> Vec<u8> {
        let mut bytes = if big { b"II\x2b\0\x08\0\0\0".to_vec() } else { b"II\x2a\0".to_vec() };
        let ghost = format!("GDAL_STRUCTURAL_METADATA_SIZE={:06} bytes\n{LAYOUT}", LAYOUT.len());
        let width = if big { 8 } else { 4 };
        let directories = (bytes.len() + width + ghost.len()).next_multiple_of(8);
        directory::number(&mut bytes, directories as u64, big);
        bytes.extend(ghost.as_bytes());
        bytes.resize(directories, 0);
        let mut at = data;
        let mut offsets: Vec<Vec<u64>> = Vec::new();
        for level in levels.iter().rev() {
            let of_place = |place: &Place| {
                let begin = at;
                at += u64::from(place.bytes);
                begin
            };
            offsets.push(level.places.iter().map(of_place).collect());
        }
        offsets.reverse();
        let last = levels.len().saturating_sub(1);
        for (k, (level, offsets)) in levels.iter().zip(&offsets).enumerate() {
            let directory = Directory::of_level(picture, level, offsets, k > 0);
            directory.append(&mut bytes, big, k == last);
        }
        bytes
    }
}

#[cfg(test)]
mod tests;
