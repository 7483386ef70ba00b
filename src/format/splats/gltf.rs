//! glTF with `KHR_gaussian_splatting`, as one binary file (GLB): a primitive of points whose attributes are f32.
//!
//! Rotations are unit quaternions x, y, z, w; scales and opacities are not logarithms and logits; spherical harmonics
//! are as in a model. `COLOR_0` shows points of the right colour to programs without the extension. y is up in glTF:
//! y and z of models are negated.

mod read;
mod write;

pub use read::decode;
pub use write::{encode, encode_spz};

/// Beginning of the names of the extension's attributes.
const EXTENSION: &str = "KHR_gaussian_splatting";
/// Name of the draft extension for splats packed as SPZ, version 2.
const SPZ: &str = "KHR_gaussian_splatting_compression_spz_2";
/// First bytes of a binary file, and the types of its two chunks.
pub(super) const MAGIC: [u8; 4] = *b"glTF";
const JSON_CHUNK: u32 = 0x4e4f_534a;
const BINARY_CHUNK: u32 = 0x004e_4942;
/// The type numbers of f32 and of unsigned bytes.
const FLOAT: u32 = 5126;
const BYTE: u32 = 5121;

/// Name of the attribute of coefficient `k` from 0, the constant one, on.
fn harmonic(k: usize) -> String {
    let degree = [1, 4, 9].iter().filter(|first| k >= **first).count();
    format!("{EXTENSION}:SH_DEGREE_{degree}_COEF_{}", k - degree * degree)
}
