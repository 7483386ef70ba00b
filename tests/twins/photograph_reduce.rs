//! `photograph_reduce` against the mean in f64: sizes that are not divisible, masked pixels, 8 and 16 bits.

use psrgs_vk::pass::photograph_reduce::{PASS, Push};
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::loss::{codes, counting, unpack};
use psrgs_vk::twin::photograph_reduce::mean;
use psrgs_vk::vk::Gpu;

use super::harness::{self, Words, bytes, garbage};

pub fn run(gpu: &Gpu) {
    let mut random = Random::new(12);
    for (width, height) in [(2, 2), (8, 4), (13, 11), (65, 17)] {
        for (factor, bits) in [(2, 8), (2, 16), (4, 8), (4, 16)] {
            one(gpu, &mut random, [width, height, factor], bits);
        }
    }
}

fn one(gpu: &Gpu, random: &mut Random, [width, height, factor]: [u32; 3], bits: u32) {
    let words = bits as usize / 8;
    let mut target = random.words((width * height) as usize * words);
    // A third of the pixels masked.
    for k in (0..(width * height) as usize).filter(|k| k % 3 == 1) {
        match bits {
            8 => target[k] &= 0xff_ffff,
            _ => target[2 * k + 1] &= 0xffff,
        }
    }
    let pixels = ((width / factor) * (height / factor)) as usize;
    let push = Push { width, height, factor };
    let buffers = [bytes(&target), garbage(words * pixels + 5)];
    let groups = pixels.div_ceil(64).max(1) as u32;
    let outcome = harness::run(gpu, &PASS, &[("PHOTOGRAPH_BITS", bits)], &buffers, &push, groups);
    let (device, twin) = (outcome.device::<u32>(1), outcome.twin::<u32>(1));
    let used = pixels * words;
    let (got, same) = (codes(&device[..used], bits), codes(&twin[..used], bits));
    let (colours, counts) = (unpack::<f64>(&target, bits), counting(&target, bits));
    let white = f64::from((1_u32 << bits) - 1);
    for (k, (device, twin)) in got.iter().zip(&same).enumerate() {
        let want = mean(&colours, &counts, width as usize, factor as usize, k);
        assert_eq!(device[3] != 0, want.is_some(), "{width}x{height} by {factor}: pixel {k} counts");
        assert_eq!(device[3], twin[3]);
        for c in 0..3 {
            // The nearest code, or either of two equally near ones.
            let exact = want.unwrap_or_default()[c] * white;
            for code in [device[c], twin[c]] {
                let error = (f64::from(code) - exact).abs();
                assert!(error <= 0.5 + 1e-2, "{width}x{height} by {factor}: pixel {k}, {code} for {exact}");
            }
        }
    }
    assert_eq!(device[used..], twin[used..], "words behind the result changed");
}
