//! Twins of `glsl/probe_copy.comp` and `glsl/probe_rate.comp`.

use super::{Real, TwinCall};
use crate::pass::probe::{CHAINS, COPY_GROUPS, CopyPush, RatePush, UNROLL};

/// Adapter of the copy.
pub fn copy(call: &mut TwinCall<'_>) {
    let push: CopyPush = call.push();
    let count = push.count.min(call.groups * COPY_GROUPS) as usize;
    let source = call.get::<[u32; 4]>(0);
    call.set(1, &source[..count]);
}

/// The sum of a thread's chains after `turns` turns, each of [`UNROLL`] calls of `step`.
pub fn chains<R: Real>(thread: u32, turns: u32, step: impl Fn(R) -> R) -> R {
    let chain = |j: u32| {
        let start = R::of(f64::from((thread + j) % 16) * 0.0625);
        (0..u64::from(turns) * u64::from(UNROLL)).fold(start, |x, _| step(x))
    };
    (0..CHAINS).fold(R::zero(), |sum, j| sum + chain(j))
}

/// Adapter of the arithmetic.
pub fn rate(call: &mut TwinCall<'_>) {
    let push: RatePush = call.push();
    let [local_size, exp2] = [call.constants[0], call.constants[1]];
    let threads = push.threads.min(call.groups * local_size);
    let step = |x: f32| if exp2 == 1 { (-x).exp2() } else { x * push.a + push.b };
    let sums: Vec<f32> = (0..threads).map(|t| chains(t, push.turns, step)).collect();
    call.set(0, &sums);
}
