//! Point clouds, and telling them from models.

use std::path::Path;

use super::Model;
use super::columns::columns;
use super::read::{open, read, read_comments};
use crate::format::{At, Error, atomic};

/// Colour of points that have none.
const GREY: u8 = 128;

/// Points with normals and colours.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cloud {
    /// Positions.
    pub positions: Vec<[f64; 3]>,
    /// Normals, as many as positions, or none.
    pub normals: Vec<[f32; 3]>,
    /// 8-bit colours, as many as positions.
    pub colors: Vec<[u8; 3]>,
}

/// What a PLY file holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// Splats.
    Model(Box<Model>),
    /// Plain points.
    Cloud(Cloud),
}

/// Reads splats or plain points: a file whose vertices have any property of splats is taken for a model.
pub fn read_content(file: &Path) -> Result<Content, Error> {
    let (header, vertices, _) = open(file)?;
    let splats = |name: &str| {
        ["opacity", "packed_position"].contains(&name)
            || ["f_dc_", "f_rest_", "scale_", "rot_"].iter().any(|start| name.starts_with(start))
    };
    if header.elements[vertices].properties.iter().any(|p| splats(&p.name)) {
        return Ok(Content::Model(Box::new(read(file)?)));
    }
    Cloud::read(file).map(Content::Cloud)
}

impl Cloud {
    /// Reads positions (`x y z`, any number type), normals (`nx ny nz`) where all have them, and colours (`red green blue` from 0 to
    /// 255), grey where there are none. An offset in a comment is added.
    pub fn read(file: &Path) -> Result<Self, Error> {
        let rows = columns(file, &["x", "y", "z"], &["red", "green", "blue", "nx", "ny", "nz"])?;
        let mut comments = Model::default();
        read_comments(file, &open(file)?.0, &mut comments)?;
        let mut cloud = Self::default();
        let mut normals = Some(Vec::with_capacity(rows.len()));
        for (i, row) in rows.iter().enumerate() {
            let at = |k: usize| row.get(k).copied().flatten();
            let position = [0, 1, 2].map(|k| at(k).unwrap_or(0.0) + comments.shift[k]);
            if position.iter().any(|v| !v.is_finite()) {
                let problem = "is not finite with the offset of the comment added";
                return Err(Error::malformed(file, format_args!("vertex {i}"), At::Byte(0), problem));
            }
            cloud.positions.push(position);
            cloud.colors.push([3, 4, 5].map(|k| at(k).map_or(GREY, |c| c.round().clamp(0.0, 255.0) as u8)));
            let normal = [6, 7, 8].map(|k| at(k).filter(|v| v.is_finite()).map(|v| v as f32));
            match (normal, &mut normals) {
                ([Some(x), Some(y), Some(z)], Some(all)) => all.push([x, y, z]),
                _ => normals = None,
            }
        }
        cloud.normals = normals.unwrap_or_default();
        Ok(cloud)
    }

    /// Writes a binary file with coordinates in double precision.
    pub fn write(&self, file: &Path) -> Result<(), Error> {
        let n = self.positions.len();
        let with_normals = !self.normals.is_empty();
        if self.colors.len() != n || (with_normals && self.normals.len() != n) {
            let problem = format!("{n} positions, {} normals, {} colours", self.normals.len(), self.colors.len());
            return Err(Error::Unwritable { file: file.to_owned(), what: "the points", problem });
        }
        atomic::write(file, |out| {
            let properties =
                |kind: &str, names: [&str; 3]| names.map(|name| format!("property {kind} {name}\n")).concat();
            let normals = if with_normals { properties("float", ["nx", "ny", "nz"]) } else { String::new() };
            write!(
                out,
                "ply\nformat binary_little_endian 1.0\nelement vertex {n}\n{}{normals}{}end_header\n",
                properties("double", ["x", "y", "z"]),
                properties("uchar", ["red", "green", "blue"])
            )?;
            for i in 0..n {
                for v in self.positions[i] {
                    out.write_all(&v.to_le_bytes())?;
                }
                for v in self.normals.get(i).into_iter().flatten() {
                    out.write_all(&v.to_le_bytes())?;
                }
                out.write_all(&self.colors[i])?;
            }
            Ok(())
        })
    }
}
