//! `compact` and `gather_counts`: none, some and all visible, around workgroup edges.

use psrgs_vk::pass::{compact, counters};
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::scan::exclusive;
use psrgs_vk::vk::Gpu;

use super::harness::{self, Words, bytes, garbage};

pub fn run(gpu: &Gpu) {
    let mut random = Random::new(41);
    for n in [0usize, 1, 63, 64, 65, 127, 128, 129, 1000] {
        for (hidden, shift) in [(0, 0), (2, 7), (3, 0), (u32::MAX, 15)] {
            let what = format!("compact of {n}, 1 in {hidden} visible");
            let tile_counts: Vec<u32> = (0..n + 3)
                .map(|_| match random.word() {
                    w if hidden == 0 || (hidden != u32::MAX && w % hidden == 0) => 1 + w % 7,
                    _ => 0,
                })
                .collect();
            let (places, visible) = exclusive(tile_counts[..n].iter().map(|&c| u32::from(c > 0)));
            let splat2d: Vec<[f32; 12]> =
                (0..n + 3).map(|_| std::array::from_fn(|_| random.between(0.2, 100.0))).collect();
            let mut counts = [7u32; counters::COUNT];
            counts[counters::SPLATS] = n as u32;
            counts[counters::VISIBLE] = visible;
            let places = if n == 0 { garbage(4) } else { bytes(&places) };
            let buffers =
                [bytes(&splat2d), bytes(&tile_counts), places, bytes(&counts), garbage(n + 4), garbage(n + 4)];
            let groups = n.div_ceil(64).max(1) as u32;
            let outcome = harness::run(gpu, &compact::PASS, &[], &buffers, &compact::Push { shift }, groups);
            outcome.assert_same_bits(&what);
            let listed = &outcome.device::<u32>(5)[..visible as usize];
            assert!(listed.windows(2).all(|w| w[0] < w[1]), "{what}: not in the order of the index");

            let order: Vec<u32> = listed.iter().rev().copied().chain([u32::MAX; 4]).collect();
            let buffers = [bytes(&order), bytes(&tile_counts), bytes(&counts), garbage(n + 4)];
            let outcome = harness::run(gpu, &compact::GATHER_COUNTS, &[], &buffers, &(), groups);
            outcome.assert_same_bits(&format!("gather_counts of {visible}"));
        }
    }
}
