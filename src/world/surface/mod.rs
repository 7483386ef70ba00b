//! The appearance of surfaces: procedural albedo as a function of position.
//!
//! Patterns go down to a few centimetres; supersampling filters detail below a photograph's pixel.

mod building;
mod decal;
mod ground;
mod plant;

pub(crate) use building::{Facade, Wall};
pub(crate) use decal::{Decal, DecalKind};
pub(crate) use ground::{GroundMap, OnGround};

use glam::{DVec2, DVec3, Vec3};

use super::noise::{cell, fbm2};

/// The finish of a face.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Finish {
    /// One colour with slight mottling.
    Plain(Vec3),
    /// Smooth paint of a car.
    Paint(Vec3),
    /// Glass.
    Glass,
    /// A wall with windows.
    Facade(Facade),
    /// Roof tiles: colour, seed, and whether part of the roof carries solar panels.
    Tiles { colour: Vec3, seed: u32, panels: bool },
    /// Ribbed sheet metal.
    Metal { colour: Vec3, seed: u32 },
    /// Gravel on a flat roof, with membrane seams.
    Gravel { seed: u32 },
    /// A bare membrane: hardly any texture.
    Smooth(Vec3),
    /// A lettered board.
    Letters { paint: Vec3, back: Vec3, glyph: f64, seed: u32 },
    /// Foliage: colour, seed, and the crown's centre and radius, whose inside is darker.
    Leaves { colour: Vec3, seed: u32, centre: DVec3, radius: f64 },
}

/// Appearance at a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Appearance {
    /// Diffuse albedo, linear.
    pub(crate) albedo: Vec3,
    /// Normal for shading, world axes.
    pub(crate) normal: DVec3,
    /// Share of the sky's light that reaches the point.
    pub(crate) openness: f32,
    /// Share of mirror reflection at normal incidence; 0 for matte surfaces.
    pub(crate) gloss: f32,
    /// Whether the point has too little texture to be matched in another photograph.
    pub(crate) plain: bool,
}

impl Appearance {
    pub(crate) fn matte(albedo: Vec3, normal: DVec3) -> Self {
        Self { albedo, normal, openness: 1.0, gloss: 0.0, plain: false }
    }
}

/// Coordinates on a face: u along its horizontal, v up its slope (metres, solid's frame).
fn face_coordinates(local: DVec3, local_normal: DVec3) -> DVec2 {
    let u = DVec3::Z.cross(local_normal).try_normalize().unwrap_or(DVec3::X);
    let v = local_normal.cross(u);
    DVec2::new(local.dot(u), local.dot(v))
}

impl Finish {
    /// Appearance at a point, given as `point` in the world and `local` in the solid's frame, with the outward normals
    /// in both frames.
    pub(crate) fn sample(&self, point: DVec3, local: DVec3, normal: DVec3, local_normal: DVec3) -> Appearance {
        let uv = face_coordinates(local, local_normal);
        match *self {
            Finish::Plain(colour) => Appearance::matte(colour * (0.85 + 0.3 * fbm2(uv * 2.3, 3, 11) as f32), normal),
            Finish::Paint(colour) => Appearance { gloss: 0.05, ..Appearance::matte(colour, normal) },
            Finish::Glass => Appearance { gloss: 0.12, ..Appearance::matte(Vec3::new(0.02, 0.025, 0.03), normal) },
            Finish::Facade(facade) => facade.sample(uv, normal),
            Finish::Tiles { colour, seed, panels } => building::tiles(uv, normal, colour, seed, panels),
            Finish::Metal { colour, seed } => building::metal(uv, normal, colour, seed),
            Finish::Gravel { seed } => building::gravel(uv, normal, seed),
            Finish::Smooth(colour) => {
                let aged = 0.985 + 0.03 * fbm2(uv / 4.0, 2, 13) as f32;
                Appearance { plain: true, ..Appearance::matte(colour * aged, normal) }
            }
            Finish::Letters { paint, back, glyph, seed } => {
                Appearance::matte(if letter(uv, glyph, seed) { paint } else { back }, normal)
            }
            Finish::Leaves { colour, seed, centre, radius } => {
                plant::leaves(point, normal, colour, seed, (point - centre).length() / radius)
            }
        }
    }
}

/// Whether a point is inked: rows of 5 x 7 characters of random strokes, `glyph` metres per dot.
fn letter(uv: DVec2, glyph: f64, seed: u32) -> bool {
    let dot = uv / glyph;
    let (column, row) = ((dot.x / 6.0).floor(), (dot.y / 9.0).floor());
    let (x, y) = ((dot.x - column * 6.0).floor() as i32, (dot.y - row * 9.0).floor() as i32);
    if x >= 5 || y >= 7 {
        return false;
    }
    let (column, row) = (column as i32, row as i32);
    if cell(column, row, seed ^ 0x51) < 0.14 {
        return false;
    }
    // Strokes rather than single dots: verticals at both ends and in the middle, horizontals at three heights.
    let on = |k: i32, p: f64| cell(column * 16 + k, row, seed) < p;
    (x == 0 && on(0, 0.85))
        || (x == 4 && on(1, 0.5))
        || (x == 2 && on(2, 0.25))
        || (y == 0 && on(3, 0.5))
        || (y == 3 && on(4, 0.55))
        || (y == 6 && on(5, 0.6))
}
