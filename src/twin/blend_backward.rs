//! Twin of `glsl/blend_backward.comp`.

use super::blend_forward::{Blend, Evaluation, NO_BLOCKS, evaluate, inputs};
use super::{Real, TwinCall};
use crate::pass::blend_forward::{COLUMN_SIDE, PIXEL_SIDE};
use crate::scene::tile;

/// Index of the constant BLOCK in the passes that have it.
const BLOCK: usize = 4;

/// Inputs of the backward pass besides [`Blend`].
#[derive(Clone, Debug)]
pub struct Upstream<R> {
    /// The blended image: its last component is the final transmittance.
    pub image: Vec<[R; 4]>,
    /// Entries of the tile's list up to and including the last contributor.
    pub last: Vec<u32>,
    /// dL/d(r, g, b, final transmittance).
    pub grad_image: Vec<[R; 4]>,
    /// dL/d(sum w z, sum w n); not read without normals.
    pub grad_aux: Vec<[R; 4]>,
    /// Whether the gradient passes through min(0.99, alpha) where alpha is clamped, as in the 3DGS reference.
    pub clamp_gradient_passes: bool,
}

/// Gradients per entry of the tiles' lists.
#[derive(Clone, Debug)]
pub struct PairGrads<R> {
    /// Rows as in `grad2d`.
    pub rows: Vec<[R; 12]>,
    /// Gradients of the normals.
    pub normals: Vec<[R; 4]>,
    /// Pixel-splats evaluated.
    pub evaluated: u32,
    /// Pixel-splats blended.
    pub blended: u32,
}

/// Gradients of every (splat, tile) pair.
pub fn backward<R: Real>(blend: &Blend<R>, up: &Upstream<R>) -> PairGrads<R> {
    let mut out = PairGrads {
        rows: vec![[R::zero(); 12]; blend.sorted.len()],
        normals: vec![[R::zero(); 4]; blend.sorted.len()],
        evaluated: 0,
        blended: 0,
    };
    for y in 0..blend.height {
        for x in 0..blend.width {
            let pixel = y * blend.width + x;
            let begin = blend.ranges[blend.tile(x, y)][0] as usize;
            let [r, g, b, grad_t] = up.grad_image[pixel];
            let grad = [r, g, b];
            let mut transmittance = up.image[pixel][3];
            // Colour and auxiliary values behind the current splat, the background included.
            let (mut colour, mut aux) = (blend.background, [R::zero(); 4]);
            // The final transmittance acts like a further channel in which only the background has colour.
            let mut see_through = R::one();
            for place in (0..up.last[pixel] as usize).rev() {
                let splat = blend.sorted[begin + place] as usize;
                if !blend.evaluates(splat, x, y) {
                    continue;
                }
                let row = &blend.splats[splat];
                let at = evaluate(row, Blend::center(x, y), blend.alpha_min);
                out.evaluated += 1;
                let alpha = at.alpha();
                if alpha == R::zero() {
                    continue;
                }
                out.blended += 1;
                transmittance /= R::one() - alpha;
                let weight = alpha * transmittance;
                let mut grad_alpha = R::zero();
                let mix = |front: R, back: R| back + alpha * (front - back);
                let sums = &mut out.rows[begin + place];
                for k in 0..3 {
                    grad_alpha += transmittance * (row[8 + k] - colour[k]) * grad[k];
                    sums[6 + k] += weight * grad[k];
                    colour[k] = mix(row[8 + k], colour[k]);
                }
                grad_alpha -= transmittance * see_through * grad_t;
                see_through = mix(R::zero(), see_through);
                if blend.normals.is_some() {
                    let (values, g) = (blend.aux_of(splat, x, y), up.grad_aux[pixel]);
                    for k in 0..4 {
                        grad_alpha += transmittance * (values[k] - aux[k]) * g[k];
                        aux[k] = mix(values[k], aux[k]);
                    }
                    sums[9] += weight * g[0];
                    for k in 0..3 {
                        out.normals[begin + place][k] += weight * g[1 + k];
                    }
                }
                if at.unclamped <= R::of(0.99) || up.clamp_gradient_passes {
                    add_geometry(sums, row, &at, grad_alpha);
                }
            }
        }
    }
    out
}

/// Adds the gradients of mean, conic and opacity from the gradient of alpha at one pixel.
fn add_geometry<R: Real>(sums: &mut [R; 12], row: &[R; 12], at: &Evaluation<R>, grad_alpha: R) {
    let [dx, dy] = at.d;
    let [a, b, rest] = [row[2], row[3], row[7]];
    let along = dx + b / a * dy;
    let grad_power = at.unclamped * grad_alpha;
    let mean = [grad_power * a * along, grad_power * (b * along + rest * dy)];
    sums[0] += mean[0];
    sums[1] += mean[1];
    sums[2] -= grad_power * dx * dx / R::of(2.0);
    sums[3] -= grad_power * dx * dy;
    sums[4] -= grad_power * dy * dy / R::of(2.0);
    sums[5] += at.falloff * grad_alpha;
    sums[10] += mean[0].abs();
    sums[11] += mean[1].abs();
}

fn pairs(call: &TwinCall<'_>, side: u32, block: usize) -> (Blend<f32>, PairGrads<f32>) {
    let alpha_min = call.constants.last().map_or(tile::ALPHA_MIN, |bits| f32::from_bits(*bits));
    let blend = inputs(call, side, block, alpha_min);
    let up = Upstream {
        image: call.get(4),
        last: call.get(5),
        grad_image: call.get(6),
        grad_aux: call.get(7),
        clamp_gradient_passes: call.constants[3] != 0,
    };
    let mut grads = backward(&blend, &up);
    if call.constants[2] == 0 {
        grads.rows.iter_mut().for_each(|row| row[10..].fill(0.0));
    }
    (blend, grads)
}

fn count(call: &mut TwinCall<'_>, binding: usize, grads: &PairGrads<f32>) {
    if call.constants[1] != 0 {
        let mut counts = call.get::<u32>(binding);
        counts[2] += grads.evaluated;
        counts[3] += grads.blended;
        call.set(binding, &counts);
    }
}

fn run_slots(call: &mut TwinCall<'_>, side: u32, block: usize) {
    let (blend, grads) = pairs(call, side, block);
    let slots: Vec<u32> = call.get(8);
    let (mut rows, mut normals) = (call.get::<[f32; 12]>(9), call.get::<[f32; 4]>(10));
    for [begin, end] in blend.ranges {
        for pair in begin as usize..end as usize {
            rows[slots[pair] as usize] = grads.rows[pair];
            if blend.normals.is_some() {
                normals[slots[pair] as usize][..3].copy_from_slice(&grads.normals[pair][..3]);
            }
        }
    }
    call.set(9, &rows);
    call.set(10, &normals);
    count(call, 11, &grads);
}

fn run_sums(call: &mut TwinCall<'_>, side: u32, block: usize) {
    let (blend, grads) = pairs(call, side, block);
    let (mut rows, mut normals) = (call.get::<[f32; 12]>(8), call.get::<[f32; 4]>(9));
    for [begin, end] in blend.ranges {
        for pair in begin as usize..end as usize {
            let splat = blend.sorted[pair] as usize;
            rows[splat].iter_mut().zip(grads.rows[pair]).for_each(|(sum, x)| *sum += x);
            if blend.normals.is_some() {
                normals[splat].iter_mut().zip(grads.normals[pair]).for_each(|(sum, x)| *sum += x);
            }
        }
    }
    call.set(8, &rows);
    call.set(9, &normals);
    count(call, 10, &grads);
}

/// Adapter over raw buffers: COLUMN tiles, slots.
pub fn run_column_slots(call: &mut TwinCall<'_>) {
    run_slots(call, COLUMN_SIDE, NO_BLOCKS);
}

/// Adapter over raw buffers: COLUMN tiles, sums per splat.
pub fn run_column_sums(call: &mut TwinCall<'_>) {
    run_sums(call, COLUMN_SIDE, NO_BLOCKS);
}

/// Adapter over raw buffers: PIXEL tiles, slots, every splat at every pixel.
pub fn run_whole_slots(call: &mut TwinCall<'_>) {
    run_slots(call, PIXEL_SIDE, NO_BLOCKS);
}

/// Adapter over raw buffers: PIXEL tiles, slots, with the constant BLOCK.
pub fn run_pixel_slots(call: &mut TwinCall<'_>) {
    run_slots(call, PIXEL_SIDE, BLOCK);
}

/// Adapter over raw buffers: PIXEL tiles, sums per splat, with the constant BLOCK.
pub fn run_pixel_sums(call: &mut TwinCall<'_>) {
    run_sums(call, PIXEL_SIDE, BLOCK);
}

/// Adapter over raw buffers: PIXEL tiles, sums per splat, every splat at every pixel.
pub fn run_whole_sums(call: &mut TwinCall<'_>) {
    run_sums(call, PIXEL_SIDE, NO_BLOCKS);
}
