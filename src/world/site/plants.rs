//! Trees, bushes and hedges.

use glam::{DVec2, DVec3, Vec3};

use crate::scene::random::Random;
use crate::world::Class;
use crate::world::geometry::{Shape, Solid};
use crate::world::surface::Finish;

use super::building::block;

const GREENS: [Vec3; 5] = [
    Vec3::new(0.1, 0.17, 0.045),
    Vec3::new(0.075, 0.14, 0.05),
    Vec3::new(0.15, 0.19, 0.05),
    Vec3::new(0.2, 0.2, 0.055),
    Vec3::new(0.06, 0.115, 0.05),
];

/// A broad-leaved tree: clumps of leaves about a trunk. Returns the crown's radius.
pub(super) fn broadleaf(at: DVec3, size: f64, random: &mut Random, out: &mut Vec<Solid>) -> f64 {
    let radius = size * random.range(0.28, 0.36);
    let centre = at + DVec3::Z * (size - radius);
    let colour = random.pick(&GREENS) * random.range(0.85, 1.15) as f32;
    trunk(at, size - radius, 0.035 * size, out);
    let clumps = 16;
    for k in 0..clumps {
        // Spread over the sphere by the golden angle, with jitter; fewer underneath.
        let z = 1.0 - 1.55 * (f64::from(k) + 0.5) / f64::from(clumps);
        let angle = 2.399_963 * f64::from(k) + random.range(-0.4, 0.4);
        let ring = (1.0 - z * z).max(0.0).sqrt();
        let direction = DVec3::new(ring * angle.cos(), ring * angle.sin(), z);
        let own = radius * random.range(0.34, 0.52);
        let middle = centre + direction * (radius * random.range(0.62, 0.8));
        let radii = DVec3::new(own, own * random.range(0.8, 1.1), own * random.range(0.65, 0.85));
        let tint = colour * random.range(0.82, 1.18) as f32;
        let finish = Finish::Leaves { colour: tint, seed: random.seed(), centre, radius: 1.2 * radius };
        out.push(Solid::new(middle, random.range(0.0, 3.0), Shape::Ellipsoid(radii), Class::Vegetation, finish));
    }
    radius * 1.25
}

/// A conifer: a stack of cones. Returns the crown's radius.
pub(super) fn conifer(at: DVec3, size: f64, random: &mut Random, out: &mut Vec<Solid>) -> f64 {
    let radius = size * random.range(0.17, 0.23);
    let colour = Vec3::new(0.045, 0.1, 0.05) * random.range(0.8, 1.3) as f32;
    trunk(at, 0.3 * size, 0.025 * size, out);
    for k in 0..5 {
        let share = f64::from(k) / 5.0;
        let own = radius * (1.0 - 0.85 * share);
        let base = at + DVec3::Z * size * (0.12 + 0.75 * share);
        let shape = Shape::Cone { radius: own, height: size * 0.3 * (1.0 - 0.3 * share) };
        let finish = Finish::Leaves { colour, seed: random.seed(), centre: base, radius: own };
        out.push(Solid::new(base, 0.0, shape, Class::Vegetation, finish));
    }
    radius
}

/// A bush of a few clumps. Returns the bush's radius.
pub(super) fn bush(at: DVec3, size: f64, random: &mut Random, out: &mut Vec<Solid>) -> f64 {
    let colour = random.pick(&GREENS) * random.range(0.8, 1.2) as f32;
    for _ in 0..4 {
        let shift = DVec3::new(random.range(-0.5, 0.5), random.range(-0.5, 0.5), random.range(0.2, 0.5)) * size;
        let own = size * random.range(0.4, 0.65);
        let finish = Finish::Leaves { colour, seed: random.seed(), centre: at, radius: size };
        let shape = Shape::Ellipsoid(DVec3::new(own, own, own * 0.8));
        out.push(Solid::new(at + shift, 0.0, shape, Class::Vegetation, finish));
    }
    size
}

/// A clipped hedge between two points; `ground` gives the ground's height.
pub(super) fn hedge(from: DVec2, to: DVec2, ground: impl Fn(DVec2) -> f64, random: &mut Random, out: &mut Vec<Solid>) {
    let colour = random.pick(&GREENS) * 0.9;
    let length = (to - from).length();
    let count = (length / 0.7).ceil().max(1.0) as u32;
    for k in 0..count {
        let p = from.lerp(to, (f64::from(k) + 0.5) / f64::from(count));
        let radii = DVec3::new(random.range(0.5, 0.62), random.range(0.42, 0.55), random.range(0.75, 0.95));
        let at = p.extend(ground(p) + 0.35);
        let finish = Finish::Leaves { colour, seed: random.seed(), centre: at - DVec3::Z * 0.4, radius: 1.1 };
        out.push(Solid::new(at, (to - from).to_angle(), Shape::Ellipsoid(radii), Class::Vegetation, finish));
    }
}

fn trunk(at: DVec3, height: f64, half: f64, out: &mut Vec<Solid>) {
    let bark = Finish::Plain(Vec3::new(0.13, 0.095, 0.07));
    let faces = block(DVec2::splat(half.max(0.1)), -1.0, height, bark, bark);
    out.push(Solid::new(at, 0.4, Shape::Convex(faces.into_boxed_slice()), Class::Vegetation, bark));
}
