//! Every subgroup operation, in hardware and emulated, also at widths that the device does not have.

use psrgs_vk::pass::subgroup_probe::{EMULATED, LOCAL_SIZE, Push, RESULTS, SUBGROUP};
use psrgs_vk::scene::random::Random;
use psrgs_vk::vk::{Gpu, Subgroup};

use super::harness::{self, Words, bytes, garbage};

pub fn run(gpu: &Gpu) {
    let groups = 5;
    let threads = (groups * LOCAL_SIZE) as usize;
    let mut random = Random::new(31);
    let mut words = random.words(threads);
    // So that subgroups with and without a word that ends in 7 occur.
    words[..threads / 2].iter_mut().filter(|w| **w & 255 == 7).for_each(|w| *w += 1);
    words[3] = 7;
    let buffers = [bytes(&words), garbage(threads * RESULTS)];
    for width in [8, 16, 32, 64] {
        let outcome = harness::run(gpu, &EMULATED, &[("EMULATED_WIDTH", width)], &buffers, &Push { width }, groups);
        outcome.assert_same_bits(&format!("emulated subgroups of {width}"));
    }
    if let Subgroup::Hardware(width) = gpu.caps().subgroup {
        let outcome = harness::run(gpu, &SUBGROUP, &[], &buffers, &Push { width }, groups);
        outcome.assert_same_bits(&format!("hardware subgroups of {width}"));
    }
}
