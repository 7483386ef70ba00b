//! A network of gently winding roads.

use glam::{DVec2, Vec3};

use crate::scene::random::Random;
use crate::world::noise::{cell, fbm2, noise2, smoothstep};

/// Width of the pavement beside a road, metres.
const PAVEMENT: f64 = 1.5;
/// Distance between parallel roads, metres.
const SPACING: f64 = 38.0;

/// A road whose centre line is `offset + amplitude sin(frequency s + phase)` over its axis s (x or y).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Road {
    along_x: bool,
    offset: f64,
    amplitude: f64,
    frequency: f64,
    phase: f64,
    /// Half the width of the carriageway.
    pub(crate) half: f64,
}

impl Road {
    fn centre(&self, s: f64) -> f64 {
        self.offset + self.amplitude * (self.frequency * s + self.phase).sin()
    }

    fn slope(&self, s: f64) -> f64 {
        self.amplitude * self.frequency * (self.frequency * s + self.phase).cos()
    }

    /// Coordinates along the road and across it (metres, to first order in the curvature).
    fn coordinates(&self, p: DVec2) -> (f64, f64) {
        let (s, across) = if self.along_x { (p.x, p.y) } else { (p.y, p.x) };
        let slope = self.slope(s);
        (s, (across - self.centre(s)) / (1.0 + slope * slope).sqrt())
    }

    /// The point at s, `d` metres across, and the heading of the road there.
    pub(crate) fn place(&self, s: f64, d: f64) -> (DVec2, f64) {
        let slope = self.slope(s);
        let norm = (1.0 + slope * slope).sqrt();
        let (a, c) = (s - d * slope / norm, self.centre(s) + d / norm);
        if self.along_x { (DVec2::new(a, c), slope.atan()) } else { (DVec2::new(c, a), (1.0f64).atan2(slope)) }
    }
}

/// All roads.
#[derive(Clone, Debug)]
pub(crate) struct Roads(Vec<Road>);

impl Roads {
    pub(crate) fn new(extent: f64, random: &mut Random) -> Self {
        let count = ((extent / SPACING).round() as i32).max(1);
        let mut roads = Vec::new();
        for along_x in [true, false] {
            for k in 0..count {
                roads.push(Road {
                    along_x,
                    offset: (f64::from(k) - 0.5 * f64::from(count - 1)) * SPACING + random.range(-3.0, 3.0),
                    amplitude: random.range(1.0, 3.0),
                    frequency: std::f64::consts::TAU / random.range(90.0, 150.0),
                    phase: random.range(0.0, std::f64::consts::TAU),
                    half: if k == 0 { 3.3 } else { 2.7 },
                });
            }
        }
        Self(roads)
    }

    /// A single road.
    pub(crate) fn one(road: Road) -> Self {
        Self(vec![road])
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &Road> {
        self.0.iter()
    }

    /// Distance from the nearest carriageway's edge; negative on it.
    pub(crate) fn distance(&self, p: DVec2) -> f64 {
        self.0.iter().map(|r| r.coordinates(p).1.abs() - r.half).fold(f64::INFINITY, f64::min)
    }

    /// Albedo of carriageway, kerb or pavement; `None` elsewhere.
    pub(crate) fn sample(&self, p: DVec2, seed: u32) -> Option<Vec3> {
        let mut nearest: Option<(&Road, f64, f64, f64)> = None;
        let mut others = f64::INFINITY;
        for r in &self.0 {
            let (s, d) = r.coordinates(p);
            let edge = d.abs() - r.half;
            match nearest {
                Some((.., best)) if best <= edge => others = others.min(edge),
                _ => {
                    others = nearest.map_or(f64::INFINITY, |(.., best)| best);
                    nearest = Some((r, s, d, edge));
                }
            }
        }
        let (road, s, d, edge) = nearest?;
        if edge > PAVEMENT {
            return None;
        }
        if edge > 0.0 {
            if edge < 0.16 {
                return Some(Vec3::splat(0.42 + 0.08 * cell((s / 0.9).floor() as i32, 5, seed) as f32));
            }
            let (u, v) = (s / 0.5, edge / 0.5);
            let joint = u - u.floor() < 0.08 || v - v.floor() < 0.08;
            let tint = 0.85 + 0.25 * cell(u.floor() as i32, v.floor() as i32, seed ^ 0x61) as f32;
            return Some(Vec3::new(0.33, 0.32, 0.3) * if joint { 0.6 } else { tint });
        }
        let grain = 0.8 + 0.4 * noise2(p * 7.0, seed ^ 0x62);
        let patch = 0.75 + 0.5 * fbm2(p / 2.5, 4, seed ^ 0x63);
        let mut asphalt = Vec3::new(0.098, 0.098, 0.102) * (grain * patch) as f32;
        // Mended patches and cracks.
        if cell((s / 4.0).floor() as i32, (d / 1.6).floor() as i32, seed ^ 0x64) < 0.1 {
            asphalt *= 0.6;
        }
        let crack = (fbm2(p / 1.7, 4, seed ^ 0x65) - 0.5).abs();
        asphalt *= (0.55 + 0.45 * smoothstep(0.0, 0.012, crack)) as f32;
        let worn = noise2(p * 4.0, seed ^ 0x66) > 0.16;
        let white = Vec3::splat(0.66) * (0.85 + 0.2 * grain) as f32;
        if others < 0.4 {
            // No markings inside a crossing.
            return Some(asphalt);
        }
        if others < 3.4 {
            // Zebra stripes, then a stop line.
            let stripe = (d / 0.9).rem_euclid(1.0) < 0.5 && d.abs() < road.half - 0.25;
            let painted = if others < 2.9 { others > 0.8 && stripe } else { others > 3.1 && d > 0.1 };
            return Some(if painted && worn { white } else { asphalt });
        }
        let dash = (s / 4.5).rem_euclid(1.0) < 0.55;
        let line = (d.abs() < 0.09 && dash) || (d.abs() - (road.half - 0.25)).abs() < 0.07;
        Some(if line && worn { white } else { asphalt })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placing_inverts_coordinates() {
        let roads = Roads::new(80.0, &mut Random::stream(3, 1));
        assert_eq!(roads.iter().count(), 4);
        for road in roads.iter() {
            let (p, heading) = road.place(12.0, 0.0);
            assert!(road.coordinates(p).1.abs() < 1e-12);
            let (q, _) = road.place(12.01, 0.0);
            let step = (q - p).normalize();
            assert!(step.dot(DVec2::from_angle(heading)) > 0.9999);
            // Across, to first order.
            let (r, _) = road.place(12.0, 2.0);
            assert!((road.coordinates(r).1 - 2.0).abs() < 0.05);
        }
    }
}
