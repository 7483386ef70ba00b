//! `project_backward_adam_packed`, which keeps moments in 16 bits each: a step against f64 from equal moments.

use psrgs_vk::pass::camera::Projection;
use psrgs_vk::pass::project_backward::Penalties;
use psrgs_vk::pass::project_backward_adam::StepCounts;
use psrgs_vk::pass::project_backward_adam_packed::PASS;
use psrgs_vk::twin::project_backward_adam_packed::{pack, unpack};
use psrgs_vk::twin::splat::PARAMETERS;
use psrgs_vk::vk::Gpu;

use super::harness::{self, bytes};
use super::project_backward_adam::{Case, Form, ROWS, Steppers, case, plain, splats_of};
use super::projection_scene as scene;

/// Moments after packing.
fn kept(first: f64, second: f64) -> (f64, f64) {
    let (first, second) = unpack(pack(first as f32, second as f32, 0));
    (f64::from(first), f64::from(second))
}

/// Half a unit of the first moment's half float, and a whole unit of the second moment's eight bits.
fn rounding(first: f64, second: f64) -> (f64, f64) {
    (first.abs() * 2f64.powi(-11) + second.sqrt() * 2f64.powi(-24), second * 2f64.powi(-8))
}

/// The planes of both moments as one plane of words, rows beyond the model included.
pub(super) fn packed(first: &[u8], second: &[u8]) -> Vec<u8> {
    let floats = |bytes: &[u8]| -> Vec<f32> { bytes.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect() };
    let words: Vec<u32> = floats(first).iter().zip(floats(second)).map(|(m, v)| pack(*m, v.abs(), 0)).collect();
    bytes(&words)
}

fn run_case(gpu: &Gpu, case: &Case) -> harness::Outcome {
    let mut buffers = case.buffers[..13].to_vec();
    buffers.extend((13..21).map(|k| packed(&case.buffers[k], &case.buffers[k + 8])));
    buffers.push(case.buffers[29].clone());
    let groups = case.n.div_ceil(64).max(1) as u32;
    let outcome = harness::run(gpu, &PASS, &case.given(), &buffers, &case.push, groups);
    assert_eq!(outcome.device[..5], buffers[..5], "inputs changed");
    case.check_stats(&outcome, "packed");
    for k in 5..21 {
        let rows = 4 * ROWS[(k - 5) % 8] * case.n;
        assert_eq!(outcome.device[k][rows..], buffers[k][rows..], "beyond the rows of {k}");
    }
    outcome
}

/// Parameters and unpacked moments after a dispatch.
fn unpacked(planes: impl Fn(usize) -> Vec<f32>, n: usize) -> [Vec<[f32; PARAMETERS]>; 3] {
    let params: Vec<Vec<f32>> = (5..13).map(&planes).collect();
    let words: Vec<Vec<f32>> = (13..21).map(&planes).collect();
    let words = splats_of(&words, n);
    let moments = |which: fn((f32, f32)) -> f32| {
        words.iter().map(|splat| splat.map(|word| which(unpack(word.to_bits())))).collect()
    };
    [splats_of(&params, n), moments(|m| m.0), moments(|m| m.1)]
}

pub fn run(gpu: &Gpu) {
    let steps = StepCounts { most: 9, opacities: Some(4) };
    let form = plain(steps);
    for n in [0, 1, 64, 65] {
        let case = case(&scene::ordinary(n, 500 + n as u64), &Projection::default(), 3, form, kept);
        let outcome = run_case(gpu, &case);
        case.judge(unpacked(|k| outcome.device(k), n), rounding, &format!("{n} splats"));
    }
    for (k, projection) in scene::settings().into_iter().enumerate() {
        let most = (projection.sh_degree + u32::from(k >= 4)).min(3);
        let opacities = (k % 3 != 2).then_some(4);
        let flatten = if k == 2 { 0.7 } else { 0.0 };
        let form = Form {
            aux: k % 2 == 1,
            steps: StepCounts { opacities, ..steps },
            poison: k == 5,
            penalties: Penalties { flatten, shrink: 0.5, opacity: 50.0, scale: 80.0, decide: 0.8 },
            steppers: [Steppers::All, Steppers::Listed, Steppers::CatchUp][k % 3],
            beta2: if k % 2 == 0 { 0.98 } else { 0.999 },
        };
        let case = case(&scene::ordinary(600, 60 + k as u64), &projection, most, form, kept);
        let what = format!("{projection:?}, {form:?}");
        assert!(case.seen() > 250, "{what}: {} seen", case.seen());
        let outcome = run_case(gpu, &case);
        case.judge(unpacked(|k| outcome.device(k), case.n), rounding, &what);
        dithers_as_the_twin_does(&outcome, case.n, &what);
    }
    let hard = case(&scene::hard(), &Projection::default(), 3, form, kept);
    let outcome = run_case(gpu, &hard);
    hard.judge(unpacked(|k| outcome.device(k), hard.n), rounding, "hard splats");
}

/// Random rounding has the twin's bits: words are equal where moments are, up to the last bits of their f32. With other
/// random bits half of all words would differ.
fn dithers_as_the_twin_does(outcome: &harness::Outcome, n: usize, what: &str) {
    let (mut same, mut words) = (0, 0);
    for k in 13..21 {
        let rows = ROWS[k - 13] * n;
        let (device, twin) = (outcome.device::<u32>(k), outcome.twin::<u32>(k));
        same += device[..rows].iter().zip(&twin[..rows]).filter(|(d, t)| **d >> 16 == **t >> 16).count();
        words += rows;
    }
    assert!(same * 100 > words * 97, "{what}: {same} of {words} second moments agree");
}
