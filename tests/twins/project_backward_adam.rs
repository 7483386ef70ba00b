//! `project_backward_adam`: against the f64 twin, and bit for bit against `project_backward` followed by `adam`.

use psrgs_vk::pass::adam::{self, AdamSettings};
use psrgs_vk::pass::camera::Projection;
use psrgs_vk::pass::project_backward::Penalties;
use psrgs_vk::pass::project_backward_adam::{
    Constants, DECIDES, LearningRates, PASS, Push, STEP_SHIFT, StepCounts, catching_up, constants, listed, penalising,
    reading_again,
};
use psrgs_vk::pass::{Pass, counters, project_backward};
use psrgs_vk::scene::Gaussians;
use psrgs_vk::scene::random::Random;
use psrgs_vk::scene::tile::TileGrid;
use psrgs_vk::twin::project::project;
use psrgs_vk::twin::project_backward::{
    Grad2d, decide as add_decision, flatten as add_flatness, price as add_price, project_backward as gradient_of,
    shrink as add_smallness,
};
use psrgs_vk::twin::project_backward_adam::{Pace, SplatState, step_after, view};
use psrgs_vk::twin::splat::{PARAMETERS, Splat, TwinCamera};
use psrgs_vk::vk::{DeviceKind, Gpu};

use super::common::splats::seeded;
use super::harness::{self, bytes, garbage};
use super::projection_scene as scene;

pub(super) const ROWS: [usize; 8] = [3, 4, 3, 1, 12, 12, 12, 12];
const RATES: LearningRates =
    LearningRates { means: 8e-4, quats: 1e-3, scales: 5e-3, opacities: 0.025, sh_base: 2.5e-3, sh_rest: 1.25e-4 };

/// The input of a dispatch, and its results in f64.
pub(super) struct Case {
    pub(super) n: usize,
    pub(super) push: Push,
    degree: u32,
    aux: bool,
    penalties: Penalties,
    steppers: Steppers,
    settings: AdamSettings,
    /// Buffers in binding order; `stats` is the last.
    pub(super) buffers: Vec<Vec<u8>>,
    camera: psrgs_vk::pass::camera::CameraPush,
    tiles: Vec<u32>,
    before: Vec<SplatState<f64>>,
    /// Results where missed steps are made up for, each with its pace.
    caught: Vec<(SplatState<f64>, Option<Pace>)>,
    want: Vec<SplatState<f64>>,
    /// Gradients, and the bounds of the device's errors.
    gradients: Vec<([f64; PARAMETERS], [f64; PARAMETERS])>,
}

/// The family of parameters against which an f32 gradient is judged, and its bound (see `project_backward`).
fn family(k: usize) -> (std::ops::Range<usize>, f64) {
    match k {
        0..3 => (0..3, 2e-4),
        3..7 => (3..7, 2e-4),
        7..10 => (7..10, 2e-4),
        10 => (10..11, 1e-5),
        _ => (11..PARAMETERS, 1e-5),
    }
}

fn model_of(splats: &[Splat<f64>]) -> Gaussians {
    scene::model(splats)
}

/// Rounds moments to the bits that the device keeps.
pub(super) type Kept = fn(f64, f64) -> (f64, f64);

/// Options of a step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Form {
    pub(super) aux: bool,
    pub(super) steps: StepCounts,
    /// Some gradients are not finite.
    pub(super) poison: bool,
    /// Losses on the splats themselves.
    pub(super) penalties: Penalties,
    pub(super) steppers: Steppers,
    /// Decay of the second moments.
    pub(super) beta2: f64,
}

/// A step of all parameters of all splats, with the published decay, on finite gradients, also of depth and normals.
pub(super) fn plain(steps: StepCounts) -> Form {
    let penalties = Penalties::default();
    Form { aux: true, steps, poison: false, penalties, steppers: Steppers::All, beta2: 0.999 }
}

/// The splats that take a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Steppers {
    /// All splats.
    All,
    /// Splats on the image, which also make up for missed steps.
    Listed,
    /// No splat, but all make up for missed steps.
    CatchUp,
}

/// A step of `model`. Harmonics up to `most` have been in use: moments above are zero.
pub(super) fn case(model: &Gaussians, projection: &Projection, most: u32, form: Form, kept: Kept) -> Case {
    let Form { aux, steps, poison, penalties, steppers, beta2 } = form;
    let n = model.len();
    let settings = AdamSettings { beta2, ..AdamSettings::default() };
    let camera = scene::push(projection);
    let push = Push::new(&camera, &settings, &RATES, steps).deciding(penalties.decide > 0.5);
    let full = TwinCamera::<f64>::of(&camera);
    let grid = TileGrid::new(full.size, [16, 16]);
    let mut random = seeded(7 + n as u64);
    let (mut splat2d, mut tiles) = (vec![[f32::NAN; 12]; n], vec![0u32; n]);
    let (mut grad2d, mut normals) = (vec![[f32::NAN; 12]; n], vec![[f32::NAN; 4]; n]);
    let (mut before, mut gradients) = (Vec::new(), Vec::new());
    for i in 0..n {
        let splat = Splat::<f64>::of(model, i);
        let on_device = project(&Splat::<f32>::of(model, i), &TwinCamera::of(&camera), Some(&grid)).is_ok();
        let seen = project(&splat, &full, Some(&grid)).ok().filter(|_| on_device);
        let (mut g, mut error) = ([0.0; PARAMETERS], [0.0; PARAMETERS]);
        if let Some(p) = seen {
            tiles[i] = p.tiles;
            splat2d[i] = p.row().map(|v| v as f32);
            let size = 1.0 / (p.conic[0] * p.conic[2]).sqrt();
            grad2d[i] = std::array::from_fn(|k| match k {
                2..=4 => (size * random.symmetric()) as f32,
                10 | 11 => f32::NAN,
                // Without normals the depth has no gradient.
                9 if !aux => 0.0,
                _ => random.symmetric() as f32,
            });
            if poison && i % 5 == 0 {
                grad2d[i][0] = f32::NAN;
            }
            if poison && i % 5 == 1 {
                grad2d[i][6] = f32::INFINITY;
            }
            normals[i] = std::array::from_fn(|k| if aux && k < 3 { random.symmetric() as f32 } else { f32::NAN });
            let normal = if aux { [0, 1, 2].map(|k| f64::from(normals[i][k])) } else { [0.0; 3] };
            let up = Grad2d { row: grad2d[i].map(f64::from), normal };
            let colour = [8, 9, 10].map(|c| f64::from(splat2d[i][c]));
            let mut gradient = gradient_of(&splat, &full, colour, &up);
            add_flatness(&mut gradient, splat.log_scale, f64::from(penalties.flatten));
            add_smallness(&mut gradient, &splat.sh, full.sh_degree, f64::from(penalties.shrink));
            // A weight of at most one half is compiled but not asked for by the push constants.
            let weight = if penalties.decide > 0.5 { penalties.decide } else { 0.0 };
            add_decision(&mut gradient, splat.logit, f64::from(weight));
            g = gradient.to_array();
            let condition = if projection.antialias { scene::condition(&splat, &full) } else { 1.0 };
            error = std::array::from_fn(|k| {
                let (range, bound) = family(k);
                let largest = g[range].iter().fold(0.0f64, |m, v| m.max(v.abs()));
                bound * largest * if k == 10 { condition } else { 1.0 }
            });
        }
        let mut priced = Splat::from_array(&[0.0; PARAMETERS]);
        let prices = [penalties.opacity, penalties.scale].map(|weight| f64::from(weight) / n as f64);
        add_price(&mut priced, splat.log_scale, splat.logit, prices);
        for (k, price) in priced.to_array().into_iter().enumerate().filter(|(_, price)| *price != 0.0) {
            g[k] += price;
            error[k] += 1e-5 * price.abs();
        }
        // Moments in the size that these gradients leave, in f32.
        let used = 11 + 3 * (most as usize + 1).pow(2);
        let f = |x: f64| f64::from(x as f32);
        let size: [f64; PARAMETERS] = g.map(|v| if v.is_finite() { v.abs().clamp(1e-6, 1e9) } else { 1.0 });
        let moment = |random: &mut Random, scale: &dyn Fn(f64, f64) -> f64| -> Splat<f64> {
            let values: [f64; PARAMETERS] =
                std::array::from_fn(|k| if k < used { f(scale(size[k], random.symmetric())) } else { 0.0 });
            Splat::from_array(&values)
        };
        let first = moment(&mut random, &|size, x| size * x).to_array();
        let second = moment(&mut random, &|size, x| size * size * (1.5 + x)).to_array();
        let kept: [(f64, f64); PARAMETERS] = std::array::from_fn(|k| kept(first[k], second[k]));
        let [first, second] = [kept.map(|m| m.0), kept.map(|m| m.1)].map(|values| Splat::from_array(&values));
        before.push(SplatState { splat, first, second });
        gradients.push((g, error));
    }
    let given = of(penalising(constants(&settings, most, aux), penalties), steppers);
    let values: Vec<u32> = given.iter().map(|(_, value)| *value).collect();
    let seen: Vec<u32> = (0..n as u32).filter(|i| tiles[*i as usize] > 0).collect();
    // Steps are known modulo 2^16. Steps before the last catch-up of all splats are remains of other rows.
    let now = push.flags >> STEP_SHIFT;
    let caught_up = now.wrapping_sub(60) & 0xffff;
    // Some splats have moved in advance: by nothing, by too little, by too much.
    let last = |i: usize| {
        let advanced = [0, 0, 30, 200][(i / 3) % 4] as f32;
        (now.wrapping_sub(1 + (i as u32 * 7) % 90) & 0xffff) as f32 + 65536.0 * advanced
    };
    let stats: Vec<[f32; 4]> = (0..n).map(|i| [1.5, -2.5, 3.5, last(i)]).collect();
    let steps = |i: usize| steppers != Steppers::Listed || tiles[i] > 0;
    let caught: Vec<(SplatState<f64>, Option<Pace>)> = (0..n)
        .map(|i| {
            let pace = match steppers {
                Steppers::All => None,
                _ if !steps(i) => None,
                _ => Pace::new(&push, &values, stats[i][3], caught_up),
            };
            let Some(pace) = pace else { return (before[i].clone(), None) };
            assert!(pace.missed <= 60, "{pace:?}");
            let only = of(constants(&settings, most, aux), Steppers::CatchUp).map(|(_, value)| value);
            (step_after(&push, &only, &before[i], &Splat::from_array(&[0.0; PARAMETERS]), pace), Some(pace))
        })
        .collect();
    let after = |i: usize| match (steppers, caught[i].1) {
        _ if !steps(i) => before[i].clone(),
        (Steppers::CatchUp, _) => caught[i].0.clone(),
        (_, pace) => {
            step_after(&push, &values, &before[i], &Splat::from_array(&gradients[i].0), pace.unwrap_or_default())
        }
    };
    let want = (0..n).map(after).collect();
    if steppers == Steppers::CatchUp {
        gradients.iter_mut().for_each(|g| *g = ([0.0; PARAMETERS], [0.0; PARAMETERS]));
    }

    let mut counts: Vec<u32> =
        scene::counts_of(n, seen.len()).chunks_exact(4).map(bytemuck::pod_read_unaligned).collect();
    counts[counters::CAUGHT_UP] = caught_up;
    let mut buffers = vec![bytes(&counts)];
    let on_image = if steppers == Steppers::Listed { bytes(&seen) } else { bytes(&tiles) };
    buffers.extend([bytes(&splat2d), on_image, bytes(&grad2d), bytes(&normals)].map(|b| [b, garbage(8)].concat()));
    for k in 0..3 {
        let values: Vec<Splat<f64>> = before.iter().map(|s| [&s.splat, &s.first, &s.second][k].clone()).collect();
        buffers.extend(scene::planes(&model_of(&values)));
    }
    buffers.push([bytes(&stats), garbage(8)].concat());
    let degree = most;
    Case {
        n,
        push,
        degree,
        aux,
        penalties,
        steppers,
        settings,
        buffers,
        camera,
        tiles,
        before,
        caught,
        want,
        gradients,
    }
}

/// Total move of an element by its moments, up to a factor of the bias corrections, which is at most 4 here.
fn all_moves(rates: &LearningRates, adam: &AdamSettings, k: usize, first: f64, second: f64) -> f64 {
    let decay = adam.beta1 / adam.beta2.sqrt();
    let rate = match k {
        0..3 => rates.means,
        3..7 => rates.quats,
        7..10 => rates.scales,
        10 => rates.opacities,
        11..14 => rates.sh_base,
        _ => rates.sh_rest,
    };
    4.0 * decay / (1.0 - decay) * rate * first.abs() / second.sqrt().max(1e-300)
}

fn of(constants: Constants, steppers: Steppers) -> Constants {
    match steppers {
        Steppers::All => constants,
        Steppers::Listed => listed(constants),
        Steppers::CatchUp => catching_up(constants),
    }
}

/// The planes of a dispatch as splats.
pub(super) fn splats_of(planes: &[Vec<f32>], n: usize) -> Vec<[f32; PARAMETERS]> {
    let model = Gaussians {
        means: planes[0][..3 * n].to_vec(),
        quats: planes[1][..4 * n].to_vec(),
        scales: planes[2][..3 * n].to_vec(),
        opacities: planes[3][..n].to_vec(),
        sh: std::array::from_fn(|g| planes[4 + g][..12 * n].to_vec()),
        ids: Vec::new(),
    };
    (0..n).map(|i| Splat::<f32>::of(&model, i).to_array()).collect()
}

impl Case {
    pub(super) fn given(&self) -> Constants {
        let constants = constants(&self.settings, self.degree, self.aux);
        of(penalising(constants, self.penalties), self.steppers)
    }

    /// Runs on the device. Words beyond the rows and read-only buffers must keep their bits.
    fn run(&self, gpu: &Gpu, what: &str) -> harness::Outcome {
        let groups = self.n.div_ceil(64).max(1) as u32;
        let outcome = harness::run(gpu, &PASS, &self.given(), &self.buffers, &self.push, groups);
        assert_eq!(outcome.device[..5], self.buffers[..5], "{what}: inputs changed");
        if harness::rounds_alike(gpu) {
            let again = harness::run(gpu, &PASS, &reading_again(self.given()), &self.buffers, &self.push, groups);
            assert!(again.device == outcome.device, "{what}: other bits where coefficients are read again");
        }
        self.check_stats(&outcome, what);
        for first in [5, 13, 21] {
            for (k, row) in ROWS.into_iter().enumerate() {
                let rows = 4 * row * self.n;
                assert_eq!(
                    outcome.device[first + k][rows..],
                    self.buffers[first + k][rows..],
                    "{what}: beyond its rows"
                );
            }
        }
        outcome
    }

    /// Checks that the last column has the step for stepped and moved splats, and that all else is unchanged.
    pub(super) fn check_stats(&self, outcome: &harness::Outcome, what: &str) {
        let stats = self.buffers.len().min(outcome.device.len()) - 1;
        let mut want: Vec<f32> =
            self.buffers[self.buffers.len() - 1].chunks_exact(4).map(bytemuck::pod_read_unaligned).collect();
        for i in 0..self.n {
            if let Some(pace) = self.caught[i].1 {
                want[4 * i + 3] = pace.row(&self.push);
            }
        }
        assert_eq!(outcome.device[stats], bytes(&want), "{what}: statistics");
    }

    fn check(&self, gpu: &Gpu, what: &str) {
        let outcome = self.run(gpu, what);
        let planes = |first: usize| (first..first + 8).map(|k| outcome.device::<f32>(k)).collect::<Vec<_>>();
        let of_planes = [5, 13, 21].map(|first| splats_of(&planes(first), self.n));
        self.judge(of_planes, |_, _| (0.0, 0.0), what);
    }

    /// Parameters, first and second moments against f64; `rounding` of a first and a second moment is added to their
    /// bounds.
    pub(super) fn judge(
        &self,
        [params, first, second]: [Vec<[f32; PARAMETERS]>; 3],
        rounding: impl Fn(f64, f64) -> (f64, f64),
        what: &str,
    ) {
        let eps = f64::from(f32::EPSILON);
        let mut moved = 0;
        for (i, ((params, first), second)) in params.iter().zip(&first).zip(&second).enumerate() {
            let (before, (caught, pace), want) = (&self.before[i], &self.caught[i], &self.want[i]);
            let arrays = |s: &SplatState<f64>| [s.splat.to_array(), s.first.to_array(), s.second.to_array()];
            let ([p00, m00, v00], [p0, m0, v0], [p1, m1, v1]) = (arrays(before), arrays(caught), arrays(want));
            let (g, dg) = &self.gradients[i];
            // A power by squaring has as many roundings as factors.
            let slack = pace.map_or(0.0, |pace| (2.0 * f64::from(pace.missed) + 16.0) * eps);
            for k in 0..PARAMETERS {
                let [p, m, v] = [params, first, second].map(|splat| f64::from(splat[k]));
                if (p1[k], m1[k], v1[k]) == (p00[k], m00[k], v00[k]) {
                    assert_eq!((p, m, v), (p00[k], m00[k], v00[k]), "{what}: splat {i}, element {k} should not move");
                    continue;
                }
                moved += 1;
                let dm =
                    (1.0 - self.settings.beta1) * dg[k] + 2.0 * eps * (m0[k].abs() + g[k].abs()) + slack * m0[k].abs();
                let dv = (1.0 - self.settings.beta2) * dg[k] * (2.0 * g[k].abs() + dg[k])
                    + 4.0 * eps * v1[k]
                    + slack * v0[k]
                    + 1e-37;
                let (rm, rv) = rounding(m1[k], v1[k]);
                assert!(
                    (m - m1[k]).abs() <= dm + rm,
                    "{what}: splat {i}, first moment {k}: {m:e} instead of {:e}",
                    m1[k]
                );
                assert!(
                    (v - v1[k]).abs() <= dv + rv,
                    "{what}: splat {i}, second moment {k}: {v:e} instead of {:e}",
                    v1[k]
                );
                let step = (p1[k] - p0[k]).abs();
                let share = dm / m1[k].abs().max(1e-300) + dv / v1[k].max(1e-300) + 16.0 * eps;
                // Missed moves and moves in advance may cancel.
                let of_missed = match pace {
                    Some(_) => {
                        slack * ((p0[k] - p00[k]).abs() + all_moves(&RATES, &self.settings, k, m00[k], v00[k]))
                            + eps * p0[k].abs()
                    }
                    None => 0.0,
                };
                let dp = step * share + of_missed + eps * p1[k].abs() + 1e-30;
                assert!((p - p1[k]).abs() <= dp, "{what}: splat {i}, parameter {k}: {p:e} instead of {:e}", p1[k]);
            }
        }
        assert!(moved >= 10 * self.n, "{what}: only {moved} elements of {} splats moved", self.n);
    }

    /// Against `project_backward` and eight times `adam`.
    fn check_against_unfused(&self, gpu: &Gpu, steps: StepCounts, what: &str) {
        let groups = self.n.div_ceil(64).max(1) as u32;
        let of = |pass: &Pass, given: &[(&str, u32)], buffers: &[Vec<u8>], groups| {
            assert_eq!(buffers.len(), pass.kernel.bindings.len());
            harness::run(gpu, pass, given, buffers, &self.camera, groups)
        };
        let mut buffers = vec![self.buffers[0].clone()];
        buffers.extend_from_slice(&self.buffers[5..13]);
        buffers.extend_from_slice(&self.buffers[1..5]);
        buffers.extend(ROWS.map(|row| garbage(row * self.n + scene::BEYOND)));
        let decide = if self.push.flags & DECIDES != 0 { self.penalties.decide } else { 0.0 };
        let weights = Penalties { decide, ..self.penalties }.constants();
        let given = [&[("AUX", u32::from(self.aux))], weights.as_slice()].concat();
        let gradients = of(&project_backward::PASS, &given, &buffers, groups);
        let fused = self.run(gpu, what);
        let rates = [RATES.means, RATES.quats, RATES.scales, RATES.opacities];
        for (k, row) in ROWS.into_iter().enumerate() {
            let planes = [5, 13, 21].map(|first| self.buffers[first + k].clone());
            let mut after = planes.clone();
            if let Some(t) = if k == 3 { steps.opacities } else { Some(steps.most) } {
                let rest = rates.get(k).copied().unwrap_or(RATES.sh_rest);
                let head = if k == 4 { 3 } else { 0 };
                let push = adam::Push::new(&self.settings, t, row as u32, head, RATES.sh_base, rest);
                let mut buffers = vec![self.buffers[0].clone(), gradients.device[13 + k].clone()];
                buffers.extend(planes);
                let groups = (row * self.n).div_ceil(64).max(1) as u32;
                let stepped = harness::run(gpu, &adam::PASS, &[], &buffers, &push, groups);
                after = std::array::from_fn(|j| stepped.device[2 + j].clone());
            }
            for (j, first) in [5, 13, 21].into_iter().enumerate() {
                let same = fused.device[first + k] == after[j];
                assert!(same, "{what}: {} differs", PASS.kernel.bindings[first + k].name);
            }
        }
    }

    pub(super) fn seen(&self) -> usize {
        self.tiles.iter().filter(|t| **t > 0).count()
    }
}

pub fn run(gpu: &Gpu) {
    // On a GPU, a compiler may contract the gradients of the two forms differently: the f64 twin bounds both.
    let same_bits = gpu.caps().kind == DeviceKind::Cpu;
    let all = StepCounts { most: 9, opacities: Some(4) };
    let form = plain(all);
    let exact: Kept = |m, v| (m, v);
    for n in [0, 1, 63, 64, 65] {
        let case = case(&scene::ordinary(n, 300 + n as u64), &Projection::default(), 3, form, exact);
        case.check(gpu, &format!("{n} splats"));
    }
    for (k, projection) in scene::settings().into_iter().enumerate() {
        // The degree in use, and one more where one more was in use before.
        let most = (projection.sh_degree + u32::from(k >= 4)).min(3);
        let steps = if k % 3 == 2 { StepCounts { most: 30, opacities: None } } else { all };
        let form = Form {
            aux: k % 2 == 1,
            poison: k == 5,
            penalties: Penalties {
                flatten: if k == 2 || k == 5 { 0.7 } else { 0.0 },
                shrink: if k % 2 == 1 { 0.6 } else { 0.0 },
                opacity: if k % 3 == 1 { 90.0 } else { 0.0 },
                scale: if k % 3 == 1 || k == 3 { 150.0 } else { 0.0 },
                decide: [0.0, 0.8, 0.4][k % 3],
            },
            beta2: if k % 2 == 0 { 0.98 } else { 0.999 },
            ..plain(steps)
        };
        let case = case(&scene::ordinary(600, 20 + k as u64), &projection, most, form, exact);
        let what = format!("{projection:?}, {steps:?}");
        assert!(case.seen() > 250 && case.seen() < 600, "{what}: {} seen", case.seen());
        case.check(gpu, &what);
        if same_bits {
            case.check_against_unfused(gpu, steps, &what);
        }
    }
    for antialias in [false, true] {
        let projection = Projection { antialias, ..Projection::default() };
        let case = case(&scene::hard(), &projection, 3, form, exact);
        case.check(gpu, &format!("hard splats, anti-aliasing {antialias}"));
        if same_bits {
            case.check_against_unfused(gpu, all, "hard splats");
        }
    }
    // The splats on the image alone, and all with missed steps. Step 70,000 wraps around.
    for (k, projection) in scene::settings().into_iter().enumerate() {
        let most = projection.sh_degree.min(3);
        let beta2 = if k % 4 < 2 { 0.98 } else { 0.999 };
        let steps = if k % 2 == 0 { StepCounts { most: 70_000, opacities: Some(69_999) } } else { all };
        let penalties = Penalties { shrink: 0.6, opacity: 90.0, scale: 150.0, decide: 0.8, ..Penalties::default() };
        let form = Form { aux: k % 2 == 0, penalties, steppers: Steppers::Listed, steps, beta2, ..form };
        let model = scene::ordinary(600, 80 + k as u64);
        let listed = case(&model, &projection, most, form, exact);
        assert!(listed.seen() > 250 && listed.seen() < 560, "{projection:?}: {} seen", listed.seen());
        listed.check(gpu, &format!("{projection:?}, those on the image alone"));
        let form = Form { aux: false, steppers: Steppers::CatchUp, ..form };
        case(&model, &projection, most, form, exact).check(gpu, &format!("{projection:?}, all caught up with"));
    }
    for steppers in [Steppers::All, Steppers::Listed, Steppers::CatchUp] {
        twin_adapter(gpu, steppers);
    }
}

/// The twin on raw buffers agrees with the typed twin in f32.
fn twin_adapter(gpu: &Gpu, steppers: Steppers) {
    let steps = StepCounts { most: 3, opacities: Some(2) };
    let penalties = Penalties { opacity: 90.0, scale: 150.0, decide: 0.8, ..Penalties::default() };
    let form = Form { steppers, beta2: 0.98, penalties, ..plain(steps) };
    let case = case(&scene::ordinary(100, 5), &Projection::default(), 3, form, |m, v| (m, v));
    let outcome = case.run(gpu, "adapter");
    assert_eq!(view::<f64>(&case.push).focal, TwinCamera::<f64>::of(&case.camera).focal);
    assert_eq!(outcome.device[29], outcome.twin[29], "statistics");
    for k in 5..29 {
        let (device, twin) = (outcome.device::<f32>(k), outcome.twin::<f32>(k));
        let largest = twin[..case.n].iter().fold(0.0f32, |m, v| m.max(v.abs()));
        let rows = ROWS[(k - 5) % 8] * case.n;
        let off =
            device[..rows].iter().zip(&twin[..rows]).filter(|(d, t)| (**d - **t).abs() > 1e-3 * (t.abs() + largest));
        assert!(off.count() * 100 < rows, "{}", PASS.kernel.bindings[k].name);
    }
}
