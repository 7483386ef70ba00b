//! Reads GLB files: the splats of the first primitive that has some. Nodes must leave the splats where they are.

use std::path::Path;

use serde_json::Value;

use super::super::decoding::{damaged, finished, set_coefficient, splat_count};
use super::super::encoding::MAX_LOGIT;
use super::super::flip::flipped;
use super::super::spz;
use super::{BINARY_CHUNK, EXTENSION, FLOAT, JSON_CHUNK, MAGIC, SPZ, harmonic};
use crate::format::ply::{Model, REST_BY_DEGREE};
use crate::format::{At, Error};
use crate::scene::Gaussians;

/// A model from the bytes of a GLB file. `file` is its name, for messages. A few splats that are not finite are left
/// out; where `strict` is set they are an error.
pub fn decode(file: &Path, bytes: &[u8], strict: bool) -> Result<Model, Error> {
    let (document, buffer) = chunks(file, bytes)?;
    let empty = |of: &Value| of.as_array().is_none_or(Vec::is_empty);
    if empty(&document["meshes"]) {
        return Ok(Model::default());
    }
    check_nodes(file, &document)?;
    let primitives = document["meshes"].as_array().into_iter().flatten();
    let mut primitives = primitives.flat_map(|mesh| mesh["primitives"].as_array().into_iter().flatten());
    let with_splats = primitives.find(|primitive| primitive["extensions"].get(EXTENSION).is_some());
    let primitive = with_splats.ok_or_else(|| {
        let problem = "no primitive has the extension KHR_gaussian_splatting: this file has no splats";
        Error::malformed(file, "meshes", At::Byte(20), problem)
    })?;
    if let Some(packed) = primitive["extensions"][EXTENSION]["extensions"].get(SPZ) {
        let at = packed["bufferView"].as_u64().and_then(|at| usize::try_from(at).ok());
        return spz::decode(file, packed_bytes(file, &document, buffer, at)?, strict);
    }
    let source = Source { file, document: &document, buffer, attributes: &primitive["attributes"] };
    let (g, degree) = source.splats(bytes.len())?;
    finished(file, Model { gaussians: flipped(&g), sh_degree: degree, ..Model::default() }, strict)
}

/// The bytes of a buffer view.
fn packed_bytes<'a>(file: &Path, document: &Value, buffer: &'a [u8], at: Option<usize>) -> Result<&'a [u8], Error> {
    let number = |of: &Value| of.as_u64().and_then(|v| usize::try_from(v).ok());
    let view = at.and_then(|at| document["bufferViews"].get(at));
    let begin = view.map(|view| number(&view["byteOffset"]).unwrap_or(0));
    let bytes = view.and_then(|view| number(&view["byteLength"]));
    let data = begin.zip(bytes).and_then(|(begin, bytes)| buffer.get(begin..)?.get(..bytes));
    data.ok_or_else(|| damaged(file, SPZ, At::Byte(20), "its data is not in the file"))
}

/// The document and the binary data.
fn chunks<'a>(file: &Path, bytes: &'a [u8]) -> Result<(Value, &'a [u8]), Error> {
    let short = |at: usize| damaged(file, "chunk", At::Byte(at as u64), "the file ends here");
    let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    if !bytes.starts_with(&MAGIC) || word(4) != Some(2) {
        let problem = "a binary glTF file begins with 'glTF' and version 2: convert the file to that";
        return Err(Error::malformed(file, "magic", At::Byte(0), problem));
    }
    let chunk = |at: usize, kind: u32| {
        let size = word(at)? as usize;
        let body = bytes.get(at + 8..)?.get(..size)?;
        (word(at + 4) == Some(kind)).then_some(body)
    };
    let text = chunk(12, JSON_CHUNK).ok_or_else(|| short(12))?;
    let document = serde_json::from_slice(text).map_err(|e| damaged(file, "document", At::Byte(20), e))?;
    let at = 20 + text.len();
    let buffer = if bytes.len() > at { chunk(at, BINARY_CHUNK).ok_or_else(|| short(at))? } else { &[] };
    Ok((document, buffer))
}

/// Refuses nodes that move, turn or scale.
fn check_nodes(file: &Path, document: &Value) -> Result<(), Error> {
    let moved =
        |node: &&Value| ["matrix", "rotation", "scale", "translation"].iter().any(|key| node.get(key).is_some());
    match document["nodes"].as_array().into_iter().flatten().find(moved) {
        None => Ok(()),
        Some(_) => {
            let problem = "a node moves, turns or scales its splats, which is not supported: apply its transform first";
            Err(Error::malformed(file, "nodes", At::Byte(20), problem))
        }
    }
}

struct Source<'a> {
    file: &'a Path,
    document: &'a Value,
    buffer: &'a [u8],
    attributes: &'a Value,
}

impl<'a> Source<'a> {
    fn wrong(&self, name: &str, problem: impl std::fmt::Display) -> Error {
        damaged(self.file, name, At::Byte(20), problem)
    }

    /// The accessor of an attribute.
    fn accessor(&self, name: &str) -> Option<&'a Value> {
        let at = usize::try_from(self.attributes.get(name)?.as_u64()?).ok()?;
        self.document["accessors"].get(at)
    }

    /// The f32 of an attribute, `components` for each splat.
    fn floats(&self, name: &str, components: usize, splats: usize) -> Result<Vec<f32>, Error> {
        let accessor = self.accessor(name).ok_or_else(|| self.wrong(name, "the attribute is missing"))?;
        let number = |of: &Value, key: &str| of[key].as_u64().and_then(|v| usize::try_from(v).ok());
        if number(accessor, "componentType") != Some(FLOAT as usize) || number(accessor, "count") != Some(splats) {
            let problem = format!("{splats} rows of f32 are needed; convert the file to uncompressed f32");
            return Err(Error::malformed(self.file, name, At::Byte(20), problem));
        }
        let view = number(accessor, "bufferView").and_then(|at| self.document["bufferViews"].get(at));
        let view = view.ok_or_else(|| self.wrong(name, "it has no buffer view"))?;
        let row = 4 * components;
        let stride = number(view, "byteStride").unwrap_or(row);
        let begin = number(view, "byteOffset").unwrap_or(0).checked_add(number(accessor, "byteOffset").unwrap_or(0));
        let end = splats.saturating_sub(1).checked_mul(stride).and_then(|bytes| bytes.checked_add(row));
        let data = begin.and_then(|begin| self.buffer.get(begin..)).zip(end);
        let data = data.and_then(|(data, end)| data.get(..end)).filter(|_| stride >= row);
        let data = data.ok_or_else(|| self.wrong(name, "its data is not in the file"))?;
        let rows = data.chunks(stride).flat_map(|bytes| bytes[..row].chunks_exact(4));
        Ok(rows.map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
    }

    /// The splats in the axes of the file, and the degree of their harmonics.
    fn splats(&self, bytes: usize) -> Result<(Gaussians, u32), Error> {
        let count = self.accessor("POSITION").and_then(|accessor| accessor["count"].as_u64());
        let n = splat_count(self.file, count.unwrap_or(0), bytes, At::Byte(20))?;
        let named = |name: &str| format!("{EXTENSION}:{name}");
        let degree = (1..=3).take_while(|degree| self.accessor(&harmonic(degree * degree)).is_some()).count();
        let means = self.floats("POSITION", 3, n)?;
        let rotations = self.floats(&named("ROTATION"), 4, n)?;
        let scales = self.floats(&named("SCALE"), 3, n)?;
        let opacities = self.floats(&named("OPACITY"), 1, n)?;
        let mut g = Gaussians::zeros(n);
        g.means = means;
        g.quats = rotations.chunks_exact(4).flat_map(|q| [q[3], q[0], q[1], q[2]]).collect();
        g.normalise_quats();
        let thin = |s: &f32| if *s == 0.0 { f32::MIN_POSITIVE } else { *s }.ln();
        g.scales = scales.iter().map(thin).collect();
        let logit = |o: &f32| (*o / (1.0 - *o)).ln().clamp(-MAX_LOGIT, MAX_LOGIT);
        g.opacities = opacities.iter().map(logit).collect();
        for k in 0..=REST_BY_DEGREE[degree] {
            let values = self.floats(&harmonic(k), 3, n)?;
            for (i, rgb) in values.chunks_exact(3).enumerate() {
                (0..3).for_each(|c| set_coefficient(&mut g, i, k, c, rgb[c]));
            }
        }
        Ok((g, degree as u32))
    }
}
