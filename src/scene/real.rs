//! Arithmetic in single or double precision.

/// f32 or f64.
pub trait Real:
    num_traits::Float + num_traits::FloatConst + num_traits::NumAssign + std::fmt::Debug + Send + Sync + 'static
{
    /// From a literal.
    fn of(x: f64) -> Self;
    /// Widened.
    fn f64(self) -> f64;
    /// Of a number of a buffer. As f32 it keeps its bits, which need not be those of a number:
    /// on the way through an f64 some would change.
    fn of_single(x: f32) -> Self;
    /// As a number of a buffer, likewise.
    fn single(self) -> f32;
}

impl Real for f32 {
    fn of(x: f64) -> Self {
        x as f32
    }
    fn f64(self) -> f64 {
        f64::from(self)
    }
    fn of_single(x: f32) -> Self {
        x
    }
    fn single(self) -> f32 {
        self
    }
}

impl Real for f64 {
    fn of(x: f64) -> Self {
        x
    }
    fn f64(self) -> f64 {
        self
    }
    fn of_single(x: f32) -> Self {
        f64::from(x)
    }
    fn single(self) -> f32 {
        self as f32
    }
}
