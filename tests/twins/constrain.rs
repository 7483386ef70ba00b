//! `constrain`, `grad2d_keep` and `grad2d_add`: bit by bit against their twins, and their promises for each splat.

use psrgs_vk::pass::constrain::{ADD, KEEP, PASS};
use psrgs_vk::pass::counters::{self, CONSTRAINED, SPLATS};
use psrgs_vk::scene::random::Random;
use psrgs_vk::vk::Gpu;

use super::harness::{self, Words, bytes, garbage};

pub fn run(gpu: &Gpu) {
    let mut random = Random::new(41);
    for n in [0_usize, 1, 63, 64, 200] {
        let room = n + 5;
        let mut counts = [0_u32; counters::COUNT];
        (counts[SPLATS], counts[CONSTRAINED]) = (n as u32, 1000);
        let groups = n.div_ceil(64).max(1) as u32;
        let ids: Vec<u32> = (0..room).map(|_| 990 + random.word() % 20).collect();
        let tile_counts: Vec<u32> = (0..room).map(|_| random.word() % 3).collect();
        let floats = |random: &mut Random| -> Vec<f32> { (0..12 * room).map(|_| random.between(-2.0, 2.0)).collect() };

        let buffers = [bytes(&counts), bytes(&ids), bytes(&tile_counts)];
        let outcome = harness::run(gpu, &PASS, &[], &buffers, &(), groups);
        outcome.assert_same_bits(&format!("constrain of {n}"));
        for (i, left) in outcome.device::<u32>(2).into_iter().enumerate() {
            let outside = i < n && ids[i] >= 1000;
            assert_eq!(left, if outside { 0 } else { tile_counts[i] }, "splat {i} of {n}");
        }

        let (grad2d, other) = (floats(&mut random), floats(&mut random));
        let buffers = [bytes(&counts), bytes(&tile_counts), bytes(&grad2d), garbage(12 * room)];
        let outcome = harness::run(gpu, &KEEP, &[], &buffers, &(), groups);
        outcome.assert_same_bits(&format!("grad2d_keep of {n}"));
        let kept = outcome.device::<f32>(3);

        let buffers = [bytes(&counts), bytes(&tile_counts), bytes(&kept), bytes(&other)];
        let outcome = harness::run(gpu, &ADD, &[], &buffers, &(), groups);
        outcome.assert_same_bits(&format!("grad2d_add of {n}"));
        for (k, sum) in outcome.device::<f32>(3).into_iter().enumerate() {
            let seen = k / 12 < n && tile_counts[k / 12] != 0;
            assert_eq!(sum, if seen { other[k] + grad2d[k] } else { other[k] }, "float {k} of {n}");
        }
    }
}
