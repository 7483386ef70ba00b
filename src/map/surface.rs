//! Renders windows of a map.

use rayon::prelude::*;

use super::{Area, Error, Grid, Placement, Window};
use crate::pass::camera::{NEAR, Projection};
use crate::raster::{DepthProbe, Picture, Planes, RenderView, Viewer};
use crate::scene::{Camera, Frame, Similarity};
use crate::vk;

/// Side in cells of the squares over which one similarity stands for the way to the map. The squares lie at multiples
/// of their side, whatever the windows and the bounds, so a cell is always rendered in the same way.
const SQUARE: i64 = 4096;
/// A cell has data where splats hide at least this share of what is behind them.
pub const OPAQUE: f32 = 0.5;

/// The model of a map, on the device.
pub struct SurfaceModel {
    /// Renders the model.
    pub viewer: Viewer,
    /// Its splats, in scene coordinates.
    pub planes: Planes,
    /// How many there are.
    pub splats: u32,
    /// How splats are drawn; rays are made parallel.
    pub projection: Projection,
    /// Scene and dataset.
    pub frame: Frame,
}

/// Renders windows of a grid from straight above.
pub struct Surface {
    model: SurfaceModel,
    placement: Placement,
    grid: Grid,
    /// Height above which nothing is drawn.
    top: f64,
    /// Height below which nothing is a surface.
    bottom: f64,
    /// Height at which similarities are taken.
    middle: f64,
    /// The place in cells from which positions on the device are counted: whole numbers near the scene's origin.
    anchor: [i64; 2],
}

/// A rendered window, row-major from the north-west.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// The cells.
    pub window: Window,
    /// Red, green and blue of what splats show, not multiplied by the opacity.
    pub colour: Vec<[f32; 3]>,
    /// Opacity, from 0 to 1.
    pub alpha: Vec<f32>,
    /// Height in metres of the map at which half of the light from above is stopped; NaN where less is, and below the
    /// area.
    pub height: Vec<f64>,
    /// The same place in scene coordinates; not meaningful where the height is NaN.
    pub point: Vec<[f32; 3]>,
}

impl Surface {
    /// Renders cells of `grid`; `area` says the heights.
    pub fn new(model: SurfaceModel, placement: Placement, grid: Grid, area: &Area) -> Result<Self, Error> {
        if model.splats == 0 {
            return Err(Error::NoSplats);
        }
        let origin = placement.to_map(model.frame.to_dataset([0.0; 3]));
        let cell = |v: f64| (v / grid.gsd).round() as i64;
        let anchor = [cell(origin[0]), cell(origin[1])];
        Ok(Self {
            model,
            placement,
            grid,
            top: area.top,
            bottom: area.bottom,
            middle: 0.5 * (area.bottom + area.top),
            anchor,
        })
    }

    /// The grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The way from the dataset to the map.
    pub fn placement(&self) -> &Placement {
        &self.placement
    }

    /// The model.
    pub fn model(&mut self) -> &mut SurfaceModel {
        &mut self.model
    }

    /// The direction of heights in the scene, about a window, and the metres of the map in a unit of the scene.
    pub fn up(&self, window: Window) -> ([f64; 3], f64) {
        let to_map = self.to_map_in(window);
        (to_map.rotation[2], to_map.scale)
    }

    /// Renders a window of the grid.
    pub fn render(&mut self, window: Window) -> Result<Block, vk::Error> {
        let cells = window.cells();
        let mut block = Block {
            window,
            colour: vec![[0.0; 3]; cells],
            alpha: vec![0.0; cells],
            height: vec![f64::NAN; cells],
            point: vec![[0.0; 3]; cells],
        };
        for part in self.parts(window) {
            let similarity = self.to_map_in(part);
            let camera = self.camera(part, &similarity);
            let projection = Projection { orthographic: true, near: NEAR, limits: None, ..self.model.projection };
            let view = RenderView { camera, projection, background: [0.0; 3] };
            let SurfaceModel { viewer, planes, splats, .. } = &mut self.model;
            let (picture, depths) = viewer.surface(planes, *splats, &view)?;
            self.put(&mut block, part, &camera, (&picture, &depths));
        }
        Ok(block)
    }

    /// The parts of a window in each of the squares.
    fn parts(&self, window: Window) -> Vec<Window> {
        if self.placement.is_similarity() {
            return vec![window];
        }
        let cuts = |first: i64, length: u32| {
            let mut at = vec![0];
            at.extend((1..length).filter(|k| (first + i64::from(*k)).rem_euclid(SQUARE) == 0));
            at.push(length);
            at
        };
        let columns = cuts(self.grid.west + i64::from(window.left), window.width);
        let rows = cuts(i64::from(window.top) - self.grid.north, window.height);
        let part = |x: &[u32], y: &[u32]| Window {
            left: window.left + x[0],
            top: window.top + y[0],
            width: x[1] - x[0],
            height: y[1] - y[0],
        };
        rows.windows(2).flat_map(|y| columns.windows(2).map(move |x| part(x, y))).collect()
    }

    /// The similarity from the scene to the map in the square of a window.
    fn to_map_in(&self, window: Window) -> Similarity {
        let of_dataset = match self.placement.is_similarity() {
            true => self.placement.similarity_at([0.0; 3]),
            false => {
                let middle = |cell: i64| (cell.div_euclid(SQUARE) * SQUARE + SQUARE / 2) as f64 * self.grid.gsd;
                let east = middle(self.grid.west + i64::from(window.left));
                let north = -middle(i64::from(window.top) - self.grid.north);
                self.placement.similarity_at(self.placement.to_dataset([east, north, self.middle]))
            }
        };
        Similarity::to_scene(&self.model.frame).inverse().then(&of_dataset)
    }

    /// The camera that looks down on a window. Its focal length is cells per scene unit, and its principal point is a
    /// whole number, so that only that differs between windows of a square.
    fn camera(&self, window: Window, to_map: &Similarity) -> Camera {
        let (gsd, [east, north]) = (self.grid.gsd, self.anchor);
        let [r0, r1, r2] = to_map.rotation;
        let focal = to_map.scale / gsd;
        let [x, y, z] = to_map.translation;
        let translation =
            [(x / gsd - east as f64) / focal, (north as f64 - y / gsd) / focal, (self.top - z) / to_map.scale + NEAR];
        Camera {
            rotation: [r0, r1.map(|v| -v), r2.map(|v| -v)],
            translation,
            fx: focal,
            fy: focal,
            cx: (east - self.grid.west - i64::from(window.left)) as f64,
            cy: (self.grid.north - i64::from(window.top) - north) as f64,
            width: window.width,
            height: window.height,
        }
    }

    /// Puts a rendered part into its block.
    fn put(&self, block: &mut Block, part: Window, camera: &Camera, (picture, depths): (&Picture, &DepthProbe)) {
        let width = block.window.width as usize;
        let (left, top) = ((part.left - block.window.left) as usize, (part.top - block.window.top) as usize);
        let place = |k: usize| {
            let depth = Some(depths.median[k]).filter(|depth| *depth > 0.0)?;
            let point = on_ray(camera, [k % part.width as usize, k / part.width as usize], f64::from(depth));
            let height = self.placement.to_map(self.model.frame.to_dataset(point))[2];
            (height >= self.bottom).then_some((height, point.map(|v| v as f32)))
        };
        let places: Vec<_> = (0..part.cells()).into_par_iter().map(place).collect();
        for (k, pixel) in picture.rgbt.chunks_exact(4).enumerate() {
            let at = (top + k / part.width as usize) * width + left + k % part.width as usize;
            let alpha = 1.0 - pixel[3];
            block.alpha[at] = alpha;
            if let Some((height, point)) = places[k] {
                (block.height[at], block.point[at]) = (height, point);
            }
            if alpha > 0.0 {
                block.colour[at] = [pixel[0] / alpha, pixel[1] / alpha, pixel[2] / alpha];
            }
        }
    }
}

/// The scene point at a depth on the ray of a pixel's middle, of a camera of parallel rays.
fn on_ray(camera: &Camera, [column, row]: [usize; 2], depth: f64) -> [f64; 3] {
    let at = [
        (column as f64 + 0.5 - camera.cx) / camera.fx - camera.translation[0],
        (row as f64 + 0.5 - camera.cy) / camera.fy - camera.translation[1],
        depth - camera.translation[2],
    ];
    std::array::from_fn(|i| (0..3).map(|k| camera.rotation[k][i] * at[k]).sum())
}

impl Block {
    /// Whether a cell shows a surface.
    pub fn is_opaque(&self, cell: usize) -> bool {
        self.alpha.get(cell).is_some_and(|alpha| *alpha >= OPAQUE) && self.height[cell].is_finite()
    }
}
