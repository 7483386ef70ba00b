//! The radix passes against their twins, one digit at a time.

use psrgs_vk::pass::plan::NO_COUNTER;
use psrgs_vk::pass::radix::{
    COUNT_GROUPS, COUNT_RUNS, GROUPS_ITEMS, GROUPS_LOCAL_SIZE, MOST_BITS, Push, ROWS, ROWS_EMULATED, RUNS_LOCAL_SIZE,
    SCATTER_GROUPS, SCATTER_GROUPS_EMULATED, SCATTER_RUNS,
};
use psrgs_vk::pass::{Pass, counters};
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::radix;
use psrgs_vk::twin::scan::exclusive;
use psrgs_vk::vk::{Gpu, Subgroup};

use super::harness::{self, Words, bytes, garbage};

struct Shape<'a> {
    count: &'a Pass,
    /// The pass of the groups shape that turns rows into positions.
    rows: Option<&'a Pass>,
    scatter: &'a Pass,
    given: &'a [(&'a str, u32)],
    /// Further constants of the pass over rows and of the pass that moves keys.
    more: [&'a [(&'a str, u32)]; 2],
    /// Keys per block, and blocks per workgroup.
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
    padded.extend(Random::new(5).words(9));
    let (padded, counts) = (bytes(&padded), bytes(&counts));
    let table = garbage((blocks << bits) + 9);
    let count = harness::run(gpu, shape.count, shape.given, &[padded.clone(), counts.clone(), table], &push, groups);
    count.assert_same_bits(&what);
    let counted = count.device::<u32>(2)[..blocks << bits].to_vec();
    let (places, total) = exclusive(counted.iter().copied());
    assert_eq!(total as usize, n, "{what}");
    let places = if let Some(pass) = shape.rows {
        let table = if counted.is_empty() { garbage(4) } else { bytes(&counted) };
        let buffers = [counts.clone(), table, garbage(((blocks + 1) << bits) + 9)];
        let rows = harness::run(gpu, pass, &[shape.given, shape.more[0]].concat(), &buffers, &push, push.digits + 1);
        rows.assert_same_bits(&what);
        let made = rows.device::<u32>(2)[..(blocks + 1) << bits].to_vec();
        assert_eq!(radix::whole(&made, push.digits as usize), places, "{what}");
        bytes(&made)
    } else if places.is_empty() {
        garbage(4)
    } else {
        bytes(&places)
    };
    let vals = bytes(&(0..n as u32 + 9).collect::<Vec<_>>());
    let buffers = [padded, vals, counts, places, garbage(n + 9), garbage(n + 9)];
    let given = [shape.given, shape.more[1]].concat();
    let scatter = harness::run(gpu, shape.scatter, &given, &buffers, &push, groups);
    scatter.assert_same_bits(&what);
    let mut expected: Vec<u32> = (0..n as u32).collect();
    expected.sort_by_key(|&i| (keys[i as usize] >> shift) & push.mask);
    assert_eq!(scatter.device::<u32>(5)[..n], expected, "{what}");
}

fn shape(gpu: &Gpu, shape: &Shape<'_>) {
    let mut random = Random::new(23);
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
        let (rows, more) = (None, [&[][..]; 2]);
        shape(gpu, &Shape { count, rows, scatter, given: &given, more, block, per_group: RUNS_LOCAL_SIZE });
    }
    if let Subgroup::Hardware(width) = gpu.caps().subgroup {
        for items in [1, GROUPS_ITEMS, 2 * GROUPS_ITEMS] {
            groups(gpu, &ROWS, &SCATTER_GROUPS, items, [&[], &[("WIDTH", width)]]);
        }
    }
    for width in [8, 16, 32, 64] {
        let width = [("EMULATED_WIDTH", width)];
        groups(gpu, &ROWS_EMULATED, &SCATTER_GROUPS_EMULATED, 3, [&width, &width]);
    }
}

fn groups<'a>(gpu: &Gpu, rows: &'a Pass, scatter: &'a Pass, items: u32, more: [&'a [(&'a str, u32)]; 2]) {
    let (count, block) = (&COUNT_GROUPS, GROUPS_LOCAL_SIZE * items);
    shape(gpu, &Shape { count, rows: Some(rows), scatter, given: &[("ITEMS", items)], more, block, per_group: 1 });
}
