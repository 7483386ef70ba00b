//! Writes SPZ files.

use std::f64::consts::FRAC_1_SQRT_2;
use std::io::Write;

use rayon::prelude::*;

use super::super::EncodeError;
use super::super::encoding::{alpha_byte, byte, check, coefficient, largest_first, rest, unit_quat};
use super::super::flip::flipped;
use super::{ANTIALIASED, COLOUR, HEADER, MAGIC};
use crate::format::ply::Model;
use crate::scene::Gaussians;

/// Largest step number of a position.
const MOST_STEPS: f64 = 8_388_607.0;
/// Fractional bits of positions: as the reference writer has them where they fit, more for small models.
const USUAL_BITS: u32 = 12;
const MOST_BITS: u32 = 24;
/// Steps between origin and largest coordinate that a file has at least.
const FINE: f64 = 65_536.0;
/// Steps of harmonics of degree 1 and above, in units of the byte. Coarser steps compress better.
const FIRST_STEP: f64 = 2.0;
const LATER_STEP: f64 = 4.0;
/// Levels of compression: close to the smallest size, at a good speed.
const ZSTD_LEVEL: i32 = 12;
const GZIP_LEVEL: u32 = 6;

/// The version of an SPZ file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Version {
    /// Coarse rotations. The only version that tilers of glTF know.
    Two,
    /// Fine rotations.
    Three,
    /// Compressed with zstd.
    #[default]
    Four,
}

impl Version {
    /// The number in the header.
    pub fn number(self) -> u32 {
        match self {
            Self::Two => 2,
            Self::Three => 3,
            Self::Four => 4,
        }
    }
}

/// The bytes of an SPZ file with the splats of a model, with spherical harmonics up to `sh_degree`.
///
/// Positions get as many fractional bits as their largest coordinate leaves, so none is cut off. Values outside of the
/// other ranges are set to their ends. Splats are along Morton's curve, which compresses best.
pub fn encode(model: &Model, sh_degree: u32, version: Version) -> Result<Vec<u8>, EncodeError> {
    check(&model.gaussians)?;
    let degree = sh_degree.min(model.sh_degree).min(3);
    let g = flipped(&model.gaussians.in_morton_order());
    let count =
        u32::try_from(g.len()).map_err(|_| EncodeError::TooMany { splats: g.len(), most: u32::MAX as usize })?;
    let bits = fractional_bits(&g)?;
    let parts = [
        positions(&g, bits),
        g.opacities.par_iter().map(|logit| alpha_byte(*logit)).collect(),
        (0..3 * g.len()).into_par_iter().map(|k| colour(&g, k / 3, k % 3)).collect(),
        g.scales.par_iter().map(|s| byte((f64::from(*s) + 10.0) * 16.0)).collect(),
        rotations(&g, version),
        harmonics(&g, degree),
    ];
    let flags = if model.antialias == Some(true) { ANTIALIASED } else { 0 };
    let mut head = MAGIC.to_vec();
    head.extend(version.number().to_le_bytes());
    head.extend(count.to_le_bytes());
    head.extend([degree as u8, bits as u8, flags]);
    let written = if version == Version::Four { streams(head, &parts) } else { gzip(head, &parts) };
    written.map_err(|e| EncodeError::Encoder(e.to_string()))
}

/// Version 4: a header, a table of sizes, and each part that is not empty as a stream.
fn streams(mut out: Vec<u8>, parts: &[Vec<u8>; 6]) -> std::io::Result<Vec<u8>> {
    let used = parts.par_iter().filter(|part| !part.is_empty());
    let packed = used.map(|part| Ok((zstd::bulk::compress(part, ZSTD_LEVEL)?, part.len())));
    let packed: Vec<(Vec<u8>, usize)> = packed.collect::<std::io::Result<_>>()?;
    out.push(packed.len() as u8);
    out.extend((HEADER as u32).to_le_bytes());
    out.resize(HEADER, 0);
    for (stream, bytes) in &packed {
        out.extend((stream.len() as u64).to_le_bytes());
        out.extend((*bytes as u64).to_le_bytes());
    }
    packed.iter().for_each(|(stream, _)| out.extend(stream));
    Ok(out)
}

/// Earlier versions: one stream of header and parts.
fn gzip(mut head: Vec<u8>, parts: &[Vec<u8>; 6]) -> std::io::Result<Vec<u8>> {
    head.push(0);
    let mut out = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::new(GZIP_LEVEL));
    out.write_all(&head)?;
    parts.iter().try_for_each(|part| out.write_all(part))?;
    out.finish()
}

/// The number of fractional bits with which all coordinates fit.
fn fractional_bits(g: &Gaussians) -> Result<u32, EncodeError> {
    let largest = g.means.iter().fold(0.0, |most: f64, v| most.max(f64::from(v.abs())));
    let steps = |bits: u32| (largest * f64::from(1 << bits)).round();
    let fine = (USUAL_BITS..MOST_BITS).find(|bits| steps(*bits) >= FINE).unwrap_or(MOST_BITS);
    let fitting = (1..=if largest > 0.0 { fine } else { USUAL_BITS }).rev().find(|bits| steps(*bits) <= MOST_STEPS);
    fitting.ok_or_else(|| {
        let at = g.means.iter().position(|v| f64::from(v.abs()) == largest).unwrap_or(0);
        let most = (MOST_STEPS / 2.0) as f32;
        EncodeError::OutOfRange { splat: at / 3, field: "position", value: g.means[at], most }
    })
}

fn positions(g: &Gaussians, bits: u32) -> Vec<u8> {
    let steps = f64::from(1_u32 << bits);
    let fixed = |v: &f32| (f64::from(*v) * steps).round() as i32;
    g.means.par_iter().flat_map_iter(|v| fixed(v).to_le_bytes().into_iter().take(3)).collect()
}

fn colour(g: &Gaussians, i: usize, channel: usize) -> u8 {
    byte(f64::from(coefficient(g, i, 0, channel)) * COLOUR + 127.5)
}

fn rotations(g: &Gaussians, version: Version) -> Vec<u8> {
    let rows = (0..g.len()).into_par_iter().map(|i| {
        // The file's order is x, y, z, w.
        let [w, x, y, z] = unit_quat(g, i);
        [x, y, z, w]
    });
    match version {
        Version::Two => rows.flat_map_iter(first_three).collect(),
        _ => rows.flat_map_iter(|q| smallest_three(q).to_le_bytes()).collect(),
    }
}

/// x, y and z of the quaternion with a positive w.
fn first_three(q: [f64; 4]) -> [u8; 3] {
    let sign = if q[3] < 0.0 { -1.0 } else { 1.0 };
    [0, 1, 2].map(|k| byte(127.5 * sign * q[k] + 127.5))
}

/// Index of the largest component, then sign and magnitude of each other one.
fn smallest_three(q: [f64; 4]) -> u32 {
    let (largest, q) = largest_first(q);
    (0..4).filter(|k| *k != largest).fold(largest as u32, |packed, k| {
        let magnitude = (511.0 * q[k].abs() / FRAC_1_SQRT_2).round().min(511.0) as u32;
        packed << 10 | u32::from(q[k] < 0.0) << 9 | magnitude
    })
}

fn harmonics(g: &Gaussians, degree: u32) -> Vec<u8> {
    let rest = rest(degree);
    let rows = (0..g.len()).into_par_iter();
    rows.flat_map_iter(|i| {
        (1..=rest).flat_map(move |k| {
            let step = if k <= 3 { FIRST_STEP } else { LATER_STEP };
            [0, 1, 2].map(|c| {
                let value = f64::from(coefficient(g, i, k, c)) * 128.0 + 128.0;
                byte((value / step).round() * step)
            })
        })
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(largest: f32) -> Gaussians {
        let mut g = Gaussians::zeros(2);
        g.means[4] = -largest;
        g
    }

    #[test]
    fn fractional_bits_follow_the_largest_coordinate() {
        let bits = |largest: f32| fractional_bits(&at(largest)).expect("fits");
        let found = [0.0, 0.001, 1.0, 16.0, 2047.9, 2048.0, 5e5, 4_194_303.0].map(bits);
        assert_eq!(found, [12, 24, 16, 12, 12, 11, 4, 1]);
        let error = fractional_bits(&at(4_194_304.0)).expect_err("too far").to_string();
        assert!(error.contains("position of splat 1 is -4194304"), "{error}");
    }
}
