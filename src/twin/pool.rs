//! Twins of `glsl/pool.comp` and `glsl/pool_backward.comp`.

use super::{Real, TwinCall};
use crate::pass::pool::{BackwardPush, FLAG_ADD, FLAG_GATE, Push};

/// The largest value in each 3x3 window, and its row-major index there (the first of equals).
pub fn pool<R: Real>(push: &Push, source: &[[R; 4]]) -> (Vec<[R; 4]>, Vec<[u8; 4]>) {
    let (mut values, mut winners) = (Vec::new(), Vec::new());
    for image in 0..push.images {
        for y in 0..push.out_height {
            for x in 0..push.out_width {
                for quad in 0..push.quads {
                    let (mut best, mut winner) = ([None; 4], [0; 4]);
                    for tap in 0..9 {
                        let (sy, sx) = (2 * y + tap / 3, 2 * x + tap % 3);
                        if sy >= push.in_height || sx >= push.in_width {
                            continue;
                        }
                        let pixel = (image * push.in_height + sy) * push.in_width + sx;
                        let value = source[(pixel * push.quads + quad) as usize];
                        for c in 0..4 {
                            if best[c].is_none_or(|b| value[c] > b) {
                                (best[c], winner[c]) = (Some(value[c]), tap as u8);
                            }
                        }
                    }
                    values.push(best.map(|b| b.unwrap_or_else(R::nan)));
                    winners.push(winner);
                }
            }
        }
    }
    (values, winners)
}

/// Adds the gradient of every maximum to the gradient of its source pixel, and applies the gate.
pub fn backward<R: Real>(
    push: &BackwardPush,
    grad_out: &[[R; 4]],
    winners: &[[u8; 4]],
    gate: &[[R; 4]],
    grad_in: &mut [[R; 4]],
) {
    let rows = (push.in_width * push.in_height * push.quads) as usize;
    if push.flags & FLAG_ADD == 0 {
        grad_in[..rows].fill([R::zero(); 4]);
    }
    for y in 0..push.out_height {
        for x in 0..push.out_width {
            for quad in 0..push.quads {
                let at = ((y * push.out_width + x) * push.quads + quad) as usize;
                for c in 0..4 {
                    let tap = u32::from(winners[at][c]);
                    let pixel = (2 * y + tap / 3) * push.in_width + 2 * x + tap % 3;
                    grad_in[(pixel * push.quads + quad) as usize][c] += grad_out[at][c];
                }
            }
        }
    }
    if push.flags & FLAG_GATE != 0 {
        for (grad, gate) in grad_in[..rows].iter_mut().zip(gate) {
            for c in 0..4 {
                if gate[c] <= R::zero() {
                    grad[c] = R::zero();
                }
            }
        }
    }
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let (values, winners) = pool(&push, &call.get::<[f32; 4]>(0));
    call.set(1, &values);
    call.set(2, &winners);
}

/// Adapter over raw buffers.
pub fn run_backward(call: &mut TwinCall<'_>) {
    let push: BackwardPush = call.push();
    let (grad_out, winners, gate) = (call.get::<[f32; 4]>(0), call.get::<[u8; 4]>(1), call.get::<[f32; 4]>(2));
    let mut grad_in = call.get::<[f32; 4]>(3);
    backward(&push, &grad_out, &winners, &gate, &mut grad_in);
    call.set(3, &grad_in);
}
