//! `fill`, also with more workgroups than an axis holds.

use psrgs_vk::pass::fill::{PASS, Push};
use psrgs_vk::vk::Gpu;

use super::harness::{self, garbage};

pub fn run_count(gpu: &Gpu, words: usize, count: u32, groups: u32) {
    let push = Push { count, value: 0xdead_beef };
    harness::run(gpu, &PASS, &[], &[garbage(words)], &push, groups).assert_same_bits(&format!("fill of {count}"));
}

pub fn run(gpu: &Gpu) {
    for count in [0, 1, 63, 64, 65, 1000] {
        run_count(gpu, 1100, count, (count.div_ceil(64)).max(1));
    }
    // 70,000 workgroups: two rows.
    run_count(gpu, 70_000 * 64 + 5, 70_000 * 64, 70_000);
}
