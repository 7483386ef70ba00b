//! Twin of `glsl/adam.comp`.

use super::{Real, TwinCall};
use crate::pass::adam::Push;
use crate::pass::counters;

/// Largest gradient that is used: the square of a larger one would overflow f32. A larger gradient, like a NaN, leaves
/// its element unchanged.
pub const LARGEST_GRADIENT: f64 = 4e18;

/// A parameter and its moments, in place.
#[derive(Debug)]
pub struct Element<'a, R> {
    /// The parameter.
    pub param: &'a mut R,
    /// The first moment.
    pub first: &'a mut R,
    /// The second moment.
    pub second: &'a mut R,
}

impl<R> Element<'_, R> {
    /// A reborrow, which leaves `self` usable afterwards.
    pub fn reborrowed(&mut self) -> Element<'_, R> {
        Element { param: self.param, first: self.first, second: self.second }
    }
}

/// One step of one element with its gradient `g` and learning rate `lr`.
pub fn adam<R: Real>(push: &Push, lr: R, g: R, element: Element<'_, R>) {
    let Element { param, first, second } = element;
    let r = |x: f32| R::of(f64::from(x));
    if g.is_nan() || g.abs() > R::of(LARGEST_GRADIENT) {
        return;
    }
    *first = r(push.beta1) * *first + r(push.gain1) * g;
    *second = r(push.beta2) * *second + r(push.gain2) * (g * g);
    *param -= lr * (*first * r(push.inv_bias1)) / (second.sqrt() * r(push.inv_sqrt_bias2) + r(push.eps));
}

/// The joint effect of several steps with a gradient of zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MissedSteps<R> {
    /// Factor of the first moment.
    pub first: R,
    /// Factor of the second moment.
    pub second: R,
    /// Total movement of an element, in units of one such step without decay.
    pub moved: R,
}

impl<R: Real> MissedSteps<R> {
    /// The effect of `count` steps, fewer than 2^16.
    pub fn steps(push: &Push, count: u32) -> Self {
        let decay = decay::<R>(push);
        Self {
            first: power(R::of(f64::from(push.beta1)), count),
            second: power(R::of(f64::from(push.beta2)), count),
            moved: decay * (R::one() - power(decay, count)) / (R::one() - decay),
        }
    }
}

/// Factor of m / sqrt(v) in a step with a gradient of zero.
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

/// Applies the steps that an element has missed, with the current learning rate and bias corrections.
pub fn catch_up<R: Real>(push: &Push, missed: &MissedSteps<R>, lr: R, element: Element<'_, R>) {
    let Element { param, first, second } = element;
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
        let element = Element { param: &mut param[i], first: &mut first[i], second: &mut second[i] };
        adam(&push, lr, grad[i], element);
    }
    call.set(2, &param);
    call.set(3, &first);
    call.set(4, &second);
}

#[cfg(test)]
mod tests {
    use super::{Element, MissedSteps, adam, catch_up};
    use crate::pass::adam::{AdamSettings, Push};

    /// Compares steps with a gradient of zero, one after the other, with all at once. The bias corrections of late
    /// steps hardly differ.
    #[test]
    fn missed_steps_are_made_up_for_at_once() {
        let push = |t: u32| Push::new(&AdamSettings::default(), t, 1, 0, 0.0, 0.0);
        for (count, start) in [(0, 9_000), (1, 9_000), (7, 9_000), (28, 9_000), (1_000, 20_000), (65_535, 20_000)] {
            let (mut one, mut all) = ((0.3_f64, -2e-4, 5e-7), (0.3_f64, -2e-4, 5e-7));
            fn of((param, first, second): &mut (f64, f64, f64)) -> Element<'_, f64> {
                Element { param, first, second }
            }
            for k in 1..=count {
                adam(&push(start + k), 0.01, 0.0, of(&mut one));
            }
            let (now, missed) = (push(start + count), MissedSteps::steps(&push(start), count));
            catch_up(&now, &missed, 0.01, of(&mut all));
            let far = (one.0 - 0.3).abs();
            assert!((one.0 - all.0).abs() <= 1e-4 * far, "{count}: {} and {}", one.0, all.0);
            // Multiplied step by step, denormal numbers stall at the smallest one.
            let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * a.abs() + f64::MIN_POSITIVE;
            assert!(near(one.1, all.1) && near(one.2, all.2), "{count}: {one:?} and {all:?}");
            assert!(count == 0 || far > 1e-3, "{count}: moved by {far}");
        }
    }
}
