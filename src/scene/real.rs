//! Arithmetic in single or double precision.

/// f32 or f64.
pub trait Real:
    num_traits::Float + num_traits::FloatConst + num_traits::NumAssign + std::fmt::Debug + Send + Sync + 'static
{
    /// From a literal.
    fn of(x: f64) -> Self;
    /// Widened.
    fn f64(self) -> f64;
}

impl Real for f32 {
    fn of(x: f64) -> Self {
        x as f32
    }
    fn f64(self) -> f64 {
        f64::from(self)
    }
}

impl Real for f64 {
    fn of(x: f64) -> Self {
        x
    }
    fn f64(self) -> f64 {
        self
    }
}
