//! Transforms between coordinate systems in the formats of other trainers.

use std::path::Path;

use serde::Deserialize;

use super::{At, Error, read_text};
use crate::scene::Similarity;

/// The accepted contents.
#[derive(Deserialize)]
#[serde(untagged)]
enum Content {
    /// A 4x4 or 3x4 matrix, row by row.
    Matrix(Vec<Vec<f64>>),
    /// nerfstudio's `dataparser_transforms.json`.
    Named {
        transform: Vec<Vec<f64>>,
        /// Applied after the matrix, to its translation too.
        #[serde(default = "one")]
        scale: f64,
    },
}

fn one() -> f64 {
    1.0
}

/// Reads a similarity from JSON: a 4x4 or 3x4 matrix row by row (such as gsplat's normalisation), or an object with
/// `transform` (a matrix) and `scale` (applied after it), as in nerfstudio's `dataparser_transforms.json`.
pub fn read_transform(file: &Path) -> Result<Similarity, Error> {
    let text = read_text(file).map_err(Error::io(file, "read"))?;
    let fail =
        |line: usize, problem: String| Error::malformed(file, "transform", At::Line(line.max(1) as u64), problem);
    // Parsed as any JSON first, because those errors have a position.
    let value: serde_json::Value = serde_json::from_str(&text).map_err(|e| fail(e.line(), e.to_string()))?;
    let wanted = "a matrix of 3x4 or 4x4 numbers, or an object with such a 'transform' and a 'scale', is expected";
    let content: Content = serde_json::from_value(value).map_err(|_| fail(1, wanted.to_owned()))?;
    let (matrix, scale) = match content {
        Content::Matrix(matrix) => (matrix, 1.0),
        Content::Named { transform, scale } => (transform, scale),
    };
    let mut rows = [[0.0; 4]; 3];
    if !(3..=4).contains(&matrix.len()) || matrix.iter().any(|row| row.len() != 4) {
        return Err(fail(1, wanted.to_owned()));
    }
    for (row, given) in rows.iter_mut().zip(&matrix) {
        row.copy_from_slice(given);
    }
    if matrix.get(3).is_some_and(|last| last[..] != [0.0, 0.0, 0.0, 1.0]) {
        return Err(fail(1, "the last row of a 4x4 matrix must be 0 0 0 1".to_owned()));
    }
    if !(scale.is_finite() && scale > 0.0) {
        return Err(fail(1, format!("the scale must be a positive number, it is {scale}")));
    }
    let rows = rows.map(|row| row.map(|v| v * scale));
    Similarity::from_rows(&rows).map_err(|problem| fail(1, problem.to_string()))
}
