//! Appearance of marked patches of ground.

use glam::{DVec2, DVec3, Vec3};

use super::{Appearance, letter};
use crate::world::noise::{fbm2, noise2};
use crate::world::site::Footprint;

/// The kind of a marked patch of ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DecalKind {
    /// Tennis court.
    Court,
    /// Parking lot.
    Parking,
    /// Evenly sown grass.
    Meadow,
    /// An elliptic pond.
    Pond,
    /// A paved place with lettering and a resolution star.
    Plaza,
}

/// A marked patch of ground.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Decal {
    pub(crate) area: Footprint,
    pub(crate) kind: DecalKind,
}

fn grain(p: DVec2, seed: u32) -> f32 {
    (0.9 + 0.2 * noise2(p * 8.0, seed ^ 0x50)) as f32
}

fn stain(p: DVec2, seed: u32) -> f32 {
    (0.85 + 0.3 * fbm2(p / 2.0, 4, seed ^ 0x51)) as f32
}

/// A tennis court: lines of 23.77 m x 10.97 m, scaled to the patch.
pub(super) fn court(d: &Decal, p: DVec2, seed: u32) -> Vec3 {
    let (q, half) = (d.area.to_local(p), d.area.half);
    let (grain, stain) = (grain(p, seed), stain(p, seed));
    let s = DVec2::new((half.x - 1.5) / 11.885, (half.y - 1.2) / 5.485);
    let a = DVec2::new(q.x / s.x, q.y / s.y).abs();
    let w = 0.09;
    let on = |x: f64, at: f64| (x - at).abs() < w;
    let inside = a.x < 11.885 + w && a.y < 5.485 + w;
    let line = inside
        && (on(a.x, 11.885)
            || on(a.y, 5.485)
            || on(a.y, 4.115)
            || (on(a.x, 6.4) && a.y < 4.115)
            || (a.y < w && a.x < 6.4));
    if line {
        Vec3::splat(0.75) * grain
    } else if a.x < 0.06 {
        Vec3::splat(0.08)
    } else if inside {
        Vec3::new(0.1, 0.2, 0.32) * stain * grain
    } else {
        Vec3::new(0.3, 0.13, 0.08) * stain * grain
    }
}

/// A parking lot with marked stalls.
pub(super) fn parking(d: &Decal, p: DVec2, seed: u32) -> Vec3 {
    let (q, half) = (d.area.to_local(p), d.area.half);
    let stall = (q.x / 2.5).rem_euclid(1.0) * 2.5;
    let line = stall < 0.12 && q.y.abs() > half.y - 4.8;
    if line && noise2(p * 5.0, seed ^ 0x52) > 0.2 {
        Vec3::splat(0.75) * grain(p, seed)
    } else {
        Vec3::new(0.12, 0.12, 0.125) * stain(p, seed) * grain(p, seed)
    }
}

/// Evenly sown grass.
pub(super) fn meadow(p: DVec2, seed: u32) -> Vec3 {
    Vec3::new(0.13, 0.2, 0.06) * (0.975 + 0.05 * fbm2(p / 8.0, 2, seed ^ 0x53)) as f32
}

/// Relative distance from the middle of a pond: 0 in the middle, 1 on the winding shore.
pub(super) fn pond_radius(d: &Decal, p: DVec2, seed: u32) -> f64 {
    let q = d.area.to_local(p);
    let wind = 0.12 * (fbm2(p / 4.0, 2, seed ^ 0x54) - 0.5);
    (q / d.area.half).length() * 1.1 + wind
}

/// Water with ripples: dark, and a mirror of the sky at flat angles.
pub(super) fn water(p: DVec2, normal: DVec3, seed: u32) -> Appearance {
    let slope = |k: u32| 0.05 * (noise2(p * 1.7, seed ^ k) - 0.5) + 0.05 * (noise2(p * 5.0, seed ^ k ^ 0x9) - 0.5);
    let rippled = (normal + DVec3::new(slope(0x55), slope(0x56), 0.0)).normalize_or(normal);
    Appearance { gloss: 0.03, plain: true, ..Appearance::matte(Vec3::new(0.018, 0.034, 0.03), rippled) }
}

/// Flagstones. With `text` also a Siemens star of 36 pairs of rays (blur shows as a grey disc whose radius grows with
/// the blur) and rows of letters with dots from 20 to 5 cm.
pub(super) fn plaza(d: &Decal, p: DVec2, seed: u32, text: bool) -> Vec3 {
    let (q, half) = (d.area.to_local(p), d.area.half);
    let stone = Vec3::new(0.42, 0.41, 0.38) * stain(p, seed) * grain(p, seed);
    let (black, white) = (Vec3::splat(0.03), Vec3::splat(0.72));
    if text {
        let radius = (half.y - 0.5).min(0.5 * half.x - 0.3);
        let star = q - DVec2::new(-half.x + radius + 0.4, 0.0);
        if star.length() < radius {
            let sector = (star.to_angle() / std::f64::consts::TAU * 36.0).rem_euclid(1.0);
            return if sector < 0.5 { black } else { white };
        }
        let left = -half.x + 2.0 * radius + 1.2;
        let mut top = half.y - 0.4;
        for (k, dot) in [0.2, 0.15, 0.1, 0.07, 0.05].into_iter().enumerate() {
            // A row is nine dots high: seven of the letters and two between rows.
            let bottom = top - 9.0 * dot;
            if q.x > left && q.x < half.x - 0.4 && q.y > bottom && q.y < top {
                let inked = letter(DVec2::new(q.x - left, q.y - bottom), dot, seed ^ (0x60 + k as u32));
                return if inked { black } else { white };
            }
            top = bottom;
        }
    }
    let joint = (q.x / 0.6).rem_euclid(1.0) < 0.06 || (q.y / 0.6).rem_euclid(1.0) < 0.06;
    stone * if joint { 0.55 } else { 1.0 }
}
