//! Random numbers that depend on a seed alone.

/// A stream of random numbers (SplitMix64, Steele, Lea and Flood 2014): the same numbers on every machine.
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// The stream that begins at `seed`.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The stream `stream` of a seed; streams are independent, so that a further stream changes no other.
    pub fn stream(seed: u64, stream: u64) -> Self {
        let mut random = Self(seed ^ stream.wrapping_mul(0xd1b5_4a32_d192_ed03));
        random.bits();
        random
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        let bits = hash(self.0);
        self.0 = self.0.wrapping_add(STEP);
        bits
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform in [-1, 1).
    pub fn symmetric(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    /// Uniform in [a, b).
    pub fn range(&mut self, a: f64, b: f64) -> f64 {
        a + (b - a) * self.unit()
    }

    /// True with probability p.
    pub fn chance(&mut self, p: f64) -> bool {
        self.unit() < p
    }

    /// One of the items. The slice must not be empty.
    pub fn pick<T: Copy>(&mut self, items: &[T]) -> T {
        items[(self.unit() * items.len() as f64) as usize]
    }

    /// A 32-bit seed, for a texture for example.
    pub fn seed(&mut self) -> u32 {
        (self.bits() >> 32) as u32
    }

    /// Normal with mean 0 and standard deviation 1 (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        let (a, b) = (1.0 - self.unit(), self.unit());
        (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    }
}

/// What each number adds to a stream's state.
const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// 64 bits that depend on all bits of `x`.
pub fn hash(x: u64) -> u64 {
    let x = x.wrapping_add(STEP);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_have_the_numbers_of_their_publication() {
        // The first numbers of the seed 1234567, as the authors' program prints them.
        let mut random = Random::new(1_234_567);
        let want = [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423];
        assert_eq!([random.bits(), random.bits(), random.bits()], want);
    }

    #[test]
    fn moments_of_the_streams() {
        let mut r = Random::stream(7, 1);
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
        assert_ne!(Random::stream(7, 1).bits(), Random::stream(7, 2).bits());
    }
}
