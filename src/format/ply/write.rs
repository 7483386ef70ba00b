//! Writes models.

use std::io::{self, Write};
use std::path::Path;

use super::{Model, REST_BY_DEGREE};
use crate::format::{Error, atomic};
use crate::scene::{Gaussians, SH_GROUP_FLOATS};

/// Writes the model's splats unchanged, always with spherical harmonics of degree 3 like INRIA's own files.
pub fn write(file: &Path, model: &Model) -> Result<(), Error> {
    write_degree(file, model, 3)
}

/// [`write()`] with spherical harmonics up to a degree only.
pub fn write_degree(file: &Path, model: &Model, sh_degree: u32) -> Result<(), Error> {
    let gaussians = &model.gaussians;
    if let Some(problem) = inconsistent(gaussians) {
        return Err(Error::Unwritable { file: file.to_owned(), what: "the splats", problem });
    }
    let rest = REST_BY_DEGREE[sh_degree.min(3) as usize];
    atomic::write(file, |out| {
        out.write_all(header(model, gaussians.len() as u64, rest).as_bytes())?;
        (0..gaussians.len()).try_for_each(|i| vertex(out, gaussians, i, rest))
    })
}

/// Why planes differ in their number of splats; `None` where they agree.
pub(in crate::format) fn inconsistent(g: &Gaussians) -> Option<String> {
    let n = g.len();
    let planes = [("means", &g.means, 3), ("quats", &g.quats, 4), ("scales", &g.scales, 3)];
    let sh = g.sh.iter().map(|plane| ("sh", plane, SH_GROUP_FLOATS));
    planes
        .into_iter()
        .chain(sh)
        .find(|(_, plane, floats)| plane.len() != floats * n)
        .map(|(name, plane, floats)| format!("'{name}' has {} floats for {n} splats of {floats}", plane.len()))
}

/// Property names in the order of the layout.
pub(super) fn properties(rest: usize) -> Vec<String> {
    let numbered = |name: &'static str, n: usize| (0..n).map(move |i| format!("{name}_{i}"));
    ["x", "y", "z", "nx", "ny", "nz"]
        .map(str::to_owned)
        .into_iter()
        .chain(numbered("f_dc", 3))
        .chain(numbered("f_rest", 3 * rest))
        .chain(["opacity".to_owned()])
        .chain(numbered("scale", 3))
        .chain(numbered("rot", 4))
        .collect()
}

/// The header of a file with `count` splats.
pub(super) fn header(model: &Model, count: u64, rest: usize) -> String {
    let mut out = String::from("ply\nformat binary_little_endian 1.0\n") + &comments(model, model.constrained);
    out.push_str(&format!("element vertex {count}\n"));
    for name in properties(rest) {
        out.push_str(&format!("property float {name}\n"));
    }
    out + "end_header\n"
}

/// The comments on a model of which the first `constrained` splats in the file are a set of their own.
pub(super) fn comments(model: &Model, constrained: Option<usize>) -> String {
    let mut out = String::new();
    if let Some(antialias) = model.antialias {
        out.push_str(&format!("comment SplatRenderMode: {}\n", if antialias { "mip" } else { "default" }));
    }
    let mut comment = |key: &str, value: String| out.push_str(&format!("comment psrgs-vk {key} {value}\n"));
    if let Some(version) = &model.version {
        comment("version", version.clone());
    }
    if let Some(constrained) = constrained {
        comment("constrained", constrained.to_string());
    }
    if model.shift != [0.0; 3] {
        // The shortest decimals from which the same f64 is read.
        comment("offset", model.shift.map(|v| v.to_string()).join(" "));
    }
    out
}

fn vertex(out: &mut dyn Write, g: &Gaussians, i: usize, rest: usize) -> io::Result<()> {
    let mut row = [0_f32; 62];
    row[..3].copy_from_slice(&g.means[3 * i..][..3]);
    row[6..9].copy_from_slice(&g.sh[0][SH_GROUP_FLOATS * i..][..3]);
    for k in 1..=rest {
        for c in 0..3 {
            row[9 + c * rest + k - 1] = g.sh[k / 4][SH_GROUP_FLOATS * i + 3 * (k % 4) + c];
        }
    }
    let after = 9 + 3 * rest;
    row[after] = g.opacities[i];
    row[after + 1..after + 4].copy_from_slice(&g.scales[3 * i..][..3]);
    row[after + 4..after + 8].copy_from_slice(&g.quats[4 * i..][..4]);
    let mut bytes = [0; 4 * 62];
    for (to, value) in bytes.chunks_exact_mut(4).zip(row) {
        to.copy_from_slice(&value.to_le_bytes());
    }
    out.write_all(&bytes[..4 * (after + 8)])
}
