//! Twin of `glsl/splat_outlines.comp`.

use super::blend_forward::{Blend, TRANSMITTANCE_MIN};
use super::{Real, TwinCall};
use crate::pass::splat_outlines::{FILL, HALF_LINE, Push, RADIUS};

/// (r, g, b, final transmittance) of the outlines at every pixel.
pub fn outlines<R: Real>(blend: &Blend<R>) -> Vec<[R; 4]> {
    let one = |pixel: usize| {
        let (x, y) = (pixel % blend.width, pixel / blend.width);
        let (mut colour, mut transmittance) = ([R::zero(); 3], R::one());
        for &splat in blend.list(x, y) {
            if transmittance <= R::of(f64::from(TRANSMITTANCE_MIN)) {
                break;
            }
            let row = &blend.splats[splat as usize];
            let [u, v] = Blend::<R>::center(x, y);
            let alpha = outline(row, [u - row[0], v - row[1]]).min(R::of(0.99));
            for (sum, part) in colour.iter_mut().zip(&row[8..11]) {
                *sum += alpha * transmittance * *part;
            }
            transmittance *= R::one() - alpha;
        }
        let [r, g, b] = std::array::from_fn(|k| colour[k] + transmittance * blend.background[k]);
        [r, g, b, transmittance]
    };
    (0..blend.width * blend.height).map(one).collect()
}

/// Alpha of the outline of a splat at `d` from its mean.
fn outline<R: Real>(row: &[R; 12], d: [R; 2]) -> R {
    let of = |v: f32| R::of(f64::from(v));
    let along = d[0] + row[3] / row[2] * d[1];
    let distance = (row[2] * along * along + row[7] * d[1] * d[1]).max(R::zero()).sqrt();
    let slope = [row[2] * d[0] + row[3] * d[1], row[3] * d[0] + row[4] * d[1]];
    let steep = (slope[0] * slope[0] + slope[1] * slope[1]).sqrt().max(R::of(1e-30));
    let pixels = (distance - of(RADIUS)).abs() * distance / steep;
    let line = (of(HALF_LINE) - pixels).max(R::zero()).min(R::one());
    let line = if distance > R::zero() { line } else { R::zero() };
    row[5] * line.max(of(FILL) * (-distance * distance / R::of(2.0)).exp())
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let blend = Blend {
        width: push.width as usize,
        height: push.height as usize,
        background: [push.red, push.green, push.blue],
        side: push.side as usize,
        splats: call.get(0),
        normals: None,
        sorted: call.get(1),
        ranges: call.get(2),
        block: None,
        alpha_min: crate::scene::tile::ALPHA_MIN,
    };
    let rows = outlines(&blend);
    call.set(3, &rows);
}
