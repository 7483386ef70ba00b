//! Least times (floors) of a pass: its bytes at the device's bandwidth, and its arithmetic at the device's rate.

use serde::Serialize;

use super::memory_traffic::{self, Work};
use super::rates::Rates;

/// Arithmetic that a pass must do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arithmetic {
    /// Additions, multiplications, comparisons and selections of floats.
    pub operations: f64,
    /// Exponentials to the base of 2.
    pub exp2: f64,
}

/// Both floors of a pass in milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Floors {
    /// Bytes moved by design over the bandwidth of a copy.
    pub bytes_ms: Option<f64>,
    /// Arithmetic over the measured rates.
    pub arithmetic_ms: Option<f64>,
}

impl Floors {
    /// The floors of all dispatches of `pass` in a step.
    pub fn of(pass: &str, work: &Work, per_pixel: Option<&PerPixel>, rates: &Rates) -> Floors {
        let time = |a: Arithmetic| 1e-6 * (a.operations / rates.gops_per_s + a.exp2 / rates.gexp2_per_s);
        Floors {
            bytes_ms: memory_traffic::bytes(pass, work).map(|bytes| 1e3 * bytes / rates.bandwidth()),
            arithmetic_ms: arithmetic(pass, work, per_pixel).map(time),
        }
    }

    /// The larger floor.
    pub fn larger(&self) -> Option<f64> {
        [self.bytes_ms, self.arithmetic_ms].into_iter().flatten().reduce(f64::max)
    }
}

/// Arithmetic of all dispatches of a pass in one step; `None` where it is negligible beside the bytes, or not known.
///
/// An evaluation is one splat tested at one pixel that has not stopped. `splats_per_pixel` counts the evaluations, and
/// those that were blended. Values shared by the pixels of a thread (such as dx) and data movement (shuffles, sums over
/// threads) are left out.
///
/// | pass | operations |
/// |---|---|
/// | `blend_forward` | 10 and one exp2 per evaluation: dy 1, exponent as two squares 6, times opacity 1, two comparisons. 13 more where it is blended: clamp 1, transmittance 2, stop 1, weight 1, colour 6, last 1, new transmittance 1 |
/// | `blend_backward` | 11 and one exp2 per evaluation: as forward, and the comparison with the last. 35 more where it is blended: clamp 1, transmittance 2 (a division counts as one), weight 1, colour dot gradient 5, difference 1, what lies behind 2, v 2, its moments 5, colour sums 6, absolute sums 10 |
/// | `loss_strips` | 700 per pixel: per channel moments 8, four windows along rows of 16, four down columns of 16, SSIM and its derivatives 49, three windows down columns of 16 |
/// | `loss_grad` | 180 per pixel: per channel three windows along rows of 16, the gradient 9, the absolute difference 3 |
/// | `project` | 150 per splat, 430 more per visible one: position 18, culling and guards 30, quaternion and scales 40, covariance 62; then projection 90, conic and radius 30, harmonics of degree 3 with their direction 170, tiles 140 |
/// | `project_backward_adam` | as `project_backward` and `adam` |
/// | `project_backward` | 900 per visible splat: twice the derivative of what `project` does for a visible one, without the tiles |
/// | `adam` | 15 per parameter |
/// | `slot_sum` | 12 per pair |
pub fn arithmetic(pass: &str, work: &Work, per_pixel: Option<&PerPixel>) -> Option<Arithmetic> {
    let is = |family: &str| pass.strip_prefix(family).is_some_and(|rest| rest.is_empty() || rest.starts_with('_'));
    let plain = |operations: f64| Some(Arithmetic { operations, exp2: 0.0 });
    let blend = |evaluated: f64, blended: f64, each: f64, more: f64| {
        let [evaluated, blended] = [evaluated, blended].map(|per_pixel| per_pixel * work.pixels);
        Arithmetic { operations: each * evaluated + more * blended, exp2: evaluated }
    };
    if is("blend_forward") {
        return per_pixel.map(|p| blend(p.forward_evaluated, p.forward_blended, 10.0, 13.0));
    }
    if is("blend_backward") {
        return per_pixel.map(|p| blend(p.backward_evaluated, p.backward_blended, 11.0, 35.0));
    }
    match pass {
        _ if is("loss_strips") => plain(700.0 * work.pixels),
        _ if is("loss_grad") => plain(180.0 * work.pixels),
        _ if is("project_backward_adam") => {
            // Parameters that make up for missed steps take twelve more operations, among them one root and one
            // division.
            let of_parameter = if work.listed { 27.0 } else { 15.0 };
            plain(900.0 * work.visible + of_parameter * work.stepped() * work.splats_stepped())
        }
        _ if is("project_backward") => plain(900.0 * work.visible),
        _ if is("project") => plain(150.0 * work.splats + 430.0 * work.visible),
        _ if is("adam") => plain(15.0 * memory_traffic::parameters() * work.splats),
        _ if is("slot_sum") => plain(12.0 * work.pairs),
        _ => None,
    }
}

/// Mean numbers of splats per pixel.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PerPixel {
    /// Evaluated by the forward pass.
    pub forward_evaluated: f64,
    /// Blended by the forward pass.
    pub forward_blended: f64,
    /// Evaluated by the backward pass.
    pub backward_evaluated: f64,
    /// Given a gradient by the backward pass.
    pub backward_blended: f64,
}
