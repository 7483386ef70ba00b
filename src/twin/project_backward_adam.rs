//! Twin of `glsl/project_backward_adam.comp`.

use super::adam::{Element, LARGEST_GRADIENT, MissedSteps, adam, catch_up, decay};
use super::project_backward::{Grad2d, decide, flatten, price, prices, project_backward, shrink};
use super::splat::{PARAMETERS, Splat, TwinCamera};
use super::{Real, TwinCall};
use crate::pass::adam::Push as AdamPush;
use crate::pass::camera::{ANTIALIAS, BLACK_LEARNS, REFERENCE_CLAMP};
use crate::pass::counters;
use crate::pass::project_backward_adam::{DECIDES, DEGREE_SHIFT, Push, STEP_SHIFT, STEPS_OPACITIES};
use crate::scene::{Gaussians, SH_GROUP_FLOATS};
use crate::twin::splat::model_of;

/// A splat with the moments of its parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct SplatState<R> {
    /// Parameters.
    pub splat: Splat<R>,
    /// First moments.
    pub first: Splat<R>,
    /// Second moments.
    pub second: Splat<R>,
}

/// The camera of the push constants; fields that the backward does not use are zero.
pub fn view<R: Real>(push: &Push) -> TwinCamera<R> {
    let r = |x: f32| R::of(f64::from(x));
    let rows = [push.row0, push.row1, push.row2];
    TwinCamera {
        rotation: rows.map(|row| [r(row[0]), r(row[1]), r(row[2])]),
        translation: rows.map(|row| r(row[3])),
        center: push.center.map(r),
        near: R::zero(),
        focal: push.focal.map(r),
        principal: [R::zero(); 2],
        limits: push.limits.map(r),
        size: [0; 2],
        sh_degree: push.flags >> DEGREE_SHIFT & 3,
        antialias: push.flags & ANTIALIAS != 0,
        reference_clamp: push.flags & REFERENCE_CLAMP != 0,
        black_learns: push.flags & BLACK_LEARNS != 0,
        orthographic: false,
    }
}

/// The optimiser's settings and the learning rate for parameter `k` of 59; `constants` are the pass's constants, in
/// order.
fn of_parameter(push: &Push, constants: &[u32], k: usize) -> (AdamPush, f32) {
    let float = |i: usize| f32::from_bits(constants[i]);
    let (lr, inv_bias1, inv_sqrt_bias2) = match k {
        0..3 => (push.lr_means, push.inv_bias1, push.inv_sqrt_bias2),
        3..7 => (push.lr_quats, push.inv_bias1, push.inv_sqrt_bias2),
        7..10 => (push.lr_scales, push.inv_bias1, push.inv_sqrt_bias2),
        10 => (push.lr_opacities, push.inv_bias1_opacities, push.inv_sqrt_bias2_opacities),
        11..14 => (push.lr_sh_base, push.inv_bias1, push.inv_sqrt_bias2),
        _ => (push.lr_sh_rest, push.inv_bias1, push.inv_sqrt_bias2),
    };
    let (beta1, gain1, beta2, gain2, eps) = (float(2), float(3), float(4), float(5), float(6));
    (AdamPush { beta1, gain1, beta2, gain2, eps, inv_bias1, inv_sqrt_bias2, ..AdamPush::default() }, lr)
}

/// Number of parameters with spherical harmonics up to a degree, the 11 of the geometry included.
fn within(degree: u32) -> usize {
    11 + 3 * (degree as usize + 1).pow(2)
}

/// Number of parameters that a step changes, opacity aside. A splat that is not `full` has harmonics up to degree 1
/// only.
pub(super) fn touched(constants: &[u32], full: bool) -> usize {
    within(if full { constants[1] } else { constants[1].min(1) })
}

/// One step of one splat with the gradients of its parameters (zeros for a culled splat).
pub fn step<R: Real>(push: &Push, constants: &[u32], state: &SplatState<R>, gradient: &Splat<R>) -> SplatState<R> {
    step_of(push, constants, state, gradient, Pace::default(), true)
}

/// As [`step`], for a splat that has missed steps.
pub fn step_after<R: Real>(
    push: &Push,
    constants: &[u32],
    state: &SplatState<R>,
    gradient: &Splat<R>,
    pace: Pace,
) -> SplatState<R> {
    step_of(push, constants, state, gradient, pace, true)
}

/// As [`step_after`]. A splat that is not `full` has harmonics up to degree 1 only.
pub(super) fn step_of<R: Real>(
    push: &Push,
    constants: &[u32],
    state: &SplatState<R>,
    gradient: &Splat<R>,
    pace: Pace,
    full: bool,
) -> SplatState<R> {
    let (g, mut params) = (gradient.to_array(), state.splat.to_array());
    let (mut first, mut second) = (state.first.to_array(), state.second.to_array());
    for k in (0..PARAMETERS).filter(|&k| k < touched(constants, full) && (k != 10 || push.flags & STEPS_OPACITIES != 0))
    {
        let (numbers, lr) = of_parameter(push, constants, k);
        let lr = R::of(f64::from(lr));
        let mut element = Element { param: &mut params[k], first: &mut first[k], second: &mut second[k] };
        if constants[LISTED] == 0 && constants[CATCHES_UP] == 0 {
            adam(&numbers, lr, g[k], element);
            continue;
        }
        let parts = |count: u32| R::of(f64::from(count)) * part::<R>(&numbers);
        let mut missed = MissedSteps::steps(&numbers, pace.missed);
        missed.moved -= parts(pace.advanced);
        catch_up(&numbers, &missed, lr, element.reborrowed());
        if constants[CATCHES_UP] == 0 {
            let says_nothing = g[k].is_nan() || g[k].abs() > R::of(LARGEST_GRADIENT);
            let g = if says_nothing { R::zero() } else { g[k] };
            adam(&numbers, (R::one() + parts(pace.advance)) * lr, g, element);
        }
    }
    SplatState {
        splat: Splat::from_array(&params),
        first: Splat::from_array(&first),
        second: Splat::from_array(&second),
    }
}

/// Index of `LISTED` among the pass's constants.
const LISTED: usize = 9;

/// Index of `CATCHES_UP` among the pass's constants.
const CATCHES_UP: usize = 10;

/// The steps that a splat has missed, from its row of `stats`, and the movement in advance of its next step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pace {
    /// Number of missed steps.
    pub missed: u32,
    /// Movement that the last step made in advance, in 1/[`PARTS`] of the total movement that the moments would ever
    /// cause.
    pub advanced: u32,
    /// Movement that the next step makes in advance, in the same unit.
    pub advance: u32,
}

/// Unit of [`Pace::advanced`]: parts of the total movement.
pub const PARTS: u32 = 255;
/// Weight of the latest gap between two steps in the expected next gap.
const LATEST: f32 = 0.25;

impl Pace {
    /// From the last value `row` of a splat's row of `stats`, where all splats caught up in step `caught_up`; `None`
    /// where nothing is to be done.
    pub fn new(push: &Push, constants: &[u32], row: f32, caught_up: u32) -> Option<Self> {
        let (now, row, catches_up) = (push.flags >> STEP_SHIFT, row as u32, constants[CATCHES_UP] != 0);
        let [since_last, since_all] = [row, caught_up].map(|step| now.wrapping_sub(step) & 0xffff);
        let since = since_last.min(since_all);
        let missed = if catches_up { since } else { since.saturating_sub(1) };
        let advanced = if since_last <= since_all { row >> 16 } else { 0 };
        if catches_up && missed == 0 && advanced == 0 {
            return None;
        }
        let (numbers, _) = of_parameter(push, constants, 0);
        let parts = MissedSteps::<f32>::steps(&numbers, missed).moved / part::<f32>(&numbers);
        let before = advanced as f32;
        let expected = if advanced == 0 { parts } else { before + LATEST * (parts - before) };
        let advance = if catches_up { 0 } else { (expected + 0.5).floor() as u32 };
        Some(Self { missed, advanced, advance })
    }

    /// The last value of the row after the step.
    pub fn row(&self, push: &Push) -> f32 {
        (push.flags >> STEP_SHIFT) as f32 + 65536.0 * self.advance as f32
    }
}

/// 1/[`PARTS`] of the total movement that moments would ever cause, in steps.
fn part<R: Real>(numbers: &AdamPush) -> R {
    let decay = decay::<R>(numbers);
    decay / (R::one() - decay) / R::of(f64::from(PARTS))
}

/// The splats that take a step or catch up. Updates the rows of `stats`.
pub(super) fn steppers(call: &mut TwinCall<'_>, inputs: &Inputs, stats: usize) -> Vec<(usize, Pace)> {
    let (push, constants) = (call.push::<Push>(), call.constants);
    if constants[LISTED] == 0 && constants[CATCHES_UP] == 0 {
        return inputs.stepping().map(|i| (i, Pace::default())).collect();
    }
    let caught_up = call.get::<u32>(0)[counters::CAUGHT_UP];
    let mut rows: Vec<[f32; 4]> = call.get(stats);
    let pace = |i: usize| Some((i, Pace::new(&push, constants, rows[i][3], caught_up)?));
    let chosen: Vec<(usize, Pace)> = inputs.stepping().filter_map(pace).collect();
    for (i, pace) in &chosen {
        rows[*i][3] = pace.row(&push);
    }
    call.set(stats, &rows);
    chosen
}

/// The inputs of a step besides the model and its moments, from the bound buffers.
pub(super) struct Inputs {
    /// Number of splats.
    pub(super) n: usize,
    /// Number of threads that own a splat.
    threads: usize,
    listed: bool,
    catches_up: bool,
    /// Rows from this index on have harmonics up to degree 1 only.
    pub(super) full: usize,
    view: TwinCamera<f32>,
    splat2d: Vec<[f32; 12]>,
    on_image: Vec<u32>,
    grad2d: Vec<[f32; 12]>,
    grad_normals: Vec<[f32; 4]>,
    aux: bool,
    flatten: f32,
    shrink: f32,
    prices: [f32; 2],
    decide: f32,
}

impl Inputs {
    /// Reads bindings 0 to 4.
    pub(super) fn new(call: &TwinCall<'_>, push: &Push) -> Self {
        let listed = call.constants[LISTED] != 0;
        let counted = if listed { counters::VISIBLE } else { counters::SPLATS };
        Self {
            listed,
            catches_up: call.constants[CATCHES_UP] != 0,
            n: call.get::<u32>(0)[counters::SPLATS] as usize,
            threads: (call.groups as usize * 64).min(call.get::<u32>(0)[counted] as usize),
            full: counters::full_rows(&call.get::<u32>(0)),
            view: view(push),
            splat2d: call.get(1),
            on_image: call.get(2),
            grad2d: call.get(3),
            grad_normals: call.get(4),
            aux: call.constants[0] != 0,
            flatten: f32::from_bits(call.constants[7]),
            shrink: f32::from_bits(call.constants[8]),
            prices: prices([call.constants[11], call.constants[12]], call.get::<u32>(0)[counters::SPLATS] as usize),
            decide: if push.flags & DECIDES != 0 { f32::from_bits(call.constants[13]) } else { 0.0 },
        }
    }

    /// The splats that take a step.
    pub(super) fn stepping(&self) -> impl Iterator<Item = usize> {
        (0..self.threads).map(|thread| if self.listed { self.on_image[thread] as usize } else { thread })
    }

    /// The gradient of splat `i`.
    pub(super) fn gradient(&self, i: usize, splat: &Splat<f32>) -> Splat<f32> {
        if self.catches_up || !self.listed && self.on_image[i] == 0 {
            let mut gradient = Splat::of(&Gaussians::zeros(1), 0);
            if !self.catches_up {
                price(&mut gradient, splat.log_scale, splat.logit, self.prices);
            }
            return gradient;
        }
        let [x, y, z, _] = if self.aux { self.grad_normals[i] } else { [0.0; 4] };
        let colour = [self.splat2d[i][8], self.splat2d[i][9], self.splat2d[i][10]];
        let up = Grad2d { row: self.grad2d[i], normal: [x, y, z] };
        let view = self.view.of_row(i < self.full);
        let mut gradient = project_backward(splat, &view, colour, &up);
        flatten(&mut gradient, splat.log_scale, self.flatten);
        shrink(&mut gradient, &splat.sh, view.sh_degree, self.shrink);
        decide(&mut gradient, splat.logit, self.decide);
        price(&mut gradient, splat.log_scale, splat.logit, self.prices);
        gradient
    }
}

/// Writes a model's planes from binding `first` on; for harmonics above degree 1, the rows before `full` only.
pub(super) fn set_planes(call: &mut TwinCall<'_>, first: usize, plane: &Gaussians, full: usize) {
    call.set(first, &plane.means);
    call.set(first + 1, &plane.quats);
    call.set(first + 2, &plane.scales);
    call.set(first + 3, &plane.opacities);
    for (group, values) in plane.sh.iter().enumerate() {
        let rows = if group == 0 { values.len() } else { values.len().min(full * SH_GROUP_FLOATS) };
        call.set(first + 4 + group, &values[..rows]);
    }
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let inputs = Inputs::new(call, &push);
    let mut planes = [5, 13, 21].map(|first| model_of(call, first, inputs.n));
    for (i, pace) in steppers(call, &inputs, 29) {
        let [splat, first, second] = std::array::from_fn(|k| Splat::<f32>::of(&planes[k], i));
        let gradient = inputs.gradient(i, &splat);
        let state = SplatState { splat, first, second };
        let after = step_of(&push, call.constants, &state, &gradient, pace, i < inputs.full);
        for (values, plane) in [after.splat, after.first, after.second].iter().zip(&mut planes) {
            values.store(plane, i);
        }
    }
    for (first, plane) in [5, 13, 21].into_iter().zip(&planes) {
        set_planes(call, first, plane, inputs.full);
    }
}
