//! Cars, lamp posts, and boards beside the street.

use glam::{DVec2, DVec3, Vec3};

use super::building::{block, face};
use crate::scene::random::Random;
use crate::world::Class;
use crate::world::geometry::{Shape, Solid};
use crate::world::surface::Finish;

/// A car at a point of the ground, heading along `yaw`.
pub(super) fn car(at: DVec3, yaw: f64, random: &mut Random, out: &mut Vec<Solid>) {
    let colours = [
        Vec3::splat(0.7),
        Vec3::splat(0.03),
        Vec3::splat(0.28),
        Vec3::new(0.45, 0.03, 0.03),
        Vec3::new(0.04, 0.1, 0.3),
        Vec3::new(0.55, 0.48, 0.3),
    ];
    let paint = Finish::Paint(random.pick(&colours));
    let dark = Finish::Plain(Vec3::splat(0.03));
    let length = random.range(1.95, 2.3);
    let mut add =
        |faces: Vec<_>| out.push(Solid::new(at, yaw, Shape::Convex(faces.into_boxed_slice()), Class::Other, dark));
    add(block(DVec2::new(length - 0.1, 0.78), -0.1, 0.4, dark, dark));
    let mut body = block(DVec2::new(length, 0.88), 0.28, 0.92, paint, paint);
    let slope = DVec3::new(0.35, 0.0, 1.0).normalize();
    body.push(face(slope, slope.dot(DVec3::new(length - 0.9, 0.0, 0.92)), paint));
    add(body);
    let mut cabin = block(DVec2::new(1.5, 0.86), 0.9, 1.45, Finish::Glass, paint);
    for (x, y, reach) in [(1.0, 0.0, 1.05), (-1.0, 0.0, 1.3), (0.0, 1.0, 0.8), (0.0, -1.0, 0.8)] {
        let n = DVec3::new(x, y, 0.6).normalize();
        cabin.push(face(n, n.dot(DVec3::new(x * reach, y * reach, 1.05)), Finish::Glass));
    }
    add(cabin);
}

/// A lamp post whose arm reaches along `yaw`.
pub(super) fn lamp(at: DVec3, yaw: f64, out: &mut Vec<Solid>) {
    let steel = Finish::Plain(Vec3::splat(0.4));
    let head = Finish::Plain(Vec3::splat(0.75));
    let mut add = |origin: DVec3, faces: Vec<_>| {
        out.push(Solid::new(origin, yaw, Shape::Convex(faces.into_boxed_slice()), Class::Other, steel));
    };
    add(at, block(DVec2::splat(0.07), -1.0, 6.4, steel, steel));
    let along = DVec2::from_angle(yaw).extend(0.0);
    add(at + along * 0.8, block(DVec2::new(0.85, 0.05), 6.3, 6.4, steel, steel));
    add(at + along * 1.6, block(DVec2::new(0.35, 0.14), 6.2, 6.36, head, head));
}

/// A board on two posts, blank or with small letters on both sides; the board faces `yaw` + 90 degrees.
pub(super) fn board(at: DVec3, yaw: f64, lettered: bool, random: &mut Random, out: &mut Vec<Solid>) {
    let steel = Finish::Plain(Vec3::splat(0.3));
    let back = random.pick(&[Vec3::new(0.7, 0.68, 0.6), Vec3::new(0.62, 0.1, 0.06), Vec3::new(0.05, 0.12, 0.34)]);
    let paint = if back.x > 0.65 { Vec3::splat(0.03) } else { Vec3::splat(0.8) };
    let (glyph, seed) = (random.pick(&[0.06, 0.09, 0.13]), random.seed());
    let face = if lettered { Finish::Letters { paint, back, glyph, seed } } else { Finish::Plain(back) };
    let mut add = |x: f64, faces: Vec<_>| {
        let origin = at + (DVec2::from_angle(yaw) * x).extend(0.0);
        out.push(Solid::new(origin, yaw, Shape::Convex(faces.into_boxed_slice()), Class::Other, steel));
    };
    add(0.0, block(DVec2::new(2.6, 0.06), 1.3, 4.1, face, steel));
    for x in [-2.0, 2.0] {
        add(x, block(DVec2::new(0.07, 0.05), -1.0, 1.3, steel, steel));
    }
}
