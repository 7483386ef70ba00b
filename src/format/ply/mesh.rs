//! Triangle meshes.

use std::path::Path;

use super::read::open;
use crate::format::{At, Error, atomic};

/// Most corners of a wrong polygon in a message.
const SHOWN: usize = 8;

/// A triangle mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions of the corners.
    pub vertices: Vec<[f64; 3]>,
    /// Indices of each triangle's corners, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Reads the element `vertex` (x, y, z), and after it `face` (the list `vertex_indices` or `vertex_index`).
    /// Polygons become triangle fans.
    pub fn read(file: &Path) -> Result<Self, Error> {
        let (header, vertices, mut rows) = open(file)?;
        let vertex = &header.elements[vertices];
        let missing = |what: &str| {
            let problem = format!("there is no {what}: this is no triangle mesh");
            Error::malformed(file, "header", At::Byte(header.bytes), problem)
        };
        let place = |name: &str| vertex.properties.iter().position(|p| p.name == name).ok_or_else(|| missing(name));
        let places = [place("x")?, place("y")?, place("z")?];
        let faces = header.elements.iter().skip(vertices + 1).position(|e| e.name == "face");
        let faces = vertices + 1 + faces.ok_or_else(|| missing("element 'face' after the vertices"))?;
        let face = &header.elements[faces];
        let indices = |name: &str| matches!(name, "vertex_indices" | "vertex_index");
        let corners = face.properties.iter().position(|p| p.count.is_some() && indices(&p.name));
        let corners = corners.ok_or_else(|| missing("list 'vertex_indices'"))?;

        let mut mesh = Self::default();
        rows.go_to(&header, vertices)?;
        for i in 0..vertex.count {
            let mut position = [0.0; 3];
            rows.row(vertex, i, |p, value| {
                if let Some(axis) = places.iter().position(|at| *at == p) {
                    position[axis] = value;
                }
            })?;
            if position.iter().any(|v| !v.is_finite()) {
                return Err(Error::malformed(file, format_args!("vertex {i}"), rows.place(), "is not finite"));
            }
            mesh.vertices.push(position);
        }
        let mut polygon = Vec::new();
        for between in &header.elements[vertices + 1..faces] {
            rows.pass_over_lists(between)?;
        }
        for i in 0..face.count {
            rows.list_row(face, i, corners, &mut polygon)?;
            let known = |v: f64| v >= 0.0 && v < mesh.vertices.len() as f64;
            if polygon.len() < 3 || !polygon.iter().all(|v| known(*v)) {
                let some = &polygon[..polygon.len().min(SHOWN)];
                let problem = format!("{} numbers, {some:?} first, are not the corners of a polygon", polygon.len());
                return Err(Error::malformed(file, format_args!("face {i}"), rows.place(), problem));
            }
            let fan = polygon.windows(2).skip(1).map(|pair| [polygon[0], pair[0], pair[1]].map(|v| v as u32));
            mesh.triangles.extend(fan);
        }
        Ok(mesh)
    }

    /// Writes a binary file with coordinates in double precision.
    pub fn write(&self, file: &Path) -> Result<(), Error> {
        atomic::write(file, |out| {
            write!(
                out,
                "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\n\
                 property double z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
                self.vertices.len(),
                self.triangles.len()
            )?;
            for v in self.vertices.iter().flatten() {
                out.write_all(&v.to_le_bytes())?;
            }
            for triangle in &self.triangles {
                out.write_all(&[3])?;
                triangle.iter().try_for_each(|k| out.write_all(&k.to_le_bytes()))?;
            }
            Ok(())
        })
    }
}
