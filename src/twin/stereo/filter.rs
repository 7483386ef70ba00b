//! Twin of `glsl/stereo_filter.comp`.

use crate::pass::stereo::{FilterPush, LINK_ROWS};
use crate::twin::Real;

/// The agreement of the sources on a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement<R> {
    /// Number of sources that agree.
    pub sources: u32,
    /// 0 where too few agree, else NCC times n / (n + 1) where n agree.
    pub confidence: R,
    /// Distance of the nearest decision from its opposite outcome: in pixels for positions, relative for depths, in
    /// units of the score for scores.
    pub margin: R,
}

/// Checks a pixel against the sources.
pub fn agreement<R: Real>(push: &FilterPush, planes: &[[R; 4]], links: &[[R; 4]], pixel: u32) -> Agreement<R> {
    let middle = [pixel % push.width, pixel / push.width].map(|v| R::of(f64::from(v) + 0.5));
    let plane = planes[pixel as usize];
    let applied = |rows: &[[R; 4]], at: [R; 4]| -> [R; 3] {
        std::array::from_fn(|row| (0..4).map(|k| rows[row][k] * at[k]).fold(R::zero(), |a, b| a + b))
    };
    let of = |v: f32| R::of(v.into());
    let mut agree = 0;
    let mut margin = (plane[3] - of(push.score)).abs();
    for source in 0..push.sources as usize {
        let rows = &links[LINK_ROWS * source..][..LINK_ROWS];
        let there = applied(rows, [middle[0], middle[1], R::one(), plane[0]]);
        let z = there[2].max(R::of(1e-12));
        let at = [there[0] / z, there[1] / z];
        let size = [rows[3][0], rows[3][1]];
        let edge = (0..2).map(|k| at[k].abs().min((at[k] - size[k]).abs())).fold(R::infinity(), R::min);
        // The choice of the nearest pixel is a decision too.
        let step = (0..2).map(|k| (at[k] - at[k].round()).abs()).fold(R::infinity(), R::min);
        margin = margin.min(edge).min(step);
        if there[2] <= R::zero() || (0..2).any(|k| at[k] < R::zero() || at[k] >= size[k]) {
            continue;
        }
        let nearest = [at[0].floor(), at[1].floor()];
        let row = nearest[1].f64() as usize * size[0].f64() as usize + nearest[0].f64() as usize;
        let other = planes[(source + 1) * push.stride as usize + row];
        let half = R::of(0.5);
        let d = other[0] + other[1] * (at[0] - nearest[0] - half) + other[2] * (at[1] - nearest[1] - half);
        if other[3] <= R::zero() || d <= R::zero() {
            continue;
        }
        let back = applied(&rows[4..], [at[0], at[1], R::one(), d]);
        let back_z = back[2].max(R::of(1e-12));
        let apart = (back[0] / back_z - middle[0]).hypot(back[1] / back_z - middle[1]);
        let off = (z * d / plane[0].max(R::of(1e-30)) - R::one()).abs();
        margin = margin.min((apart - of(push.pixels)).abs()).min((off - of(push.depth)).abs());
        if apart < of(push.pixels) && off < of(push.depth) && back[2] > R::zero() {
            agree += 1;
        }
    }
    let held = plane[0] > R::zero() && plane[3] > R::zero();
    let kept = held && plane[3] >= of(push.score) && agree >= push.needed;
    let share = R::of(f64::from(agree)) / R::of(f64::from(agree + 1));
    let ncc = (plane[3] - R::one()).max(R::zero()).min(R::one());
    Agreement { sources: agree, confidence: if kept { ncc * share } else { R::zero() }, margin }
}
