//! The ground: a height field of triangles on a square grid.

use glam::{DVec2, DVec3};

use super::Ray;

/// Heights at the corners of square cells, centred at the world's origin. Each cell is split into two triangles along
/// its diagonal from (0, 0) to (1, 1), so that the surface is exactly defined.
#[derive(Clone, Debug)]
pub struct Terrain {
    heights: Vec<f64>,
    /// Corners along a side.
    side: usize,
    cell: f64,
    half: f64,
    low: f64,
    high: f64,
}

impl Terrain {
    /// Samples `height` (metres, at x and y in metres) on a grid of `cells` x `cells` cells over [-half, half]^2.
    pub(crate) fn new(half: f64, cells: usize, height: impl Fn(DVec2) -> f64) -> Self {
        let (side, cell) = (cells + 1, 2.0 * half / cells as f64);
        let heights: Vec<f64> = (0..side * side)
            .map(|k| height(DVec2::new((k % side) as f64 * cell - half, (k / side) as f64 * cell - half)))
            .collect();
        let (low, high) = heights.iter().fold((f64::MAX, f64::MIN), |(l, h), &z| (l.min(z), h.max(z)));
        Self { heights, side, cell, half, low, high }
    }

    /// Half the side of the covered square, metres.
    pub fn half_side(&self) -> f64 {
        self.half
    }

    /// Side of a cell, metres.
    pub fn cell(&self) -> f64 {
        self.cell
    }

    /// Lowest and highest ground, metres.
    pub fn range(&self) -> (f64, f64) {
        (self.low, self.high)
    }

    /// Corners of cells along a side.
    pub fn corners(&self) -> usize {
        self.side
    }

    /// A corner: column and row from the south-west.
    pub fn corner_position(&self, i: usize, j: usize) -> DVec3 {
        DVec3::new(i as f64 * self.cell - self.half, j as f64 * self.cell - self.half, self.corner(i, j))
    }

    fn corner(&self, i: usize, j: usize) -> f64 {
        self.heights[j * self.side + i]
    }

    fn locate(&self, x: f64, y: f64) -> (usize, usize, f64, f64) {
        let last = (self.side - 2) as f64;
        let (gx, gy) = ((x + self.half) / self.cell, (y + self.half) / self.cell);
        let (fx, fy) = (gx.floor().clamp(0.0, last), gy.floor().clamp(0.0, last));
        (fx as usize, fy as usize, (gx - fx).clamp(0.0, 1.0), (gy - fy).clamp(0.0, 1.0))
    }

    /// Height of the triangles at (x, y); beyond the border, the height of the nearest border point.
    pub fn height(&self, x: f64, y: f64) -> f64 {
        let (i, j, u, v) = self.locate(x, y);
        let (a, b) = (self.corner(i, j), self.corner(i + 1, j + 1));
        if u >= v {
            let c = self.corner(i + 1, j);
            a + u * (c - a) + v * (b - c)
        } else {
            let c = self.corner(i, j + 1);
            a + v * (c - a) + u * (b - c)
        }
    }

    /// Unit normal of the triangle at (x, y).
    pub fn normal(&self, x: f64, y: f64) -> DVec3 {
        let (i, j, u, v) = self.locate(x, y);
        let (a, b) = (self.corner(i, j), self.corner(i + 1, j + 1));
        let (dx, dy) = if u >= v {
            let c = self.corner(i + 1, j);
            (c - a, b - c)
        } else {
            let c = self.corner(i, j + 1);
            (b - c, c - a)
        };
        DVec3::new(-dx, -dy, self.cell).normalize()
    }

    /// Normal for shading: slopes over two cells, so that triangles do not show.
    pub(crate) fn smooth_normal(&self, x: f64, y: f64) -> DVec3 {
        let h = self.cell;
        let dx = self.height(x + h, y) - self.height(x - h, y);
        let dy = self.height(x, y + h) - self.height(x, y - h);
        DVec3::new(-dx, -dy, 2.0 * h).normalize()
    }

    /// Where the ray passes from above to below the ground with `low < t < high`.
    pub(crate) fn enter(&self, ray: &Ray, low: f64, high: f64) -> Option<f64> {
        let (mut t, mut end) = (low, high);
        for (o, d, min, max) in [
            (ray.origin.x, ray.direction.x, -self.half, self.half),
            (ray.origin.y, ray.direction.y, -self.half, self.half),
            (ray.origin.z, ray.direction.z, self.low - 1.0, self.high + 1e-6),
        ] {
            if d.abs() < 1e-300 {
                if o < min || o > max {
                    return None;
                }
                continue;
            }
            let (a, b) = ((min - o) / d, (max - o) / d);
            t = t.max(a.min(b));
            end = end.min(a.max(b));
        }
        if t >= end {
            return None;
        }
        // Walk the cells (Amanatides and Woo 1987).
        let start = ray.at(t);
        let (mut i, mut j, ..) = self.locate(start.x, start.y);
        let axis = |o: f64, d: f64, k: usize| {
            let edge = |n: f64| (n * self.cell - self.half - o) / d;
            if d > 0.0 {
                (edge(k as f64 + 1.0), self.cell / d)
            } else if d < 0.0 {
                (edge(k as f64), -self.cell / d)
            } else {
                (f64::INFINITY, f64::INFINITY)
            }
        };
        let (mut next_x, step_x) = axis(ray.origin.x, ray.direction.x, i);
        let (mut next_y, step_y) = axis(ray.origin.y, ray.direction.y, j);
        loop {
            let leave = next_x.min(next_y).min(end);
            if let Some(hit) = self.enter_cell(ray, i, j, t, leave) {
                return Some(hit);
            }
            if leave >= end {
                return None;
            }
            t = leave;
            let (index, forward) = if next_x <= next_y {
                next_x += step_x;
                (&mut i, ray.direction.x > 0.0)
            } else {
                next_y += step_y;
                (&mut j, ray.direction.y > 0.0)
            };
            if forward {
                *index += 1;
                if *index >= self.side - 1 {
                    return None;
                }
            } else {
                *index = index.checked_sub(1)?;
            }
        }
    }

    /// As [`Self::enter`], within one cell: within a triangle the height above the ground is linear in t.
    fn enter_cell(&self, ray: &Ray, i: usize, j: usize, t0: f64, t1: f64) -> Option<f64> {
        let (a, b) = (self.corner(i, j), self.corner(i + 1, j + 1));
        let (c, e) = (self.corner(i + 1, j), self.corner(i, j + 1));
        let lowest_ray = (ray.origin.z + t0 * ray.direction.z).min(ray.origin.z + t1 * ray.direction.z);
        if lowest_ray > a.max(b).max(c).max(e) {
            return None;
        }
        let (x0, y0) = (i as f64 * self.cell - self.half, j as f64 * self.cell - self.half);
        let (ou, ov) = ((ray.origin.x - x0) / self.cell, (ray.origin.y - y0) / self.cell);
        let (du, dv) = (ray.direction.x / self.cell, ray.direction.y / self.cell);
        let across = du - dv;
        let middle = if across.abs() > 1e-300 { (ov - ou) / across } else { f64::INFINITY };
        let parts = if middle > t0 && middle < t1 { [(t0, middle), (middle, t1)] } else { [(t0, t1), (t1, t1)] };
        for (from, to) in parts {
            if to <= from {
                continue;
            }
            let centre = 0.5 * (from + to);
            let (slope_u, slope_v) = if ou + centre * du >= ov + centre * dv { (c - a, b - c) } else { (b - e, e - a) };
            let above =
                |t: f64| ray.origin.z + t * ray.direction.z - (a + (ou + t * du) * slope_u + (ov + t * dv) * slope_v);
            let (f0, f1) = (above(from), above(to));
            // A crossing in the gap that rounding leaves between two parts counts for the later one.
            if f1 <= 0.0 && f0 >= -1e-9 && f0 > f1 {
                return Some(from + (to - from) * (f0.max(0.0) / (f0.max(0.0) - f1)));
            }
        }
        None
    }
}
