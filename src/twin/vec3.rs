//! Three-vectors in any precision, for the projection's twins.

use super::Real;

pub(super) fn dot<R: Real>(a: [R; 3], b: [R; 3]) -> R {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross<R: Real>(a: [R; 3], b: [R; 3]) -> [R; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn scale<R: Real>(s: R, a: [R; 3]) -> [R; 3] {
    a.map(|v| s * v)
}

pub(super) fn add<R: Real>(a: [R; 3], b: [R; 3]) -> [R; 3] {
    std::array::from_fn(|k| a[k] + b[k])
}

pub(super) fn sub<R: Real>(a: [R; 3], b: [R; 3]) -> [R; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

pub(super) fn mul<R: Real>(a: [R; 3], b: [R; 3]) -> [R; 3] {
    std::array::from_fn(|k| a[k] * b[k])
}

/// Sum of `weights[k]` times `rows[k]`.
pub(super) fn combine<R: Real>(weights: [R; 3], rows: [[R; 3]; 3]) -> [R; 3] {
    std::array::from_fn(|k| weights[0] * rows[0][k] + weights[1] * rows[1][k] + weights[2] * rows[2][k])
}
