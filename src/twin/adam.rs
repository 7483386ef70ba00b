//! Twin of `glsl/adam.comp`.

use super::{Real, TwinCall};
use crate::pass::adam::Push;
use crate::pass::counters;

/// A larger gradient (its square would not fit f32) leaves its element as it is, like one that is not finite.
pub const LARGEST_GRADIENT: f64 = 4e18;

/// One step on one element: gradient, then parameter, first and second moment in place.
/// `lr` is the element's learning rate.
pub fn adam<R: Real>(push: &Push, lr: R, g: R, (param, first, second): (&mut R, &mut R, &mut R)) {
    let r = |x: f32| R::of(f64::from(x));
    if g.is_nan() || g.abs() > R::of(LARGEST_GRADIENT) {
        return;
    }
    *first = r(push.beta1) * *first + r(push.gain1) * g;
    *second = r(push.beta2) * *second + r(push.gain2) * (g * g);
    *param -= lr * (*first * r(push.inv_bias1)) / (second.sqrt() * r(push.inv_sqrt_bias2) + r(push.eps));
}

/// What steps with a gradient of zero do, several at once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Missed<R> {
    /// What they multiply first moments by.
    pub first: R,
    /// What they multiply second moments by.
    pub second: R,
    /// How far an element moves in them, in steps like one of them without the decay.
    pub moved: R,
}

impl<R: Real> Missed<R> {
    /// Of `count` steps, below 2^16.
    pub fn steps(push: &Push, count: u32) -> Self {
        let decay = decay::<R>(push);
        Self {
            first: power(R::of(f64::from(push.beta1)), count),
            second: power(R::of(f64::from(push.beta2)), count),
            moved: decay * (R::one() - power(decay, count)) / (R::one() - decay),
        }
    }
}

/// What m / sqrt(v) is multiplied by in a step without a gradient.
pub fn decay<R: Real>(push: &Push) -> R {
    R::of(f64::from(push.beta1)) / R::of(f64::from(push.beta2)).sqrt()
}

fn power<R: Real>(x: R, k: u32) -> R {
    let (mut product, mut square) = (R::one(), x);
    for bit in 0..16 {
        if k >> bit & 1 != 0 {
            product *= square;
        }
        square *= square;
    }
    product
}

/// Makes up for steps that an element has missed, with the rate and the bias corrections of now.
pub fn catch_up<R: Real>(push: &Push, missed: &Missed<R>, lr: R, (param, first, second): (&mut R, &mut R, &mut R)) {
    let r = |x: f32| R::of(f64::from(x));
    let speed = (*first * r(push.inv_bias1)) / (second.sqrt() * r(push.inv_sqrt_bias2) + r(push.eps));
    *param -= lr * missed.moved * speed;
    *first *= missed.first;
    *second *= missed.second;
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let n = (call.get::<u32>(0)[counters::SPLATS] * push.row).min(call.groups * 64) as usize;
    let grad = call.get::<f32>(1);
    let (mut param, mut first, mut second) = (call.get::<f32>(2), call.get::<f32>(3), call.get::<f32>(4));
    for i in 0..n {
        let lr = if (i as u32) % push.row < push.head { push.lr_head } else { push.lr_rest };
        adam(&push, lr, grad[i], (&mut param[i], &mut first[i], &mut second[i]));
    }
    call.set(2, &param);
    call.set(3, &first);
    call.set(4, &second);
}

#[cfg(test)]
mod tests {
    use super::{Missed, adam, catch_up};
    use crate::pass::adam::{Push, Settings};

    /// Without a gradient, one step after the other and all at once. The bias corrections of late steps hardly differ.
    #[test]
    fn missed_steps_are_made_up_for_at_once() {
        let push = |t: u32| Push::new(&Settings::default(), t, 1, 0, 0.0, 0.0);
        for (count, start) in [(0, 9_000), (1, 9_000), (7, 9_000), (28, 9_000), (1_000, 20_000), (65_535, 20_000)] {
            let (mut one, mut all) = ((0.3_f64, -2e-4, 5e-7), (0.3_f64, -2e-4, 5e-7));
            for k in 1..=count {
                adam(&push(start + k), 0.01, 0.0, (&mut one.0, &mut one.1, &mut one.2));
            }
            let (now, missed) = (push(start + count), Missed::steps(&push(start), count));
            catch_up(&now, &missed, 0.01, (&mut all.0, &mut all.1, &mut all.2));
            let far = (one.0 - 0.3).abs();
            assert!((one.0 - all.0).abs() <= 1e-4 * far, "{count}: {} and {}", one.0, all.0);
            // Multiplied step by step, what is below the normal numbers stays at the smallest of them.
            let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * a.abs() + f64::MIN_POSITIVE;
            assert!(near(one.1, all.1) && near(one.2, all.2), "{count}: {one:?} and {all:?}");
            assert!(count == 0 || far > 1e-3, "{count}: moved by {far}");
        }
    }
}
