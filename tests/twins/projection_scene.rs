//! Models, cameras and buffers for the tests of `project` and `project_backward`.

use psrgs_vk::pass::camera::{CameraPush, Projection};
use psrgs_vk::pass::counters;
use psrgs_vk::scene::random::Random;
use psrgs_vk::scene::{Camera, Gaussians};
use psrgs_vk::twin::project::geometry;
use psrgs_vk::twin::splat::{Splat, TwinCamera};

use super::common::splats::{camera, seeded, spread, to_scene};
use super::harness::{bytes, garbage};

/// Words of every buffer beyond what the pass may touch.
pub const BEYOND: usize = 40;

/// The camera of the projection tests.
pub fn view() -> Camera {
    camera(200, 150)
}

/// The camera of a projection: [`view`], or one of parallel rays that looks the same way.
pub fn view_of(projection: &Projection) -> Camera {
    match projection.orthographic {
        true => Camera { fx: 41.3, fy: 37.7, cx: 95.0, cy: 81.0, ..view() },
        false => view(),
    }
}

/// Splats in f32.
pub fn model(splats: &[Splat<f64>]) -> Gaussians {
    let mut out = Gaussians::zeros(splats.len());
    for (i, splat) in splats.iter().enumerate() {
        splat.store(&mut out, i);
    }
    out
}

/// `n` ordinary splats, some of them off screen.
pub fn ordinary(n: usize, seed: u64) -> Gaussians {
    let mut random = seeded(seed);
    model(&(0..n).map(|_| spread(&mut random, &view(), 1.5)).collect::<Vec<_>>())
}

/// Hard but finite splats: through the near plane, far off the frustum, vanishing quaternions and scales, saturated
/// logits, needles, giants, specks.
pub fn hard() -> Gaussians {
    let view = view();
    let mut random = seeded(99);
    let mut splats = Vec::new();
    let mut push = |random: &mut Random, change: &dyn Fn(&mut Splat<f64>)| {
        let mut splat = spread(random, &view, 1.0);
        change(&mut splat);
        splats.push(splat);
    };
    let at = |x: f64, y: f64, z: f64| to_scene(&view, [x * z, y * z, z]);
    for step in -40..=40 {
        push(&mut random, &|s| s.mean = at(0.1, -0.1, 0.2 * (1.0 + 1e-3 * f64::from(step))));
        push(&mut random, &|s| s.mean = to_scene(&view, [0.01, 0.02, 0.005 * f64::from(step)]));
    }
    for step in 0..40 {
        // Steps that avoid both ends of the field-of-view clamp, where rounding picks the side.
        let far = 0.21 * f64::from(step);
        push(&mut random, &|s| s.mean = at(far, 0.5 * far, 1.0));
        push(&mut random, &|s| s.mean = at(-far, far, 3.0));
        push(&mut random, &|s| s.mean = at(0.3 * far, 0.0, -1.0));
    }
    push(&mut random, &|s| s.mean = view.center());
    for tiny in [0.0, 1e-30, 1e-13, 1e-11, 1e-6, 1e6, 1e15] {
        push(&mut random, &|s| s.quat = [tiny, -tiny, 0.5 * tiny, 0.0]);
    }
    for log_scale in [-100.0, -50.0, -20.0, -12.0, 4.0, 8.0, 20.0, 60.0, 100.0] {
        push(&mut random, &|s| s.log_scale = [log_scale; 3]);
        push(&mut random, &|s| s.log_scale[1] = log_scale);
    }
    for logit in [-100.0, -30.0, -5.5, -5.0, 5.0, 30.0, 100.0] {
        push(&mut random, &|s| s.logit = logit);
    }
    for _ in 0..40 {
        push(&mut random, &|s| s.log_scale = [0.0, -6.9, -6.9]);
        push(&mut random, &|s| s.log_scale = [-8.0, -7.0, -9.0]);
        push(&mut random, &|s| s.log_scale = [1.5, 1.0, -3.0]);
    }
    model(&splats)
}

/// The tested combinations of settings.
pub fn settings() -> Vec<Projection> {
    (0..8)
        .map(|k| Projection {
            sh_degree: k % 4,
            antialias: k >= 4,
            reference_clamp: k == 6,
            black_learns: k % 2 == 1,
            ..Projection::default()
        })
        .collect()
}

/// The counters of a model of `n` splats.
pub fn counts(n: usize) -> Vec<u8> {
    counts_of(n, 7)
}

/// As [`counts`], with `visible` splats on the image.
pub fn counts_of(n: usize, visible: usize) -> Vec<u8> {
    let mut words = [7u32; counters::COUNT];
    (words[counters::SPLATS], words[counters::PLAIN]) = (n as u32, 0);
    words[counters::VISIBLE] = visible as u32;
    bytes(&words)
}

/// The model's planes in binding order, each followed by words that the pass must not read as splats.
pub fn planes(model: &Gaussians) -> Vec<Vec<u8>> {
    let [sh0, sh1, sh2, sh3] = &model.sh;
    [&model.means, &model.quats, &model.scales, &model.opacities, sh0, sh1, sh2, sh3]
        .iter()
        .map(|plane| [bytes(plane), garbage(BEYOND)].concat())
        .collect()
}

/// Buffers of `project` with garbage in its outputs.
pub fn project_buffers(model: &Gaussians) -> Vec<Vec<u8>> {
    let n = model.len();
    let mut buffers = vec![counts(n)];
    buffers.extend(planes(model));
    buffers.extend([garbage(12 * n + BEYOND), garbage(n + BEYOND), garbage(4 * n + BEYOND)]);
    buffers
}

/// The camera as push constants.
pub fn push(projection: &Projection) -> CameraPush {
    CameraPush::new(&view_of(projection), projection)
}

/// The largest slopes of the depth, along x and y, that a splat of this deviation of the depth and this conic can have.
pub fn steepest(splat: &Splat<f64>, view: &TwinCamera<f64>) -> [f64; 2] {
    let (_, e) = geometry(splat, view);
    let deviation = e.u[2].iter().map(|x| x * x).sum::<f64>().sqrt();
    [e.conic[0], e.conic[2]].map(|inverse_variance| inverse_variance.sqrt() * deviation)
}

/// Condition number of a splat's 2D shape: the rows of J W R S are differences (`u_k - ratio u_2`), and their area, a
/// cross product, is a difference again.
pub fn condition(splat: &Splat<f64>, view: &TwinCamera<f64>) -> f64 {
    let (_, e) = geometry(splat, view);
    let norm = |v: &[f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let pulled = (0..2).fold(1.0f64, |worst, k| {
        worst.max(e.zoom[k] * (norm(&e.u[k]) + e.ratio[k].abs() * norm(&e.u[2])) / norm(&e.m[k]))
    });
    pulled * norm(&e.m[0]) * norm(&e.m[1]) / norm(&e.n)
}
