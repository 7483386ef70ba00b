//! Twin of `glsl/densify_views.comp`.

use super::project::to_camera;
use super::splat::TwinCamera;
use super::{Real, TwinCall, projection, vec3};
use crate::pass::camera::CameraPush;
use crate::pass::counters::SPLATS;

/// Side of a tile of the 3DGS reference, in pixels.
const TILE: u32 = 16;
/// Smallest value under the root of the reference's larger eigenvalue, in pixels to the fourth power.
const LEAST_SPREAD: f64 = 0.1;
/// Variance in square pixels that the projection adds.
const DILATION: f64 = 0.3;

/// Whether the 3DGS reference counts a view for a splat, that is, whether the splat's radius is above zero there. The
/// radius spans a square about the mean, which must touch a tile. `mean`, `quat` (w first) and `log_scale` are the
/// splat's, in scene coordinates.
pub fn is_counted<R: Real>(view: &TwinCamera<R>, mean: [R; 3], quat: [R; 4], log_scale: [R; 3]) -> bool {
    let p = to_camera(view, mean);
    let known = mean.iter().chain(&quat).chain(&log_scale).all(|v| v.is_finite());
    if !known || p[2] <= view.near {
        return false;
    }
    let e = projection::project(view, p, quat, log_scale);
    let (a, b, c) = (vec3::dot(e.m[0], e.m[0]), vec3::dot(e.m[0], e.m[1]), vec3::dot(e.m[1], e.m[1]));
    let half = R::of(0.5);
    let spread = (half * half * (a - c) * (a - c) + b * b).max(R::of(LEAST_SPREAD)).sqrt();
    let radius = (R::of(3.0) * (half * (a + c) + R::of(DILATION) + spread).sqrt()).ceil();
    let inside = (0..2).all(|k| {
        // The reference has pixel centres at integer coordinates.
        let at = view.focal[k] * (p[k] / p[2]) + view.principal[k] - R::of(0.5);
        let end = R::of(f64::from(view.size[k].div_ceil(TILE) * TILE));
        at + radius >= R::one() && at - radius < end
    });
    inside && e.det.is_finite() && radius.is_finite()
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let view = TwinCamera::<f32>::of(&call.push::<CameraPush>());
    let splats = call.get::<u32>(0)[SPLATS].min(64 * call.groups) as usize;
    let tile_counts = call.get::<u32>(1);
    let (means, quats, scales) = (call.get::<[f32; 3]>(2), call.get::<[f32; 4]>(3), call.get::<[f32; 3]>(4));
    let mut stats = call.get::<[f32; 4]>(5);
    for i in (0..splats).filter(|&i| tile_counts[i] == 0) {
        if is_counted(&view, means[i], quats[i], scales[i]) {
            stats[i][2] += 1.0;
        }
    }
    call.set(5, &stats);
}
