//! Twin of `glsl/depth_probe.comp`.

use super::blend_forward::{Blend, TRANSMITTANCE_MIN, evaluate};
use super::{Real, TwinCall};
use crate::pass::depth_probe::{BEHIND, FRONT, Push};

/// What [`probe`] finds at a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probed<R> {
    /// Depth, at the pixel, of the splat at which the transmittance falls to one half or below; 0 where it never does.
    pub median: R,
    /// Sum of the weights of splats in front of the known depth.
    pub front: R,
    /// Sum of the weights of splats behind it.
    pub behind: R,
    /// Final transmittance.
    pub transmittance: R,
}

/// Looks at every pixel of an image. `known` has a depth for each, not positive where none is known.
pub fn probe<R: Real>(blend: &Blend<R>, known: Option<&[R]>) -> Vec<Probed<R>> {
    let one = |pixel: usize| {
        let (x, y) = (pixel % blend.width, pixel / blend.width);
        let known = known.map_or(R::zero(), |known| known[pixel]);
        let [near, far] = [FRONT, BEHIND].map(|share| R::of(f64::from(share)) * known);
        let mut at = Probed { median: R::zero(), front: R::zero(), behind: R::zero(), transmittance: R::one() };
        for &splat in blend.list(x, y) {
            let row = &blend.splats[splat as usize];
            let alpha = evaluate(row, Blend::center(x, y), blend.alpha_min).alpha();
            let next = at.transmittance * (R::one() - alpha);
            if next < R::of(f64::from(TRANSMITTANCE_MIN)) {
                break;
            }
            let (depth, weight, half) = (blend.aux_of(splat as usize, x, y)[0], alpha * at.transmittance, R::of(0.5));
            if known > R::zero() && depth < near {
                at.front += weight;
            }
            if known > R::zero() && depth > far {
                at.behind += weight;
            }
            if at.transmittance > half && next <= half {
                at.median = depth;
            }
            at.transmittance = next;
        }
        at
    };
    (0..blend.width * blend.height).map(one).collect()
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let blend = Blend {
        width: push.width as usize,
        height: push.height as usize,
        background: [0.0; 3],
        side: push.side as usize,
        splats: call.get(0),
        normals: Some(call.get(1)),
        sorted: call.get(2),
        ranges: call.get(3),
        block: None,
        alpha_min: f32::from_bits(call.constants[1]),
    };
    let known = (call.constants[0] != 0).then(|| call.get::<f32>(4));
    let rows: Vec<[f32; 4]> =
        probe(&blend, known.as_deref()).into_iter().map(|p| [p.median, p.front, p.behind, p.transmittance]).collect();
    call.set(5, &rows);
}
