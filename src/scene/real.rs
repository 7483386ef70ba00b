//! Arithmetic in single or double precision.

/// f32 or f64.
pub trait Real:
    num_traits::Float + num_traits::FloatConst + num_traits::NumAssign + std::fmt::Debug + Send + Sync + 'static
{
    /// Converts a literal.
    fn of(x: f64) -> Self;
    /// Converts to f64.
    fn f64(self) -> f64;
    /// Converts a value of a buffer. An f32 keeps its bits, even where they are no number: a conversion through f64
    /// would change some.
    fn of_single(x: f32) -> Self;
    /// Converts to a value of a buffer. An f32 keeps its bits.
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
