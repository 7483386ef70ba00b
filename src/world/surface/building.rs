//! Walls and roofs.

use glam::{DVec2, DVec3, Vec3};

use super::{Appearance, letter};
use crate::world::noise::{cell, fbm2, noise2, smoothstep};

/// Material of the wall between the windows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wall {
    /// Bricks with mortar.
    Brick,
    /// Plaster, stained by rain.
    Plaster,
    /// Concrete panels with joints.
    Panels,
    /// Sheet metal.
    Sheet,
}

/// A wall with rows of windows. u runs along the wall from its middle, v upwards from the floor (metres).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Facade {
    pub(crate) wall: Wall,
    pub(crate) colour: Vec3,
    pub(crate) seed: u32,
    /// Width of the wall; windows keep clear of its ends.
    pub(crate) width: f64,
    /// Number of storeys and their height.
    pub(crate) storeys: u32,
    pub(crate) storey: f64,
    /// Distance of window axes and size of a window.
    pub(crate) spacing: f64,
    pub(crate) window: DVec2,
    /// Colour of the shutters, if any.
    pub(crate) shutters: Option<Vec3>,
    /// Whether a lettered band runs above the ground floor.
    pub(crate) sign: bool,
    /// Whether all windows above the ground floor are identical.
    pub(crate) alike: bool,
}

const SIGN_LOW: f64 = 2.55;
const SIGN_HIGH: f64 = 3.35;

impl Facade {
    pub(super) fn sample(&self, uv: DVec2, normal: DVec3) -> Appearance {
        // Less sky is visible near the ground.
        let openness = (0.72 + 0.28 * smoothstep(-0.2, 3.0, uv.y)) as f32;
        let s = self.window_sample(uv, normal).unwrap_or_else(|| Appearance::matte(self.wall(uv), normal));
        Appearance { openness: s.openness * openness, ..s }
    }

    fn wall(&self, uv: DVec2) -> Vec3 {
        if uv.y < 0.45 && self.wall != Wall::Sheet {
            return Vec3::splat(0.2 + 0.08 * noise2(uv * 6.0, self.seed) as f32);
        }
        if self.sign && (SIGN_LOW..SIGN_HIGH).contains(&uv.y) && uv.x.abs() < 0.5 * self.width - 0.6 {
            let dark = Vec3::new(0.06, 0.07, 0.1);
            let text = DVec2::new(uv.x, uv.y - SIGN_LOW - 0.13);
            let inked = (0.0..0.55).contains(&text.y) && letter(text, 0.078, self.seed ^ 0x99);
            return if inked { Vec3::new(0.85, 0.8, 0.55) } else { dark };
        }
        let stain = (0.82 + 0.36 * fbm2(DVec2::new(uv.x * 0.9, uv.y * 0.35), 4, self.seed ^ 3)) as f32;
        let pattern = match self.wall {
            Wall::Brick => {
                let (length, height) = (0.42, 0.16);
                let row = (uv.y / height).floor();
                let u = uv.x / length + 0.5 * (row as i64 & 1) as f64;
                let (fu, fv) = ((u - u.floor()) * length, uv.y - row * height);
                if fu < 0.035 || fv < 0.03 {
                    return Vec3::new(0.5, 0.47, 0.42) * stain;
                }
                0.6 + 0.75 * cell(u.floor() as i32, row as i32, self.seed) as f32
            }
            Wall::Plaster => 0.88 + 0.24 * fbm2(uv * 7.0, 2, self.seed) as f32,
            Wall::Panels => {
                let (fu, fv) = ((uv.x / 1.2).rem_euclid(1.0), (uv.y / self.storey).rem_euclid(1.0));
                if fu < 0.04 || fv < 0.025 {
                    0.45
                } else {
                    let panel = cell((uv.x / 1.2).floor() as i32, (uv.y / self.storey).floor() as i32, self.seed);
                    0.86 + 0.22 * panel as f32
                }
            }
            Wall::Sheet => {
                let rib = (uv.x / 0.33).rem_euclid(1.0);
                if rib < 0.22 { 0.68 } else { 1.0 + 0.06 * cell((uv.x / 1.0).floor() as i32, 0, self.seed) as f32 }
            }
        };
        self.colour * pattern * stain
    }

    fn window_sample(&self, uv: DVec2, normal: DVec3) -> Option<Appearance> {
        let columns = ((self.width - 0.9) / self.spacing).floor();
        let row = (uv.y / self.storey).floor();
        let column = uv.x / self.spacing + 0.5 * columns;
        if columns < 1.0 || row < 0.0 || row >= f64::from(self.storeys) || column < 0.0 || column >= columns {
            return None;
        }
        let (mut i, mut j) = (column.floor() as i32, row as i32);
        if self.alike && j > 0 {
            (i, j) = (0, 1);
        }
        let door = j == 0 && cell(i, 77, self.seed) < 0.16;
        if !door && cell(i, j, self.seed ^ 0x1f) < 0.06 {
            return None;
        }
        let x = (column - column.floor() - 0.5) * self.spacing;
        let y = uv.y - row * self.storey;
        let half = 0.5 * self.window.x;
        let (bottom, top) = if door { (0.0, 2.15) } else { (0.95, 0.95 + self.window.y) };
        if let Some(colour) = self.shutters
            && !door
            && (half..half + 0.42).contains(&x.abs())
            && (bottom - 0.04..top + 0.04).contains(&y)
        {
            let slat = if (y / 0.11).rem_euclid(1.0) < 0.35 { 0.55 } else { 1.0 };
            return Some(Appearance::matte(colour * slat, normal));
        }
        if !door && (bottom - 0.14..bottom).contains(&y) && x.abs() < half + 0.1 {
            return Some(Appearance::matte(Vec3::splat(0.62), normal));
        }
        if x.abs() >= half || !(bottom..top).contains(&y) {
            return None;
        }
        let frame = 0.07;
        if door {
            let wood = [Vec3::new(0.22, 0.1, 0.05), Vec3::new(0.05, 0.14, 0.1), Vec3::new(0.3, 0.3, 0.32)];
            let tint = wood[(cell(i, 78, self.seed) * 3.0) as usize % 3];
            let groove = if (x / 0.2).rem_euclid(1.0) < 0.12 { 0.5 } else { 1.0 };
            return Some(Appearance::matte(tint * groove, normal));
        }
        if half - x.abs() < frame || y - bottom < frame || top - y < frame || x.abs() < 0.035 {
            return Some(Appearance::matte(Vec3::splat(0.7), normal));
        }
        // Behind the pane: a dark room, or curtains.
        let curtain = cell(i, j, self.seed ^ 0x2e);
        let drawn = x.abs() > half * (0.45 + 0.8 * curtain) || curtain < 0.13;
        let inside = if drawn { Vec3::new(0.3, 0.28, 0.24) * 0.8 } else { Vec3::new(0.025, 0.03, 0.036) };
        Some(Appearance { gloss: 0.1, ..Appearance::matte(inside, normal) })
    }
}

/// Overlapping tiles in rows, with a darker lower edge.
pub(super) fn tiles(uv: DVec2, normal: DVec3, colour: Vec3, seed: u32, panels: bool) -> Appearance {
    if panels {
        // A field of modules with bright frames and thin cell lines.
        let (u, v) = (uv.x / 1.04, uv.y / 1.68);
        let block = cell((u / 4.0).floor() as i32, (v / 2.0).floor() as i32, seed ^ 0xb0) < 0.75;
        if block && (u / 4.0).rem_euclid(1.0) < 0.985 {
            let (fu, fv) = (u.rem_euclid(1.0) * 1.04, v.rem_euclid(1.0) * 1.68);
            let edge = fu < 0.05 || fv < 0.05;
            let line = (fu / 0.165).rem_euclid(1.0) < 0.1 || (fv / 0.165).rem_euclid(1.0) < 0.1;
            let albedo = if edge {
                Vec3::splat(0.55)
            } else if line {
                Vec3::new(0.1, 0.12, 0.2)
            } else {
                Vec3::new(0.012, 0.02, 0.06)
            };
            return Appearance { gloss: 0.05, ..Appearance::matte(albedo, normal) };
        }
    }
    let (width, height) = (0.31, 0.36);
    let row = (uv.y / height).floor();
    let u = uv.x / width + 0.5 * (row as i64 & 1) as f64;
    let (fu, fv) = (u - u.floor(), uv.y / height - row);
    let tint = 0.62 + 0.6 * cell(u.floor() as i32, row as i32, seed) as f32;
    let edge = if fv < 0.16 {
        0.42
    } else if fu < 0.1 {
        0.66
    } else {
        1.0
    };
    let moss = smoothstep(0.55, 0.75, fbm2(uv * 0.55, 4, seed ^ 0x3c)) as f32;
    let aged = (0.8 + 0.4 * fbm2(uv * 0.35, 3, seed ^ 0x3d)) as f32;
    let albedo = (colour * tint * aged).lerp(Vec3::new(0.1, 0.115, 0.06), 0.55 * moss) * edge;
    Appearance::matte(albedo, normal)
}

/// Ribbed sheets with rust and skylights.
pub(super) fn metal(uv: DVec2, normal: DVec3, colour: Vec3, seed: u32) -> Appearance {
    let sheet = (uv.x / 1.1).floor() as i32;
    let rib = (uv.x / 0.275).rem_euclid(1.0);
    let skylight = sheet.rem_euclid(4) == 2 && (uv.y / 5.0).rem_euclid(1.0) < 0.55 && cell(sheet, 4, seed) < 0.8;
    if skylight {
        let bar = (uv.y / 0.6).rem_euclid(1.0) < 0.12;
        return Appearance::matte(if bar { Vec3::splat(0.25) } else { Vec3::new(0.62, 0.68, 0.7) }, normal);
    }
    let rust = smoothstep(0.6, 0.8, fbm2(DVec2::new(uv.x * 1.2, uv.y * 0.3), 4, seed)) as f32;
    let shade = if rib < 0.18 { 0.6 } else { 0.94 + 0.12 * cell(sheet, (uv.y / 6.0).floor() as i32, seed) as f32 };
    Appearance::matte((colour * shade).lerp(Vec3::new(0.22, 0.1, 0.05), 0.6 * rust), normal)
}

/// Pebbles, dark seams every few metres, puddle stains.
pub(super) fn gravel(uv: DVec2, normal: DVec3, seed: u32) -> Appearance {
    let pebble = cell((uv.x / 0.11).floor() as i32, (uv.y / 0.11).floor() as i32, seed);
    let seam = uv.x.rem_euclid(3.2) < 0.09;
    let stain = fbm2(uv * 0.6, 4, seed ^ 9);
    let shade = if seam { 0.12 } else { 0.22 + 0.22 * pebble + 0.2 * (stain - 0.5) };
    Appearance::matte(Vec3::new(1.0, 0.97, 0.9) * shade as f32, normal)
}
