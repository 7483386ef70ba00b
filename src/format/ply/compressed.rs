//! SuperSplat's compressed layout: 16 bytes a splat, and one byte for each spherical harmonic.
//!
//! The element `chunk` has least and largest values of 256 splats; positions and scales are 11, 10 and 11 bits of the
//! range of their chunk, colours 8 bits, rotations two bits for the largest component and 10 bits for each other one.
//! Harmonics are steps of 1/32 from -4 to 4 in the element `sh`.

use std::f64::consts::SQRT_2;
use std::path::Path;

use super::header::{Element, Header};
use super::read::{Rows, read_comments};
use super::write::comments;
use super::{Model, REST_BY_DEGREE};
use crate::format::splats::EncodeError;
use crate::format::splats::decoding::{finished, set_coefficient, with_largest};
use crate::format::splats::encoding::{alpha_byte, check, coefficient, largest_first, logit_of_alpha, unit_quat};
use crate::format::{At, Error};
use crate::scene::Gaussians;
use crate::scene::init::SH_C0;

/// Splats of a chunk.
const CHUNK: usize = 256;
/// Largest logarithm of a scale.
const MOST_SCALE: f32 = 20.0;
/// Range of a harmonic, and steps in it.
const SH_RANGE: f64 = 8.0;
const SH_STEPS: f64 = 256.0;
/// Values of a chunk.
const BOUNDS: [&str; 18] = [
    "min_x",
    "min_y",
    "min_z",
    "max_x",
    "max_y",
    "max_z",
    "min_scale_x",
    "min_scale_y",
    "min_scale_z",
    "max_scale_x",
    "max_scale_y",
    "max_scale_z",
    "min_r",
    "min_g",
    "min_b",
    "max_r",
    "max_g",
    "max_b",
];
/// Bounds without those of colours, which early files do not have: there colours are from 0 to 1.
const EARLY_BOUNDS: usize = 12;
const PACKED: [&str; 4] = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];

/// The bytes of a compressed PLY file with the splats of a model, with spherical harmonics up to `sh_degree`. Splats
/// are along Morton's curve, so those of a chunk are close to each other.
pub fn encode_compressed(model: &Model, sh_degree: u32) -> Result<Vec<u8>, EncodeError> {
    check(&model.gaussians)?;
    let g = model.gaussians.in_morton_order();
    let rest = REST_BY_DEGREE[sh_degree.min(model.sh_degree).min(3) as usize];
    let mut out = header(model, g.len(), rest).into_bytes();
    let begins: Vec<usize> = (0..g.len()).step_by(CHUNK).collect();
    let chunks: Vec<Chunk> = begins.iter().map(|begin| Chunk::of(&g, *begin)).collect();
    chunks.iter().flat_map(Chunk::bounds).for_each(|v| out.extend(v.to_le_bytes()));
    for i in 0..g.len() {
        chunks[i / CHUNK].packed(&g, i).iter().for_each(|word| out.extend(word.to_le_bytes()));
    }
    for i in 0..g.len() {
        for at in 0..3 * rest {
            let value = f64::from(coefficient(&g, i, 1 + at % rest, at / rest));
            out.push(((value / SH_RANGE + 0.5) * SH_STEPS).floor().clamp(0.0, SH_STEPS - 1.0) as u8);
        }
    }
    Ok(out)
}

fn header(model: &Model, splats: usize, rest: usize) -> String {
    let mut out = format!("ply\nformat binary_little_endian 1.0\n{}", comments(model, None));
    out += &format!("element chunk {}\n", splats.div_ceil(CHUNK));
    BOUNDS.iter().for_each(|name| out += &format!("property float {name}\n"));
    out += &format!("element vertex {splats}\n");
    PACKED.iter().for_each(|name| out += &format!("property uint {name}\n"));
    if rest > 0 {
        out += &format!("element sh {splats}\n");
        (0..3 * rest).for_each(|k| out += &format!("property uchar f_rest_{k}\n"));
    }
    out + "end_header\n"
}

/// Least and largest values of positions, scales and colours.
#[derive(Clone, Copy)]
struct Chunk {
    low: [[f32; 3]; 3],
    high: [[f32; 3]; 3],
}

/// Position, scale and colour of a splat.
fn values(g: &Gaussians, i: usize) -> [[f32; 3]; 3] {
    let scale = |k: usize| g.scales[3 * i + k].clamp(-MOST_SCALE, MOST_SCALE);
    let colour = |c: usize| (f64::from(coefficient(g, i, 0, c)) * SH_C0 + 0.5) as f32;
    [[0, 1, 2].map(|k| g.means[3 * i + k]), [0, 1, 2].map(scale), [0, 1, 2].map(colour)]
}

impl Chunk {
    fn of(g: &Gaussians, begin: usize) -> Self {
        let first = values(g, begin);
        (begin + 1..g.len().min(begin + CHUNK)).fold(Self { low: first, high: first }, |mut bounds, i| {
            let values = values(g, i);
            for (of, k) in (0..3).flat_map(|of| (0..3).map(move |k| (of, k))) {
                bounds.low[of][k] = bounds.low[of][k].min(values[of][k]);
                bounds.high[of][k] = bounds.high[of][k].max(values[of][k]);
            }
            bounds
        })
    }

    /// The bounds in the order of the file.
    fn bounds(&self) -> impl Iterator<Item = f32> {
        (0..3).flat_map(|of| self.low[of].into_iter().chain(self.high[of]))
    }

    fn from_bounds(bounds: &[f32; 18]) -> Self {
        let of = |first: usize| [0, 6, 12].map(|at| [0, 1, 2].map(|k| bounds[at + first + k]));
        Self { low: of(0), high: of(3) }
    }

    /// The four words of a splat.
    fn packed(&self, g: &Gaussians, i: usize) -> [u32; 4] {
        let values = values(g, i);
        let step = |of: usize, k: usize, bits: u32| {
            let (low, high) = (f64::from(self.low[of][k]), f64::from(self.high[of][k]));
            let share = if high > low { (f64::from(values[of][k]) - low) / (high - low) } else { 0.0 };
            steps(share, bits)
        };
        let fine = |of: usize| step(of, 0, 11) << 21 | step(of, 1, 10) << 11 | step(of, 2, 11);
        let colour = step(2, 0, 8) << 24 | step(2, 1, 8) << 16 | step(2, 2, 8) << 8;
        let (largest, q) = largest_first(unit_quat(g, i));
        let others = (0..4).filter(|k| *k != largest);
        let rotation = others.fold(largest as u32, |packed, k| packed << 10 | steps(q[k] * SQRT_2 * 0.5 + 0.5, 10));
        [fine(0), rotation, fine(1), colour | u32::from(alpha_byte(g.opacities[i]))]
    }

    /// Sets position, rotation, scale, colour and opacity of a splat.
    fn unpack(&self, g: &mut Gaussians, i: usize, [position, rotation, scale, colour]: [u32; 4]) {
        let value = |of: usize, k: usize, word: u32, from: u32, bits: u32| {
            let share = share(word >> from, bits);
            (f64::from(self.low[of][k]) * (1.0 - share) + f64::from(self.high[of][k]) * share) as f32
        };
        let fine =
            |of: usize, word: u32| [value(of, 0, word, 21, 11), value(of, 1, word, 11, 10), value(of, 2, word, 0, 11)];
        g.means[3 * i..3 * i + 3].copy_from_slice(&fine(0, position));
        g.scales[3 * i..3 * i + 3].copy_from_slice(&fine(1, scale));
        for c in 0..3 {
            let shown = value(2, c, colour, 24 - 8 * c as u32, 8);
            set_coefficient(g, i, 0, c, ((f64::from(shown) - 0.5) / SH_C0) as f32);
        }
        g.opacities[i] = logit_of_alpha(colour as u8);
        let smaller = [20, 10, 0].map(|from| ((share(rotation >> from, 10) - 0.5) * SQRT_2) as f32);
        g.quats[4 * i..4 * i + 4].copy_from_slice(&with_largest((rotation >> 30) as usize, smaller));
    }
}

/// A share from 0 to 1 as a number of so many bits.
fn steps(share: f64, bits: u32) -> u32 {
    let most = f64::from((1_u32 << bits) - 1);
    (share * most).round().clamp(0.0, most) as u32
}

/// The share that the lowest bits of a word stand for.
fn share(word: u32, bits: u32) -> f64 {
    let most = (1_u32 << bits) - 1;
    f64::from(word & most) / f64::from(most)
}

/// Whether vertices are in this layout.
pub(super) fn is_compressed(vertex: &Element) -> bool {
    vertex.properties.iter().any(|p| p.name == PACKED[0])
}

/// Reads a compressed file after its header.
pub(super) fn read(file: &Path, header: &Header, rows: &mut Rows<'_>, strict: bool) -> Result<Model, Error> {
    let element = |name: &str| header.elements.iter().position(|e| e.name == name);
    let need = |name: &str| {
        let problem = format!("there is no element '{name}', which the compressed layout has");
        element(name).ok_or_else(|| Error::malformed(file, "header", At::Byte(0), problem))
    };
    let (chunk_at, vertex_at) = (need("chunk")?, need("vertex")?);
    let (chunk, vertex) = (&header.elements[chunk_at], &header.elements[vertex_at]);
    let early = !chunk.properties.iter().any(|p| p.name == BOUNDS[EARLY_BOUNDS]);
    let known = if early { EARLY_BOUNDS } else { BOUNDS.len() };
    let (bounds_at, packed_at) = (places(file, chunk, &BOUNDS[..known])?, places(file, vertex, &PACKED)?);
    let fail = |problem: &str| Error::malformed(file, "element chunk", At::Byte(chunk.at), problem);
    if chunk_at > vertex_at || vertex.count.div_ceil(CHUNK as u64) != chunk.count {
        return Err(fail("a chunk for each 256 vertices must come before them"));
    }
    rows.go_to(header, chunk_at)?;
    let chunks = (0..chunk.count).map(|i| {
        // Colours from 0 to 1 where the file does not say.
        let mut bounds = [0.0_f32; 18];
        bounds[15..].fill(1.0);
        rows.row(chunk, i, |p, v| {
            if let Some(at) = bounds_at[p] {
                bounds[at] = v as f32;
            }
        })?;
        Ok(Chunk::from_bounds(&bounds))
    });
    let chunks: Vec<Chunk> = chunks.collect::<Result<_, Error>>()?;
    rows.skip(header, chunk_at + 1..vertex_at)?;
    let n = u32::try_from(vertex.count).map_err(|_| fail("there are more vertices than can be numbered"))? as usize;
    let mut g = Gaussians::zeros(n);
    for i in 0..n {
        let mut words = [0; 4];
        rows.row(vertex, i as u64, |p, v| {
            if let Some(at) = packed_at[p] {
                words[at] = v as u32;
            }
        })?;
        chunks[i / CHUNK].unpack(&mut g, i, words);
    }
    let sh_degree = match element("sh").filter(|at| *at > vertex_at) {
        Some(at) => {
            rows.skip(header, vertex_at + 1..at)?;
            harmonics(file, &header.elements[at], rows, &mut g)?
        }
        None => 0,
    };
    let mut model = Model { gaussians: g, sh_degree, ..Model::default() };
    read_comments(file, header, &mut model)?;
    finished(file, model, strict)
}

/// For each property its place among `names`; each name must be there.
fn places(file: &Path, element: &Element, names: &[&str]) -> Result<Vec<Option<usize>>, Error> {
    if let Some(missing) = names.iter().find(|name| !element.properties.iter().any(|p| p.name == **name)) {
        let problem = format!("the property '{missing}' is missing");
        return Err(Error::malformed(file, format_args!("element {}", element.name), At::Byte(element.at), problem));
    }
    Ok(element.properties.iter().map(|p| names.iter().position(|name| p.name == *name)).collect())
}

/// Reads the harmonics of all splats; the result is their degree.
fn harmonics(file: &Path, sh: &Element, rows: &mut Rows<'_>, g: &mut Gaussians) -> Result<u32, Error> {
    let fail = |problem: String| Error::malformed(file, "element sh", At::Byte(sh.at), problem);
    let count = sh.properties.len();
    let Some(degree) = REST_BY_DEGREE.iter().position(|n| 3 * n == count && count > 0) else {
        return Err(fail(format!("{count} properties are not those of a degree from 1 to 3")));
    };
    if sh.count != g.len() as u64 {
        return Err(fail(format!("{} rows for {} splats", sh.count, g.len())));
    }
    let names: Vec<String> = (0..count).map(|k| format!("f_rest_{k}")).collect();
    let places = places(file, sh, &names.iter().map(String::as_str).collect::<Vec<_>>())?;
    rows.check_fits(sh)?;
    let rest = REST_BY_DEGREE[degree];
    for i in 0..g.len() {
        rows.row(sh, i as u64, |p, v| {
            if let Some(at) = places[p] {
                // The middle of the step; the outermost steps stand for the ends.
                let share = if v <= 0.0 { 0.0 } else { ((v + 0.5) / SH_STEPS).min(1.0) };
                let share = if v >= SH_STEPS - 1.0 { 1.0 } else { share };
                set_coefficient(g, i, 1 + at % rest, at / rest, (SH_RANGE * (share - 0.5)) as f32);
            }
        })?;
    }
    Ok(degree as u32)
}
