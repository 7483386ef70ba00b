//! Models in files of any format.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::{EncodeError, gltf, placement, sog, splat, spz};
use crate::format::ply::{self, Content, Model};
use crate::format::{Error, LeftOut, atomic, foreign, source};

/// A format of files with splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// PLY in the layout of INRIA's 3DGS.
    Ply,
    /// PLY in SuperSplat's compressed layout.
    CompressedPly,
    /// SPZ.
    Spz(spz::Version),
    /// SOG. Writing packs a file; reading takes `meta.json` of an unpacked SOG too.
    Sog,
    /// `.splat`.
    Splat,
    /// glTF with the extension `KHR_gaussian_splatting`, as one binary file.
    Glb,
}

impl Format {
    /// The format of files of this name.
    pub fn of_name(file: &Path) -> Option<Self> {
        let name = file.file_name()?.to_string_lossy().to_lowercase();
        let (stem, extension) = name.rsplit_once('.')?;
        Some(match extension {
            "ply" if stem.ends_with(".compressed") => Self::CompressedPly,
            "ply" => Self::Ply,
            "spz" => Self::Spz(spz::Version::default()),
            "sog" => Self::Sog,
            "splat" => Self::Splat,
            "glb" => Self::Glb,
            _ => return None,
        })
    }

    /// The usual ending of names.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::CompressedPly => "compressed.ply",
            Self::Spz(_) => "spz",
            Self::Sog => "sog",
            Self::Splat => "splat",
            Self::Glb => "glb",
        }
    }

    /// Whether files hold the shift from their coordinates to those of the dataset.
    pub fn holds_shift(self) -> bool {
        matches!(self, Self::Ply | Self::CompressedPly | Self::Sog)
    }

    /// Writes a model, with spherical harmonics up to a degree, whole or not at all.
    pub fn write(self, file: &Path, model: &Model, sh_degree: u32) -> Result<(), Error> {
        let degree = sh_degree.min(model.sh_degree);
        let encoded = match self {
            Self::Ply => return ply::write_degree(file, model, degree),
            Self::CompressedPly => ply::encode_compressed(model, degree),
            Self::Spz(version) => spz::encode(model, degree, version),
            Self::Sog => sog::encode(model, degree),
            Self::Splat => splat::encode(model),
            Self::Glb => gltf::encode(model, degree),
        };
        let refused =
            |e: EncodeError| Error::Unwritable { file: file.to_owned(), what: "the splats", problem: e.to_string() };
        let bytes = encoded.map_err(refused)?;
        atomic::write(file, |out| out.write_all(&bytes))
    }

    /// The format of a file by its first bytes, else by its name; PLY where they say nothing, or where a file is known
    /// to be no model: the reader of PLY files says what they are.
    fn of_content(file: &Path) -> Result<Self, Error> {
        let (mut opened, bytes) = source::open(file)?;
        let mut begin = Vec::new();
        opened.by_ref().take(foreign::LOOKED_AT as u64).read_to_end(&mut begin).map_err(Error::io(file, "read"))?;
        let named = Self::of_name(file);
        let spz = Self::Spz(spz::Version::default());
        Ok(match (begin.as_slice(), named) {
            ([b'p', b'l', b'y', ..], _) => Self::Ply,
            ([b'N', b'G', b'S', b'P', ..], _) => spz,
            ([b'g', b'l', b'T', b'F', ..], _) => Self::Glb,
            ([b'{', ..], None) if is_unpacked_sog(file) => Self::Sog,
            ([0x1f, 0x8b, ..], Some(Self::Spz(_))) | ([b'P', b'K', ..], Some(Self::Sog)) => named.unwrap_or(spz),
            // Such a file begins with numbers, which could be anything but text.
            (begin, Some(Self::Splat)) if !foreign::is_text(begin) => Self::Splat,
            (begin, Some(named)) if foreign::described(file, bytes, begin).is_none() => named,
            _ => Self::Ply,
        })
    }
}

/// Reads a model of any format, by content and name. The coordinates are those of the file. A few splats that are not
/// finite are left out, see [`Model::left_out`]; where `strict` is set or where they are more than one in ten, they are
/// an error.
pub fn read(file: &Path, strict: bool) -> Result<Model, Error> {
    decoded(Format::of_content(file)?, file, strict)
}

fn is_unpacked_sog(file: &Path) -> bool {
    file.file_name() == Some(sog::META.as_ref())
}

fn decoded(format: Format, file: &Path, strict: bool) -> Result<Model, Error> {
    let decode = match format {
        Format::Ply | Format::CompressedPly => return ply::read_with(file, strict),
        Format::Spz(_) => spz::decode,
        Format::Sog if is_unpacked_sog(file) => return sog::read_unpacked(file, strict),
        Format::Sog => sog::decode,
        Format::Splat => splat::decode,
        Format::Glb => gltf::decode,
    };
    let bytes = std::fs::read(file).map_err(Error::io(file, "read"))?;
    decode(file, &bytes, strict)
}

/// A model in the axes of its dataset.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// The model.
    pub model: Model,
    /// The file beside the model that told where it belongs, if there is one.
    pub by: Option<PathBuf>,
}

/// [`read`] with the coordinates of the dataset, if the model was moved or turned and a file beside it tells so.
pub fn read_placed(file: &Path, strict: bool) -> Result<Placed, Error> {
    let (model, by) = placement::placed(read(file, strict)?, file)?;
    Ok(Placed { model, by })
}

/// Reads splats of any format, or plain points of a PLY file, and what was left out.
pub fn read_content(file: &Path, strict: bool) -> Result<(Content, Option<LeftOut>), Error> {
    let (content, left_out) = match Format::of_content(file)? {
        Format::Ply => ply::read_content_with(file, strict)?,
        other => {
            let mut model = decoded(other, file, strict)?;
            let left_out = model.left_out.take();
            (Content::Model(Box::new(model)), left_out)
        }
    };
    Ok(match content {
        Content::Model(model) => (Content::Model(Box::new(placement::placed(*model, file)?.0)), left_out),
        cloud => (cloud, left_out),
    })
}
