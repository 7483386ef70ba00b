//! Twin of `glsl/project_backward.comp`.

use super::projection;
use super::splat::{Splat, TwinCamera, model_of};
use super::{Real, TwinCall, project, vec3};
use crate::pass::camera::CameraPush;
use crate::pass::counters;
use crate::scene::Gaussians;
use crate::scene::sh;

/// Gradients of one splat's projection: a row of `grad2d` (mean x, mean y, A, B, C, opacity, r, g, b, depth, two unused
/// values) and the normal's gradient.
#[derive(Clone, Debug)]
pub struct Grad2d<R> {
    /// The row of `grad2d`.
    pub row: [R; 12],
    /// The row of `grad_normals`; zeros without normals.
    pub normal: [R; 3],
}

/// Gradients of the 59 parameters of a splat that is on the image with colour `colour` (0 where it was clamped; see
/// [`crate::pass::camera::Projection::black_learns`]). The slopes of the depth count as constants.
pub fn project_backward<R: Real>(splat: &Splat<R>, view: &TwinCamera<R>, colour: [R; 3], g: &Grad2d<R>) -> Splat<R> {
    let o = R::zero();
    let (p, e) = project::geometry(splat, view);
    let passes = |c: usize| colour[c] > o || view.black_learns && g.row[6 + c] < o;
    let g_rgb: [R; 3] = std::array::from_fn(|c| if passes(c) { g.row[6 + c] } else { o });
    let (dir, distance) = project::direction(splat, view);
    let y = sh::basis(dir, view.sh_degree);
    let g_sh = y.map(|value| g_rgb.map(|v| value * v));
    let per_coefficient: [R; 16] = std::array::from_fn(|k| vec3::dot(splat.sh[k], g_rgb));
    let g_dir = sh::slope(dir, view.sh_degree, &per_coefficient);

    let [sigma, slope] = projection::sigmoid(splat.logit);
    let g_opacity = g.row[5];
    let logit = g_opacity * slope * if view.antialias { e.compensation } else { R::one() };
    let g_compensation = if view.antialias { g_opacity * sigma } else { o };

    let axis = projection::shortest_axis(splat.log_scale);
    let (_, side) = projection::normal(view, p, &e.rot, axis);
    let w = view.rotation;
    let g_axis = vec3::combine(vec3::scale(side, g.normal), w);
    let conic = [g.row[2], g.row[3], g.row[4]];
    let upstream = projection::EwaUpstream { conic, compensation: g_compensation, axis, of_axis: g_axis };
    let through = projection::backward(view, &e, p[2], &upstream);
    let mut g_p = through.p;
    g_p[2] += g.row[9];
    let slope = projection::depth_slope(&e);
    for k in 0..2 {
        // A moved mean moves the plane of the depths along.
        let moved = (g.row[k] - g.row[9] * slope[k]) * e.zoom[k];
        g_p[k] += moved;
        g_p[2] -= moved * (p[k] / p[2]);
    }
    let along = vec3::dot(dir, g_dir);
    let turned = std::array::from_fn(|k| (g_dir[k] - dir[k] * along) / distance);
    Splat {
        mean: vec3::add(vec3::combine(g_p, w), turned),
        quat: through.quat,
        log_scale: through.log_scale,
        logit,
        sh: g_sh,
    }
}

/// Adds the derivative of `weight` times the splat's smallest standard deviation.
pub fn flatten<R: Real>(gradient: &mut Splat<R>, log_scale: [R; 3], weight: R) {
    if weight != R::zero() {
        let axis = projection::shortest_axis(log_scale);
        gradient.log_scale[axis] += weight * log_scale[axis].exp();
    }
}

/// Adds the derivative of `weight` times half the squares of the coefficients of degrees 1 to `degree`.
pub fn shrink<R: Real>(gradient: &mut Splat<R>, sh: &[[R; 3]; 16], degree: u32, weight: R) {
    if weight != R::zero() {
        let in_use = 1..(degree as usize + 1).pow(2);
        for (g, value) in gradient.sh[in_use.clone()].as_flattened_mut().iter_mut().zip(sh[in_use].as_flattened()) {
            *g += weight * *value;
        }
    }
}

/// Adds the derivatives of `opacity` times the splat's opacity and of `scale` times the mean of its standard deviations.
pub fn price<R: Real>(gradient: &mut Splat<R>, log_scale: [R; 3], logit: R, [opacity, scale]: [R; 2]) {
    if opacity != R::zero() || scale != R::zero() {
        gradient.logit += opacity * projection::sigmoid(logit)[1];
        for (g, log_scale) in gradient.log_scale.iter_mut().zip(log_scale) {
            *g += scale / R::of(3.0) * log_scale.exp();
        }
    }
}

/// Adds the derivative of `weight` times o (1 - o) of the splat's opacity o.
pub fn decide<R: Real>(gradient: &mut Splat<R>, logit: R, weight: R) {
    if weight != R::zero() {
        let [opacity, slope] = projection::sigmoid(logit);
        gradient.logit += weight * (slope * (R::one() - R::of(2.0) * opacity));
    }
}

/// The weights of [`price`] for one of `splats` splats, from the bits of the weights of the means.
pub(super) fn prices(bits: [u32; 2], splats: usize) -> [f32; 2] {
    bits.map(|bits| f32::from_bits(bits) / splats as f32)
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: CameraPush = call.push();
    let view = TwinCamera::<f32>::of(&push);
    let n = (call.groups as usize * 64).min(call.get::<u32>(0)[counters::SPLATS] as usize);
    let model = model_of(call, 1, n);
    let splat2d = call.get::<[f32; 12]>(9);
    let tile_counts = call.get::<u32>(10);
    let grad2d = call.get::<[f32; 12]>(11);
    let grad_normals = call.get::<[f32; 4]>(12);
    let aux = call.constants[0] != 0;
    let add = call.constants[2] != 0;
    let mut out = Gaussians::zeros(n);
    let prices = prices([call.constants[4], call.constants[5]], call.get::<u32>(0)[counters::SPLATS] as usize);
    for i in 0..n {
        let splat = Splat::of(&model, i);
        if tile_counts[i] == 0 {
            let mut gradient = Splat::of(&out, i);
            price(&mut gradient, splat.log_scale, splat.logit, prices);
            gradient.store(&mut out, i);
            continue;
        }
        let [x, y, z, _] = if aux { grad_normals[i] } else { [0.0; 4] };
        let colour = [splat2d[i][8], splat2d[i][9], splat2d[i][10]];
        let g = Grad2d { row: grad2d[i], normal: [x, y, z] };
        let mut gradient = project_backward(&splat, &view, colour, &g);
        flatten(&mut gradient, splat.log_scale, f32::from_bits(call.constants[1]));
        shrink(&mut gradient, &splat.sh, view.sh_degree, f32::from_bits(call.constants[3]));
        decide(&mut gradient, splat.logit, f32::from_bits(call.constants[6]));
        price(&mut gradient, splat.log_scale, splat.logit, prices);
        gradient.store(&mut out, i);
    }
    let planes = [&out.means, &out.quats, &out.scales, &out.opacities].into_iter().chain(&out.sh);
    for (k, plane) in planes.enumerate() {
        let mut values = if add { call.get::<f32>(13 + k) } else { vec![0.0; plane.len()] };
        values.iter_mut().zip(plane).for_each(|(value, more)| *value += more);
        call.set(13 + k, &values);
    }
}
