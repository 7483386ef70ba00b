//! Twin of `glsl/convolution.comp`: sums all taps of every output value in order.

use super::{Real, TwinCall};
use crate::pass::convolution::{CHANNELS, FLAG_ADD, FLAG_GATE, FLAG_RELU, PIXELS, Push};

/// Buffers of a convolution, in binding order.
pub struct Buffers<'a, R> {
    /// Pixels as rows of four channels.
    pub source: &'a [[R; 4]],
    /// See [`Push::filter_row`].
    pub filters: &'a [[R; 4]],
    /// Two rows per group of outputs.
    pub biases: &'a [[R; 4]],
    /// Features in the layout of the result.
    pub gate: &'a [[R; 4]],
    /// Rows that are written, or added to.
    pub result: &'a mut [[R; 4]],
}

/// The convolution.
pub fn convolution<R: Real>(push: &Push, buffers: Buffers<'_, R>) {
    let Buffers { source, filters, biases, gate, result } = buffers;
    let at = |v: u32| v as usize;
    let taps = at(push.size * push.size);
    let of_image = push.out_width * push.out_height;
    for pixel in 0..of_image * push.images {
        let (image, within) = (pixel / of_image, pixel % of_image);
        let (y, x) = (within / push.out_width, within % push.out_width);
        for channel in 0..push.groups * CHANNELS {
            let (group, half, k) = (at(channel / CHANNELS), at(channel / 4 % 2), at(channel % 4));
            let mut sum = biases[at(push.bias_row) + 2 * group + half][k];
            for tap in 0..push.size * push.size {
                // Coordinates left of the image or above it wrap to large values.
                let sx = (x * push.stride + tap % push.size).wrapping_sub(push.pad);
                let sy = (y * push.stride + tap / push.size).wrapping_sub(push.pad);
                if sx >= push.in_width || sy >= push.in_height {
                    continue;
                }
                let from = (image * push.in_height + sy) * push.in_width + sx;
                for quad in 0..push.in_quads {
                    let value = source[at(from * push.in_row + push.in_first + quad)];
                    let tap = (group * taps + at(tap)) * at(push.in_quads) + at(quad);
                    let first = at(push.filter_row) + 8 * tap + half;
                    for (c, v) in value.into_iter().enumerate() {
                        sum += v * filters[first + 2 * c][k];
                    }
                }
            }
            let row = at(pixel * push.out_row + push.out_first) + 2 * group + half;
            if push.flags & FLAG_ADD != 0 {
                sum += result[row][k];
            }
            if push.flags & FLAG_RELU != 0 {
                sum = sum.max(R::zero());
            }
            if push.flags & FLAG_GATE != 0 && gate[row][k] <= R::zero() {
                sum = R::zero();
            }
            result[row][k] = sum;
        }
    }
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    debug_assert!(u64::from(call.groups) * 64 >= push.threads(), "{PIXELS} pixels to a thread");
    let (source, filters, biases, gate) =
        (call.get::<[f32; 4]>(0), call.get::<[f32; 4]>(1), call.get::<[f32; 4]>(2), call.get::<[f32; 4]>(3));
    let mut result = call.get::<[f32; 4]>(4);
    let buffers = Buffers { source: &source, filters: &filters, biases: &biases, gate: &gate, result: &mut result };
    convolution(&push, buffers);
    call.set(4, &result);
}
