//! How far pictures change where two splats are drawn as one.

use super::blob::{Blob, MOST_OPACITY, SH, Symmetric, area, with_room};
use crate::scene::init::SH_C0;

/// Weight of the error in what shows through, in relation to the error of a colour channel. Larger weights keep
/// outlines in front of far things, smaller ones keep colours.
const COVER: f64 = 0.1;
/// Least determinant of a projected covariance: splats may be thin as lines.
const LEAST_DETERMINANT: f64 = 1e-290;

/// What a splat adds to pictures.
pub(super) struct Look {
    opacity: f64,
    /// Colour over all directions: its scalar product is that of the colours in the mean over all directions, as
    /// harmonics are orthogonal.
    colour: [f32; SH],
    /// Squared length of colour and cover.
    square: f64,
    /// Overlap with itself.
    own: f64,
}

impl Look {
    pub(super) fn of(blob: &Blob) -> Self {
        let mut colour = blob.sh.map(|v| v * SH_C0 as f32);
        colour[..3].iter_mut().for_each(|v| *v += 0.5);
        let square = dot(&colour, &colour) + COVER;
        let own = overlap(&blob.covariance, [0.0; 3], &blob.covariance);
        Self { opacity: blob.opacity(), colour, square, own }
    }
}

/// The squared error of pictures in which two splats are drawn as one, summed over pictures along the three axes, and
/// what merging the two has cost before. With the former cost a splat that has taken in many takes in no more for
/// nothing.
pub(super) fn cost((a, look_a): (&Blob, &Look), (b, look_b): (&Blob, &Look)) -> f64 {
    let [p, q] = a.shares(b);
    let between = (b.mean - a.mean).to_array();
    let mass = a.mass + b.mass;
    let joined = with_room(a.joined(b), mass);
    let opacity = (mass / area(&joined)).min(MOST_OPACITY);
    // Products of the colours of a, b and the merged splat m.
    let ab = dot(&look_a.colour, &look_b.colour) + COVER;
    let (am, bm) = (p * look_a.square + q * ab, p * ab + q * look_b.square);
    let mm = p * am + q * bm;
    let (of_a, of_b) = (look_a.opacity, look_b.opacity);
    let squares = of_a * of_a * look_a.square * look_a.own
        + of_b * of_b * look_b.square * look_b.own
        + opacity * opacity * mm * overlap(&joined, [0.0; 3], &joined);
    let products = of_a * of_b * ab * overlap(&a.covariance, between, &b.covariance)
        - of_a * opacity * am * overlap(&a.covariance, between.map(|v| v * q), &joined)
        - of_b * opacity * bm * overlap(&b.covariance, between.map(|v| v * p), &joined);
    let change = (squares + 2.0 * products).max(0.0);
    let all = change + a.cost + b.cost;
    if all.is_finite() { all } else { f64::MAX }
}

fn dot(a: &[f32; SH], b: &[f32; SH]) -> f64 {
    f64::from(a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>())
}

/// The integral of the product of two splats of opacity 1, `between` apart, over pictures along x, y and z; a factor of
/// 2 pi is left out.
fn overlap(a: &Symmetric, between: [f64; 3], b: &Symmetric) -> f64 {
    // Indices of the axes of a picture, and of their entries in the matrices.
    let pictures = [([0, 1], [0, 1, 3]), ([0, 2], [0, 2, 5]), ([1, 2], [3, 4, 5])];
    let determinant = |[xx, xy, yy]: [f64; 3]| (xx * yy - xy * xy).max(LEAST_DETERMINANT);
    let of = |(axes, entries): ([usize; 2], [usize; 3])| {
        let (a, b) = (entries.map(|k| a[k]), entries.map(|k| b[k]));
        let sum: [f64; 3] = std::array::from_fn(|k| a[k] + b[k]);
        let [x, y] = axes.map(|k| between[k]);
        let both = determinant(sum);
        let distance = (sum[2] * x * x - 2.0 * sum[1] * x * y + sum[0] * y * y) / both;
        (determinant(a) * determinant(b) / both).sqrt() * (-0.5 * distance).exp()
    };
    pictures.into_iter().map(of).sum()
}
