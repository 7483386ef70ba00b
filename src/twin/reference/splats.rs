//! Projection of one splat and its derivative, by plain matrix calculus.

use super::matrix::{Mat2, Mat2x3, Mat3, norm, product, scaled, times, transposed};
use super::{Settings, Splat};
use crate::scene::Camera;

/// A projected splat.
#[derive(Clone, Debug)]
pub(super) struct ProjectedSplat {
    /// Index in the input.
    pub(super) index: usize,
    pub(super) mean: [f64; 2],
    /// A, B, C.
    pub(super) conic: [f64; 3],
    /// Opacity with the anti-aliasing factor.
    pub(super) opacity: f64,
    pub(super) depth: f64,
    /// Change of the depth per pixel: Q T Sigma w2.
    pub(super) slope: [f64; 2],
    pub(super) colour: [f64; 3],
    pub(super) normal: [f64; 3],
    /// Condition of the mean, the conic and the depth in f32 arithmetic: error over epsilon (absolute,
    /// relative, relative).
    pub(super) mean_condition: [f64; 2],
    pub(super) conic_condition: f64,
    pub(super) depth_condition: f64,
    parts: ProjectionParts,
}

/// Intermediate results that the derivative needs.
#[derive(Clone, Debug)]
struct ProjectionParts {
    point: [f64; 3],
    ellipsoid: Ellipsoid,
    ellipse: Ellipse,
    lit: [bool; 3],
    shortest: usize,
    turned: f64,
    sigmoid: f64,
}

/// A splat's covariance in the scene, sigma = axes axes^T.
#[derive(Clone, Debug)]
struct Ellipsoid {
    rotation: Mat3,
    deviations: [f64; 3],
    axes: Mat3,
    sigma: Mat3,
}

/// The covariance in the image.
#[derive(Clone, Debug)]
struct Ellipse {
    /// x/z and y/z in the Jacobian, and whether they are clamped.
    slope: [f64; 2],
    clamped: [bool; 2],
    jacobian: Mat2x3,
    /// The covariance before the dilation, and after.
    before: Mat2,
    after: Mat2,
    /// Anti-aliasing factor of the opacity.
    factor: f64,
    factor_floored: bool,
}

fn quaternion_matrix(q: &[f64; 4]) -> Mat3 {
    let [w, x, y, z] = *q;
    [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
}

/// Derivative of [`quaternion_matrix`] with respect to component `k`.
fn quaternion_slope(q: &[f64; 4], k: usize) -> Mat3 {
    let [w, x, y, z] = q.map(|v| 2.0 * v);
    match k {
        0 => [[w, -z, y], [z, w, -x], [-y, x, w]],
        1 => [[x, y, z], [y, -x, -w], [z, w, -x]],
        2 => [[-y, x, w], [x, y, z], [-w, z, -y]],
        _ => [[-z, -w, x], [w, -z, y], [x, y, z]],
    }
}

/// The unit quaternion and the length; a vanishing quaternion is the identity.
fn unit_quaternion(q: &[f64; 4]) -> ([f64; 4], Option<f64>) {
    let length = norm(q);
    if length < 1e-12 { ([1.0, 0.0, 0.0, 0.0], None) } else { (q.map(|v| v / length), Some(length)) }
}

/// The 16 basis functions as polynomials with their gradients, in the order and with the signs of the 3DGS reference.
fn harmonics([x, y, z]: [f64; 3]) -> [(f64, [f64; 3]); 16] {
    let pi = std::f64::consts::PI;
    let c0 = 0.5 / pi.sqrt();
    let c1 = (3.0 / (4.0 * pi)).sqrt();
    let c2 = (15.0 / (4.0 * pi)).sqrt();
    let c20 = (5.0 / (16.0 * pi)).sqrt();
    let c33 = (35.0 / (32.0 * pi)).sqrt();
    let c32 = (105.0 / (4.0 * pi)).sqrt();
    let c31 = (21.0 / (32.0 * pi)).sqrt();
    let c30 = (7.0 / (16.0 * pi)).sqrt();
    let term = |c: f64, v: f64, g: [f64; 3]| (c * v, g.map(|d| c * d));
    [
        term(c0, 1.0, [0.0, 0.0, 0.0]),
        term(-c1, y, [0.0, 1.0, 0.0]),
        term(c1, z, [0.0, 0.0, 1.0]),
        term(-c1, x, [1.0, 0.0, 0.0]),
        term(c2, x * y, [y, x, 0.0]),
        term(-c2, y * z, [0.0, z, y]),
        term(c20, 2.0 * z * z - x * x - y * y, [-2.0 * x, -2.0 * y, 4.0 * z]),
        term(-c2, x * z, [z, 0.0, x]),
        term(c2 / 2.0, x * x - y * y, [2.0 * x, -2.0 * y, 0.0]),
        term(-c33, y * (3.0 * x * x - y * y), [6.0 * x * y, 3.0 * x * x - 3.0 * y * y, 0.0]),
        term(c32, x * y * z, [y * z, x * z, x * y]),
        term(-c31, y * (4.0 * z * z - x * x - y * y), [-2.0 * x * y, 4.0 * z * z - x * x - 3.0 * y * y, 8.0 * y * z]),
        term(
            c30,
            z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y),
            [-6.0 * x * z, -6.0 * y * z, 6.0 * z * z - 3.0 * x * x - 3.0 * y * y],
        ),
        term(-c31, x * (4.0 * z * z - x * x - y * y), [4.0 * z * z - 3.0 * x * x - y * y, -2.0 * x * y, 8.0 * x * z]),
        term(c32 / 2.0, z * (x * x - y * y), [2.0 * x * z, -2.0 * y * z, x * x - y * y]),
        term(-c33, x * (x * x - 3.0 * y * y), [3.0 * x * x - 3.0 * y * y, -6.0 * x * y, 0.0]),
    ]
}

fn used(degree: u32) -> usize {
    [1, 4, 9, 16][degree.min(3) as usize]
}

/// Direction from the camera centre, and the distance.
fn sight(splat: &Splat<f64>, camera: &Camera) -> ([f64; 3], f64) {
    let center = camera.center();
    let offset: [f64; 3] = std::array::from_fn(|k| splat.mean[k] - center[k]);
    let distance = norm(&offset);
    (offset.map(|v| v / distance), distance)
}

fn inverse(m: &Mat2) -> Mat2 {
    let det = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    [[m[1][1] / det, -m[0][1] / det], [-m[1][0] / det, m[0][0] / det]]
}

fn ellipsoid(splat: &Splat<f64>) -> Ellipsoid {
    let (unit, _) = unit_quaternion(&splat.quat);
    let rotation = quaternion_matrix(&unit);
    let deviations = splat.log_scale.map(f64::exp);
    let axes: Mat3 = std::array::from_fn(|i| std::array::from_fn(|j| rotation[i][j] * deviations[j]));
    Ellipsoid { rotation, deviations, axes, sigma: product(&axes, &transposed(&axes)) }
}

/// The image of an ellipsoid around a point in the camera frame.
fn ellipse([x, y, z]: [f64; 3], sigma: &Mat3, camera: &Camera, settings: &Settings) -> Ellipse {
    let (focal, principal) = (focal(camera), principal(camera));
    let size = [f64::from(camera.width), f64::from(camera.height)];
    let free = [x / z, y / z];
    let slope: [f64; 2] = std::array::from_fn(|k| {
        if settings.orthographic {
            return 0.0;
        }
        let margin = 0.3 * (size[k] / (2.0 * focal[k]));
        free[k].clamp(-principal[k] / focal[k] - margin, (size[k] - principal[k]) / focal[k] + margin)
    });
    let clamped = std::array::from_fn(|k| slope[k] != free[k]);
    let jacobian = match settings.orthographic {
        true => [[focal[0], 0.0, 0.0], [0.0, focal[1], 0.0]],
        false => [[focal[0] / z, 0.0, -focal[0] * slope[0] / z], [0.0, focal[1] / z, -focal[1] * slope[1] / z]],
    };
    let t = product(&jacobian, &camera.rotation);
    let before = product(&product(&t, sigma), &transposed(&t));
    let after = [[before[0][0] + 0.3, before[0][1]], [before[1][0], before[1][1] + 0.3]];
    let det = |m: &Mat2| m[0][0] * m[1][1] - m[0][1] * m[1][0];
    let share = det(&before) / det(&after);
    let (factor, factor_floored) = match settings.antialias {
        true => (share.max(2.5e-5).sqrt(), share <= 2.5e-5),
        false => (1.0, true),
    };
    Ellipse { slope, clamped, jacobian, before, after, factor, factor_floored }
}

fn focal(camera: &Camera) -> [f64; 2] {
    [camera.fx, camera.fy]
}

fn principal(camera: &Camera) -> [f64; 2] {
    [camera.cx, camera.cy]
}

/// The colour before it is clamped to at least 0.
fn unbounded_colour(splat: &Splat<f64>, camera: &Camera, settings: &Settings) -> [f64; 3] {
    let dir = if settings.orthographic { camera.rotation[2] } else { sight(splat, camera).0 };
    let mut colour = [0.5; 3];
    for (y, f) in harmonics(dir).iter().zip(&splat.sh).take(used(settings.sh_degree)) {
        for c in 0..3 {
            colour[c] += y.0 * f[c];
        }
    }
    colour
}

/// Condition of the mean, the conic and the depth, see [`ProjectedSplat`].
struct Condition {
    mean: [f64; 2],
    conic: f64,
    depth: f64,
}

/// First-order effect of rounding every operand, as multiples of epsilon.
fn condition(splat: &Splat<f64>, camera: &Camera, point: [f64; 3], axes: &Mat3, ellipse: &Ellipse) -> Condition {
    let [x, y, z] = point;
    let (w, focal, principal) = (&camera.rotation, focal(camera), principal(camera));
    let free = [x / z, y / z];
    let reach: [f64; 3] = std::array::from_fn(|i| {
        (0..3).map(|j| (w[i][j] * splat.mean[j]).abs()).sum::<f64>() + camera.translation[i].abs()
    });
    let in_camera = product(w, axes);
    let pulled: [f64; 2] = std::array::from_fn(|k| {
        let span = norm(&in_camera[k]) + ellipse.slope[k].abs() * norm(&in_camera[2]);
        focal[k] / z * span / ellipse.after[k][k].sqrt()
    });
    let depth = 1.0 + reach[2] / z;
    Condition {
        mean: std::array::from_fn(|k| {
            focal[k] / z * (reach[k] + free[k].abs() * reach[2]) + (focal[k] * free[k]).abs() + principal[k].abs()
        }),
        conic: pulled[0].max(pulled[1]) + depth,
        depth,
    }
}

/// Projects a splat; `None` where it is not visible.
pub(super) fn see(index: usize, splat: &Splat<f64>, camera: &Camera, settings: &Settings) -> Option<ProjectedSplat> {
    if splat.to_array().iter().any(|v| !v.is_finite()) {
        return None;
    }
    let w = &camera.rotation;
    let moved = times(w, &splat.mean);
    let point: [f64; 3] = std::array::from_fn(|k| moved[k] + camera.translation[k]);
    let [x, y, z] = point;
    if z <= settings.near {
        return None;
    }
    let ellipsoid = ellipsoid(splat);
    let ellipse = ellipse(point, &ellipsoid.sigma, camera, settings);
    let lens_point = if settings.orthographic { [0.0, 0.0, 1.0] } else { point };
    let condition = condition(splat, camera, lens_point, &ellipsoid.axes, &ellipse);
    let q = inverse(&ellipse.after);
    let t = product(&ellipse.jacobian, w);
    let slope = times(&q, &times(&product(&t, &ellipsoid.sigma), &w[2]));
    let sigmoid = 1.0 / (1.0 + (-splat.logit).exp());
    let colour = unbounded_colour(splat, camera, settings);
    let shortest = (1..3).fold(0, |best, k| if splat.log_scale[k] < splat.log_scale[best] { k } else { best });
    let axis = times(w, &std::array::from_fn(|i| ellipsoid.rotation[i][shortest]));
    let facing: f64 = match settings.orthographic {
        true => axis[2],
        false => (0..3).map(|k| axis[k] * point[k]).sum(),
    };
    let turned = if facing > 0.0 { -1.0 } else { 1.0 };
    let (focal, principal) = (focal(camera), principal(camera));
    let before_lens = if settings.orthographic { [x, y] } else { [x / z, y / z] };
    Some(ProjectedSplat {
        index,
        mean: std::array::from_fn(|k| focal[k] * before_lens[k] + principal[k]),
        conic: [q[0][0], q[0][1], q[1][1]],
        opacity: sigmoid * ellipse.factor,
        depth: z,
        slope,
        colour: colour.map(|v| v.max(0.0)),
        normal: axis.map(|v| turned * v),
        mean_condition: condition.mean,
        conic_condition: condition.conic,
        depth_condition: condition.depth,
        parts: ProjectionParts { point, ellipsoid, ellipse, lit: colour.map(|v| v > 0.0), shortest, turned, sigmoid },
    })
}

/// Gradients of the 59 parameters from a row of `grad2d` and the gradient of the normal.
pub(super) fn pull_back(
    splat: &Splat<f64>,
    seen: &ProjectedSplat,
    camera: &Camera,
    settings: &Settings,
    row: &[f64; 12],
    g_normal: &[f64; 3],
) -> Splat<f64> {
    let parts = &seen.parts;
    let [x, y, z] = parts.point;
    let mut g_point = [0.0; 3];

    // Mean and depth: a moved mean moves the plane of the depths along.
    let g_mean: [f64; 2] = std::array::from_fn(|k| row[k] - row[9] * seen.slope[k]);
    g_point[0] += g_mean[0] * camera.fx / z;
    g_point[1] += g_mean[1] * camera.fy / z;
    g_point[2] += row[9] - g_mean[0] * camera.fx * x / (z * z) - g_mean[1] * camera.fy * y / (z * z);

    // Opacity: o = sigmoid(logit) f, f = sqrt(det before / det after).
    let logit = row[5] * parts.ellipse.factor * parts.sigmoid * (1.0 - parts.sigmoid);
    let g_cov = pull_back_conic(&parts.ellipse, row, row[5] * parts.sigmoid, settings.antialias);
    let g_sigma = pull_back_ellipse(parts, camera, &g_cov, &mut g_point);
    let (quat, log_scale) =
        pull_back_ellipsoid(splat, parts, &g_sigma, &times(&transposed(&camera.rotation), g_normal));

    // Colour: at the lower bound, only gradients that would raise the colour pass, if any.
    let share = |c: usize| match (parts.lit[c], settings.black_learns) {
        (true, _) => row[6 + c],
        (false, true) => row[6 + c].min(0.0),
        (false, false) => 0.0,
    };
    let g_colour: [f64; 3] = std::array::from_fn(share);
    let (sh, g_sight) = pull_back_colour(splat, camera, settings.sh_degree, &g_colour);
    let through_camera = times(&transposed(&camera.rotation), &g_point);
    let mean = std::array::from_fn(|k| through_camera[k] + g_sight[k]);
    Splat { mean, quat, log_scale, logit, sh }
}

/// Gradient of the covariance in the image, from the gradients of the conic and of the opacity's factor: d(Q) = -Q
/// d(Sigma') Q; d ln det(m) = tr(m^-1 dm).
fn pull_back_conic(ellipse: &Ellipse, row: &[f64; 12], g_factor: f64, antialias: bool) -> Mat2 {
    let q = inverse(&ellipse.after);
    let packed = [[row[2], row[3] / 2.0], [row[3] / 2.0, row[4]]];
    let mut g_cov = scaled(-1.0, &product(&product(&q, &packed), &q));
    if antialias && !ellipse.factor_floored {
        let q0 = inverse(&ellipse.before);
        for i in 0..2 {
            for j in 0..2 {
                g_cov[i][j] += g_factor * ellipse.factor / 2.0 * (q0[i][j] - q[i][j]);
            }
        }
    }
    g_cov
}

/// Gradient of the covariance in the scene, and, through the Jacobian, of the point: Sigma' = T Sigma T^T with T = J W.
fn pull_back_ellipse(parts: &ProjectionParts, camera: &Camera, g_cov: &Mat2, g_point: &mut [f64; 3]) -> Mat3 {
    let Ellipse { slope, clamped, jacobian, .. } = &parts.ellipse;
    let (w, z, focal) = (&camera.rotation, parts.point[2], focal(camera));
    let t = product(jacobian, w);
    let g_t: Mat2x3 = scaled(2.0, &product(&product(g_cov, &t), &parts.ellipsoid.sigma));
    let g_sigma = product(&product(&transposed(&t), g_cov), &t);
    let g_j: Mat2x3 = product(&g_t, &transposed(w));
    for k in 0..2 {
        // J[k][k] = f / z, J[k][2] = -f s / z with s = x / z unless clamped.
        let g_slope = -g_j[k][2] * focal[k] / z;
        g_point[2] += (-g_j[k][k] * focal[k] + g_j[k][2] * focal[k] * slope[k]) / (z * z);
        if !clamped[k] {
            g_point[k] += g_slope / z;
            g_point[2] -= g_slope * slope[k] / z;
        }
    }
    g_sigma
}

/// Gradients of the quaternion and the log scales, from the gradients of the covariance and the normal in the scene:
/// Sigma = M M^T with M = R diag(s).
fn pull_back_ellipsoid(
    splat: &Splat<f64>,
    parts: &ProjectionParts,
    g_sigma: &Mat3,
    g_normal: &[f64; 3],
) -> ([f64; 4], [f64; 3]) {
    let Ellipsoid { rotation, deviations, axes, .. } = &parts.ellipsoid;
    let g_axes = scaled(2.0, &product(g_sigma, axes));
    let log_scale = std::array::from_fn(|j| deviations[j] * (0..3).map(|i| rotation[i][j] * g_axes[i][j]).sum::<f64>());
    let mut g_rotation: Mat3 = std::array::from_fn(|i| std::array::from_fn(|j| g_axes[i][j] * deviations[j]));
    for i in 0..3 {
        g_rotation[i][parts.shortest] += parts.turned * g_normal[i];
    }
    let (unit, length) = unit_quaternion(&splat.quat);
    let g_unit: [f64; 4] = std::array::from_fn(|k| {
        let slope = quaternion_slope(&unit, k);
        (0..3).flat_map(|i| (0..3).map(move |j| (i, j))).map(|(i, j)| slope[i][j] * g_rotation[i][j]).sum()
    });
    let radial: f64 = (0..4).map(|k| unit[k] * g_unit[k]).sum();
    let quat = std::array::from_fn(|k| length.map_or(0.0, |l| (g_unit[k] - unit[k] * radial) / l));
    (quat, log_scale)
}

/// Gradients of the harmonics, and, through the viewing direction, of the mean.
fn pull_back_colour(
    splat: &Splat<f64>,
    camera: &Camera,
    degree: u32,
    g_colour: &[f64; 3],
) -> ([[f64; 3]; 16], [f64; 3]) {
    let (dir, distance) = sight(splat, camera);
    let mut sh = [[0.0; 3]; 16];
    let mut g_dir = [0.0; 3];
    for (k, (value, slope)) in harmonics(dir).iter().enumerate().take(used(degree)) {
        sh[k] = g_colour.map(|g| value * g);
        let weight: f64 = (0..3).map(|c| splat.sh[k][c] * g_colour[c]).sum();
        for axis in 0..3 {
            g_dir[axis] += weight * slope[axis];
        }
    }
    let radial: f64 = (0..3).map(|k| dir[k] * g_dir[k]).sum();
    (sh, std::array::from_fn(|k| (g_dir[k] - dir[k] * radial) / distance))
}
