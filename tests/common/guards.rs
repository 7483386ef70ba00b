//! Four guards for comparing a computed vector with a reference: each element, the whole vector's relative norm, its
//! direction, and a signed bias. A row that is zero in place of a nonzero reference fails as well.
//!
//! One guard alone lets errors through: an element bound passes a bias of every element, a norm passes a wrong small
//! row, a cosine passes a wrong factor.
#![allow(dead_code, unreachable_pub)]

/// Bounds of the guards.
#[derive(Clone, Copy, Debug)]
pub struct Guards {
    /// Largest error of an element, relative to the larger of its own magnitude and `floor` times its row's largest.
    pub element: f64,
    /// See `element`.
    pub floor: f64,
    /// Largest |got - want| / |want| of the whole vector.
    pub norm: f64,
    /// Largest 1 - cosine of the whole vectors.
    pub cosine: f64,
    /// Largest |sum of (got - want) sign(want)| / sum of |want|: a factor common to all elements.
    pub bias: f64,
}

impl Guards {
    /// All bounds from one: errors of rounding scatter, so the norm holds to a quarter of the element bound and the
    /// bias to an eighth; the cosine's deviation is quadratic in the norm's.
    pub const fn of(element: f64) -> Self {
        Self { element, floor: 1.0, norm: element / 4.0, cosine: element * element / 32.0 + 1e-14, bias: element / 8.0 }
    }

    /// The error of the first guard that fails; `row` is the number of elements of a row.
    pub fn verdict(&self, row: usize, got: &[f32], want: &[f64]) -> Result<(), String> {
        if got.len() != want.len() {
            return Err(format!("{} values instead of {}", got.len(), want.len()));
        }
        let largest = |values: &[f64]| values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        for (r, (g, w)) in got.chunks(row).zip(want.chunks(row)).enumerate() {
            let scale = largest(w);
            if scale > 1e-30 && g.iter().all(|v| *v == 0.0) {
                return Err(format!("row {r} is zero but should be {w:?}"));
            }
            for (k, (&g, &w)) in g.iter().zip(w).enumerate() {
                let error = (f64::from(g) - w).abs();
                let bound = self.element * w.abs().max(self.floor * scale) + 1e-36;
                if error.is_nan() || error > bound {
                    return Err(format!(
                        "element {k} of row {r}: {g:e} instead of {w:e}, off by {error:e} > {bound:e}"
                    ));
                }
            }
        }
        let sum = |f: &dyn Fn(f64, f64) -> f64| got.iter().zip(want).map(|(&g, &w)| f(f64::from(g), w)).sum::<f64>();
        let (gg, ww, gw) = (sum(&|g, _| g * g), sum(&|_, w| w * w), sum(&|g, w| g * w));
        if ww == 0.0 {
            return if gg == 0.0 { Ok(()) } else { Err(format!("all should be zero, norm is {:e}", gg.sqrt())) };
        }
        let norm = (sum(&|g, w| (g - w) * (g - w)) / ww).sqrt();
        if norm > self.norm {
            return Err(format!("relative norm {norm:e} > {:e}", self.norm));
        }
        let cosine = 1.0 - gw / (gg * ww).sqrt();
        if cosine > self.cosine {
            return Err(format!("1 - cosine {cosine:e} > {:e}", self.cosine));
        }
        let bias = sum(&|g, w| (g - w) * w.signum()).abs() / sum(&|_, w| w.abs());
        if bias > self.bias {
            return Err(format!("signed bias {bias:e} > {:e}", self.bias));
        }
        Ok(())
    }

    /// Panics with `name` when a guard fails.
    #[track_caller]
    pub fn check(&self, name: &str, row: usize, got: &[f32], want: &[f64]) {
        if let Err(why) = self.verdict(row, got, want) {
            panic!("{name}: {why}");
        }
    }
}

/// `got` with the error of each element divided by its condition number, so that the same guards can judge
/// ill-conditioned values.
pub fn eased(got: &[f32], want: &[f64], condition: &[f64]) -> Vec<f32> {
    let ease = |((g, w), c): ((&f32, &f64), &f64)| (w + (f64::from(*g) - w) / c.max(1.0)) as f32;
    got.iter().zip(want).zip(condition).map(ease).collect()
}
