//! Point clouds, and how they differ from models.

use std::path::Path;

use super::Model;
use super::colours::Place;
use super::columns::for_each;
use super::read::{open, read_comments, read_with};
use crate::format::{At, Error, LeftOut, Tally, atomic};

/// Properties known to hold no colours.
const NO_COLOURS: [&str; 7] = ["x", "y", "z", "nx", "ny", "nz", "curvature"];

/// Points with normals and colours.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cloud {
    /// Positions.
    pub positions: Vec<[f64; 3]>,
    /// Normals, one per position, or empty.
    pub normals: Vec<[f32; 3]>,
    /// 8-bit colours, one per position, or empty.
    pub colours: Vec<[u8; 3]>,
    /// Without colours: the file's properties in which no colours were recognised.
    pub unknown: Vec<String>,
}

/// The content of a PLY file.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// Splats.
    Model(Box<Model>),
    /// Plain points.
    Cloud(Cloud),
}

/// Reads splats or plain points. A file is a model if its vertices have any property of splats, except if they only
/// have splat colours. A few vertices that are not finite are left out; [`read_content_with`] says which.
pub fn read_content(file: &Path) -> Result<Content, Error> {
    read_content_with(file, false).map(|(content, _)| content)
}

/// Reads splats or plain points, and the vertices left out. Vertices that are not finite are an error where `strict` is
/// set or where they are more than one in ten.
pub fn read_content_with(file: &Path, strict: bool) -> Result<(Content, Option<LeftOut>), Error> {
    let (header, vertices, _) = open(file)?;
    let splats = |name: &str| {
        ["opacity", "packed_position"].contains(&name)
            || ["f_rest_", "scale_", "rot_"].iter().any(|start| name.starts_with(start))
    };
    if header.elements[vertices].properties.iter().any(|p| splats(&p.name)) {
        let mut model = read_with(file, strict)?;
        let left_out = model.left_out.take();
        return Ok((Content::Model(Box::new(model)), left_out));
    }
    Cloud::read_with(file, strict).map(|(cloud, left_out)| (Content::Cloud(cloud), left_out))
}

impl Cloud {
    /// Reads positions (`x y z`, any number type), normals (`nx ny nz`) if complete, and colours under their usual
    /// names (`red green blue`, `r g b`, `diffuse_red`, `f_dc_0`, packed `rgb` and more) and ranges (0 to 255, 65535 or
    /// 1, from the declared type and the values). Adds an offset from a comment.
    ///
    /// A few points that are not finite are left out; [`Cloud::read_with`] says which.
    pub fn read(file: &Path) -> Result<Self, Error> {
        Self::read_with(file, false).map(|(cloud, _)| cloud)
    }

    /// Reads a cloud, and the points left out. Points that are not finite are an error where `strict` is set or where
    /// they are more than one in ten.
    pub fn read_with(file: &Path, strict: bool) -> Result<(Self, Option<LeftOut>), Error> {
        let (header, vertices, _) = open(file)?;
        let vertex = &header.elements[vertices];
        let place = Place::find(vertex);
        let named = |p: usize| vertex.properties[p].name.as_str();
        let coloured: Vec<&str> = place.iter().flat_map(Place::properties).map(named).collect();
        let others = [&["nx", "ny", "nz"], coloured.as_slice()].concat();
        let mut tally = Tally::new(strict);
        let mut comments = Model::default();
        read_comments(file, &header, &mut comments)?;
        let mut cloud = Self::default();
        let (mut normals, mut values) = (Some(Vec::new()), Vec::new());
        for_each(file, &["x", "y", "z"], &others, &mut tally, |i, row| {
            let position = [0, 1, 2].map(|k| row[k] + comments.shift[k]);
            if position.iter().any(|v| !v.is_finite()) {
                let problem = "is not finite with the offset of the comment added";
                return Err(Error::malformed(file, format_args!("vertex {i}"), At::Byte(0), problem));
            }
            cloud.positions.push(position);
            values.extend_from_slice(&row[6..]);
            let normal = [3, 4, 5].map(|k| row[k]);
            match &mut normals {
                Some(all) if normal.iter().all(|v| v.is_finite()) => all.push(normal.map(|v| v as f32)),
                _ => normals = None,
            }
            Ok(())
        })?;
        match place.and_then(|place| place.colours(vertex, &values)) {
            Some(colours) => cloud.colours = colours,
            None => {
                let other = vertex.properties.iter().filter(|p| !NO_COLOURS.contains(&p.name.as_str()));
                cloud.unknown = other.map(|p| p.name.clone()).collect();
            }
        }
        cloud.normals = normals.unwrap_or_default();
        let left_out = tally.end(file, "points", cloud.positions.len())?;
        Ok((cloud, left_out))
    }

    /// Writes a binary file with coordinates in double precision.
    pub fn write(&self, file: &Path) -> Result<(), Error> {
        let n = self.positions.len();
        let (with_normals, with_colours) = (!self.normals.is_empty(), !self.colours.is_empty());
        if (with_colours && self.colours.len() != n) || (with_normals && self.normals.len() != n) {
            let problem = format!("{n} positions, {} normals, {} colours", self.normals.len(), self.colours.len());
            return Err(Error::Unwritable { file: file.to_owned(), what: "the points", problem });
        }
        atomic::write(file, |out| {
            let properties =
                |kind: &str, names: [&str; 3]| names.map(|name| format!("property {kind} {name}\n")).concat();
            let normals = if with_normals { properties("float", ["nx", "ny", "nz"]) } else { String::new() };
            let colours = if with_colours { properties("uchar", ["red", "green", "blue"]) } else { String::new() };
            write!(
                out,
                "ply\nformat binary_little_endian 1.0\nelement vertex {n}\n{}{normals}{colours}end_header\n",
                properties("double", ["x", "y", "z"]),
            )?;
            for i in 0..n {
                for v in self.positions[i] {
                    out.write_all(&v.to_le_bytes())?;
                }
                for v in self.normals.get(i).into_iter().flatten() {
                    out.write_all(&v.to_le_bytes())?;
                }
                if let Some(colour) = self.colours.get(i) {
                    out.write_all(colour)?;
                }
            }
            Ok(())
        })
    }
}
