//! Small dense matrices in f64.

pub(super) type Mat3 = [[f64; 3]; 3];
pub(super) type Mat2x3 = [[f64; 3]; 2];
pub(super) type Mat2 = [[f64; 2]; 2];

/// Product of an `I x K` and a `K x J` matrix.
pub(super) fn product<const I: usize, const K: usize, const J: usize>(
    a: &[[f64; K]; I],
    b: &[[f64; J]; K],
) -> [[f64; J]; I] {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..K).map(|k| a[i][k] * b[k][j]).sum()))
}

pub(super) fn transposed<const I: usize, const J: usize>(a: &[[f64; J]; I]) -> [[f64; I]; J] {
    std::array::from_fn(|j| std::array::from_fn(|i| a[i][j]))
}

pub(super) fn times<const I: usize, const J: usize>(a: &[[f64; J]; I], v: &[f64; J]) -> [f64; I] {
    std::array::from_fn(|i| (0..J).map(|j| a[i][j] * v[j]).sum())
}

pub(super) fn scaled<const I: usize, const J: usize>(s: f64, a: &[[f64; J]; I]) -> [[f64; J]; I] {
    a.map(|row| row.map(|v| s * v))
}

pub(super) fn norm<const I: usize>(v: &[f64; I]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}
