//! Twins of `glsl/stereo_*.comp`.

mod filter;
mod refit;
mod sweep;
mod window;

pub use filter::{Agreement, agreement};
pub use refit::refitted;
pub use sweep::{Sweep, candidates, possible};
pub use window::{Window, sample};

use super::TwinCall;
use crate::pass::stereo::{BlocksPush, FilterPush, RefitPush, SweepPush};

/// Blocks of 2x2 pixels: every pixel with its neighbours to the right and below.
pub fn blocks<T: Copy>(width: u32, height: u32, luma: &[T]) -> Vec<[T; 4]> {
    let at = |x: u32, y: u32| luma[(y.min(height - 1) * width + x.min(width - 1)) as usize];
    (0..width * height)
        .map(|p| (p % width, p / width))
        .map(|(x, y)| [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)])
        .collect()
}

/// Adapter over raw buffers.
pub fn run_blocks(call: &mut TwinCall<'_>) {
    let push: BlocksPush = call.push();
    let (luma, mut rows) = (call.get::<f32>(0), call.get::<[f32; 4]>(1));
    let made = blocks(push.width, push.height, &luma);
    rows[push.first as usize..][..made.len()].copy_from_slice(&made);
    call.set(1, &rows);
}

/// Adapter over raw buffers.
pub fn run_sweep(call: &mut TwinCall<'_>) {
    let push: SweepPush = call.push();
    let (blocks, links, pixels) = (call.get::<[f32; 4]>(0), call.get::<[f32; 4]>(1), call.get::<u32>(2));
    let mut planes = call.get::<[f32; 4]>(3);
    let sweep = Sweep { push: &push, side: call.constants[1], step: call.constants[0], blocks: &blocks, links: &links };
    let list = &pixels[push.first as usize..][..push.count as usize];
    // A pixel reads only pixels that the call does not change.
    let results: Vec<[f32; 4]> = list.iter().map(|&pixel| sweep.pixel(&planes, pixel)).collect();
    for (&pixel, result) in list.iter().zip(results) {
        planes[pixel as usize] = result;
    }
    call.set(3, &planes);
}

/// Adapter over raw buffers.
pub fn run_filter(call: &mut TwinCall<'_>) {
    let push: FilterPush = call.push();
    let (planes, links) = (call.get::<[f32; 4]>(0), call.get::<[f32; 4]>(1));
    let kept: Vec<[f32; 4]> = (0..push.width * push.height)
        .map(|pixel| match (agreement(&push, &planes, &links, pixel).confidence, planes[pixel as usize]) {
            (confidence, [d, gx, gy, _]) if confidence > 0.0 => [d, gx, gy, confidence],
            _ => [0.0; 4],
        })
        .collect();
    call.set(2, &kept);
}

/// Adapter over raw buffers.
pub fn run_refit(call: &mut TwinCall<'_>) {
    let push: RefitPush = call.push();
    let kept = call.get::<[f32; 4]>(0);
    let refined: Vec<[f32; 4]> = (0..push.width * push.height).map(|pixel| refitted(&push, &kept, pixel)).collect();
    call.set(1, &refined);
}
