//! Twin of `glsl/include/projection.glsl`: EWA projection in product form and its derivative.

use super::splat::TwinCamera;
use super::{Real, vec3};

const DILATION: f64 = 0.3;
const ANTIALIAS_FLOOR: f64 = 2.5e-5;
const QUAT_MIN_SQUARED: f64 = 1e-24;

/// A rotation with the values that its derivative needs.
#[derive(Clone, Debug)]
pub struct Rotation<R> {
    /// Rows of the matrix.
    pub rows: [[R; 3]; 3],
    unit: [R; 4],
    inverse: R,
}

/// The rotation of a quaternion (w first) of any length; a vanishing quaternion is the identity.
pub fn rotation<R: Real>(quat: [R; 4]) -> Rotation<R> {
    let squared = quat.iter().fold(R::zero(), |sum, &q| sum + q * q);
    let usable = squared >= R::of(QUAT_MIN_SQUARED);
    let inverse = if usable { R::one() / squared.sqrt() } else { R::zero() };
    let unit = if usable { quat.map(|q| q * inverse) } else { [R::one(), R::zero(), R::zero(), R::zero()] };
    let [w, x, y, z] = unit;
    let (one, two) = (R::one(), R::of(2.0));
    let rows = [
        [one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
        [two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)],
        [two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y)],
    ];
    Rotation { rows, unit, inverse }
}

/// dL/d(quat) from dL/dR.
pub fn rotation_backward<R: Real>(rot: &Rotation<R>, g: [[R; 3]; 3]) -> [R; 4] {
    let [w, x, y, z] = rot.unit;
    let two = R::of(2.0);
    let raw = [
        z * (g[1][0] - g[0][1]) + y * (g[0][2] - g[2][0]) + x * (g[2][1] - g[1][2]),
        y * (g[0][1] + g[1][0]) + z * (g[0][2] + g[2][0]) - two * x * (g[1][1] + g[2][2]) + w * (g[2][1] - g[1][2]),
        x * (g[0][1] + g[1][0]) + z * (g[1][2] + g[2][1]) - two * y * (g[0][0] + g[2][2]) + w * (g[0][2] - g[2][0]),
        x * (g[0][2] + g[2][0]) + y * (g[1][2] + g[2][1]) - two * z * (g[0][0] + g[1][1]) + w * (g[1][0] - g[0][1]),
    ]
    .map(|v| two * v);
    let along = rot.unit.iter().zip(&raw).fold(R::zero(), |sum, (&u, &r)| sum + u * r);
    std::array::from_fn(|k| (raw[k] - rot.unit[k] * along) * rot.inverse)
}

/// Sigmoid and its slope, without overflow at either end.
pub fn sigmoid<R: Real>(x: R) -> [R; 2] {
    let e = (-x.abs()).exp();
    let d = R::one() / (R::one() + e);
    [if x >= R::zero() { d } else { e * d }, e * d * d]
}

/// A projected covariance with the values that its derivative needs.
#[derive(Clone, Debug)]
pub struct Ewa<R> {
    /// The splat's rotation.
    pub rot: Rotation<R>,
    /// Standard deviations.
    pub scale: [R; 3],
    /// Rows of W R S.
    pub u: [[R; 3]; 3],
    /// x/z and y/z after the clamp to the field of view.
    pub ratio: [R; 2],
    /// Whether the clamp is active.
    pub clamped: [bool; 2],
    /// Focal lengths over z.
    pub zoom: [R; 2],
    /// Rows of J W R S, pixels.
    pub m: [[R; 3]; 2],
    /// m0 x m1.
    pub n: [R; 3],
    /// Determinant of the dilated 2D covariance.
    pub det: R,
    /// The conic (A, B, C).
    pub conic: [R; 3],
    /// C - B^2 / A, the inverse of the dilated variance along y.
    pub rest: R,
    /// sqrt(det before / det after dilation), floored.
    pub compensation: R,
    /// Whether the floor is active.
    pub floored: bool,
}

/// Projects a covariance at camera-frame position `p`.
pub fn project<R: Real>(view: &TwinCamera<R>, p: [R; 3], quat: [R; 4], log_scale: [R; 3]) -> Ewa<R> {
    let rot = rotation(quat);
    let scale = log_scale.map(R::exp);
    let u = view.rotation.map(|w| vec3::mul(vec3::combine(w, rot.rows), scale));
    let mut ratio = [R::zero(); 2];
    let mut clamped = [false; 2];
    let mut zoom = [R::zero(); 2];
    let mut m = [[R::zero(); 3]; 2];
    for k in 0..2 {
        let free = p[k] / p[2];
        ratio[k] = free.max(view.limits[2 * k]).min(view.limits[2 * k + 1]);
        clamped[k] = ratio[k] != free;
        zoom[k] = view.focal[k] / p[2];
        m[k] = vec3::scale(zoom[k], vec3::sub(u[k], vec3::scale(ratio[k], u[2])));
    }
    let n = vec3::cross(m[0], m[1]);
    let (a, c) = (vec3::dot(m[0], m[0]), vec3::dot(m[1], m[1]));
    let dilation = R::of(DILATION);
    let det0 = vec3::dot(n, n);
    let det = det0 + dilation * (a + c) + dilation * dilation;
    let rest = R::one() / (c + dilation);
    let conic = [(c + dilation) / det, -vec3::dot(m[0], m[1]) / det, (a + dilation) / det];
    let share = det0 / det;
    let floored = share <= R::of(ANTIALIAS_FLOOR);
    let compensation = share.max(R::of(ANTIALIAS_FLOOR)).sqrt();
    Ewa { rot, scale, u, ratio, clamped, zoom, m, n, det, conic, rest, compensation, floored }
}

/// Change of the depth per pixel: the mean of z under the Gaussian at a pixel is the depth of the centre plus the slope
/// times the pixel's distance.
pub fn depth_slope<R: Real>(e: &Ewa<R>) -> [R; 2] {
    let x = [vec3::cross(e.m[1], e.n), vec3::cross(e.n, e.m[0])];
    std::array::from_fn(|r| vec3::dot(vec3::add(vec3::scale(R::of(DILATION), e.m[r]), x[r]), e.u[2]) / e.det)
}

/// Gradients that [`backward`] gives.
#[derive(Clone, Debug)]
pub struct EwaGrad<R> {
    /// With respect to the camera-frame centre, through the Jacobian only.
    pub p: [R; 3],
    /// With respect to the quaternion.
    pub quat: [R; 4],
    /// With respect to the log scales.
    pub log_scale: [R; 3],
}

/// Gradients that [`backward`] takes.
#[derive(Clone, Copy, Debug)]
pub struct EwaUpstream<R> {
    /// With respect to the conic.
    pub conic: [R; 3],
    /// With respect to the compensation.
    pub compensation: R,
    /// The column of the rotation that is the normal.
    pub axis: usize,
    /// With respect to the normal's column.
    pub of_axis: [R; 3],
}

/// The gradients with respect to the projection's inputs, at depth `z`, from the gradients with respect to its results.
pub fn backward<R: Real>(view: &TwinCamera<R>, e: &Ewa<R>, z: R, upstream: &EwaUpstream<R>) -> EwaGrad<R> {
    let EwaUpstream { conic: g_conic, compensation: g_compensation, axis, of_axis: g_axis } = *upstream;
    let (half, two) = (R::of(0.5), R::of(2.0));
    let x = [vec3::cross(e.m[1], e.n), vec3::cross(e.n, e.m[0])];
    let k: [[R; 3]; 2] =
        std::array::from_fn(|r| std::array::from_fn(|i| (R::of(DILATION) * e.m[r][i] + x[r][i]) / e.det));
    let h0 = vec3::add(vec3::scale(g_conic[0], k[0]), vec3::scale(half * g_conic[1], k[1]));
    let h1 = vec3::add(vec3::scale(half * g_conic[1], k[0]), vec3::scale(g_conic[2], k[1]));
    let [qa, qb, qc] = e.conic;
    let mut gm = [
        vec3::scale(-two, vec3::add(vec3::scale(qa, h0), vec3::scale(qb, h1))),
        vec3::scale(-two, vec3::add(vec3::scale(qb, h0), vec3::scale(qc, h1))),
    ];
    // m0 gm0 + m1 gm1 of each column, without the products that cancel along a needle.
    let mut log_scale = vec3::scale(-two, vec3::add(vec3::mul(h0, k[0]), vec3::mul(h1, k[1])));
    if !e.floored {
        let (up, down) = (g_compensation / (e.compensation * e.det), g_compensation * e.compensation);
        for r in 0..2 {
            gm[r] = vec3::add(gm[r], vec3::sub(vec3::scale(up, x[r]), vec3::scale(down, k[r])));
        }
        let squares = vec3::mul(e.n, e.n);
        let stretched: [R; 3] = std::array::from_fn(|i| squares[(i + 1) % 3] + squares[(i + 2) % 3]);
        let spread = vec3::add(vec3::mul(e.m[0], e.m[0]), vec3::mul(e.m[1], e.m[1]));
        let total = vec3::add(vec3::scale(R::of(DILATION), spread), stretched).map(|v| v / e.det);
        log_scale = vec3::add(log_scale, vec3::sub(vec3::scale(up, stretched), vec3::scale(down, total)));
    }
    let gu0 = vec3::scale(e.zoom[0], gm[0]);
    let gu1 = vec3::scale(e.zoom[1], gm[1]);
    let gu2 = vec3::scale(-R::one(), vec3::add(vec3::scale(e.ratio[0], gu0), vec3::scale(e.ratio[1], gu1)));
    let g_ratio = [-vec3::dot(gu0, e.u[2]), -vec3::dot(gu1, e.u[2])];
    let mut p = [R::zero(); 3];
    let mut along = log_scale[0] + log_scale[1] + log_scale[2];
    for i in 0..2 {
        if !e.clamped[i] {
            p[i] = g_ratio[i] / z;
        }
        if !e.clamped[i] || view.reference_clamp {
            along += g_ratio[i] * e.ratio[i];
        }
    }
    p[2] = -along / z;
    let g_u = [gu0, gu1, gu2];
    let w = &view.rotation;
    let mut g_rot = [[R::zero(); 3]; 3];
    for r in 0..3 {
        let gv = vec3::combine([w[0][r], w[1][r], w[2][r]], g_u);
        g_rot[r] = vec3::mul(gv, e.scale);
        g_rot[r][axis] += g_axis[r];
    }
    EwaGrad { p, quat: rotation_backward(&e.rot, g_rot), log_scale }
}

/// The axis with the smallest scale, the first of equals.
pub fn shortest_axis<R: Real>(s: [R; 3]) -> usize {
    if s[2] < s[0].min(s[1]) { 2 } else { usize::from(s[1] < s[0]) }
}

/// The camera-frame normal (a column of R turned towards the camera) and its side, 1 or -1.
pub fn normal<R: Real>(view: &TwinCamera<R>, p: [R; 3], rot: &Rotation<R>, axis: usize) -> ([R; 3], R) {
    let column = [rot.rows[0][axis], rot.rows[1][axis], rot.rows[2][axis]];
    let n = view.rotation.map(|w| vec3::dot(w, column));
    let side = if vec3::dot(n, p) > R::zero() { -R::one() } else { R::one() };
    (vec3::scale(side, n), side)
}
