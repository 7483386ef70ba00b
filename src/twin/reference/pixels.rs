//! Blending of every splat at every pixel, its derivative, and the distance to decisions.

use super::splats::{ProjectedSplat, pull_back, see};
use super::{Gradients, Image, ImageGradient, Settings, Splat};
use crate::scene::Camera;

/// A splat that takes part in a pixel.
struct Layer {
    /// Position in the depth order.
    at: usize,
    dx: f64,
    dy: f64,
    /// exp(power).
    falloff: f64,
    alpha: f64,
    /// Transmittance in front of the splat.
    before: f64,
    /// Whether alpha is held at 0.99.
    clamped: bool,
}

/// The visible splats, front to back; equal depths in the order of the input.
fn sorted(splats: &[Splat<f64>], camera: &Camera, settings: &Settings) -> Vec<ProjectedSplat> {
    let mut seen: Vec<ProjectedSplat> =
        splats.iter().enumerate().filter_map(|(i, splat)| see(i, splat, camera, settings)).collect();
    seen.sort_by(|a, b| a.depth.total_cmp(&b.depth).then(a.index.cmp(&b.index)));
    seen
}

/// The layers of the pixel whose centre is (px, py), the final transmittance, and the distance to the nearest decision.
fn layers(
    seen: &[ProjectedSplat],
    splats: &[Splat<f64>],
    settings: &Settings,
    (px, py): (f64, f64),
) -> (Vec<Layer>, f64, f64) {
    let mut out: Vec<Layer> = Vec::new();
    let (mut t, mut t_condition) = (1.0, 1.0);
    let mut margin = f64::INFINITY;
    for (at, s) in seen.iter().enumerate() {
        let (dx, dy) = (px - s.mean[0], py - s.mean[1]);
        let [a, b, c] = s.conic;
        let power = -0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy;
        let size = 0.5 * (a * dx * dx + c * dy * dy) + (b * dx * dy).abs();
        let condition = 1.0
            + size * (1.0 + s.conic_condition)
            + (a * dx + b * dy).abs() * s.mean_condition[0]
            + (b * dx + c * dy).abs() * s.mean_condition[1];
        let falloff = power.exp();
        let free = s.opacity * falloff;
        // A splat near the cut-off limits the margin on either side of it.
        margin = margin.min((free / settings.alpha_min).ln().abs() / condition);
        if power > 0.0 || free < settings.alpha_min {
            continue;
        }
        margin = margin.min((free / 0.99).ln().abs() / condition);
        if size > 0.0 {
            margin = margin.min(-power / (size * (1.0 + s.conic_condition)));
        }
        if let Some(last) = out.last() {
            let front = &seen[last.at];
            if splats[front.index].mean != splats[s.index].mean {
                margin = margin.min((s.depth / front.depth).ln() / (s.depth_condition + front.depth_condition));
            }
        }
        let alpha = free.min(0.99);
        let next = t * (1.0 - alpha);
        t_condition += 1.0 + if free < 0.99 { alpha / (1.0 - alpha) * condition } else { 0.0 };
        margin = margin.min((next / settings.transmittance_min).ln().abs() / t_condition);
        if next < settings.transmittance_min {
            break;
        }
        out.push(Layer { at, dx, dy, falloff, alpha, before: t, clamped: free > 0.99 });
        t = next;
    }
    (out, t, margin)
}

/// Mean of z under the splat's Gaussian along the pixel's ray.
fn depth_at(s: &ProjectedSplat, layer: &Layer) -> f64 {
    s.depth + s.slope[0] * layer.dx + s.slope[1] * layer.dy
}

/// Every pixel.
fn all(camera: &Camera) -> Vec<usize> {
    (0..camera.width as usize * camera.height as usize).collect()
}

/// Centre of a pixel.
fn centre(camera: &Camera, pixel: usize) -> (f64, f64) {
    let width = camera.width as usize;
    ((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5)
}

/// Renders the splats.
pub fn render(splats: &[Splat<f64>], camera: &Camera, settings: &Settings) -> Image {
    render_at(splats, camera, settings, &all(camera))
}

/// As [`render`], for the pixels with the given row-major indices only: one entry per index.
pub fn render_at(splats: &[Splat<f64>], camera: &Camera, settings: &Settings, pixels: &[usize]) -> Image {
    blended(splats, &sorted(splats, camera, settings), camera, settings, pixels)
}

/// As [`render`], with the slopes of the depths that the splats `held` have: the slopes count as constants in
/// [`backward`].
pub fn render_with_slopes_of(
    held: &[Splat<f64>],
    splats: &[Splat<f64>],
    camera: &Camera,
    settings: &Settings,
) -> Image {
    let mut seen = sorted(splats, camera, settings);
    for splat in &mut seen {
        if let Some(held) = see(splat.index, &held[splat.index], camera, settings) {
            splat.slope = held.slope;
        }
    }
    blended(splats, &seen, camera, settings, &all(camera))
}

fn blended(
    splats: &[Splat<f64>],
    seen: &[ProjectedSplat],
    camera: &Camera,
    settings: &Settings,
    pixels: &[usize],
) -> Image {
    let mut image = Image::default();
    for (px, py) in pixels.iter().map(|pixel| centre(camera, *pixel)) {
        let (layers, t, margin) = layers(seen, splats, settings, (px, py));
        let mut colour = settings.background.map(|b| b * t);
        let (mut depth, mut normal) = (0.0, [0.0; 3]);
        for layer in &layers {
            let s = &seen[layer.at];
            let weight = layer.alpha * layer.before;
            depth += weight * depth_at(s, layer);
            for k in 0..3 {
                colour[k] += weight * s.colour[k];
                normal[k] += weight * s.normal[k];
            }
        }
        image.colour.push(colour);
        image.transmittance.push(t);
        image.depth.push(depth);
        image.normal.push(normal);
        image.blended.push(layers.len() as u32);
        image.margin.push(margin);
    }
    image
}

/// Gradients of a loss whose derivative with respect to the image is `g`.
pub fn backward(splats: &[Splat<f64>], camera: &Camera, settings: &Settings, g: &ImageGradient) -> Gradients {
    backward_at(splats, camera, settings, g, &all(camera))
}

/// As [`backward`], for a loss that depends on `pixels` only: `g` has one entry per pixel.
pub fn backward_at(
    splats: &[Splat<f64>],
    camera: &Camera,
    settings: &Settings,
    g: &ImageGradient,
    pixels: &[usize],
) -> Gradients {
    let seen = sorted(splats, camera, settings);
    let mut rows = vec![[0.0; 12]; splats.len()];
    let mut normals = vec![[0.0; 3]; splats.len()];
    for (pixel, at) in pixels.iter().enumerate() {
        let (px, py) = centre(camera, *at);
        let (layers, t, _) = layers(&seen, splats, settings, (px, py));
        let (gc, gd, gn) = (g.colour[pixel], g.depth[pixel], g.normal[pixel]);
        // L is linear in the weights w_i = alpha_i T_i and in the final T: with v_i = dL/dw_i and v_end = dL/dT,
        // dL/d(alpha_i) = T_i v_i - (sum over j > i of w_j v_j + T v_end) / (1 - alpha_i).
        let behind: f64 = (0..3).map(|k| gc[k] * settings.background[k]).sum::<f64>() + g.transmittance[pixel];
        let mut rest = t * behind;
        for layer in layers.iter().rev() {
            let s = &seen[layer.at];
            let weight = layer.alpha * layer.before;
            let value: f64 =
                (0..3).map(|k| gc[k] * s.colour[k] + gn[k] * s.normal[k]).sum::<f64>() + gd * depth_at(s, layer);
            let g_alpha = layer.before * value - rest / (1.0 - layer.alpha);
            rest += weight * value;
            let row = &mut rows[s.index];
            for k in 0..3 {
                row[6 + k] += weight * gc[k];
                normals[s.index][k] += weight * gn[k];
            }
            row[9] += weight * gd;
            if layer.clamped {
                continue;
            }
            row[5] += g_alpha * layer.falloff;
            let g_power = g_alpha * layer.alpha;
            let [a, b, c] = s.conic;
            let (dx, dy) = (layer.dx, layer.dy);
            let g_mean = [g_power * (a * dx + b * dy), g_power * (b * dx + c * dy)];
            row[0] += g_mean[0];
            row[1] += g_mean[1];
            row[2] -= g_power * 0.5 * dx * dx;
            row[3] -= g_power * dx * dy;
            row[4] -= g_power * 0.5 * dy * dy;
            row[10] += g_mean[0].abs();
            row[11] += g_mean[1].abs();
        }
    }
    let zero = Splat { mean: [0.0; 3], quat: [0.0; 4], log_scale: [0.0; 3], logit: 0.0, sh: [[0.0; 3]; 16] };
    let mut out = vec![zero; splats.len()];
    for s in &seen {
        let i = s.index;
        out[i] = pull_back(&splats[i], s, camera, settings, &rows[i], &normals[i]);
    }
    Gradients { splats: out, grad2d: rows, normals }
}
