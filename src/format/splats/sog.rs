//! SOG, version 2: `meta.json` and lossless WebP pictures of one pixel per splat, in a zip archive or in a folder.
//!
//! | picture | red, green, blue | alpha |
//! |---|---|---|
//! | `means_l`, `means_u` | low and high bytes of 16-bit steps of `sign(x) ln(abs(x) + 1)` between `mins` and `maxs` | 255 |
//! | `quats` | the three smaller components times the root of 2, from -1 to 1 | 252 + index of the largest of w, x, y, z |
//! | `scales` | indices of a codebook of logarithms | 255 |
//! | `sh0` | indices of a codebook of coefficients | opacity |
//! | `shN_labels` | low and high bytes of the number in the palette | 255 |
//! | `shN_centroids` | the palette, 64 entries a row, one pixel per coefficient: indices of a codebook | 255 |
//!
//! Splats are along Morton's curve, so pictures compress well. Step of a position x: `(abs(x) + 1) (max - min) / 65535`.
//! `meta.json` also has `antialias`, and `asset.offset`, this program's own key: positions plus it are dataset
//! coordinates.

mod read;
mod write;

pub use read::{decode, read_unpacked};
pub use write::{encode, files};

use serde::{Deserialize, Serialize};

/// The file that tells of the pictures.
pub(super) const META: &str = "meta.json";
/// Most pixels on a side of a WebP picture.
const MOST_SIDE: usize = 16_384;
/// Palette entries in a row of `shN_centroids`.
const PALETTE_ROW: usize = 64;

/// The content of `meta.json`.
#[derive(Debug, Serialize, Deserialize)]
struct Meta {
    version: u32,
    #[serde(default)]
    asset: Asset,
    count: u64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    antialias: Option<bool>,
    means: Means,
    scales: Coded,
    quats: Files<1>,
    sh0: Coded,
    #[serde(default, rename = "shN", skip_serializing_if = "Option::is_none")]
    sh_rest: Option<Palette>,
}

#[derive(Debug, Default, Serialize, Deserialize)]
struct Asset {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    generator: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    offset: Option<[f64; 3]>,
}

#[derive(Debug, Serialize, Deserialize)]
struct Means {
    mins: [f64; 3],
    maxs: [f64; 3],
    #[serde(flatten)]
    pictures: Files<2>,
}

#[derive(Debug, Serialize, Deserialize)]
struct Coded {
    codebook: Vec<f32>,
    #[serde(flatten)]
    pictures: Files<1>,
}

#[derive(Debug, Serialize, Deserialize)]
struct Palette {
    count: u64,
    bands: u32,
    codebook: Vec<f32>,
    #[serde(flatten)]
    pictures: Files<2>,
}

#[derive(Debug, Serialize, Deserialize)]
struct Files<const N: usize>
where
    [String; N]: Serialize + for<'a> Deserialize<'a>,
{
    files: [String; N],
}

/// Width and height of a picture with a pixel per splat: multiples of 4, nearly square.
fn picture_size(splats: usize) -> (usize, usize) {
    let width = ((splats as f64).sqrt() / 4.0).ceil() as usize * 4;
    let width = width.max(4);
    (width, splats.div_ceil(width).div_ceil(4).max(1) * 4)
}
