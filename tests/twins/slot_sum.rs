//! `slot_sum`: equal bits as its twin, around workgroup edges, with splats of no, one and many slots.

use psrgs_vk::pass::{counters, slot_sum};
use psrgs_vk::scene::random::Random;
use psrgs_vk::vk::Gpu;

use super::harness::{self, Words, bytes, garbage};

pub fn run(gpu: &Gpu) {
    let mut random = Random::new(9);
    // Visible splats, and most tiles of a splat: 129,600 are all tiles of 8x8 in an image of 3840x2160.
    for (visible, most) in [(0usize, 300), (1, 129_600), (15, 300), (16, 7), (17, 8), (200, 300)] {
        for aux in [0, 1] {
            // Splats 0, 3, 6, ... are visible; the others' counts are 0.
            let splats = 3 * visible + 2;
            let mut tile_counts = vec![0u32; splats];
            let listed: Vec<u32> = (0..visible).map(|k| 3 * k as u32).collect();
            let mut offsets = vec![u32::MAX; splats];
            let mut pairs = 0;
            for &splat in &listed {
                let count = if random.word().is_multiple_of(9) || visible == 1 { most } else { 1 + random.word() % 5 };
                tile_counts[splat as usize] = count;
                offsets[splat as usize] = pairs;
                pairs += count;
            }
            let floats =
                |n: usize, random: &mut Random| -> Vec<f32> { (0..n).map(|_| random.between(-1.0, 1.0)).collect() };
            let mut counts = [u32::MAX; counters::COUNT];
            counts[counters::VISIBLE] = visible as u32;
            let slots = pairs.max(1) as usize;
            let buffers = [
                bytes(&counts),
                if visible == 0 { garbage(4) } else { bytes(&listed) },
                bytes(&offsets),
                bytes(&tile_counts),
                bytes(&floats(12 * slots, &mut random)),
                bytes(&floats(4 * slots, &mut random)),
                garbage(12 * splats),
                garbage(4 * splats),
            ];
            let groups = (visible as u32).div_ceil(slot_sum::SPLATS_PER_WORKGROUP).max(1);
            for per_turn in if most > 32_767 { [8, 16] } else { [8, 1] } {
                let given = [("AUX", aux), ("PER_TURN", per_turn)];
                let outcome = harness::run(gpu, &slot_sum::PASS, &given, &buffers, &(), groups);
                outcome.assert_same_bits(&format!("slot_sum of {visible}, aux {aux}, {per_turn} a turn"));
            }
        }
    }
}
