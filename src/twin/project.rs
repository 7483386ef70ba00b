//! Twin of `glsl/project.comp`.

use super::projection::{self, Ewa};
use super::splat::{Splat, TwinCamera, model_of, model_of_halves};
use super::{Real, TwinCall, vec3};
use crate::pass::camera::CameraPush;
use crate::pass::counters;
use crate::scene::Gaussians;
use crate::scene::sh;
use crate::scene::tile::{self, TileGrid};

/// A splat on the image.
#[derive(Clone, Debug)]
pub struct Projected<R> {
    /// Mean in pixels.
    pub mean: [R; 2],
    /// The conic (A, B, C).
    pub conic: [R; 3],
    /// C - B^2 / A.
    pub rest: R,
    /// Opacity times the anti-aliasing factor.
    pub opacity: R,
    /// z of the centre in the camera frame.
    pub depth: R,
    /// Change of the depth per pixel, along x and y.
    pub slope: [R; 2],
    /// Colour, clamped to at least 0.
    pub colour: [R; 3],
    /// Camera-frame normal.
    pub normal: [R; 3],
    /// Number of tiles touched; 0 without a grid.
    pub tiles: u32,
}

impl<R: Real> Projected<R> {
    /// The row of `splat2d`, with normals.
    pub fn row(&self) -> [R; 12] {
        let ([x, y], [a, b, c], [red, green, blue]) = (self.mean, self.conic, self.colour);
        [x, y, a, b, c, self.opacity, self.depth, self.rest, red, green, blue, self.slope[0]]
    }

    /// The row of `normals`.
    pub fn normal_row(&self) -> [R; 4] {
        let [x, y, z] = self.normal;
        [x, y, z, self.slope[1]]
    }
}

/// Why a splat is not on the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Culled {
    /// A parameter is not finite.
    Bad,
    /// At or behind the near plane.
    Near,
    /// Too faint to count, or its projection overflows.
    Faint,
    /// It touches no tile.
    OffScreen,
}

/// The camera-frame position of a splat's centre.
pub fn to_camera<R: Real>(view: &TwinCamera<R>, mean: [R; 3]) -> [R; 3] {
    std::array::from_fn(|k| vec3::dot(view.rotation[k], mean) + view.translation[k])
}

/// The camera-frame centre of a splat and its projected covariance.
pub fn geometry<R: Real>(splat: &Splat<R>, view: &TwinCamera<R>) -> ([R; 3], Ewa<R>) {
    let p = to_camera(view, splat.mean);
    (p, projection::project(view, pivot(view, p), splat.quat, splat.log_scale))
}

/// Parts of a pixel to which positions under parallel rays are rounded.
pub const PIXEL_STEPS: f64 = 1024.0;

/// The camera-frame point at which the Jacobian is taken: under parallel rays that of a point on the axis.
fn pivot<R: Real>(view: &TwinCamera<R>, p: [R; 3]) -> [R; 3] {
    if view.orthographic { [R::zero(), R::zero(), R::one()] } else { p }
}

/// Position on the image of a camera-frame point.
fn on_image<R: Real>(view: &TwinCamera<R>, p: [R; 3]) -> [R; 2] {
    let steps = R::of(PIXEL_STEPS);
    std::array::from_fn(|k| match view.orthographic {
        true => round_even(view.focal[k] * p[k] * steps) / steps + view.principal[k],
        false => view.focal[k] * (p[k] / p[2]) + view.principal[k],
    })
}

/// Rounds to the nearest whole number, and halves to the even one.
fn round_even<R: Real>(x: R) -> R {
    let down = x.floor();
    let (half, two) = (R::of(0.5), R::of(2.0));
    let odd = (down / two).floor() * two != down;
    if x - down > half || (x - down == half && odd) { down + R::one() } else { down }
}

/// Projects one splat. Without a grid, splats off screen are not culled and tiles are not counted.
pub fn project<R: Real>(
    splat: &Splat<R>,
    view: &TwinCamera<R>,
    grid: Option<&TileGrid>,
) -> Result<Projected<R>, Culled> {
    let finite = |values: &[R]| values.iter().all(|v| v.is_finite());
    let known = finite(&splat.mean) && finite(&splat.quat) && finite(&splat.log_scale) && splat.logit.is_finite();
    if !known {
        return Err(Culled::Bad);
    }
    let p = to_camera(view, splat.mean);
    if p[2].is_nan() || p[2] <= view.near {
        return Err(Culled::Near);
    }
    let e = projection::project(view, pivot(view, p), splat.quat, splat.log_scale);
    let mean = on_image(view, p);
    let mut opacity = projection::sigmoid(splat.logit)[0];
    if view.antialias {
        opacity *= e.compensation;
    }
    let alpha_min = R::of(f64::from(grid.map_or(tile::ALPHA_MIN, |grid| grid.alpha_min)));
    let sound = finite(&mean) && finite(&e.conic) && e.det.is_finite() && p[2].is_finite();
    if !sound || opacity < alpha_min {
        return Err(Culled::Faint);
    }
    let tiles = grid.map_or(0, |grid| tile::count(mean, e.conic, opacity, grid));
    if grid.is_some() && tiles == 0 {
        return Err(Culled::OffScreen);
    }
    let dir = if view.orthographic { view.rotation[2] } else { direction(splat, view).0 };
    let y = sh::basis(dir, view.sh_degree);
    let used = sh::coefficients(view.sh_degree);
    let colour: [R; 3] = std::array::from_fn(|c| (0..used).fold(R::of(0.5), |sum, k| sum + y[k] * splat.sh[k][c]));
    if !finite(&colour) {
        return Err(Culled::Bad);
    }
    let axis = projection::shortest_axis(splat.log_scale);
    let (normal, _) = projection::normal(view, pivot(view, p), &e.rot, axis);
    let colour = colour.map(|v| v.max(R::zero()));
    let slope = projection::depth_slope(&e);
    Ok(Projected { mean, conic: e.conic, rest: e.rest, opacity, depth: p[2], slope, colour, normal, tiles })
}

/// Direction from the camera centre to the splat, and the distance.
pub(super) fn direction<R: Real>(splat: &Splat<R>, view: &TwinCamera<R>) -> ([R; 3], R) {
    let offset = vec3::sub(splat.mean, view.center);
    let distance = vec3::dot(offset, offset).sqrt();
    (offset.map(|v| v / distance), distance)
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    run_with(call, model_of);
}

/// Adapter over raw buffers, spherical harmonics in half floats.
pub fn run_half(call: &mut TwinCall<'_>) {
    run_with(call, model_of_halves);
}

fn run_with(call: &mut TwinCall<'_>, model_of: fn(&TwinCall<'_>, usize, usize) -> Gaussians) {
    let push: CameraPush = call.push();
    let view = TwinCamera::<f32> { orthographic: call.constants[3] != 0, ..TwinCamera::of(&push) };
    let mut counts = call.get::<u32>(0);
    let n = (call.groups as usize * 64).min(counts[counters::SPLATS] as usize);
    let full = counters::full_rows(&counts);
    let model = model_of(call, 1, n);
    let mut splat2d = call.get::<[f32; 12]>(9);
    let mut tile_counts = call.get::<u32>(10);
    let mut normals = call.get::<[f32; 4]>(11);
    let tile = [call.constants[0], call.constants[1]];
    let grid = TileGrid { alpha_min: f32::from_bits(call.constants[4]), ..TileGrid::new(view.size, tile) };
    let aux = call.constants[2] != 0;
    for i in 0..n {
        match project(&Splat::of(&model, i), &view.of_row(i < full), Some(&grid)) {
            Ok(p) => {
                tile_counts[i] = p.tiles;
                splat2d[i] = p.row();
                if aux {
                    normals[i] = p.normal_row();
                } else {
                    splat2d[i][11] = 0.0;
                }
            }
            Err(why) => {
                tile_counts[i] = 0;
                counts[counters::BAD_SPLATS] += u32::from(why == Culled::Bad);
            }
        }
    }
    call.set(0, &counts);
    call.set(9, &splat2d);
    call.set(10, &tile_counts);
    call.set(11, &normals);
}
