//! Twin of `glsl/stereo_refit.comp`.

use crate::pass::stereo::RefitPush;
use crate::twin::Real;

/// Weight of the pixel's own slopes, in squared pixels.
const RIDGE: f64 = 0.25;

/// The plane fitted to the kept hypotheses around a pixel.
pub fn refitted<R: Real>(push: &RefitPush, kept: &[[R; 4]], pixel: u32) -> [R; 4] {
    let (width, height, reach) = (push.width as i32, push.height as i32, push.reach as i32);
    let (x, y) = (pixel as i32 % width, pixel as i32 / width);
    let own = kept[pixel as usize];
    let tolerance = R::of(push.tolerance.into()) * own[0];
    // Rows of weight, x, y, and the residual from the pixel's own plane.
    let mut rows: Vec<[R; 4]> = Vec::new();
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            if !(0..width).contains(&(x + dx)) || !(0..height).contains(&(y + dy)) {
                continue;
            }
            let other = kept[((y + dy) * width + x + dx) as usize];
            let (dx, dy) = (R::of(dx.into()), R::of(dy.into()));
            let left = other[0] - own[0] - own[1] * dx - own[2] * dy;
            let near = (R::one() - (left / tolerance).powi(2)).max(R::zero());
            if other[3] > R::zero() {
                rows.push([near * near, dx, dy, left]);
            }
        }
    }
    if own[3] <= R::zero() {
        return own;
    }
    let total = rows.iter().fold(R::zero(), |a, r| a + r[0]);
    let mean = |of: &dyn Fn(&[R; 4]) -> R| rows.iter().fold(R::zero(), |a, r| a + r[0] * of(r)) / total;
    let (mx, my, ml) = (mean(&|r| r[1]), mean(&|r| r[2]), mean(&|r| r[3]));
    let ridge = R::of(RIDGE);
    let (xx, yy) = (mean(&|r| (r[1] - mx).powi(2)) + ridge, mean(&|r| (r[2] - my).powi(2)) + ridge);
    let xy = mean(&|r| (r[1] - mx) * (r[2] - my));
    let (xl, yl) = (mean(&|r| (r[1] - mx) * r[3]), mean(&|r| (r[2] - my) * r[3]));
    let determinant = xx * yy - xy * xy;
    let (sx, sy) = ((xl * yy - yl * xy) / determinant, (yl * xx - xl * xy) / determinant);
    let d = own[0] + ml - sx * mx - sy * my;
    if d > R::zero() { [d, own[1] + sx, own[2] + sy, own[3]] } else { own }
}
