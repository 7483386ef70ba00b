//! `tile_ranges`: no pairs, one tile, gaps, and the filler number after the last tile.

use psrgs_vk::pass::counters;
use psrgs_vk::pass::tile_ranges::{PASS, Push};
use psrgs_vk::scene::random::Random;
use psrgs_vk::vk::Gpu;

use super::harness::{self, Words, bytes, garbage};

pub fn run(gpu: &Gpu) {
    let mut random = Random::new(53);
    for pairs in [0usize, 1, 2, 63, 64, 65, 1000] {
        for tiles in [1u32, 2, 50, 5000] {
            // The number `tiles` marks filler.
            let mut keys: Vec<u32> = (0..pairs).map(|_| random.word() % (tiles + 1)).collect();
            keys.sort_unstable();
            keys.extend(random.words(4));
            let mut slots: Vec<u32> = (0..pairs as u32).collect();
            slots.sort_by_key(|&s| s.wrapping_mul(0x9e37_79b9));
            slots.extend([u32::MAX; 4]);
            let mut counts = [7u32; counters::COUNT];
            counts[counters::PAIRS] = pairs as u32;
            let buffers = [
                bytes(&keys),
                bytes(&slots),
                bytes(&random.words(pairs + 4)),
                bytes(&counts),
                garbage(pairs + 4),
                vec![0; 8 * (tiles as usize + 2)],
            ];
            let groups = pairs.div_ceil(64).max(1) as u32;
            // Where pairs carry splats, the pass must not write the list of splats.
            let carried = harness::run(gpu, &PASS, &[("CARRIED", 1)], &buffers, &Push { tiles }, groups);
            carried.assert_same_bits(&format!("tile_ranges of {pairs} carried pairs, {tiles} tiles"));
            assert_eq!(carried.device[4], buffers[4]);
            let outcome = harness::run(gpu, &PASS, &[], &buffers, &Push { tiles }, groups);
            outcome.assert_same_bits(&format!("tile_ranges of {pairs} pairs, {tiles} tiles"));
            assert_eq!(outcome.device[5], carried.device[5]);
            let ranges = outcome.device::<[u32; 2]>(5);
            for (tile, range) in ranges.iter().enumerate().take(tiles as usize) {
                let begin = keys[..pairs].partition_point(|&k| k < tile as u32);
                let end = keys[..pairs].partition_point(|&k| k <= tile as u32);
                let expected = if begin == end { [0, 0] } else { [begin as u32, end as u32] };
                assert_eq!(*range, expected, "tile {tile}");
            }
        }
    }
}
