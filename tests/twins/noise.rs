//! `noise`: against the f64 twin, and its distribution over many splats.

use psrgs_vk::pass::counters::{self, SPLATS};
use psrgs_vk::pass::noise::{PASS, Push};
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::noise::displacement;
use psrgs_vk::twin::projection::rotation;
use psrgs_vk::vk::Gpu;

use super::harness::{self, Words, bytes};

/// Rows beyond the model.
const BEYOND: usize = 3;

/// A set of splats before the noise.
struct Splats {
    means: Vec<[f32; 3]>,
    quats: Vec<[f32; 4]>,
    scales: Vec<[f32; 3]>,
    opacities: Vec<f32>,
    ids: Vec<u32>,
}

impl Splats {
    fn random(n: usize) -> Self {
        let random = &mut Random::new(70 + n as u64);
        let rows = n + BEYOND;
        let mut out = Self {
            means: (0..rows).map(|_| [0; 3].map(|_| random.between(-4.0, 4.0))).collect(),
            quats: (0..rows).map(|_| [0; 4].map(|_| random.between(-2.0, 2.0))).collect(),
            scales: (0..rows).map(|_| [0; 3].map(|_| random.between(-6.0, 1.0))).collect(),
            opacities: (0..rows).map(|_| random.between(-9.0, 3.0)).collect(),
            ids: random.words(rows),
        };
        // A zero quaternion is no rotation; a move beyond all bounds is left out.
        if let [first, second, ..] = &mut out.quats[..] {
            *first = [0.0; 4];
            *second = [1.0, 0.0, 0.0, 0.0];
            (out.scales[1], out.opacities[1]) = ([60.0; 3], -9.0);
        }
        out
    }

    /// Means after the noise: on the device, and of the twin on raw buffers.
    fn moved(&self, gpu: &Gpu, push: &Push) -> [Vec<[f32; 3]>; 2] {
        let n = self.means.len() - BEYOND;
        let mut counts = [0_u32; counters::COUNT];
        counts[SPLATS] = n as u32;
        let buffers = [
            bytes(&counts),
            bytes(&self.means),
            bytes(&self.quats),
            bytes(&self.scales),
            bytes(&self.opacities),
            bytes(&self.ids),
        ];
        let outcome = harness::run(gpu, &PASS, &[], &buffers, push, n.div_ceil(64).max(1) as u32);
        for k in [0, 2, 3, 4, 5] {
            assert_eq!(outcome.device[k], buffers[k], "inputs changed");
        }
        [outcome.device(1), outcome.twin(1)]
    }
}

fn agrees(gpu: &Gpu, n: usize) {
    let splats = Splats::random(n);
    let push = Push { rate: 300.0, seed: 11, step: 1234 };
    let [device, twin] = splats.moved(gpu, &push);
    for i in 0..n + BEYOND {
        let key = [push.seed, push.step, splats.ids[i]];
        let (quat, scale) = (splats.quats[i].map(f64::from), splats.scales[i].map(f64::from));
        let want = displacement(quat, scale, f64::from(splats.opacities[i]), f64::from(push.rate), key);
        let stays = i >= n || want.iter().any(|v| v.abs() > 1e38);
        let size = want.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        for k in 0..3 {
            let mean = f64::from(splats.means[i][k]);
            for got in [device[i][k], twin[i][k]] {
                let (error, bound) = match stays {
                    true => (f64::from(got) - mean, 0.0),
                    // An exponential function on GPUs errs by 2e-5 here, and the sum by its rounding.
                    false => (f64::from(got) - mean - want[k], 3e-4 * size + 3e-7 * (mean.abs() + size)),
                };
                assert!(error.abs() <= bound, "splat {i} of {n}, axis {k}: {got} from {mean}, by {}", want[k]);
            }
        }
    }
}

/// Of equal splats, moves have mean zero and the covariance (rate x faintness x covariance of the splat) squared.
fn distribution(gpu: &Gpu) {
    let n = 20_000;
    let (quat, sigma) = ([0.8_f32, 0.1, -0.5, 0.3], [0.4_f64, 0.1, 0.2]);
    let ids: Vec<u32> = (0..(n + BEYOND) as u32).collect();
    let equal = |logit: f32| Splats {
        means: vec![[0.0; 3]; n + BEYOND],
        quats: vec![quat; n + BEYOND],
        scales: vec![sigma.map(|s| s.ln() as f32); n + BEYOND],
        opacities: vec![logit; n + BEYOND],
        ids: ids.clone(),
    };
    let push = |step| Push { rate: 2.0, seed: 5, step };
    let [moves, _] = equal(-6.0).moved(gpu, &push(9));
    let rows = rotation(quat.map(f64::from)).rows;
    let opacity = 1.0 / (1.0 + 6.0_f64.exp());
    let gain = 2.0 / (1.0 + (100.0 * (opacity - 0.005)).exp());
    let root = |a: usize, b: usize| gain * (0..3).map(|k| rows[a][k] * sigma[k].powi(2) * rows[b][k]).sum::<f64>();
    let mean = |f: &dyn Fn([f64; 3]) -> f64| moves[..n].iter().map(|m| f(m.map(f64::from))).sum::<f64>() / n as f64;
    let variance = |a: usize, b: usize| (0..3).map(|k| root(a, k) * root(k, b)).sum::<f64>();
    for a in 0..3 {
        let deviation = variance(a, a).sqrt();
        // Five standard errors.
        assert!(mean(&|m| m[a]).abs() < 5.0 * deviation / (n as f64).sqrt(), "mean of axis {a}");
        for b in 0..3 {
            let (got, want) = (mean(&|m| m[a] * m[b]), variance(a, b));
            let error = 5.0 * (variance(a, a) * variance(b, b) * 2.0 / n as f64).sqrt();
            assert!((got - want).abs() < error, "covariance of axes {a} and {b}: {got} instead of {want}");
        }
    }
    let [others, _] = equal(-6.0).moved(gpu, &push(10));
    let same = moves[..n].iter().zip(&others).map(|(m, o)| f64::from(m[0] * o[0])).sum::<f64>() / n as f64;
    assert!(same.abs() < 5.0 * variance(0, 0) / (n as f64).sqrt(), "steps draw independently: {same}");
    let [opaque, _] = equal(2.0).moved(gpu, &push(9));
    assert!(opaque[..n].iter().all(|m| m.iter().all(|v| v.abs() < 1e-12)), "opaque splats stay");
}

pub fn run(gpu: &Gpu) {
    for n in [0, 1, 63, 64, 65, 500] {
        agrees(gpu, n);
    }
    distribution(gpu);
}
