//! Twin of `glsl/blend_forward.comp`.

use super::{Real, TwinCall};
use crate::pass::blend_forward::{COLUMN_SIDE, PIXEL_SIDE, Push, mask_words};
use crate::scene::tile::{self, ALPHA_MIN, TileGrid};

/// A pixel stops before the splat that would take its transmittance below this (Kerbl et al. 2023).
pub const TRANSMITTANCE_MIN: f32 = 1e-4;

/// The inputs of blending.
#[derive(Clone, Debug)]
pub struct Blend<R> {
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
    pub height: usize,
    /// Background colour.
    pub background: [R; 3],
    /// Side of a tile in pixels.
    pub side: usize,
    /// Rows of `splat2d`.
    pub splats: Vec<[R; 12]>,
    /// Rows of `normals` (camera-frame normal, slope of the depth along y), where depth and normal are blended too.
    pub normals: Option<Vec<[R; 4]>>,
    /// Splats of the tiles' lists, front to back.
    pub sorted: Vec<u32>,
    /// List of each tile in `sorted`.
    pub ranges: Vec<[u32; 2]>,
    /// Width and height of the blocks of a tile: a splat is evaluated only in the blocks that it touches. `None` for no
    /// blocks.
    pub block: Option<[u32; 2]>,
    /// A splat is skipped where its alpha is below this.
    pub alpha_min: f32,
}

/// The blended image.
#[derive(Clone, Debug)]
pub struct Blended<R> {
    /// (r, g, b, final transmittance) per pixel.
    pub image: Vec<[R; 4]>,
    /// (sum w z, sum w n) per pixel; zeros without normals.
    pub aux: Vec<[R; 4]>,
    /// Entries of the tile's list up to and including the last contributor.
    pub last: Vec<u32>,
    /// The largest weight of each splat in any pixel.
    pub weights: Vec<R>,
    /// Pixel-splats evaluated.
    pub evaluated: u32,
    /// Pixel-splats blended.
    pub blended: u32,
}

/// A splat at a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Evaluation<R> {
    /// Pixel centre minus mean.
    pub d: [R; 2],
    /// exp(power).
    pub falloff: R,
    /// Opacity times falloff, not clamped; 0 where the splat is skipped.
    pub unclamped: R,
}

impl<R: Real> Evaluation<R> {
    /// min(0.99, alpha).
    pub fn alpha(&self) -> R {
        self.unclamped.min(R::of(0.99))
    }
}

/// The splat `row` at the pixel whose centre is `center`.
pub fn evaluate<R: Real>(row: &[R; 12], center: [R; 2], alpha_min: f32) -> Evaluation<R> {
    let d = [center[0] - row[0], center[1] - row[1]];
    let along = d[0] + row[3] / row[2] * d[1];
    let power = -(row[2] * along * along + row[7] * d[1] * d[1]) / R::of(2.0);
    let falloff = power.exp();
    let alpha = row[5] * falloff;
    let skipped = alpha < R::of(f64::from(alpha_min));
    Evaluation { d, falloff, unclamped: if skipped { R::zero() } else { alpha } }
}

impl<R: Real> Blend<R> {
    /// The tile of a pixel.
    pub fn tile(&self, x: usize, y: usize) -> usize {
        y / self.side * self.width.div_ceil(self.side) + x / self.side
    }

    /// The list of a pixel's tile.
    pub fn list(&self, x: usize, y: usize) -> &[u32] {
        let [begin, end] = self.ranges[self.tile(x, y)];
        &self.sorted[begin as usize..end as usize]
    }

    /// Whether a splat is evaluated at a pixel of its tile: everywhere, or in the blocks that it touches.
    pub fn evaluates(&self, splat: usize, x: usize, y: usize) -> bool {
        let Some([width, height]) = self.block else { return true };
        let image = [self.width as u32, self.height as u32];
        let grid = TileGrid { alpha_min: self.alpha_min, ..TileGrid::new(image, [width, height]) };
        let row = &self.splats[splat];
        let ellipse = tile::ellipse([row[0], row[1]], [row[2], row[3], row[4]], row[5], &grid);
        let at = [x as u32 / width, y as u32 / height];
        ellipse.rows.contains(&at[1]) && tile::row(&ellipse, at[1], &grid).contains(&at[0])
    }

    /// Centre of a pixel.
    pub fn center(x: usize, y: usize) -> [R; 2] {
        [R::of(x as f64 + 0.5), R::of(y as f64 + 0.5)]
    }

    /// Depth and normal of a splat at a pixel, as blended into the auxiliary image.
    pub fn aux_of(&self, splat: usize, x: usize, y: usize) -> [R; 4] {
        let row = &self.splats[splat];
        let [nx, ny, nz, slope_y] = self.normals.as_ref().map_or([R::zero(); 4], |n| n[splat]);
        let center = Self::center(x, y);
        [row[6] + row[11] * (center[0] - row[0]) + slope_y * (center[1] - row[1]), nx, ny, nz]
    }
}

/// Blends every pixel of the image.
pub fn forward<R: Real>(blend: &Blend<R>) -> Blended<R> {
    let pixels = blend.width * blend.height;
    let mut out = Blended {
        image: Vec::with_capacity(pixels),
        aux: Vec::with_capacity(pixels),
        last: Vec::with_capacity(pixels),
        weights: vec![R::zero(); blend.splats.len()],
        evaluated: 0,
        blended: 0,
    };
    for y in 0..blend.height {
        for x in 0..blend.width {
            let (mut transmittance, mut colour, mut aux, mut last) = (R::one(), [R::zero(); 3], [R::zero(); 4], 0);
            for (place, &splat) in blend.list(x, y).iter().enumerate() {
                if !blend.evaluates(splat as usize, x, y) {
                    continue;
                }
                let row = &blend.splats[splat as usize];
                let alpha = evaluate(row, Blend::center(x, y), blend.alpha_min).alpha();
                out.evaluated += 1;
                if alpha == R::zero() {
                    continue;
                }
                let next = transmittance * (R::one() - alpha);
                if next < R::of(f64::from(TRANSMITTANCE_MIN)) {
                    break;
                }
                let weight = alpha * transmittance;
                let most = &mut out.weights[splat as usize];
                *most = most.max(weight);
                for k in 0..3 {
                    colour[k] += weight * row[8 + k];
                }
                for (sum, value) in aux.iter_mut().zip(blend.aux_of(splat as usize, x, y)) {
                    *sum += weight * value;
                }
                transmittance = next;
                last = place as u32 + 1;
                out.blended += 1;
            }
            let [r, g, b] = std::array::from_fn(|k| colour[k] + transmittance * blend.background[k]);
            out.image.push([r, g, b, transmittance]);
            out.aux.push(if blend.normals.is_some() { aux } else { [R::zero(); 4] });
            out.last.push(last);
        }
    }
    out
}

/// Index for passes without the constant BLOCK.
pub(super) const NO_BLOCKS: usize = usize::MAX;

/// Width and height of a block of `pixels` pixels, as in `glsl/include/blocks.glsl`; `None` for 0 pixels.
pub fn block_size(pixels: u32) -> Option<[u32; 2]> {
    let width = match pixels {
        0 => return None,
        1..=16 => 4,
        17..=64 => 8,
        _ => 16,
    };
    Some([width, pixels / width])
}

/// The words of `masks` for blocks of `pixels` pixels in tiles of the PIXEL shape: see `glsl/include/blocks.glsl`. Those
/// of splats behind the last contributor of a tile are set too, which the device leaves out.
pub fn masks(blend: &Blend<f32>, pixels: u32) -> Vec<u32> {
    let Some([width, height]) = block_size(pixels) else { return Vec::new() };
    let blend = Blend { block: Some([width, height]), ..blend.clone() };
    let (rows, columns) = (PIXEL_SIDE / height, PIXEL_SIDE / width);
    let blocks = rows * columns;
    let mut words = vec![0; mask_words(blend.sorted.len() as u64, blend.ranges.len() as u64, pixels) as usize];
    let across = (blend.width as u32).div_ceil(PIXEL_SIDE);
    for (tile, &[begin, end]) in (0..).zip(&blend.ranges) {
        for (place, block) in (0..end - begin).flat_map(|place| (0..blocks).map(move |block| (place, block))) {
            let x = tile % across * PIXEL_SIDE + block / rows * width;
            let y = tile / across * PIXEL_SIDE + block % rows * height;
            if blend.evaluates(blend.sorted[(begin + place) as usize] as usize, x as usize, y as usize) {
                words[((begin / 32 + tile + place / 32) * blocks + block) as usize] |= 1 << (place % 32);
            }
        }
    }
    words
}

/// The input buffers that both blending passes share. `block` is the index of the constant BLOCK, or [`NO_BLOCKS`].
pub(super) fn inputs(call: &TwinCall<'_>, side: u32, block: usize, alpha_min: f32) -> Blend<f32> {
    let push: Push = call.push();
    Blend {
        width: push.width as usize,
        height: push.height as usize,
        background: [push.red, push.green, push.blue],
        side: side as usize,
        splats: call.get(0),
        normals: (call.constants[0] != 0).then(|| call.get(1)),
        sorted: call.get(2),
        ranges: call.get(3),
        block: block_size(call.constants.get(block).copied().unwrap_or(0)),
        alpha_min,
    }
}

fn run(call: &mut TwinCall<'_>, side: u32) {
    let block = if side == PIXEL_SIDE { 2 } else { NO_BLOCKS };
    let (weighed, alpha_min) = match *call.constants {
        [.., weighed, alpha_min] => (weighed != 0, f32::from_bits(alpha_min)),
        _ => (false, ALPHA_MIN),
    };
    let blend = inputs(call, side, block, alpha_min);
    let out = forward(&blend);
    call.set(4, &out.image);
    if blend.normals.is_some() {
        call.set(5, &out.aux);
    }
    call.set(6, &out.last);
    if call.constants[1] != 0 {
        let mut counts = call.get::<u32>(7);
        counts[0] += out.evaluated;
        counts[1] += out.blended;
        call.set(7, &counts);
    }
    if weighed {
        let mut weights = call.get::<u32>(8);
        weights.iter_mut().zip(&out.weights).for_each(|(kept, weight)| *kept = (*kept).max(weight.to_bits()));
        call.set(8, &weights);
    }
}

/// Adapter over raw buffers, tiles of the COLUMN shape.
pub fn run_column(call: &mut TwinCall<'_>) {
    run(call, COLUMN_SIDE);
}

/// Adapter over raw buffers, tiles of the PIXEL shape.
pub fn run_pixel(call: &mut TwinCall<'_>) {
    run(call, PIXEL_SIDE);
}
