//! Writes GLB files.

use serde_json::{Value, json};

use super::super::encoding::{alpha_byte, byte, check, coefficient, rest, unit_quat};
use super::super::flip::flipped;
use super::super::{EncodeError, spz};
use super::{BINARY_CHUNK, BYTE, EXTENSION, FLOAT, JSON_CHUNK, MAGIC, SPZ, harmonic};
use crate::format::ply::Model;
use crate::scene::Gaussians;
use crate::scene::init::SH_C0;

/// Type number of a buffer view of attributes.
const ARRAY_BUFFER: u32 = 34_962;

/// The bytes of a GLB file with the splats of a model, with spherical harmonics up to `sh_degree`.
pub fn encode(model: &Model, sh_degree: u32) -> Result<Vec<u8>, EncodeError> {
    check(&model.gaussians)?;
    let g = flipped(&model.gaussians);
    let attributes = Attributes::of(&g, sh_degree.min(model.sh_degree).min(3));
    let too_many = || {
        let each = attributes.bytes.len() / g.len().max(1);
        EncodeError::TooMany { splats: g.len(), most: u32::MAX as usize / each.max(1) }
    };
    container(&document(&attributes, g.len()), &attributes.bytes).ok_or_else(too_many)
}

/// The bytes of a GLB file whose splats are packed as SPZ, version 2, with the draft extension
/// `KHR_gaussian_splatting_compression_spz_2`: the only form in which Cesium draws splats.
pub fn encode_spz(model: &Model, sh_degree: u32) -> Result<Vec<u8>, EncodeError> {
    let degree = sh_degree.min(model.sh_degree).min(3);
    if model.gaussians.is_empty() {
        return encode(model, degree);
    }
    let packed = spz::encode(model, degree, spz::Version::Two)?;
    let n = model.gaussians.len();
    let g = flipped(&model.gaussians);
    let mut attributes = serde_json::Map::new();
    let mut accessors = Vec::new();
    let mut add = |name: String, accessor: Value| {
        attributes.insert(name, json!(accessors.len()));
        accessors.push(accessor);
    };
    // Accessors without data tell what unpacking gives.
    let floats = |kind: &str| json!({"componentType": FLOAT, "count": n, "type": kind});
    let [low, high] = bounds(&g);
    add("POSITION".to_owned(), json!({"componentType": FLOAT, "count": n, "type": "VEC3", "min": low, "max": high}));
    add("COLOR_0".to_owned(), json!({"componentType": BYTE, "normalized": true, "count": n, "type": "VEC4"}));
    add(format!("{EXTENSION}:ROTATION"), floats("VEC4"));
    add(format!("{EXTENSION}:SCALE"), floats("VEC3"));
    (1..=rest(degree)).for_each(|k| add(harmonic(k), floats("VEC3")));
    let mut splatting = splatting();
    splatting["extensions"] = json!({SPZ: {"bufferView": 0}});
    let document = json!({
        "asset": asset(),
        "extensionsUsed": [EXTENSION, SPZ],
        "extensionsRequired": [EXTENSION, SPZ],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "buffers": [{"byteLength": packed.len()}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": packed.len()}],
        "accessors": accessors,
        "meshes": [{"primitives": [{"mode": 0, "attributes": attributes, "extensions": {EXTENSION: splatting}}]}],
    });
    container(&document, &packed).ok_or(EncodeError::TooMany { splats: n, most: u32::MAX as usize / 64 })
}

/// A binary file of a document and its buffer; `None` where the file would be too large.
fn container(document: &Value, buffer: &[u8]) -> Option<Vec<u8>> {
    let text = document.to_string();
    // Chunks are multiples of four bytes: spaces follow the text, zeros the buffer.
    let text = format!("{text:<width$}", width = text.len().next_multiple_of(4));
    let padded = buffer.len().next_multiple_of(4);
    let total = 12 + 8 + text.len() + if buffer.is_empty() { 0 } else { 8 + padded };
    let size = u32::try_from(total).ok()?;
    let mut out = Vec::with_capacity(total);
    out.extend(MAGIC);
    [2, size, text.len() as u32, JSON_CHUNK].iter().for_each(|word| out.extend(word.to_le_bytes()));
    out.extend(text.as_bytes());
    if !buffer.is_empty() {
        [padded as u32, BINARY_CHUNK].iter().for_each(|word| out.extend(word.to_le_bytes()));
        out.extend(buffer);
        out.resize(total, 0);
    }
    Some(out)
}

/// Least and largest coordinates.
fn bounds(g: &Gaussians) -> [Value; 2] {
    [f32::min as fn(f32, f32) -> f32, f32::max].map(|pick| {
        let of = |k: usize| g.means.iter().skip(k).step_by(3).copied().reduce(pick);
        json!([of(0), of(1), of(2)])
    })
}

fn asset() -> Value {
    json!({"version": "2.0", "generator": concat!("psrgs-vk ", env!("CARGO_PKG_VERSION"))})
}

/// What the extension says of a primitive.
fn splatting() -> Value {
    json!({
        "kernel": "ellipse",
        "colorSpace": "srgb_rec709_display",
        "projection": "perspective",
        "sortingMethod": "cameraDistance",
    })
}

/// The attributes of the points, one after the other in a buffer.
#[derive(Default)]
struct Attributes {
    names: Vec<String>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    bytes: Vec<u8>,
}

impl Attributes {
    fn of(g: &Gaussians, degree: u32) -> Self {
        let mut out = Self::default();
        if g.is_empty() {
            return out;
        }
        let n = g.len();
        out.floats("POSITION".to_owned(), 3, &g.means);
        let [low, high] = bounds(g);
        (out.accessors[0]["min"], out.accessors[0]["max"]) = (low, high);
        let shown = |i: usize, c: usize| byte(255.0 * (0.5 + SH_C0 * f64::from(coefficient(g, i, 0, c))));
        let colours: Vec<u8> =
            (0..n).flat_map(|i| [shown(i, 0), shown(i, 1), shown(i, 2), alpha_byte(g.opacities[i])]).collect();
        out.add("COLOR_0".to_owned(), json!({"componentType": BYTE, "normalized": true, "type": "VEC4"}), n, &colours);
        let named = |name: &str| format!("{EXTENSION}:{name}");
        let turned = |i: usize| {
            let [w, x, y, z] = unit_quat(g, i);
            [x, y, z, w].map(|v| v as f32)
        };
        out.floats(named("ROTATION"), 4, &(0..n).flat_map(turned).collect::<Vec<_>>());
        // A width of infinity is no number in the sense of the format.
        let scales: Vec<f32> = g.scales.iter().map(|s| s.exp().min(f32::MAX)).collect();
        out.floats(named("SCALE"), 3, &scales);
        let opacity = |logit: &f32| (1.0 / (1.0 + (-f64::from(*logit)).exp())) as f32;
        out.floats(named("OPACITY"), 1, &g.opacities.iter().map(opacity).collect::<Vec<_>>());
        for k in 0..=rest(degree) {
            let values: Vec<f32> = (0..3 * n).map(|at| coefficient(g, at / 3, k, at % 3)).collect();
            out.floats(harmonic(k), 3, &values);
        }
        out
    }

    fn floats(&mut self, name: String, components: usize, values: &[f32]) {
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][components - 1];
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.add(name, json!({"componentType": FLOAT, "type": kind}), values.len() / components, &bytes);
    }

    fn add(&mut self, name: String, mut accessor: Value, count: usize, bytes: &[u8]) {
        accessor["bufferView"] = json!(self.views.len());
        accessor["count"] = json!(count);
        self.accessors.push(accessor);
        let view = json!({
            "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len(), "target": ARRAY_BUFFER,
        });
        self.views.push(view);
        self.names.push(name);
        self.bytes.extend(bytes);
    }
}

/// The JSON part of the file.
fn document(attributes: &Attributes, splats: usize) -> Value {
    let asset = asset();
    if splats == 0 {
        // Accessors have at least one element.
        return json!({"asset": asset, "scene": 0, "scenes": [{}]});
    }
    let named = attributes.names.iter().enumerate().map(|(at, name)| (name.clone(), json!(at)));
    let named: serde_json::Map<String, Value> = named.collect();
    json!({
        "asset": asset,
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "buffers": [{"byteLength": attributes.bytes.len()}],
        "bufferViews": attributes.views,
        "accessors": attributes.accessors,
        "meshes": [{"primitives": [{
            "mode": 0,
            "attributes": named,
            "extensions": {EXTENSION: splatting()},
        }]}],
    })
}
