//! Reproducible random numbers and procedural noise.

use glam::{DVec2, DVec3};

/// A stream of random numbers that depends on its seed only (SplitMix64, Steele et al. 2014).
#[derive(Clone, Debug)]
pub(crate) struct Random(u64);

impl Random {
    /// The stream `stream` of the seed; streams are independent, so that adding one kind of object moves no other.
    pub(crate) fn new(seed: u64, stream: u64) -> Self {
        let mut r = Self(seed ^ stream.wrapping_mul(0xd1b5_4a32_d192_ed03));
        r.bits();
        r
    }

    /// 64 random bits.
    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in [a, b).
    pub(crate) fn range(&mut self, a: f64, b: f64) -> f64 {
        a + (b - a) * self.unit()
    }

    /// True with probability p.
    pub(crate) fn chance(&mut self, p: f64) -> bool {
        self.unit() < p
    }

    /// One of the items. The slice must not be empty.
    pub(crate) fn pick<T: Copy>(&mut self, items: &[T]) -> T {
        items[(self.unit() * items.len() as f64) as usize]
    }

    /// Normal with mean 0 and standard deviation 1 (Box and Muller).
    pub(crate) fn normal(&mut self) -> f64 {
        let (a, b) = (1.0 - self.unit(), self.unit());
        (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    }

    /// A seed for procedural textures.
    pub(crate) fn seed(&mut self) -> u32 {
        (self.bits() >> 32) as u32
    }
}

fn mix(mut h: u32) -> u32 {
    h ^= h >> 16;
    h = h.wrapping_mul(0x7feb_352d);
    h ^= h >> 15;
    h = h.wrapping_mul(0x846c_a68b);
    h ^ (h >> 16)
}

/// Uniform in [0, 1) by lattice cell.
pub(crate) fn cell(x: i32, y: i32, seed: u32) -> f64 {
    let h = mix((x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77) ^ seed);
    f64::from(h) / 4_294_967_296.0
}

fn fade(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

/// Value noise in [0, 1) with unit lattice.
pub(crate) fn noise2(p: DVec2, seed: u32) -> f64 {
    let f = p.floor();
    let (x, y) = (f.x as i32, f.y as i32);
    let (u, v) = (fade(p.x - f.x), fade(p.y - f.y));
    let a = cell(x, y, seed) * (1.0 - u) + cell(x + 1, y, seed) * u;
    let b = cell(x, y + 1, seed) * (1.0 - u) + cell(x + 1, y + 1, seed) * u;
    a * (1.0 - v) + b * v
}

/// Value noise in [0, 1) with unit lattice.
pub(crate) fn noise3(p: DVec3, seed: u32) -> f64 {
    let z = p.z.floor();
    let w = fade(p.z - z);
    let layer = |k: f64| noise2(p.truncate(), seed ^ mix(k as i32 as u32 ^ 0x5bd1_e995));
    layer(z) * (1.0 - w) + layer(z + 1.0) * w
}

/// Fractal sum of value noise in [0, 1): each octave has twice the frequency and half the amplitude, and is turned so that
/// the lattices do not line up.
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
    fn moments_of_the_streams() {
        let mut r = Random::new(7, 1);
        let n = 20_000;
        let (mut mean, mut var, mut unit) = (0.0, 0.0, 0.0);
        for _ in 0..n {
            let x = r.normal();
            mean += x / f64::from(n);
            var += x * x / f64::from(n);
            unit += r.unit() / f64::from(n);
        }
        // Five standard errors of each estimate.
        assert!(mean.abs() < 5.0 / 141.0, "{mean}");
        assert!((var - 1.0).abs() < 5.0 * 1.414 / 141.0, "{var}");
        assert!((unit - 0.5).abs() < 5.0 * 0.289 / 141.0, "{unit}");
        assert_ne!(Random::new(7, 1).bits(), Random::new(7, 2).bits());
    }

    #[test]
    fn noise_is_continuous_across_cells() {
        for k in -3..4 {
            let (a, b) = (f64::from(k) - 1e-9, f64::from(k) + 1e-9);
            assert!((noise2(DVec2::new(a, 0.3), 5) - noise2(DVec2::new(b, 0.3), 5)).abs() < 1e-7);
            assert!((noise3(DVec3::new(0.1, 0.2, a), 5) - noise3(DVec3::new(0.1, 0.2, b), 5)).abs() < 1e-7);
        }
    }
}
