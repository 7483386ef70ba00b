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

fn rate(call: &mut TwinCall<'_>, step: impl Fn(f32, &RatePush) -> f32) {
    let push: RatePush = call.push();
    let threads = push.threads.min(call.groups * call.constants[0]);
    let sums: Vec<f32> = (0..threads).map(|t| chains(t, push.turns, |x| step(x, &push))).collect();
    call.set(0, &sums);
}

/// Adapter of the multiply-adds.
pub fn multiply_add(call: &mut TwinCall<'_>) {
    rate(call, |x, push| x * push.a + push.b);
}

/// Adapter of the exponentials.
pub fn exp2(call: &mut TwinCall<'_>) {
    rate(call, |x, _| (-x).exp2());
}
