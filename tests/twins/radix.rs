//! The radix passes against their twins, one digit at a time.

use psrgs_vk::pass::plan::NO_COUNTER;
use psrgs_vk::pass::radix::{
    COUNT_GROUPS, COUNT_RUNS, GROUPS_LOCAL_SIZE, MOST_BITS, Push, RUNS_LOCAL_SIZE, SCATTER_GROUPS,
    SCATTER_GROUPS_EMULATED, SCATTER_RUNS,
};
use psrgs_vk::pass::{Pass, counters};
use psrgs_vk::twin::scan::exclusive;
use psrgs_vk::vk::{Gpu, Subgroup};

use super::harness::{self, Random, bytes, garbage};

struct Shape<'a> {
    count: &'a Pass,
    scatter: &'a Pass,
    given: &'a [(&'a str, u32)],
    /// Constants of the move alone.
    moved: &'a [(&'a str, u32)],
    /// Keys of a block, blocks of a workgroup.
    block: u32,
    per_group: u32,
}

fn digit(gpu: &Gpu, shape: &Shape<'_>, keys: &[u32], shift: u32, bits: u32, counted: bool) {
    let n = keys.len();
    let what = format!("{} of {n} keys, {:?}, bits {shift}+{bits}", shape.count.kernel.name, shape.given);
    let blocks = n.div_ceil(shape.block as usize);
    let mut counts = [7u32; counters::COUNT];
    counts[counters::VISIBLE] = n as u32;
    let source = if counted { counters::VISIBLE as u32 } else { NO_COUNTER };
    let push = Push { source, count: n as u32, shift, mask: (1 << bits) - 1, digits: 1 << bits };
    let groups = blocks.div_ceil(shape.per_group as usize) as u32 + 1;
    let mut padded = keys.to_vec();
    padded.extend(Random(5).words(9));
    let (padded, counts) = (bytes(&padded), bytes(&counts));
    let table = garbage((blocks << bits) + 9);
    let count = harness::run(gpu, shape.count, shape.given, &[padded.clone(), counts.clone(), table], &push, groups);
    count.assert_same_bits(&what);
    let (places, total) = exclusive(count.device::<u32>(2)[..blocks << bits].iter().copied());
    assert_eq!(total as usize, n, "{what}");
    let places = if places.is_empty() { garbage(4) } else { bytes(&places) };
    let vals = bytes(&(0..n as u32 + 9).collect::<Vec<_>>());
    let buffers = [padded, vals, counts, places, garbage(n + 9), garbage(n + 9)];
    let given = [shape.given, shape.moved].concat();
    let scatter = harness::run(gpu, shape.scatter, &given, &buffers, &push, groups);
    scatter.assert_same_bits(&what);
    let mut expected: Vec<u32> = (0..n as u32).collect();
    expected.sort_by_key(|&i| (keys[i as usize] >> shift) & push.mask);
    assert_eq!(scatter.device::<u32>(5)[..n], expected, "{what}");
}

fn shape(gpu: &Gpu, shape: &Shape<'_>) {
    let mut random = Random(23);
    let block = shape.block as usize;
    let most = MOST_BITS;
    for n in [0, 1, 7, 8, 9, 255, 256, 257, block - 1, block, block + 1, 8 * block + 1, 20 * block + 3] {
        let keys = random.words(n);
        digit(gpu, shape, &keys, 0, most, true);
        digit(gpu, shape, &keys, 32 - most, most, false);
        digit(gpu, shape, &keys, 5, 1, true);
        digit(gpu, shape, &keys, 3, 5, true);
        digit(gpu, shape, &vec![0x5555_5555; n], 4, most, true);
        digit(gpu, shape, &vec![u32::MAX; n], 4, most, false);
    }
}

pub fn run(gpu: &Gpu) {
    for block in [2, 33, 64] {
        let given = [("BLOCK", block)];
        let (count, scatter) = (&COUNT_RUNS, &SCATTER_RUNS);
        shape(gpu, &Shape { count, scatter, given: &given, moved: &[], block, per_group: RUNS_LOCAL_SIZE });
    }
    let groups = |scatter, items: u32, moved: &[(&str, u32)]| {
        let block = GROUPS_LOCAL_SIZE * items;
        shape(gpu, &Shape { count: &COUNT_GROUPS, scatter, given: &[("ITEMS", items)], moved, block, per_group: 1 });
    };
    if let Subgroup::Hardware(width) = gpu.caps().subgroup {
        for items in [1, 16] {
            groups(&SCATTER_GROUPS, items, &[("WIDTH", width)]);
        }
    }
    for width in [8, 16, 32, 64] {
        groups(&SCATTER_GROUPS_EMULATED, 3, &[("EMULATED_WIDTH", width)]);
    }
}
