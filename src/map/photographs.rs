//! Which photographs see a place of the map, and how well they fix its height.

use half::f16;
use rayon::prelude::*;

use super::{Block, Error, SurfaceModel};
use crate::dataset::{Dataset, HostShare, View};
use crate::eval::Counting;
use crate::raster::{RenderView, Viewer};
use crate::scene::Camera;

/// Longer side of the depth maps that say what hides a place, and the least one.
const SIDES: [u32; 2] = [320, 48];
/// Bytes that the depth maps of all photographs may take.
const ROOM: u64 = 256 << 20;
/// A photograph shows a place if what it shows there is no nearer and no farther than by this share of the distance.
const TOLERANCE: f64 = 0.01;
/// A height is measured where this many photographs show the place.
const MEASURED_BY: u16 = 2;
/// Standard error of a place in a photograph, in pixels, along each side.
pub const IMAGE_ERROR: f64 = 0.5;
/// Side in cells of the squares that share a list of photographs.
const SQUARE: u32 = 32;

/// A photograph.
struct Eye {
    /// Of the scene.
    camera: Camera,
    center: [f64; 3],
    counting: Counting,
    /// Median depths of the model, row-major; 0 where nothing is.
    depths: Vec<f16>,
    size: [u32; 2],
}

/// The photographs of a map.
pub struct Photographs {
    eyes: Vec<Eye>,
}

/// What photographs see of the cells of a block.
#[derive(Clone, Debug, PartialEq)]
pub struct Sight {
    /// Number of photographs that see the cell: nothing hides it.
    pub count: Vec<u16>,
    /// Number of those that show the cell's place: they do not look through it at something farther away.
    pub showing: Vec<u16>,
    /// Expected vertical error in metres of the map: see [`Photographs::look`]. NaN where fewer than two photographs
    /// show the place.
    pub error: Vec<f32>,
}

impl Sight {
    /// Whether photographs measure the height of a cell: at least two rays meet at its place.
    pub fn measures(&self, cell: usize) -> bool {
        self.showing[cell] >= MEASURED_BY
    }
}

impl Photographs {
    /// All photographs of a dataset. A photograph that cannot be decoded, or has no file, counts as unmasked. `share`
    /// is the host's memory for those that have to be decoded, because they may be masked.
    pub fn new(
        dataset: &Dataset,
        share: &HostShare,
        model: &mut SurfaceModel,
        mut done: impl FnMut(usize),
    ) -> Result<Self, Error> {
        let costs: Vec<u64> = dataset.views.iter().map(View::decoding_bytes).collect();
        let counting = |at: usize| {
            let view = dataset.views.get(at)?;
            Some(Counting::of(view).unwrap_or_else(|_| Counting::everywhere(&view.camera)))
        };
        let counting: Vec<Option<Counting>> = share.in_turns(&costs, counting);
        let of_each = ROOM / (2 * dataset.views.len().max(1) as u64);
        let mut eyes = Vec::new();
        for (at, counting) in counting.into_iter().enumerate() {
            let (Some(camera), Some(counting)) = (dataset.scene_camera(at), counting) else { continue };
            let size = small(&camera, of_each);
            let depths = depths(model, &camera.resized(size[0], size[1]))?;
            eyes.push(Eye { center: camera.center(), camera, counting, depths, size });
            done(at + 1);
        }
        Ok(Self { eyes })
    }

    /// Number of photographs.
    pub fn len(&self) -> usize {
        self.eyes.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.eyes.is_empty()
    }

    /// Looks at the cells of a block. `up` is the direction of heights in the scene, `unit` the metres of the map in
    /// a unit of the scene.
    ///
    /// A photograph sees a cell whose place is inside of its picture, not masked there, and not hidden. It shows the
    /// place if the model's surface lies there in its view too, and not farther away: what only the view from above
    /// shows is a splat that floats. The ray of such a photograph fixes the two directions across it up to `s d / f`,
    /// with the distance d, the focal length f in pixels and the error s in pixels ([`IMAGE_ERROR`]). The rays of a
    /// cell together have the normal matrix `N = sum (f / (s d))^2 (I - r r^T)`, with unit rays r, and the error along
    /// `up` is `sqrt(up^T N^-1 up)`.
    pub fn look(&self, block: &Block, up: [f64; 3], unit: f64) -> Sight {
        let cells = block.window.cells();
        let (width, height) = (block.window.width, block.window.height);
        let squares: Vec<[u32; 2]> = (0..height.div_ceil(SQUARE))
            .flat_map(|y| (0..width.div_ceil(SQUARE)).map(move |x| [x * SQUARE, y * SQUARE]))
            .collect();
        let of_square = |[left, top]: [u32; 2]| {
            let inside = (top..height.min(top + SQUARE))
                .flat_map(move |y| (left..width.min(left + SQUARE)).map(move |x| (y * width + x) as usize));
            let cells: Vec<usize> = inside.filter(|cell| block.is_opaque(*cell)).collect();
            let eyes = self.that_may_see(block, &cells);
            cells.into_iter().map(|cell| (cell, of_point(&eyes, block.point[cell], up, unit))).collect::<Vec<_>>()
        };
        let found: Vec<_> = squares.into_par_iter().flat_map_iter(of_square).collect();
        let mut sight = Sight { count: vec![0; cells], showing: vec![0; cells], error: vec![f32::NAN; cells] };
        for (cell, (count, showing, error)) in found {
            (sight.count[cell], sight.showing[cell], sight.error[cell]) = (count, showing, error);
        }
        sight
    }

    /// The photographs in whose pictures a sphere about the cells lies, at least in part.
    fn that_may_see(&self, block: &Block, cells: &[usize]) -> Vec<&Eye> {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for cell in cells {
            for k in 0..3 {
                let v = f64::from(block.point[*cell][k]);
                (low[k], high[k]) = (low[k].min(v), high[k].max(v));
            }
        }
        let middle: [f64; 3] = std::array::from_fn(|k| 0.5 * (low[k] + high[k]));
        let radius = 0.5 * (0..3).map(|k| (high[k] - low[k]).powi(2)).sum::<f64>().sqrt();
        self.eyes.iter().filter(|eye| !cells.is_empty() && eye.may_see(middle, radius)).collect()
    }
}

/// Number of photographs that see a point, of those that show it, and the expected error of its height.
fn of_point(eyes: &[&Eye], point: [f32; 3], up: [f64; 3], unit: f64) -> (u16, u16, f32) {
    let point = point.map(f64::from);
    let (mut count, mut showing) = (0u16, 0u16);
    // The upper triangle of N.
    let mut normal = [0.0f64; 6];
    for eye in eyes {
        let Some(shows) = eye.sees(point) else { continue };
        count = count.saturating_add(1);
        if !shows {
            continue;
        }
        showing = showing.saturating_add(1);
        let ray: [f64; 3] = std::array::from_fn(|k| point[k] - eye.center[k]);
        let squared: f64 = ray.iter().map(|v| v * v).sum();
        let weight = eye.camera.fx * eye.camera.fy / (IMAGE_ERROR * IMAGE_ERROR * squared);
        for (n, [i, j]) in normal.iter_mut().zip([[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]]) {
            *n += weight * (f64::from(u8::from(i == j)) - ray[i] * ray[j] / squared);
        }
    }
    let error = if showing < MEASURED_BY { f64::NAN } else { unit * along(&normal, up).sqrt() };
    (count, showing, error as f32)
}

/// `up^T N^-1 up`; not a number where N has no inverse.
fn along([xx, xy, xz, yy, yz, zz]: &[f64; 6], [x, y, z]: [f64; 3]) -> f64 {
    let adjugate = [
        yy * zz - yz * yz,
        xz * yz - xy * zz,
        xy * yz - xz * yy,
        xx * zz - xz * xz,
        xy * xz - xx * yz,
        xx * yy - xy * xy,
    ];
    let det = xx * adjugate[0] + xy * adjugate[1] + xz * adjugate[2];
    let [a, b, c, d, e, f] = adjugate;
    let form = a * x * x + d * y * y + f * z * z + 2.0 * (b * x * y + c * x * z + e * y * z);
    // Relative to the size of N: rays that are all parallel do not fix what lies along them.
    if det > 1e-12 * (xx + yy + zz).powi(3) { form / det } else { f64::NAN }
}

impl Eye {
    fn may_see(&self, middle: [f64; 3], radius: f64) -> bool {
        let camera = &self.camera;
        let [x, y, z] = camera.rotation.map(|row| (0..3).map(|k| row[k] * (middle[k] - self.center[k])).sum::<f64>());
        if z + radius <= 0.0 {
            return false;
        }
        // Distances beyond the planes through the centre and the sides of the picture.
        let within = |at: f64, focal: f64, principal: f64, size: u32| {
            let (low, high) = (-principal / focal, (f64::from(size) - principal) / focal);
            let beyond = |edge: f64| (at - edge * z) / (1.0 + edge * edge).sqrt();
            beyond(low) >= -radius && beyond(high) <= radius
        };
        within(x, camera.fx, camera.cx, camera.width) && within(y, camera.fy, camera.cy, camera.height)
    }

    /// `None` where the point is hidden or out of the picture; else whether the picture shows the point.
    fn sees(&self, point: [f64; 3]) -> Option<bool> {
        let [u, v, z] = self.camera.placed(point)?;
        let [nearest, farthest] = self.depths_around([u, v]);
        let seen = self.counting.at([u, v]) && z <= (1.0 + TOLERANCE) * farthest;
        seen.then_some(z >= (1.0 - TOLERANCE) * nearest)
    }

    /// The least and the largest of the depths around a place of the picture; infinite where one is not known.
    fn depths_around(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let [width, height] = self.size;
        let at = |v: f64, size: u32, of: u32| v * f64::from(size) / f64::from(of) - 0.5;
        let (x, y) = (at(u, width, self.camera.width), at(v, height, self.camera.height));
        let clamp = |v: f64, size: u32| v.clamp(0.0, f64::from(size - 1)) as usize;
        let (mut least, mut most) = (f64::INFINITY, 0.0f64);
        for row in [clamp(y.floor(), height), clamp(y.floor() + 1.0, height)] {
            for column in [clamp(x.floor(), width), clamp(x.floor() + 1.0, width)] {
                let depth = self.depths[row * width as usize + column].to_f64();
                let depth = if depth > 0.0 { depth } else { f64::INFINITY };
                (least, most) = (least.min(depth), most.max(depth));
            }
        }
        [least, most]
    }
}

/// The size of a depth map that takes at most this many values.
fn small(camera: &Camera, values: u64) -> [u32; 2] {
    let (width, height) = (f64::from(camera.width.max(1)), f64::from(camera.height.max(1)));
    let longer = width.max(height);
    let fitting = (values as f64 / (width * height)).sqrt() * longer;
    let side = fitting.clamp(f64::from(SIDES[1]), f64::from(SIDES[0])).min(longer);
    [width, height].map(|v| (v * side / longer).round().max(1.0) as u32)
}

fn depths(model: &mut SurfaceModel, camera: &Camera) -> Result<Vec<f16>, Error> {
    let SurfaceModel { viewer, planes, splats, projection, .. } = model;
    let view = RenderView { camera: *camera, projection: *projection, background: [0.0; 3] };
    let median = Viewer::probe(viewer, planes, *splats, &view, None)?.median;
    Ok(median.into_iter().map(f16::from_f32).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::Window;

    /// Looks straight down from a height, at a ground of z = 0, in a picture of 100 x 100 pixels.
    fn above(x: f64, height: f64) -> Eye {
        let rotation = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
        let camera = Camera {
            rotation,
            translation: [-x, 0.0, height],
            fx: 100.0,
            fy: 100.0,
            cx: 50.0,
            cy: 50.0,
            width: 100,
            height: 100,
        };
        let depths = vec![f16::from_f64(height); 100];
        Eye { center: camera.center(), counting: Counting::everywhere(&camera), camera, depths, size: [10, 10] }
    }

    fn block(points: Vec<[f32; 3]>) -> Block {
        let cells = points.len();
        Block {
            window: Window { left: 0, top: 0, width: cells as u32, height: 1 },
            colour: vec![[0.0; 3]; cells],
            alpha: vec![1.0; cells],
            height: points.iter().map(|p| f64::from(p[2])).collect(),
            point: points,
        }
    }

    /// Two cameras at a height H, a base B apart: the parallax gives an error of s H / f times sqrt(2) H / B, seen
    /// from the middle at a small base.
    #[test]
    fn expected_error_is_that_of_the_parallax() {
        let (height, base) = (10.0, 1.0);
        let pair = Photographs { eyes: vec![above(-0.5 * base, height), above(0.5 * base, height)] };
        let sight = pair.look(&block(vec![[0.0, 0.0, 0.0]]), [0.0, 0.0, 1.0], 2.0);
        let expected = 2.0 * IMAGE_ERROR * height / 100.0 * 2f64.sqrt() * height / base;
        assert_eq!(sight.count, [2]);
        assert!((f64::from(sight.error[0]) / expected - 1.0).abs() < 0.01, "{:?} for {expected}", sight.error);
        // Twice as many rays: less by the square root of two.
        let four = (0..2).flat_map(|_| [above(-0.5, height), above(0.5, height)]).collect();
        let more = Photographs { eyes: four }.look(&block(vec![[0.0, 0.0, 0.0]]), [0.0, 0.0, 1.0], 2.0);
        assert!((sight.error[0] / more.error[0] - 2f32.sqrt()).abs() < 1e-4);
    }

    #[test]
    fn hidden_masked_and_outer_places_are_not_seen() {
        let mut roofed = above(0.0, 10.0);
        // The left half of its picture shows a roof at half the distance.
        (0..100).filter(|k| k % 10 < 5).for_each(|k| roofed.depths[k] = f16::from_f64(5.0));
        let eyes = Photographs { eyes: vec![roofed, above(0.0, 10.0)] };
        let points = vec![[-3.0, 0.0, 0.0], [3.0, 0.0, 0.0], [9.0, 0.0, 0.0], [-1.0, 0.0, 5.0], [0.0, 0.0, 11.0]];
        let mut of_all = block(points);
        let sight = eyes.look(&of_all, [0.0, 0.0, 1.0], 1.0);
        assert_eq!(sight.count, [1, 2, 0, 2, 0]);
        assert_eq!(sight.showing, [1, 2, 0, 1, 0], "one photograph looks through the place at half the distance");
        assert_eq!([0, 1, 2, 3, 4].map(|cell| sight.measures(cell)), [false, true, false, false, false]);
        of_all.alpha[1] = 0.49;
        let sight = eyes.look(&of_all, [0.0, 0.0, 1.0], 1.0);
        assert_eq!(sight.count, [1, 0, 0, 2, 0], "a cell without a surface");
        assert!(sight.error[0].is_nan() && sight.error[3].is_nan(), "one ray: {sight:?}");
    }

    #[test]
    fn depth_maps_of_many_photographs_are_smaller() {
        let camera = Camera { width: 4000, height: 3000, ..above(0.0, 1.0).camera };
        assert_eq!(small(&camera, u64::MAX >> 12), [320, 240]);
        assert_eq!(small(&camera, 12_000), [126, 95]);
        assert_eq!(small(&camera, 1), [48, 36]);
        assert_eq!(small(&Camera { width: 20, height: 10, ..camera }, 1 << 20), [20, 10]);
    }
}
