//! Procedural noise.

use glam::{DVec2, DVec3};

fn mix(mut h: u32) -> u32 {
    h ^= h >> 16;
    h = h.wrapping_mul(0x7feb_352d);
    h ^= h >> 15;
    h = h.wrapping_mul(0x846c_a68b);
    h ^ (h >> 16)
}

/// A random number in [0, 1) per lattice cell, uniformly distributed.
pub(crate) fn cell(x: i32, y: i32, seed: u32) -> f64 {
    let h = mix((x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77) ^ seed);
    f64::from(h) / 4_294_967_296.0
}

fn fade(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

/// Value noise in [0, 1) on a lattice of unit cells.
pub(crate) fn noise2(p: DVec2, seed: u32) -> f64 {
    let f = p.floor();
    let (x, y) = (f.x as i32, f.y as i32);
    let (u, v) = (fade(p.x - f.x), fade(p.y - f.y));
    let a = cell(x, y, seed) * (1.0 - u) + cell(x + 1, y, seed) * u;
    let b = cell(x, y + 1, seed) * (1.0 - u) + cell(x + 1, y + 1, seed) * u;
    a * (1.0 - v) + b * v
}

/// Value noise in [0, 1) on a lattice of unit cells.
pub(crate) fn noise3(p: DVec3, seed: u32) -> f64 {
    let z = p.z.floor();
    let w = fade(p.z - z);
    let layer = |k: f64| noise2(p.truncate(), seed ^ mix(k as i32 as u32 ^ 0x5bd1_e995));
    layer(z) * (1.0 - w) + layer(z + 1.0) * w
}

/// Fractal sum of value noise in [0, 1): each octave has twice the frequency and half the amplitude, and is turned so
/// that the lattices do not line up.
pub(crate) fn fbm2(p: DVec2, octaves: u32, seed: u32) -> f64 {
    let (mut sum, mut amplitude, mut total, mut q) = (0.0, 1.0, 0.0, p);
    for k in 0..octaves {
        sum += amplitude * noise2(q, seed.wrapping_add(k.wrapping_mul(0x68e3_1da4)));
        total += amplitude;
        amplitude *= 0.5;
        q = DVec2::new(1.6 * q.x - 1.2 * q.y, 1.2 * q.x + 1.6 * q.y);
    }
    sum / total
}

/// 0 below a, 1 above b, smooth between.
pub(crate) fn smoothstep(a: f64, b: f64, x: f64) -> f64 {
    fade(((x - a) / (b - a)).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_continuous_across_cells() {
        for k in -3..4 {
            let (a, b) = (f64::from(k) - 1e-9, f64::from(k) + 1e-9);
            assert!((noise2(DVec2::new(a, 0.3), 5) - noise2(DVec2::new(b, 0.3), 5)).abs() < 1e-7);
            assert!((noise3(DVec3::new(0.1, 0.2, a), 5) - noise3(DVec3::new(0.1, 0.2, b), 5)).abs() < 1e-7);
        }
    }
}
