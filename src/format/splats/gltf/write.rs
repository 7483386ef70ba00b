//! Writes GLB files.

use serde_json::{Value, json};

use super::super::EncodeError;
use super::super::encoding::{alpha_byte, byte, check, coefficient, rest, unit_quat};
use super::super::flip::flipped;
use super::{BINARY_CHUNK, BYTE, EXTENSION, FLOAT, JSON_CHUNK, MAGIC, harmonic};
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
    let text = document(&attributes, g.len()).to_string();
    // Chunks are multiples of four bytes: spaces after the text; attributes of four bytes end at such a place.
    let text = format!("{text:<width$}", width = text.len().next_multiple_of(4));
    let total = 12 + 8 + text.len() + if attributes.bytes.is_empty() { 0 } else { 8 + attributes.bytes.len() };
    let (Ok(size), true) = (u32::try_from(total), attributes.bytes.len().is_multiple_of(4)) else {
        let each = attributes.bytes.len() / g.len().max(1);
        return Err(EncodeError::TooMany { splats: g.len(), most: u32::MAX as usize / each.max(1) });
    };
    let mut out = Vec::with_capacity(total);
    out.extend(MAGIC);
    [2, size, text.len() as u32, JSON_CHUNK].iter().for_each(|word| out.extend(word.to_le_bytes()));
    out.extend(text.as_bytes());
    if !attributes.bytes.is_empty() {
        [attributes.bytes.len() as u32, BINARY_CHUNK].iter().for_each(|word| out.extend(word.to_le_bytes()));
        out.extend(attributes.bytes);
    }
    Ok(out)
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
        let bound = |pick: fn(f32, f32) -> f32| {
            let of = |k: usize| g.means.iter().skip(k).step_by(3).copied().reduce(pick);
            json!([of(0), of(1), of(2)])
        };
        out.accessors[0]["min"] = bound(f32::min);
        out.accessors[0]["max"] = bound(f32::max);
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
    let asset = json!({"version": "2.0", "generator": concat!("psrgs-vk ", env!("CARGO_PKG_VERSION"))});
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
            "extensions": {EXTENSION: {
                "kernel": "ellipse",
                "colorSpace": "srgb_rec709_display",
                "projection": "perspective",
                "sortingMethod": "cameraDistance",
            }},
        }]}],
    })
}
