//! `.splat`: 32 bytes a splat and nothing else. Position and scale are three f32 each, then red, green, blue and
//! opacity as bytes, then w, x, y, z of the rotation as `128 q + 128`. Spherical harmonics beyond colours have no place.

use std::path::Path;

use super::EncodeError;
use super::decoding::{damaged, finished, set_coefficient};
use super::encoding::{alpha_byte, byte, check, coefficient, logit_of_alpha, unit_quat};
use crate::format::ply::Model;
use crate::format::{At, Error};
use crate::scene::Gaussians;
use crate::scene::init::SH_C0;

/// Bytes of a splat.
pub(crate) const BYTES: usize = 32;

/// The bytes of a `.splat` file. Large and opaque splats come first, because viewers show what has arrived so far.
pub fn encode(model: &Model) -> Result<Vec<u8>, EncodeError> {
    let g = &model.gaussians;
    check(g)?;
    let mut order: Vec<(f64, usize)> = (0..g.len()).map(|i| (-weight(g, i), i)).collect();
    order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut out = Vec::with_capacity(BYTES * g.len());
    for (_, i) in order {
        let floats = g.means[3 * i..3 * i + 3].iter().copied();
        let scales = g.scales[3 * i..3 * i + 3].iter().map(|s| s.exp().clamp(f32::MIN_POSITIVE, f32::MAX));
        floats.chain(scales).for_each(|v| out.extend(v.to_le_bytes()));
        out.extend([0, 1, 2].map(|c| byte(255.0 * (0.5 + SH_C0 * f64::from(coefficient(g, i, 0, c))))));
        out.push(alpha_byte(g.opacities[i]));
        out.extend(unit_quat(g, i).map(|q| byte(128.0 * q + 128.0)));
    }
    Ok(out)
}

/// Volume times opacity.
fn weight(g: &Gaussians, i: usize) -> f64 {
    let volume: f64 = g.scales[3 * i..3 * i + 3].iter().map(|s| f64::from(*s)).sum();
    volume.exp() / (1.0 + (-f64::from(g.opacities[i])).exp())
}

/// A model from the bytes of a `.splat` file. `file` is its name, for messages. A few splats that are not finite are
/// left out; where `strict` is set they are an error.
pub fn decode(file: &Path, bytes: &[u8], strict: bool) -> Result<Model, Error> {
    if !bytes.len().is_multiple_of(BYTES) {
        let problem = format!("{} bytes are no whole number of splats of {BYTES}", bytes.len());
        return Err(damaged(file, "length", At::Byte((bytes.len() / BYTES * BYTES) as u64), problem));
    }
    let mut g = Gaussians::zeros(bytes.len() / BYTES);
    for (i, splat) in bytes.chunks_exact(BYTES).enumerate() {
        let float = |k: usize| f32::from_le_bytes([0, 1, 2, 3].map(|b| splat[4 * k + b]));
        for k in 0..3 {
            g.means[3 * i + k] = float(k);
            // Zero has no logarithm; the smallest number is as thin. A negative width is not a number.
            let width = float(3 + k);
            g.scales[3 * i + k] = if width == 0.0 { f32::MIN_POSITIVE } else { width }.ln();
            let colour = (f64::from(splat[24 + k]) / 255.0 - 0.5) / SH_C0;
            set_coefficient(&mut g, i, 0, k, colour as f32);
        }
        g.opacities[i] = logit_of_alpha(splat[27]);
        (0..4).for_each(|k| g.quats[4 * i + k] = (f32::from(splat[28 + k]) - 128.0) / 128.0);
    }
    g.normalise_quats();
    finished(file, Model { gaussians: g, ..Model::default() }, strict)
}
