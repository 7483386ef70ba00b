//! The ground's appearance: roads and pavements, yards, lawns, marked courts, and fields beyond the site.

use super::decal::{Decal, DecalKind};
use glam::{DVec2, DVec3, Vec3};

use super::{Appearance, decal};
use crate::world::Effects;
use crate::world::noise::{cell, fbm2, noise2, smoothstep};
use crate::world::site::{Footprint, Roads};

/// A disc of ground that a crown shades from the sky.
#[derive(Clone, Copy, Debug)]
struct Canopy {
    centre: DVec2,
    radius: f64,
}

const TILE: f64 = 8.0;
const YARD: f64 = 1.8;

/// The objects on the ground that affect its appearance.
pub(crate) struct OnGround<'a> {
    pub(crate) roads: Roads,
    /// Half the side of the built site.
    pub(crate) site: f64,
    pub(crate) buildings: Vec<Footprint>,
    pub(crate) decals: Vec<Decal>,
    /// Centres and radii of crowns.
    pub(crate) crowns: &'a [(DVec2, f64)],
}

/// The objects that the ground's appearance depends on, indexed by tile.
#[derive(Clone, Debug)]
pub(crate) struct GroundMap {
    roads: Roads,
    /// Half the side of the built site.
    site: f64,
    seed: u32,
    buildings: Vec<Footprint>,
    decals: Vec<Decal>,
    canopies: Vec<Canopy>,
    half: f64,
    side: usize,
    tiles: Vec<Tile>,
    plain: bool,
    water: bool,
    text: bool,
}

#[derive(Clone, Debug, Default)]
struct Tile {
    buildings: Vec<u32>,
    decals: Vec<u32>,
    canopies: Vec<u32>,
}

impl GroundMap {
    pub(crate) fn new(seed: u32, on: OnGround<'_>, effects: &Effects) -> Self {
        let OnGround { roads, site, buildings, decals, crowns } = on;
        let half = 1.5 * site;
        let side = (2.0 * half / TILE).ceil().max(1.0) as usize;
        let mut map = Self {
            roads,
            site,
            seed,
            buildings,
            decals,
            canopies: crowns
                .iter()
                .filter(|(c, _)| c.abs().max_element() < half)
                .map(|&(centre, radius)| Canopy { centre, radius })
                .collect(),
            half,
            side,
            tiles: vec![Tile::default(); side * side],
            plain: effects.plain,
            water: effects.water,
            text: effects.text,
        };
        for k in 0..map.buildings.len() {
            let (c, r) = (map.buildings[k].centre, map.buildings[k].reach() + YARD);
            map.each_tile(c, r, |t| t.buildings.push(k as u32));
        }
        for k in 0..map.decals.len() {
            let (c, r) = (map.decals[k].area.centre, map.decals[k].area.reach());
            map.each_tile(c, r, |t| t.decals.push(k as u32));
        }
        for k in 0..map.canopies.len() {
            let (c, r) = (map.canopies[k].centre, map.canopies[k].radius);
            map.each_tile(c, r, |t| t.canopies.push(k as u32));
        }
        map
    }

    fn each_tile(&mut self, centre: DVec2, radius: f64, mut put: impl FnMut(&mut Tile)) {
        let index = |x: f64| ((x + self.half) / TILE).floor().clamp(0.0, (self.side - 1) as f64) as usize;
        let (i0, i1) = (index(centre.x - radius), index(centre.x + radius));
        let (j0, j1) = (index(centre.y - radius), index(centre.y + radius));
        for j in j0..=j1 {
            for i in i0..=i1 {
                put(&mut self.tiles[j * self.side + i]);
            }
        }
    }

    fn tile(&self, p: DVec2) -> Option<&Tile> {
        let (i, j) = ((p.x + self.half) / TILE, (p.y + self.half) / TILE);
        let inside = i >= 0.0 && j >= 0.0 && i < self.side as f64 && j < self.side as f64;
        inside.then(|| &self.tiles[j as usize * self.side + i as usize])
    }

    /// Whether the site has a patch of this kind.
    #[cfg(test)]
    pub(crate) fn has(&self, kind: DecalKind) -> bool {
        self.decals.iter().any(|d| d.kind == kind)
    }

    /// Whether the point is on water.
    pub(crate) fn is_water(&self, p: DVec2) -> bool {
        let ponds = |t: &Tile| t.decals.iter().any(|&k| self.is_pond(&self.decals[k as usize], p));
        self.water && self.tile(p).is_some_and(ponds)
    }

    fn is_pond(&self, d: &Decal, p: DVec2) -> bool {
        d.kind == DecalKind::Pond && decal::pond_radius(d, p, self.seed) < 1.0
    }

    /// Appearance at a point, given the normal for shading.
    pub(crate) fn sample(&self, p: DVec2, normal: DVec3) -> Appearance {
        let tile = self.tile(p);
        let mut openness = 1.0;
        let mut wall = f64::INFINITY;
        if let Some(t) = tile {
            for &k in &t.buildings {
                wall = wall.min(self.buildings[k as usize].distance(p));
            }
            for &k in &t.canopies {
                let c = &self.canopies[k as usize];
                let d = p.distance(c.centre) / c.radius;
                openness *= 1.0 - 0.4 * (1.0 - smoothstep(0.3, 1.0, d));
            }
            openness *= 0.62 + 0.38 * smoothstep(-0.1, 2.0, wall);
        }
        let look = self.look(p, normal, tile, wall);
        Appearance { openness: look.openness * openness as f32, ..look }
    }

    fn look(&self, p: DVec2, normal: DVec3, tile: Option<&Tile>, wall: f64) -> Appearance {
        let matte = |albedo: Vec3| Appearance::matte(albedo, normal);
        if let Some(colour) = self.roads.sample(p, self.seed) {
            return matte(colour);
        }
        for &k in tile.map_or(&[][..], |t| &t.decals) {
            let d = &self.decals[k as usize];
            if d.area.distance(p) > 0.0 {
                continue;
            }
            match d.kind {
                DecalKind::Court => return matte(decal::court(d, p, self.seed)),
                DecalKind::Parking => return matte(decal::parking(d, p, self.seed)),
                DecalKind::Plaza => return matte(decal::plaza(d, p, self.seed, self.text)),
                DecalKind::Meadow if self.plain => {
                    return Appearance { plain: true, ..matte(decal::meadow(p, self.seed)) };
                }
                DecalKind::Pond if self.water && decal::pond_radius(d, p, self.seed) < 1.0 => {
                    return decal::water(p, normal, self.seed);
                }
                DecalKind::Pond if self.water && decal::pond_radius(d, p, self.seed) < 1.07 => {
                    return matte(Vec3::new(0.24, 0.2, 0.14) * (0.7 + 0.5 * noise2(p * 5.0, self.seed) as f32));
                }
                DecalKind::Meadow | DecalKind::Pond => {}
            }
        }
        if wall < YARD {
            let slab = p / 0.55;
            let (i, j) = (slab.x.floor(), slab.y.floor());
            let joint = slab.x - i < 0.07 || slab.y - j < 0.07;
            let tint = 0.8 + 0.35 * cell(i as i32, j as i32, self.seed ^ 0x40) as f32;
            return matte(Vec3::new(0.36, 0.33, 0.29) * if joint { 0.5 } else { tint });
        }
        let outside = p.abs().max_element() - self.site * 1.02;
        let edge = outside + 10.0 * (fbm2(p / 14.0, 2, self.seed ^ 0x41) - 0.5);
        if edge <= 0.0 {
            return matte(self.lawn(p));
        }
        let (colour, plain) = self.fields(p);
        Appearance { plain, ..matte(colour) }
    }

    fn lawn(&self, p: DVec2) -> Vec3 {
        let tuft = noise2(p * 3.6, self.seed ^ 0x42);
        let blade = noise2(p * 9.0, self.seed ^ 0x43);
        let patch = fbm2(p / 5.0, 4, self.seed ^ 0x44);
        let dry = smoothstep(0.5, 0.72, fbm2(p / 9.0, 4, self.seed ^ 0x45));
        let green = Vec3::new(0.085, 0.15, 0.04).lerp(Vec3::new(0.16, 0.2, 0.06), patch as f32);
        let colour = green.lerp(Vec3::new(0.3, 0.25, 0.13), 0.75 * dry as f32);
        let soil = smoothstep(0.68, 0.75, fbm2(p / 3.5, 3, self.seed ^ 0x46)) as f32;
        colour.lerp(Vec3::new(0.2, 0.14, 0.09), soil) * (0.55 + 0.5 * tuft + 0.4 * blade) as f32
    }

    /// Colour of the fields, strips of crops with rows or without, and whether the point is on a strip without rows.
    fn fields(&self, p: DVec2) -> (Vec3, bool) {
        let (sin, cos) = 0.35f64.sin_cos();
        let q = DVec2::new(cos * p.x + sin * p.y, cos * p.y - sin * p.x);
        let column = (q.x / 46.0).floor();
        let v = q.y / 31.0 + 0.37 * column;
        let (i, j) = (column as i32, v.floor() as i32);
        let (fu, fv) = (q.x - column * 46.0, (v - v.floor()) * 31.0);
        let (du, dv) = (fu.min(46.0 - fu), fv.min(31.0 - fv));
        let tuft = (0.75 + 0.5 * noise2(p * 2.2, self.seed ^ 0x47)) as f32;
        if du.min(dv) < 0.9 {
            return (Vec3::new(0.2, 0.19, 0.09) * tuft, false);
        }
        let crops = [
            (Vec3::new(0.36, 0.29, 0.13), 1.1),
            (Vec3::new(0.1, 0.17, 0.05), 0.8),
            (Vec3::new(0.24, 0.17, 0.11), 1.6),
            (Vec3::new(0.38, 0.34, 0.1), 0.9),
            (Vec3::new(0.15, 0.2, 0.07), 2.2),
        ];
        let k = (cell(i, j, self.seed ^ 0x48) * crops.len() as f64) as usize % crops.len();
        let (colour, pitch) = crops[k];
        if self.plain && cell(i, j, self.seed ^ 0x4b) < 0.6 {
            return (colour * (0.98 + 0.04 * fbm2(p / 9.0, 2, self.seed ^ 0x4c)) as f32, true);
        }
        let along = if cell(i, j, self.seed ^ 0x49) < 0.5 { q.x } else { q.y };
        let row = 0.8 + 0.4 * smoothstep(0.25, 0.6, ((along / pitch).rem_euclid(1.0) - 0.5).abs() * 2.0) as f32;
        let patch = (0.8 + 0.4 * fbm2(p / 6.0, 3, self.seed ^ 0x4a)) as f32;
        (colour * row * patch * tuft, false)
    }
}
