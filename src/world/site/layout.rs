//! The layout of the site: places terrain, roads and objects.

use glam::{DVec2, DVec3};

use super::building::{self, Kind};
use super::roads::Road;
use super::{Footprint, Roads, plants, street, wires};
use crate::scene::random::Random;
use crate::world::WorldParams;
use crate::world::geometry::{Solid, Terrain};
use crate::world::noise::{fbm2, smoothstep};
use crate::world::surface::{Decal, DecalKind, GroundMap, OnGround};

/// Side of the ground in units of the site's extent, so that no camera sees its end.
const GROUND: f64 = 5.0;
/// Random streams, one per kind of object.
const TERRAIN: u64 = 1;
const ROADS: u64 = 2;
const BUILDINGS: u64 = 3;
const PLANTS: u64 = 4;
const STREET: u64 = 5;
const POND: u64 = 6;
const BOARDS: u64 = 7;
/// Distance between the poles of a power line, metres.
const SPAN: f64 = 24.0;

/// All that stands on the site, and the ground below.
pub(crate) struct Site {
    pub(crate) terrain: Terrain,
    pub(crate) solids: Vec<Solid>,
    pub(crate) ground: GroundMap,
}

struct Planner<'a> {
    params: &'a WorldParams,
    half: f64,
    terrain: Terrain,
    roads: Roads,
    plots: Vec<Footprint>,
    decals: Vec<Decal>,
    solids: Vec<Solid>,
    crowns: Vec<(DVec2, f64)>,
}

impl Site {
    pub(crate) fn new(params: &WorldParams) -> Self {
        let half = 0.5 * params.extent;
        let seed = Random::stream(params.seed, TERRAIN).seed();
        let cells = ((GROUND * params.extent / 1.25).ceil() as usize).min(1024);
        let roads = Roads::new(params.extent, &mut Random::stream(params.seed, ROADS));
        // Hills of a few metres on the site that grow away from it.
        let hills = |p: DVec2| {
            let away = smoothstep(half, 2.0 * params.extent, p.length());
            (fbm2(p / 55.0, 3, seed) - 0.5) * (8.0 + 22.0 * away)
        };
        let pond = pond(&roads, half, params.seed);
        let level = pond.map(|pond| pond.outline().iter().map(|&c| hills(c)).fold(f64::MAX, f64::min) - 0.4);
        let terrain = Terrain::new(0.5 * GROUND * params.extent, cells, |p| match (pond, level) {
            (Some(pond), Some(level)) => {
                let r = (pond.to_local(p) / pond.half).length();
                level + (hills(p) - level) * smoothstep(1.25, 2.1, r)
            }
            _ => hills(p),
        });
        let mut p = Planner {
            params,
            half,
            terrain,
            roads,
            plots: Vec::new(),
            decals: pond.map(|area| Decal { area, kind: DecalKind::Pond }).into_iter().collect(),
            solids: Vec::new(),
            crowns: Vec::new(),
        };
        p.buildings();
        p.boards();
        if params.effects.vegetation {
            p.plants();
        }
        p.street();
        p.thin();
        let on = OnGround { roads: p.roads, site: half, buildings: p.plots, decals: p.decals, crowns: &p.crowns };
        let ground = GroundMap::new(seed ^ 0x5eed, on, &params.effects);
        Self { terrain: p.terrain, solids: p.solids, ground }
    }
}

/// A footprint for a pond, clear of the roads; `None` where there is no space.
fn pond(roads: &Roads, half: f64, seed: u64) -> Option<Footprint> {
    let mut random = Random::stream(seed, POND);
    (0..400).find_map(|_| {
        let centre = DVec2::new(random.range(-0.85, 0.85), random.range(-0.85, 0.85)) * half;
        let area = Footprint { centre, yaw: random.range(0.0, 3.0), half: DVec2::new(6.5, 4.6) };
        let clear = area.outline().iter().chain([&centre]).all(|&c| roads.distance(c) > 2.0);
        clear.then_some(area)
    })
}

impl Planner<'_> {
    fn height(&self, p: DVec2) -> f64 {
        self.terrain.height(p.x, p.y)
    }

    /// Whether a plot keeps `road` metres from every road and clear of all other plots.
    fn is_free(&self, plot: Footprint, road: f64) -> bool {
        plot.border(2.0).all(|c| self.roads.distance(c) > road)
            && self.roads.distance(plot.centre) > road
            && self.plots.iter().all(|&o| !plot.overlaps(o, 2.2))
            && self.decals.iter().all(|d| !plot.overlaps(d.area, 1.0))
    }

    /// A plot beside a road, with its long side along the road.
    fn beside(&self, road: &Road, half: DVec2, random: &mut Random) -> Footprint {
        let side = if random.chance(0.5) { 1.0 } else { -1.0 };
        let setback = road.half + 1.5 + random.range(1.2, 4.0) + half.y;
        let (centre, heading) = road.place(random.range(-0.98, 0.98) * self.half, side * setback);
        let yaw = heading + if side > 0.0 { 0.0 } else { std::f64::consts::PI };
        Footprint { centre, yaw, half }
    }

    fn buildings(&mut self) {
        let mut random = Random::stream(self.params.seed, BUILDINGS);
        let area = (self.params.extent / 80.0).powi(2);
        let count = |n: f64| (n * area).round().max(1.0) as usize;
        let roads: Vec<Road> = self.roads.iter().copied().collect();
        let (ground, building) = (|k: DecalKind| (Some(k), None), |k: Kind| (None, Some(k)));
        // Large buildings first, while there is space.
        let plan = [
            (building(Kind::Church), 1, DVec2::new(9.5, 4.6)),
            (ground(DecalKind::Meadow), count(1.0), DVec2::new(10.5, 7.5)),
            (building(Kind::Terrace), count(1.0), DVec2::new(11.5, 4.3)),
            (building(Kind::Flats), count(2.0), DVec2::new(9.0, 5.5)),
            (building(Kind::Hall), count(1.0), DVec2::new(10.5, 7.0)),
            (ground(DecalKind::Plaza), count(1.0), DVec2::new(7.0, 4.4)),
            (ground(DecalKind::Court), count(0.6), DVec2::new(13.5, 7.0)),
            (ground(DecalKind::Parking), count(1.0), DVec2::new(8.8, 7.6)),
            (building(Kind::Villa), count(6.0), DVec2::new(5.6, 4.6)),
            (building(Kind::House), count(26.0), DVec2::new(5.8, 4.2)),
        ];
        for ((ground, building), wanted, size) in plan {
            let mut built = 0;
            for _ in 0..wanted * 60 + 200 {
                if built == wanted {
                    break;
                }
                let half = size * random.range(0.88, 1.1);
                let road = random.pick(&roads);
                let plot = self.beside(&road, half, &mut random);
                if plot.centre.abs().max_element() > self.half || !self.is_free(plot, 2.0) {
                    continue;
                }
                built += 1;
                if let Some(kind) = building {
                    let z = plot.outline().iter().map(|&c| self.height(c)).fold(f64::MIN, f64::max);
                    let effects = &self.params.effects;
                    building::build(kind, plot, z - 0.2, effects, &mut random, &mut self.solids);
                    self.plots.push(plot);
                }
                self.decals.extend(ground.map(|kind| Decal { area: plot, kind }));
            }
        }
    }

    /// Boards beside the roads.
    fn boards(&mut self) {
        let mut random = Random::stream(self.params.seed, BOARDS);
        let wanted = (4.0 * (self.params.extent / 80.0).powi(2)).round().max(1.0) as usize;
        let roads: Vec<Road> = self.roads.iter().copied().collect();
        let mut built = 0;
        for _ in 0..wanted * 60 {
            let road = random.pick(&roads);
            let plot = self.beside(&road, DVec2::new(2.7, 0.3), &mut random);
            if built < wanted && plot.centre.abs().max_element() < self.half && self.is_free(plot, 1.5) {
                built += 1;
                let at = plot.centre.extend(self.height(plot.centre));
                street::board(at, plot.yaw, self.params.effects.text, &mut random, &mut self.solids);
                self.plots.push(plot);
            }
        }
    }

    /// A power line along a road and beyond, and a mast with guys on each meadow.
    fn thin(&mut self) {
        let effects = &self.params.effects;
        if !effects.masts {
            return;
        }
        if let Some(road) = self.roads.iter().last().copied() {
            let mut before: Option<[DVec3; 3]> = None;
            let mut s = -1.7 * self.half;
            while s < 1.7 * self.half {
                let (p, heading) = road.place(s, -(road.half + 0.9));
                if self.roads.distance(p) < 0.4 {
                    s += 3.0;
                    continue;
                }
                let hooks =
                    wires::pole(p.extend(self.height(p)), heading + std::f64::consts::FRAC_PI_2, &mut self.solids);
                if let (Some(before), true) = (before, effects.wires) {
                    before.iter().zip(hooks).for_each(|(&a, b)| wires::line(a, b, &mut self.solids));
                }
                before = Some(hooks);
                s += SPAN;
            }
        }
        for d in self.decals.iter().filter(|d| d.kind == DecalKind::Meadow) {
            let ground = |p: DVec2| p.extend(self.terrain.height(p.x, p.y));
            let foot = ground(d.area.centre);
            let height = wires::mast(foot, &mut self.solids);
            for k in 0..3 {
                let anchor =
                    d.area.centre + DVec2::from_angle(d.area.yaw + 0.4 + 2.1 * f64::from(k)) * (0.9 * d.area.half.y);
                if effects.wires {
                    for share in [0.55, 0.95] {
                        wires::guy(ground(anchor), foot + DVec3::Z * height * share, &mut self.solids);
                    }
                }
            }
        }
    }

    fn plants(&mut self) {
        let mut random = Random::stream(self.params.seed, PLANTS);
        let area = (self.params.extent / 80.0).powi(2);
        for _ in 0..(520.0 * area) as usize {
            let p = DVec2::new(random.range(-1.1, 1.1), random.range(-1.1, 1.1)) * self.half;
            self.tree(p, &mut random);
        }
        // Groves around the site.
        let groves = random.seed();
        for _ in 0..(420.0 * area) as usize {
            let p = DVec2::new(random.range(-2.6, 2.6), random.range(-2.6, 2.6)) * self.half;
            if p.abs().max_element() > 1.12 * self.half && fbm2(p / 30.0, 2, groves) > 0.56 {
                self.tree(p, &mut random);
            }
        }
        // Hedges behind houses.
        for plot in self.plots.clone() {
            if !random.chance(0.5) {
                continue;
            }
            let y = plot.half.y + random.range(2.0, 3.5);
            let (a, b) = (plot.to_world(DVec2::new(-plot.half.x, y)), plot.to_world(DVec2::new(plot.half.x, y)));
            let clear = (0..=8).all(|k| self.is_clear(a.lerp(b, f64::from(k) / 8.0), 0.6));
            if clear {
                let terrain = &self.terrain;
                plants::hedge(a, b, |p| terrain.height(p.x, p.y), &mut random, &mut self.solids);
            }
        }
    }

    fn is_clear(&self, p: DVec2, radius: f64) -> bool {
        self.roads.distance(p) > 0.6 + 0.5 * radius
            && self.plots.iter().all(|f| f.distance(p) > 0.5 + radius)
            && self.decals.iter().all(|d| d.area.distance(p) > 0.2 + 0.5 * radius)
    }

    fn tree(&mut self, p: DVec2, random: &mut Random) {
        let kind = random.unit();
        let size = if kind < 0.3 { random.range(0.6, 1.3) } else { random.range(4.0, 9.0) };
        let reach = if kind < 0.3 { size } else { 0.3 * size };
        let apart = self.crowns.iter().all(|&(c, r)| c.distance(p) > 0.75 * (r + reach));
        if !apart || !self.is_clear(p, reach) {
            return;
        }
        let at = p.extend(self.height(p));
        let radius = if kind < 0.3 {
            plants::bush(at, size, random, &mut self.solids)
        } else if kind < 0.48 {
            plants::conifer(at, size * 1.15, random, &mut self.solids)
        } else {
            plants::broadleaf(at, size, random, &mut self.solids)
        };
        self.crowns.push((p, radius));
    }

    fn street(&mut self) {
        let mut random = Random::stream(self.params.seed, STREET);
        let roads: Vec<Road> = self.roads.iter().copied().collect();
        let effects = &self.params.effects;
        for (index, road) in roads.iter().enumerate() {
            for side in [1.0, -1.0] {
                let mut s = -self.half + random.range(0.0, 12.0);
                while s < self.half {
                    let (p, heading) = road.place(s, side * (road.half - 1.15));
                    let crossing =
                        roads.iter().enumerate().any(|(k, r)| k != index && Roads::one(*r).distance(p) < 4.5);
                    if effects.vehicles && !crossing {
                        let yaw = heading + if side < 0.0 { 0.0 } else { std::f64::consts::PI };
                        street::car(p.extend(self.height(p)), yaw, &mut random, &mut self.solids);
                    }
                    s += random.range(7.0, 22.0);
                }
            }
            let mut s = -self.half + 6.0;
            while effects.masts && s < self.half {
                let (p, heading) = road.place(s, road.half + 0.5);
                if self.roads.distance(p) > 0.3 {
                    let yaw = heading - std::f64::consts::FRAC_PI_2;
                    street::lamp(p.extend(self.height(p)), yaw, &mut self.solids);
                }
                s += 19.0;
            }
        }
        if !effects.vehicles {
            return;
        }
        for d in self.decals.clone() {
            if d.kind != DecalKind::Parking {
                continue;
            }
            let stalls = (2.0 * d.area.half.x / 2.5).floor() as i32;
            for k in 0..stalls {
                for side in [1.0, -1.0] {
                    let x = (f64::from(k) + 0.5) * 2.5 - (d.area.half.x / 2.5).floor() * 2.5;
                    if x.abs() > d.area.half.x - 1.2 || !random.chance(0.6) {
                        continue;
                    }
                    let p = d.area.to_world(DVec2::new(x, side * (d.area.half.y - 2.5)));
                    let yaw = d.area.yaw + side * std::f64::consts::FRAC_PI_2;
                    street::car(p.extend(self.height(p)), yaw, &mut random, &mut self.solids);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_site_has_a_meadow_a_pond_and_a_plaza() {
        for seed in 0..6 {
            let params = WorldParams { seed, ..WorldParams::default() };
            let site = Site::new(&params);
            for kind in [DecalKind::Meadow, DecalKind::Pond, DecalKind::Plaza] {
                assert!(site.ground.has(kind), "seed {seed} has no {kind:?}");
            }
        }
    }
}
