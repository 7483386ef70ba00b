//! Twin of `glsl/include/random.glsl`: counter-based random numbers.

use super::Real;

/// PCG-4D of Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 2020.
pub fn bits(key: [u32; 4]) -> [u32; 4] {
    let mut v = key.map(|k| k.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    mix(&mut v);
    v = v.map(|x| x ^ (x >> 16));
    mix(&mut v);
    v
}

fn mix(v: &mut [u32; 4]) {
    v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[3]));
    v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
    v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
    v[3] = v[3].wrapping_add(v[1].wrapping_mul(v[2]));
}

/// Functions that the shader computes by polynomials; f32 mirrors the shader, f64 is the reference.
pub trait Elementary: Real {
    /// Natural logarithm.
    fn natural_log(self) -> Self;
    /// Exponential function.
    fn exponential(self) -> Self;
    /// (cos, sin) of 2 pi `bits` / 2^24.
    fn direction(bits: u32) -> [Self; 2];
}

impl Elementary for f64 {
    fn natural_log(self) -> Self {
        self.ln()
    }
    fn exponential(self) -> Self {
        self.exp()
    }
    fn direction(bits: u32) -> [Self; 2] {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(bits) / 16_777_216.0).sin_cos();
        [cos, sin]
    }
}

/// Polynomial with the highest coefficient first, by Horner's rule.
fn horner(coefficients: &[f32], x: f32) -> f32 {
    coefficients.iter().fold(0.0, |sum, c| sum * x + c)
}

const LN: [f32; 9] = [
    0.071_497_54,
    -0.115_712_01,
    0.116_615_11,
    -0.124_110_505,
    0.142_499_37,
    -0.166_684_8,
    0.200_007_08,
    -0.249_999_9,
    0.333_333_3,
];
const EXP: [f32; 6] = [0.000_198_992_77, 0.001_393_364_4, 0.008_333_298, 0.041_666_467, 0.166_666_67, 0.5];
const SIN: [f32; 5] = [0.000_158_206_5, -0.004_681_266_4, 0.079_692_58, -0.645_964_1, std::f32::consts::FRAC_PI_2];
const COS: [f32; 5] = [0.000_903_629_9, -0.020_860_07, 0.253_669_2, -1.233_700_5, 1.0];

impl Elementary for f32 {
    fn natural_log(self) -> Self {
        let shifted = self.to_bits().wrapping_sub(0x3f35_04f3);
        let exponent = shifted as i32 >> 23;
        let f = f32::from_bits((shifted & 0x007f_ffff) + 0x3f35_04f3) - 1.0;
        let square = f * f;
        exponent as f32 * std::f32::consts::LN_2 + (f + ((square * f) * horner(&LN, f) - 0.5 * square))
    }
    fn exponential(self) -> Self {
        let x = self.clamp(-87.0, 88.0);
        let k = (x * std::f32::consts::LOG2_E + 0.5).floor();
        let r = (x - k * 0.693_359_4) - k * -0.000_212_194_44;
        let fraction = 1.0 + (r + (r * r) * horner(&EXP, r));
        fraction * f32::from_bits(((k as i32 + 127) as u32) << 23)
    }
    fn direction(bits: u32) -> [Self; 2] {
        let quarter = (bits + (1 << 21)) >> 22;
        let f = (bits as i32 - (quarter << 22) as i32) as f32 * (1.0 / 4_194_304.0);
        let z = f * f;
        let (s, c) = (horner(&SIN, z) * f, horner(&COS, z));
        match quarter & 3 {
            0 => [c, s],
            1 => [-s, c],
            2 => [-c, -s],
            _ => [s, -c],
        }
    }
}

/// Two independent standard normals by Box and Muller, from the upper 24 bits of each word.
fn normal_pair<R: Elementary>(a: u32, b: u32) -> [R; 2] {
    let uniform = R::of(f64::from((a >> 8) + 1) / 16_777_216.0);
    let radius = (R::of(-2.0) * uniform.natural_log()).max(R::zero()).sqrt();
    R::direction(b >> 8).map(|d| radius * d)
}

/// Three independent standard normals, a function of the key alone.
pub fn normals<R: Elementary>(key: [u32; 4]) -> [R; 3] {
    let b = bits(key);
    let [x, y] = normal_pair(b[0], b[1]);
    let [z, _] = normal_pair(b[2], b[3]);
    [x, y, z]
}
