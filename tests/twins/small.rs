//! The small passes: one that fills, one that sums, and those that prepare or read lists.

pub mod compact {
    //! `compact` and `gather_counts`: none, some and all visible, around workgroup edges.

    use psrgs_vk::pass::{compact, counters};
    use psrgs_vk::scene::random::Random;
    use psrgs_vk::twin::scan::exclusive;
    use psrgs_vk::vk::Gpu;

    use crate::harness::{self, Words, bytes, garbage};

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
}

pub mod constrain {
    //! `constrain`, `grad2d_keep` and `grad2d_add`: bit by bit against their twins, and their promises for each splat.

    use psrgs_vk::pass::constrain::{ADD, KEEP, PASS, Push};
    use psrgs_vk::pass::counters::{self, CONSTRAINED, SPLATS};
    use psrgs_vk::scene::random::Random;
    use psrgs_vk::vk::Gpu;

    use crate::harness::{self, Words, bytes, garbage};

    pub fn run(gpu: &Gpu) {
        let mut random = Random::new(41);
        for n in [0_usize, 1, 63, 64, 200] {
            let room = n + 5;
            let mut counts = [0_u32; counters::COUNT];
            (counts[SPLATS], counts[CONSTRAINED]) = (n as u32, 1000);
            let groups = n.div_ceil(64).max(1) as u32;
            let ids: Vec<u32> = (0..room).map(|_| 990 + random.word() % 20).collect();
            let tile_counts: Vec<u32> = (0..room).map(|_| random.word() % 3).collect();
            let floats =
                |random: &mut Random| -> Vec<f32> { (0..12 * room).map(|_| random.between(-2.0, 2.0)).collect() };

            let buffers = [bytes(&counts), bytes(&ids), bytes(&tile_counts)];
            for others in [0, 1] {
                let outcome = harness::run(gpu, &PASS, &[], &buffers, &Push { others }, groups);
                outcome.assert_same_bits(&format!("constrain of {n}, others {others}"));
                for (i, left) in outcome.device::<u32>(2).into_iter().enumerate() {
                    let outside = i < n && (ids[i] >= 1000) == (others == 0);
                    assert_eq!(left, if outside { 0 } else { tile_counts[i] }, "splat {i} of {n}, others {others}");
                }
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
}

pub mod fill {
    //! `fill`, also with more workgroups than an axis holds.

    use psrgs_vk::pass::fill::{PASS, Push};
    use psrgs_vk::vk::Gpu;

    use crate::harness::{self, garbage};

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
}

pub mod saliency_plane {
    //! `saliency_plane` against its twin in f64: smaller and larger than the mask, whole images and bands of rows.

    use psrgs_vk::pass::saliency_plane::{PASS, Push};
    use psrgs_vk::scene::random::Random;
    use psrgs_vk::twin::place::ByteMask;
    use psrgs_vk::vk::Gpu;

    use crate::harness::{self, Words, bytes, garbage};

    pub fn run(gpu: &Gpu) {
        let mut random = Random::new(23);
        for mask_size in [[1_u32, 1], [4, 3], [13, 7]] {
            for (size, [top, height]) in [
                ([1, 1], [0, 1]),
                ([4, 3], [0, 3]),
                ([13, 7], [0, 7]),
                ([39, 21], [0, 21]),
                ([6, 30], [0, 30]),
                ([39, 21], [0, 9]),
                ([39, 21], [9, 12]),
                ([6, 30], [29, 1]),
            ] {
                let [mask_width, mask_height] = mask_size;
                let [width, of_height] = size;
                let words = random.words((mask_width * mask_height).div_ceil(4) as usize + 3);
                let push = Push { width, height, top, of_height, mask_width, mask_height };
                let pixels = (width * height) as usize;
                let buffers = [bytes(&words), garbage(pixels + 4)];
                let outcome = harness::run(gpu, &PASS, &[], &buffers, &push, pixels.div_ceil(64) as u32);
                let mask = ByteMask { bytes: &buffers[0], size: mask_size.map(|v| v as usize) };
                let size = size.map(|v| v as usize);
                for (got, who) in [(outcome.device::<f32>(1), "device"), (outcome.twin::<f32>(1), "twin")] {
                    for (k, v) in got[..pixels].iter().enumerate() {
                        let want: f64 = mask.at([k % size[0], top as usize + k / size[0]], size);
                        assert!(
                            (f64::from(*v) - want).abs() < 2e-6,
                            "{who}, pixel {k} of {width}x{height} from row {top} of {of_height}: {v} for {want}"
                        );
                    }
                    assert_eq!(
                        bytes(&got[pixels..]),
                        buffers[1][4 * pixels..],
                        "{who}: words behind the image changed"
                    );
                }
            }
        }
    }
}

pub mod slot_sum {
    //! `slot_sum`: equal bits as its twin, around workgroup edges, with splats of no, one and many slots.

    use psrgs_vk::pass::{counters, slot_sum};
    use psrgs_vk::scene::random::Random;
    use psrgs_vk::vk::Gpu;

    use crate::harness::{self, Words, bytes, garbage};

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
                    let count =
                        if random.word().is_multiple_of(9) || visible == 1 { most } else { 1 + random.word() % 5 };
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
}

pub mod subgroup_probe {
    //! Every subgroup operation, in hardware and emulated, also at widths that the device does not have.

    use psrgs_vk::pass::subgroup_probe::{EMULATED, LOCAL_SIZE, Push, RESULTS, SUBGROUP};
    use psrgs_vk::scene::random::Random;
    use psrgs_vk::vk::{Gpu, Subgroup};

    use crate::harness::{self, Words, bytes, garbage};

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
}

pub mod tile_ranges {
    //! `tile_ranges`: no pairs, one tile, gaps, and the filler number after the last tile.

    use psrgs_vk::pass::counters;
    use psrgs_vk::pass::tile_ranges::{PASS, Push};
    use psrgs_vk::scene::random::Random;
    use psrgs_vk::vk::Gpu;

    use crate::harness::{self, Words, bytes, garbage};

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
}
