//! Buildings as convex solids.

use glam::{DVec2, DVec3, Vec3};

use super::Footprint;
use crate::scene::random::Random;
use crate::world::geometry::{Face, Shape, Solid};
use crate::world::surface::{Facade, Finish, Wall};
use crate::world::{Class, Effects};

/// Kinds of building, by roof and use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Gabled house.
    House,
    /// House with a hipped roof.
    Villa,
    /// Flat-roofed block of flats with balconies and shops.
    Flats,
    /// Low-pitched industrial hall.
    Hall,
    /// Church with a tower.
    Church,
    /// Row of narrow gabled houses.
    Terrace,
}

/// Depth in metres of walls below the floor, so that no slope shows a gap.
const FOUNDATION: f64 = 4.0;

/// Collects the solids of one building in its own frame: z = 0 is the floor.
struct Builder<'a> {
    origin: DVec3,
    yaw: f64,
    effects: &'a Effects,
    out: &'a mut Vec<Solid>,
}

pub(super) fn face(normal: DVec3, offset: f64, finish: Finish) -> Face {
    Face { normal, offset, finish }
}

/// The six half-spaces of a box around the vertical axis: half sides x and y, from `bottom` to `top`.
pub(super) fn block(half: DVec2, bottom: f64, top: f64, side: Finish, cover: Finish) -> Vec<Face> {
    vec![
        face(DVec3::X, half.x, side),
        face(DVec3::NEG_X, half.x, side),
        face(DVec3::Y, half.y, side),
        face(DVec3::NEG_Y, half.y, side),
        face(DVec3::Z, top, cover),
        face(DVec3::NEG_Z, -bottom, side),
    ]
}

/// A roof of two slopes with the ridge along x.
#[derive(Clone, Copy)]
struct Gable {
    /// Half the sides of the walls below.
    half: DVec2,
    eaves: f64,
    /// Angle of the slopes in radians.
    angle: f64,
    /// Overhang of the roof beyond the walls.
    over: DVec2,
}

impl Builder<'_> {
    fn add(&mut self, at: DVec2, faces: Vec<Face>) {
        let turned = DVec2::from_angle(self.yaw).rotate(at);
        let shape = Shape::Convex(faces.into_boxed_slice());
        let origin = self.origin + turned.extend(0.0);
        self.out.push(Solid::new(origin, self.yaw, shape, Class::Building, Finish::Glass));
    }

    /// Walls up to `top`; with a `pitch` (radians), up to a ridge along x instead.
    fn walls(&mut self, at: DVec2, half: DVec2, top: f64, facade: Facade, pitch: Option<f64>) {
        let side =
            |width: f64, k: u32| Finish::Facade(Facade { width, seed: facade.seed.wrapping_add(k * 7919), ..facade });
        let mut faces = vec![
            face(DVec3::X, half.x, side(2.0 * half.y, 1)),
            face(DVec3::NEG_X, half.x, side(2.0 * half.y, 2)),
            face(DVec3::Y, half.y, side(2.0 * half.x, 3)),
            face(DVec3::NEG_Y, half.y, side(2.0 * half.x, 4)),
            face(DVec3::NEG_Z, FOUNDATION, Finish::Plain(facade.colour)),
        ];
        match pitch {
            None if self.effects.plain && half.min_element() > 4.0 => {
                faces.push(face(DVec3::Z, top, Finish::Smooth(Vec3::new(0.5, 0.5, 0.49))));
            }
            None => faces.push(face(DVec3::Z, top, Finish::Gravel { seed: facade.seed })),
            Some(angle) => {
                for y in [1.0, -1.0] {
                    let n = DVec3::new(0.0, y * angle.sin(), angle.cos());
                    faces.push(face(n, n.dot(DVec3::new(0.0, y * half.y, top)), Finish::Plain(facade.colour)));
                }
            }
        }
        self.add(at, faces);
    }

    /// Two roof slabs over gabled walls of equal pitch.
    fn gable_roof(&mut self, at: DVec2, roof: Gable, cover: [Finish; 2]) {
        let Gable { half, eaves, angle, over } = roof;
        let edge = Finish::Plain(Vec3::new(0.16, 0.1, 0.06));
        for (y, finish) in [(1.0, cover[0]), (-1.0, cover[1])] {
            let n = DVec3::new(0.0, y * angle.sin(), angle.cos());
            let d = n.dot(DVec3::new(0.0, y * half.y, eaves));
            self.add(
                at,
                vec![
                    face(n, d + 0.22, finish),
                    face(-n, -d, edge),
                    face(DVec3::NEG_Y * y, 0.0, edge),
                    face(DVec3::Y * y, half.y + over.y, edge),
                    face(DVec3::X, half.x + over.x, edge),
                    face(DVec3::NEG_X, half.x + over.x, edge),
                ],
            );
        }
    }

    /// Four slopes that start at the eaves.
    fn hip_roof(&mut self, at: DVec2, half: DVec2, eaves: f64, angle: f64, cover: impl Fn(usize) -> Finish) {
        let mut faces = vec![face(DVec3::NEG_Z, -eaves, Finish::Plain(Vec3::new(0.16, 0.1, 0.06)))];
        for (k, (x, y)) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)].into_iter().enumerate() {
            let n = DVec3::new(x * angle.sin(), y * angle.sin(), angle.cos());
            faces.push(face(n, n.dot(DVec3::new(x * half.x, y * half.y, eaves + 0.12)), cover(k)));
        }
        for (n, d) in [(DVec3::X, half.x), (DVec3::NEG_X, half.x), (DVec3::Y, half.y), (DVec3::NEG_Y, half.y)] {
            faces.push(face(n, d, Finish::Plain(Vec3::splat(0.3))));
        }
        self.add(at, faces);
    }

    fn chimney(&mut self, at: DVec2, bottom: f64, top: f64) {
        let brick = Finish::Facade(Facade {
            wall: Wall::Brick,
            colour: Vec3::new(0.34, 0.13, 0.08),
            seed: 5,
            width: 0.5,
            storeys: 0,
            storey: 3.0,
            spacing: 9.0,
            window: DVec2::ONE,
            shutters: None,
            sign: false,
            alike: false,
        });
        self.add(at, block(DVec2::new(0.42, 0.36), bottom, top, brick, Finish::Plain(Vec3::splat(0.08))));
    }
}

fn facade(random: &mut Random, storeys: u32) -> Facade {
    let plaster = [
        Vec3::new(0.62, 0.56, 0.44),
        Vec3::new(0.66, 0.64, 0.58),
        Vec3::new(0.58, 0.44, 0.3),
        Vec3::new(0.5, 0.54, 0.5),
        Vec3::new(0.64, 0.5, 0.42),
        Vec3::new(0.42, 0.48, 0.56),
    ];
    let brick = [Vec3::new(0.4, 0.16, 0.1), Vec3::new(0.46, 0.27, 0.17), Vec3::new(0.3, 0.14, 0.11)];
    let shutter = [Vec3::new(0.05, 0.16, 0.11), Vec3::new(0.1, 0.16, 0.3), Vec3::new(0.32, 0.1, 0.07)];
    let wall = if random.chance(0.45) { Wall::Brick } else { Wall::Plaster };
    Facade {
        wall,
        colour: if wall == Wall::Brick { random.pick(&brick) } else { random.pick(&plaster) },
        seed: random.seed(),
        width: 1.0,
        storeys,
        storey: 2.9,
        spacing: random.range(2.1, 2.8),
        window: DVec2::new(random.range(0.95, 1.25), random.range(1.2, 1.5)),
        shutters: random.chance(0.4).then(|| random.pick(&shutter)),
        sign: false,
        alike: false,
    }
}

fn tiles(random: &mut Random) -> impl Fn(bool, u32) -> Finish + use<> {
    let colours = [
        Vec3::new(0.42, 0.15, 0.08),
        Vec3::new(0.32, 0.11, 0.07),
        Vec3::new(0.2, 0.2, 0.22),
        Vec3::new(0.36, 0.2, 0.12),
        Vec3::new(0.5, 0.23, 0.12),
    ];
    let (colour, seed) = (random.pick(&colours), random.seed());
    move |panels, k| Finish::Tiles { colour, seed: seed.wrapping_add(k * 101), panels }
}

/// Adds a building on its footprint (walls' outline; the long side is x), with its floor at height `z`.
pub(super) fn build(kind: Kind, plot: Footprint, z: f64, effects: &Effects, random: &mut Random, out: &mut Vec<Solid>) {
    let mut b = Builder { origin: plot.centre.extend(z), yaw: plot.yaw, effects, out };
    let half = plot.half;
    match kind {
        Kind::House => house(&mut b, half, random),
        Kind::Villa => {
            let walls = facade(random, 2);
            let eaves = 5.9;
            b.walls(DVec2::ZERO, half, eaves, walls, None);
            let cover = tiles(random);
            let angle = random.range(0.48, 0.62);
            b.hip_roof(DVec2::ZERO, half + 0.55, eaves, angle, |k| cover(false, k as u32));
            let top = eaves + half.y * angle.tan();
            b.chimney(DVec2::new(0.3 * half.x, 0.35 * half.y), eaves, top + 0.9);
        }
        Kind::Flats => flats(&mut b, half, random),
        Kind::Hall => {
            let walls = Facade { wall: Wall::Sheet, storeys: 1, storey: 6.0, spacing: 4.2, ..facade(random, 1) };
            let colour =
                random.pick(&[Vec3::new(0.5, 0.53, 0.55), Vec3::new(0.3, 0.4, 0.48), Vec3::new(0.5, 0.44, 0.34)]);
            let walls = Facade { colour, window: DVec2::new(2.6, 1.6), shutters: None, ..walls };
            let angle = 0.16;
            b.walls(DVec2::ZERO, half, 6.0, walls, Some(angle));
            let seed = random.seed();
            let metal = |k: u32| Finish::Metal { colour: Vec3::new(0.46, 0.47, 0.48), seed: seed.wrapping_add(k) };
            let roof = Gable { half, eaves: 6.0, angle, over: DVec2::splat(0.3) };
            b.gable_roof(DVec2::ZERO, roof, [metal(0), metal(1)]);
            // A board along the ridge, with or without letters.
            let ridge = 6.0 + half.y * angle.tan();
            let (back, seed) = (Vec3::new(0.36, 0.05, 0.05), random.seed());
            let letters = if effects.text {
                Finish::Letters { paint: Vec3::new(0.75, 0.72, 0.66), back, glyph: 0.2, seed }
            } else {
                Finish::Plain(back)
            };
            b.add(DVec2::ZERO, block(DVec2::new(0.62 * half.x, 0.08), ridge - 0.3, ridge + 1.75, letters, letters));
        }
        Kind::Church => {
            let stone = Facade {
                wall: Wall::Panels,
                colour: Vec3::new(0.5, 0.46, 0.38),
                storey: 6.4,
                spacing: 3.0,
                window: DVec2::new(1.1, 3.6),
                shutters: None,
                ..facade(random, 1)
            };
            let angle = 0.85;
            let nave = half - DVec2::new(2.2, 0.6);
            b.walls(DVec2::new(2.0, 0.0), nave, 7.0, stone, Some(angle));
            let cover = tiles(random);
            let roof = Gable { half: nave, eaves: 7.0, angle, over: DVec2::splat(0.35) };
            b.gable_roof(DVec2::new(2.0, 0.0), roof, [cover(false, 0), cover(false, 1)]);
            let tower = DVec2::splat(2.3);
            let at = DVec2::new(-half.x + 2.3, 0.0);
            b.walls(at, tower, 15.0, Facade { storey: 5.0, storeys: 3, spacing: 2.4, ..stone }, None);
            let copper = Finish::Tiles { colour: Vec3::new(0.16, 0.3, 0.24), seed: 4, panels: false };
            b.hip_roof(at, tower + 0.3, 15.0, 1.13, |_| copper);
        }
        Kind::Terrace => terrace(&mut b, half, random),
    }
}

/// Five houses wall to wall, either identical or each different.
fn terrace(b: &mut Builder<'_>, half: DVec2, random: &mut Random) {
    const UNITS: u32 = 5;
    let unit = DVec2::new(half.x / f64::from(UNITS), half.y);
    let eaves = 6.2;
    let angle = 0.7;
    let mut looks = Vec::new();
    for _ in 0..UNITS {
        // All looks are drawn, even unused ones, so that later random numbers stay the same.
        let walls = Facade { spacing: 1.9, ..facade(random, 2) };
        looks.push((walls, tiles(random)));
    }
    for k in 0..UNITS {
        let (walls, cover) = &looks[if b.effects.repeats { 0 } else { k as usize }];
        let at = DVec2::new((2.0 * f64::from(k) + 1.0) * unit.x - half.x, 0.0);
        b.walls(at, unit, eaves, *walls, Some(angle));
        let roof = Gable { half: unit, eaves, angle, over: DVec2::new(0.0, 0.4) };
        b.gable_roof(at, roof, [cover(false, 0), cover(false, 1)]);
        let ridge = eaves + half.y * angle.tan();
        b.chimney(at + DVec2::new(0.6 * unit.x, 0.25 * half.y), eaves, ridge + 0.8);
        let porch = DVec2::new(at.x - 0.3 * unit.x, half.y + 0.9);
        b.add(
            porch,
            block(
                DVec2::new(0.8, 0.9),
                -FOUNDATION,
                2.5,
                Finish::Plain(walls.colour),
                Finish::Plain(Vec3::splat(0.25)),
            ),
        );
    }
}

fn house(b: &mut Builder<'_>, half: DVec2, random: &mut Random) {
    let storeys = if random.chance(0.6) { 2 } else { 1 };
    let walls = facade(random, storeys + 1);
    let eaves = 0.35 + 2.9 * f64::from(storeys);
    let angle = random.range(0.6, 0.82);
    b.walls(DVec2::ZERO, half, eaves, walls, Some(angle));
    let cover = tiles(random);
    let panels = random.chance(0.35);
    let roof = Gable { half, eaves, angle, over: DVec2::new(0.4, 0.5) };
    b.gable_roof(DVec2::ZERO, roof, [cover(false, 0), cover(panels, 1)]);
    let ridge = eaves + half.y * angle.tan();
    b.chimney(DVec2::new(0.45 * half.x, 0.2 * half.y), eaves, ridge + 1.0);
    if random.chance(0.6) && half.x > 4.5 {
        // A dormer: a small gabled box that looks out along +y.
        let x = -0.35 * half.x;
        let front = 0.7 * half.y;
        let base = eaves + (half.y - front) * angle.tan();
        let window = Facade { width: 1.8, storeys: 1, storey: 2.4, window: DVec2::new(0.9, 1.0), ..walls };
        let side = Finish::Plain(Vec3::new(0.2, 0.17, 0.15));
        let mut faces = block(DVec2::new(0.9, 0.5 * front), base - 1.0, base + 1.7, side, cover(false, 2));
        faces[2].finish = Finish::Facade(Facade { spacing: 1.6, width: 2.6, shutters: None, ..window });
        b.add(DVec2::new(x, 0.5 * front), faces);
    }
    if random.chance(0.5) {
        // A porch or garage on the gable side.
        let at = DVec2::new(-half.x - 1.5, -0.35 * half.y);
        b.walls(at, DVec2::new(1.6, 0.5 * half.y), 2.7, Facade { storeys: 1, ..walls }, None);
    }
}

fn flats(b: &mut Builder<'_>, half: DVec2, random: &mut Random) {
    let storeys = 3 + u32::from(random.chance(0.5));
    let storey = 3.1;
    let top = 0.3 + storey * f64::from(storeys);
    let base = facade(random, storeys);
    let (sign, alike) = (b.effects.text, b.effects.repeats);
    let walls = Facade { wall: Wall::Panels, storey, spacing: 2.7, sign, alike, shutters: None, ..base };
    b.walls(DVec2::ZERO, half, top, walls, None);
    let rim = Finish::Plain(Vec3::splat(0.5));
    for s in [1.0, -1.0] {
        b.add(DVec2::new(0.0, s * (half.y - 0.15)), block(DVec2::new(half.x, 0.15), top - 0.2, top + 0.6, rim, rim));
        b.add(DVec2::new(s * (half.x - 0.15), 0.0), block(DVec2::new(0.15, half.y), top - 0.2, top + 0.6, rim, rim));
    }
    // Stair head and machines on the roof.
    let plain = Finish::Plain(Vec3::new(0.55, 0.53, 0.5));
    b.add(
        DVec2::new(-0.4 * half.x, 0.0),
        block(DVec2::new(1.8, 1.5), top - 0.2, top + 2.3, plain, Finish::Gravel { seed: 3 }),
    );
    let metal = Finish::Metal { colour: Vec3::splat(0.6), seed: 8 };
    for k in 0..4 {
        let x = half.x * (0.05 + 0.22 * f64::from(k));
        let y = random.range(-0.45, 0.45) * half.y;
        b.add(DVec2::new(x, y), block(DVec2::new(0.7, 0.5), top - 0.1, top + random.range(0.6, 1.1), metal, metal));
    }
    // Balconies along one side, repeated on every storey.
    let rail = Finish::Plain(Vec3::new(0.2, 0.22, 0.25));
    let slab = Finish::Plain(Vec3::splat(0.45));
    let columns = (2.0 * half.x / 5.4).floor().max(1.0);
    for j in 1..storeys {
        for i in 0..columns as i32 {
            let x = (f64::from(i) + 0.5 - 0.5 * columns) * 5.4;
            let z = storey * f64::from(j) + 0.1;
            b.add(DVec2::new(x, -half.y - 0.6), block(DVec2::new(1.25, 0.62), z - 0.18, z, slab, slab));
            b.add(DVec2::new(x, -half.y - 1.18), block(DVec2::new(1.25, 0.04), z, z + 0.95, rail, rail));
        }
    }
}
