//! The probes: copies bit for bit, chains of operations that round alike with and without contraction, and exponentials
//! that converge to one fixed point.

use psrgs_vk::pass::probe::{COPY, COPY_GROUPS, CopyPush, RATE, RatePush};
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::probe::chains;
use psrgs_vk::vk::Gpu;

use super::harness::{self, Words, bytes, garbage};

fn copy(gpu: &Gpu) {
    for count in [0u32, 1, 63, 64, 65, 255, 256, 257, 5000] {
        let buffers = [bytes(&Random::new(7).words(4 * count as usize + 8)), garbage(4 * count as usize + 8)];
        let groups = count.div_ceil(COPY_GROUPS).max(1);
        let outcome = harness::run(gpu, &COPY, &[], &buffers, &CopyPush { count }, groups);
        outcome.assert_same_bits(&format!("copy of {count}"));
    }
}

fn rates(gpu: &Gpu) {
    for local in [8, 32] {
        for (turns, groups) in [(0, 1), (1, 3), (9, 2), (1000, 2)] {
            let given = |exp2| [("LOCAL_SIZE", local), ("EXP2", exp2)];
            let threads = groups * local - 3;
            // With a power of two as factor the product is exact, so a fused multiply-add rounds like the two separate
            // operations.
            let push = RatePush { turns, threads, a: 0.5, b: 0.75 };
            let sums = [garbage(threads as usize + 8)];
            let what = format!("{turns} turns of {threads} threads");
            let outcome = harness::run(gpu, &RATE, &given(0), &sums, &push, groups);
            outcome.assert_same_bits(&format!("multiply-adds, {what}"));

            let outcome = harness::run(gpu, &RATE, &given(1), &sums, &push, groups);
            let found = outcome.device::<f32>(0);
            for (t, sum) in found.iter().take(threads as usize).enumerate() {
                // 2^-x converges to its fixed point, so errors of 2^-20 per exponential add up to less than 2^-19.
                let exact = chains(t as u32, turns, |x: f64| (-x).exp2());
                assert!((f64::from(*sum) - exact).abs() < 8.0 * 2.0 * 2f64.powi(-20), "{what}: {sum} for {exact}");
            }
            let past = |words: Vec<u32>| words[threads as usize..].to_vec();
            assert_eq!(past(outcome.device(0)), past(outcome.twin(0)), "{what}: past the end");
        }
    }
}

pub fn run(gpu: &Gpu) {
    copy(gpu);
    rates(gpu);
}
