//! What the readers share: sizes that a file may claim, and the end of reading.

use std::fmt::Display;
use std::path::Path;

use crate::format::ply::Model;
use crate::format::{At, Error, Tally};
use crate::scene::Gaussians;

/// Splats that a file of any size may have, and splats per byte beyond. Files have 6 to 60 bytes a splat; a file that
/// claims thousands of splats in a byte is damaged, or was made to fill the memory.
const FREE: u64 = 4096;
const PER_BYTE: u64 = 2;

/// The number of splats that a file of `bytes` bytes claims, if the file may have as many.
pub(in crate::format) fn splat_count(file: &Path, claimed: u64, bytes: usize, at: At) -> Result<usize, Error> {
    let most = (PER_BYTE.saturating_mul(bytes as u64).saturating_add(FREE)).min(u64::from(u32::MAX));
    if claimed > most {
        let problem = format!("is {claimed}, and a file of {bytes} bytes holds fewer splats: copy the file again");
        return Err(Error::malformed(file, "number of splats", at, problem));
    }
    usize::try_from(claimed).map_err(|_| Error::malformed(file, "number of splats", at, "is too large"))
}

/// The model without the splats that are not finite. A few are left out and told, see [`Model::left_out`]; where
/// `strict` is set or where they are more than one in ten, they are an error.
pub(in crate::format) fn finished(file: &Path, mut model: Model, strict: bool) -> Result<Model, Error> {
    let mut tally = Tally::new(strict);
    if let Some(rows) = model.gaussians.finite_rows() {
        let all = model.gaussians.len();
        let bad = (0..all as u32).filter(|row| rows.binary_search(row).is_err());
        for row in bad {
            let error = Error::malformed(file, format_args!("splat {row}"), At::Byte(0), "a value is not finite");
            tally.bad(format_args!("splat {row}"), error)?;
        }
        model = model.rows(&rows);
    }
    model.left_out = tally.end(file, "splats", model.gaussians.len())?;
    Ok(model)
}

/// The error for a file that ends too early or is damaged.
pub(in crate::format) fn damaged(file: &Path, field: impl Display, at: At, problem: impl Display) -> Error {
    Error::malformed(file, field, at, format_args!("{problem}: copy or export the file again"))
}

/// A quaternion from its three smaller components, with the largest one positive.
pub(in crate::format) fn with_largest(largest: usize, smaller: [f32; 3]) -> [f32; 4] {
    let rest: f32 = smaller.iter().map(|v| v * v).sum();
    let mut out = [(1.0 - rest).max(0.0).sqrt(); 4];
    (0..4).filter(|k| *k != largest).zip(smaller).for_each(|(k, v)| out[k] = v);
    out
}

/// Sets coefficient `k` of a channel of splat `i`.
pub(in crate::format) fn set_coefficient(g: &mut Gaussians, i: usize, k: usize, channel: usize, value: f32) {
    g.sh[k / 4][crate::scene::SH_GROUP_FLOATS * i + 3 * (k % 4) + channel] = value;
}
