//! Thin objects: a power line, and an antenna mast with its guys.

use glam::{DVec2, DVec3, Vec3};

use super::building::{block, face};
use crate::world::Class;
use crate::world::geometry::{Face, Shape, Solid};
use crate::world::surface::Finish;

/// Height of the wires at a pole, metres.
const POLE: f64 = 8.6;
/// Sag of a wire in the middle between two poles, metres.
const SAG: f64 = 0.55;
/// Radius of an insulated line of bundled conductors, metres.
const LINE: f64 = 0.03;

fn convex(origin: DVec3, yaw: f64, class: Class, faces: Vec<Face>) -> Solid {
    Solid::new(origin, yaw, Shape::Convex(faces.into_boxed_slice()), class, Finish::Plain(Vec3::splat(0.3)))
}

/// A wooden pole with a cross-arm along `yaw`. Returns the attachment points of its three wires.
pub(super) fn pole(at: DVec3, yaw: f64, out: &mut Vec<Solid>) -> [DVec3; 3] {
    let wood = Finish::Plain(Vec3::new(0.2, 0.14, 0.09));
    out.push(convex(at, yaw, Class::Other, block(DVec2::splat(0.11), -1.0, POLE + 0.5, wood, wood)));
    out.push(convex(at, yaw, Class::Other, block(DVec2::new(1.1, 0.05), POLE - 0.12, POLE, wood, wood)));
    let arm = DVec2::from_angle(yaw).extend(0.0);
    [at + DVec3::Z * POLE - arm, at + DVec3::Z * (POLE + 0.5), at + DVec3::Z * POLE + arm]
}

/// A wire between two points, in straight pieces along a parabola.
pub(super) fn line(from: DVec3, to: DVec3, out: &mut Vec<Solid>) {
    const PIECES: u32 = 8;
    let point = |k: u32| {
        let s = f64::from(k) / f64::from(PIECES);
        from.lerp(to, s) - DVec3::Z * (4.0 * SAG * s * (1.0 - s))
    };
    (0..PIECES).for_each(|k| bar(point(k), point(k + 1), LINE, Class::Wire, Vec3::splat(0.035), out));
}

/// A mast: a thin tube with cross-arms. Returns the mast's height.
pub(super) fn mast(at: DVec3, out: &mut Vec<Solid>) -> f64 {
    const HEIGHT: f64 = 19.0;
    for k in 0..8 {
        // Banded in red and white, as aviation obstacles are.
        let colour = if k % 2 == 0 { Vec3::new(0.55, 0.05, 0.03) } else { Vec3::splat(0.7) };
        let (low, high) =
            (HEIGHT * f64::from(k) / 8.0 - if k == 0 { 1.0 } else { 0.0 }, HEIGHT * f64::from(k + 1) / 8.0);
        let paint = Finish::Plain(colour);
        out.push(convex(at, 0.3, Class::Other, block(DVec2::splat(0.13), low, high, paint, paint)));
    }
    let steel = Finish::Plain(Vec3::splat(0.5));
    for (k, half) in [(0, 1.1), (1, 0.8)] {
        let z = HEIGHT - 1.0 - 2.2 * f64::from(k);
        let arm = if k == 0 { DVec2::new(half, 0.06) } else { DVec2::new(0.06, half) };
        out.push(convex(at, 0.3, Class::Other, block(arm, z, z + 0.12, steel, steel)));
    }
    HEIGHT
}

/// A guy of a mast.
pub(super) fn guy(from: DVec3, to: DVec3, out: &mut Vec<Solid>) {
    bar(from, to, 0.02, Class::Wire, Vec3::splat(0.25), out);
}

/// A thin bar of square cross-section between two points.
fn bar(from: DVec3, to: DVec3, radius: f64, class: Class, colour: Vec3, out: &mut Vec<Solid>) {
    let along = to - from;
    let (yaw, half) = (along.y.atan2(along.x), 0.5 * along.length());
    let (level, rise) = (along.truncate().length() / (2.0 * half), along.z / (2.0 * half));
    let (axis, up) = (DVec3::new(level, 0.0, rise), DVec3::new(-rise, 0.0, level));
    let paint = Finish::Plain(colour);
    let sides = [(axis, half), (-axis, half), (up, radius), (-up, radius), (DVec3::Y, radius), (DVec3::NEG_Y, radius)];
    let faces = sides.map(|(normal, offset)| face(normal, offset, paint)).to_vec();
    out.push(convex(from.midpoint(to), yaw, class, faces));
}
