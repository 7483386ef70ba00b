//! The passes of lists that are sorted in tiles.

use psrgs_vk::pass::Pass;
use psrgs_vk::scene::tile::TileGrid;
use psrgs_vk::vk::{Gpu, Subgroup};

/// The hardware variant where there is one, and the emulated variant at each width, with their constants.
fn variants(
    gpu: &Gpu,
    hardware: &'static Pass,
    emulated: &'static Pass,
) -> Vec<(&'static Pass, Vec<(&'static str, u32)>)> {
    let native = matches!(gpu.caps().subgroup, Subgroup::Hardware(_)).then(|| (hardware, Vec::new()));
    native.into_iter().chain([8, 32, 64].map(|width| (emulated, vec![("EMULATED_WIDTH", width)]))).collect()
}

/// Images of many tiles, of few, and of one; columns of tiles and rows of tiles.
fn grids() -> [TileGrid; 5] {
    [[640, 360], [70, 53], [1, 1], [1, 300], [300, 1]].map(|image| TileGrid::new(image, [16, 16]))
}

pub mod tile_edges {
    //! `tile_edges`: sums of its words are the numbers of splats on the tiles.

    use psrgs_vk::pass::counters;
    use psrgs_vk::pass::tile_edges::{PASS, Push};
    use psrgs_vk::scene::random::Random;
    use psrgs_vk::scene::tile::{count, list};
    use psrgs_vk::vk::Gpu;

    use super::grids;
    use crate::emit::rows;
    use crate::harness::{self, bytes};

    pub fn run(gpu: &Gpu) {
        for (grid, n) in grids().iter().flat_map(|grid| [0usize, 1, 64, 65, 1000].map(|n| (grid, n))) {
            let splat2d = rows(&mut Random::new(n as u64 + 5), n.max(1), grid);
            let of = |r: &[f32; 12]| ([r[0], r[1]], [r[2], r[3], r[4]], r[5]);
            let mut tile_counts: Vec<u32> = splat2d.iter().map(of).map(|(m, q, o)| count(m, q, o, grid)).collect();
            // Splats of another part of the model have no tiles, whatever their ellipse.
            tile_counts.iter_mut().step_by(7).for_each(|count| *count = 0);
            let mut counts = [7u32; counters::COUNT];
            counts[counters::SPLATS] = n as u32;
            let [columns, tile_rows] = grid.counts();
            let words = ((columns + 1) * tile_rows) as usize;
            let buffers = [bytes(&splat2d), bytes(&tile_counts), bytes(&counts), vec![0; 4 * (words + 3)]];
            let [[width, height], [tile_width, tile_height]] = [grid.image, grid.tile];
            let push = Push { width, height, tile_width, tile_height };
            let outcome = harness::run(gpu, &PASS, &[], &buffers, &push, n.div_ceil(64).max(1) as u32);
            outcome.assert_same_bits(&format!("edges of {n} splats, {grid:?}"));
            let mut expected = vec![0u32; (columns * tile_rows) as usize];
            for (row, _) in splat2d.iter().zip(&tile_counts).take(n).filter(|(_, count)| **count > 0) {
                let (mean, conic, opacity) = of(row);
                list(mean, conic, opacity, grid).into_iter().for_each(|tile| expected[tile as usize] += 1);
            }
            let edges = outcome.device::<u32>(3);
            for (y, edges) in edges[..words].chunks((columns + 1) as usize).enumerate() {
                let mut sum = 0u32;
                for (x, edge) in edges.iter().enumerate() {
                    sum = sum.wrapping_add(*edge);
                    let wanted = if x < columns as usize { expected[y * columns as usize + x] } else { 0 };
                    assert_eq!(sum, wanted, "{grid:?}: tile {x}, {y}");
                }
            }
            let visible = tile_counts.iter().take(n).filter(|count| **count > 0).count();
            assert_eq!(edges[words] as usize, visible);
        }
    }
}

pub mod tile_offsets {
    //! `tile_offsets`: one tile, many turns, more pairs than a word holds, more than fit, and an event that is void.

    use psrgs_vk::pass::counters;
    use psrgs_vk::pass::tile_offsets::{EMULATED, PASS, Push};
    use psrgs_vk::scene::random::Random;
    use psrgs_vk::vk::Gpu;

    use super::variants;
    use crate::harness::{self, Words, bytes, garbage};

    const ENTRIES: usize = 9;

    fn case(gpu: &Gpu, columns: u32, rows: u32, counts: &[u32]) -> u32 {
        let pairs = counts.iter().map(|count| u64::from(*count)).sum::<u64>();
        let pairs = u32::try_from(pairs).unwrap_or(u32::MAX);
        let capacities = [u32::MAX - 1, pairs, pairs.saturating_sub(1)];
        for (capacity, status) in capacities.map(|most| (most, 0)).into_iter().chain([(pairs, counters::SPLATS_BIT)]) {
            within(gpu, [columns, rows], counts, capacity, status);
        }
        pairs
    }

    fn within(gpu: &Gpu, [columns, rows]: [u32; 2], counts: &[u32], capacity: u32, status: u32) {
        let edges = counts.chunks(columns as usize).flat_map(|row| {
            let before = [0].into_iter().chain(row.iter().copied());
            let after = row.iter().copied().chain([0]);
            before.zip(after).map(|(before, after)| after.wrapping_sub(before)).collect::<Vec<u32>>()
        });
        let edges: Vec<u32> = edges.chain([12_345, 7, 7]).collect();
        let tiles = counts.len();
        let mut before = [9u32; counters::COUNT];
        before[counters::STATUS] = status;
        let buffers = [bytes(&before), bytes(&edges), garbage(2 * tiles + 4), garbage(4 * (ENTRIES + 2))];
        let void_entries = ENTRIES as u32;
        let push = Push { columns, rows, capacity, void_entries, first: 5, per_group: 64, per_sum: 40 };
        let pairs = counts.iter().fold(0u32, |sum, count| sum.saturating_add(*count));
        for (pass, given) in variants(gpu, &PASS, &EMULATED) {
            for items in [1, 3, 64] {
                let given = [given.clone(), vec![("ITEMS", items)]].concat();
                let outcome = harness::run(gpu, pass, &given, &buffers, &push, 1);
                outcome.assert_same_bits(&format!("offsets of {columns}x{rows} tiles, {given:?}"));
                let all = outcome.device::<u32>(0);
                let void = status != 0 || pairs > capacity;
                assert_eq!(all[counters::STATUS], if pairs > capacity { counters::PAIRS_BIT } else { status });
                let args = outcome.device::<[u32; 4]>(3);
                assert_eq!(args[..ENTRIES].iter().all(|entry| *entry == [0; 4]), void);
                let planned = [12_345u32.div_ceil(64), 12_345u32.div_ceil(40)].map(|groups| [groups, 1, 1, 0]);
                assert_eq!(args[5..7] == planned, !void);
                assert!(args[ENTRIES..].iter().all(|entry| *entry != [0; 4]), "entries behind are cleared");
                if status != 0 {
                    assert_eq!(outcome.device::<u32>(1), edges, "a void event changes lists");
                    assert_eq!(all, before);
                    continue;
                }
                assert_eq!(all[counters::VISIBLE], 12_345);
                assert_eq!([all[counters::PAIRS], all[counters::WANT_PAIRS]], [pairs, pairs.max(9)]);
                let ranges = outcome.device::<[u32; 2]>(2);
                let mut first = 0u32;
                for (range, count) in ranges.iter().zip(counts) {
                    assert_eq!(*range, [first; 2]);
                    first = first.wrapping_add(*count);
                }
            }
        }
    }

    pub fn run(gpu: &Gpu) {
        let mut random = Random::new(3);
        for (columns, rows) in [(1, 1), (1, 700), (700, 1), (40, 23), (63, 64)] {
            let counts: Vec<u32> = random.words((columns * rows) as usize).iter().map(|w| w >> 20).collect();
            assert_eq!(case(gpu, columns, rows, &counts), counts.iter().sum::<u32>());
        }
        // The largest number of pairs, and one more.
        assert_eq!(case(gpu, 2, 1, &[u32::MAX - 1, 1]), u32::MAX);
        assert_eq!(case(gpu, 2, 2, &[u32::MAX - 1, 1, 1, 0]), u32::MAX);
        assert_eq!(case(gpu, 40, 23, &[u32::MAX / 100; 920]), u32::MAX, "a sum that overflows several times");
    }
}

pub mod emit_tiles {
    //! `emit_tiles`: the list of each tile has its pairs, in any order, and nothing else is written. Also counts that
    //! differ from the tiles.

    use psrgs_vk::pass::counters;
    use psrgs_vk::pass::emit_tiles::{EMULATED, PASS, Push};
    use psrgs_vk::scene::random::Random;
    use psrgs_vk::scene::tile::{TileGrid, count, list};
    use psrgs_vk::twin::scan::exclusive;
    use psrgs_vk::vk::Gpu;

    use super::{grids, variants};
    use crate::emit::rows;
    use crate::harness::{self, bytes};

    const POISON: u32 = u32::MAX;

    /// The pairs of each tile in order, then what lies behind them.
    fn in_order(pairs: &[u8], ranges: &[[u32; 2]]) -> Vec<[u32; 2]> {
        let mut pairs: Vec<[u32; 2]> = bytemuck::cast_slice(pairs).to_vec();
        for &[begin, end] in ranges {
            let end = (end as usize).min(pairs.len());
            pairs[begin as usize..end].sort_unstable();
        }
        pairs
    }

    fn case(gpu: &Gpu, n: usize, grid: &TileGrid, short: u32, adjust: impl Fn(usize, u32) -> u32) {
        let splat2d = rows(&mut Random::new(n as u64 + 61), n.max(1), grid);
        let of = |r: &[f32; 12]| ([r[0], r[1]], [r[2], r[3], r[4]], r[5]);
        let tiles_of: Vec<Vec<u32>> = splat2d.iter().map(of).map(|(m, q, o)| list(m, q, o, grid)).collect();
        let tile_counts: Vec<u32> = (0..)
            .zip(&splat2d)
            .map(|(i, r)| {
                let (mean, conic, opacity) = of(r);
                adjust(i, count(mean, conic, opacity, grid))
            })
            .collect();
        let [columns, tile_rows] = grid.counts();
        let mut of_tiles = vec![0u32; (columns * tile_rows) as usize];
        for (tiles, _) in tiles_of.iter().zip(&tile_counts).take(n).filter(|(_, count)| **count > 0) {
            tiles.iter().for_each(|tile| of_tiles[*tile as usize] += 1);
        }
        let counted = tiles_of.iter().zip(&tile_counts).all(|(tiles, count)| tiles.len() == *count as usize);
        let (first, pairs) = exclusive(of_tiles.iter().copied());
        let mut edges = Vec::new();
        for y in 0..tile_rows {
            let row = (y * columns) as usize;
            edges.extend(&first[row..row + columns as usize]);
            edges.push(first.get(row + columns as usize).copied().unwrap_or(pairs));
        }
        let ranges: Vec<[u32; 2]> = first.iter().map(|&first| [first; 2]).collect();
        let (slot_offsets, _) = exclusive(tile_counts.iter().copied());
        let slots: u32 = tile_counts.iter().take(n).sum();
        let mut counts = [7u32; counters::COUNT];
        counts[counters::SPLATS] = n as u32;
        let room = pairs as usize + 100;
        let buffers = [
            bytes(&splat2d),
            bytes(&tile_counts),
            bytes(&counts),
            bytes(&edges),
            bytes(&ranges),
            bytes(&vec![[POISON; 2]; room]),
            bytes(&vec![POISON; slots as usize + 100]),
            bytes(&slot_offsets),
        ];
        let [[width, height], [tile_width, tile_height]] = [grid.image, grid.tile];
        let push = Push { width, height, tile_width, tile_height, shift: 3, capacity: slots - short.min(slots) };
        for (pass, given) in variants(gpu, &PASS, &EMULATED) {
            for carried in [0, 1] {
                let given = [given.clone(), vec![("CARRIED", carried)]].concat();
                let what = format!("{n} splats into {grid:?}, {} {given:?}", pass.kernel.name);
                let outcome = harness::run(gpu, pass, &given, &buffers, &push, n.div_ceil(64).max(1) as u32);
                let wanted: Vec<[u32; 2]> = outcome.twin(4);
                for device in [Some(&outcome.device), outcome.by_address.as_ref()].into_iter().flatten() {
                    let beyond = |buffer: usize, bytes: u32| &device[buffer][bytes as usize..];
                    assert!(beyond(5, 8 * pairs).iter().all(|byte| *byte == 255), "{what}: beyond the lists");
                    assert!(beyond(6, 4 * push.capacity).iter().all(|byte| *byte == 255), "{what}: beyond the slots");
                    // With wrong counts pairs are lost, and which ones is open.
                    if !counted {
                        continue;
                    }
                    let differs = [0, 1, 2, 3, 4, 6, 7].into_iter().find(|&i| device[i] != outcome.twin[i]);
                    assert_eq!(differs, None, "{what}: a buffer differs");
                    let [got, want] = [&device[5], &outcome.twin[5]].map(|pairs| in_order(pairs, &wanted));
                    assert!(got == want, "{what}: a list differs");
                    let unwritten = |bytes: &[u8]| bytes.chunks(4).any(|word| word == [255; 4]);
                    assert!(
                        carried == 1 || !unwritten(&device[6][..4 * push.capacity as usize]),
                        "{what}: a free slot"
                    );
                }
            }
        }
    }

    pub fn run(gpu: &Gpu) {
        for grid in grids() {
            for n in [0, 1, 63, 65, 500] {
                case(gpu, n, &grid, 0, |_, count| count);
            }
        }
        let grid = TileGrid::new([640, 360], [16, 16]);
        case(gpu, 300, &grid, 0, |i, c| match i % 3 {
            0 => c + 3,
            1 => c.saturating_sub(2),
            _ => c,
        });
        case(gpu, 300, &grid, 1000, |_, count| count);
    }
}

pub mod tile_sort {
    //! `tile_sort`: lists of every length around those that change the way, equal depths, and lists with free places.

    use psrgs_vk::pass::tile_sort::{EMULATED, PASS, Push};
    use psrgs_vk::scene::random::Random;
    use psrgs_vk::vk::Gpu;

    use super::variants;
    use crate::harness::{self, Words, bytes, garbage};

    /// `lengths` of the lists of a row of tiles; `filled` says how many places of a list are filled.
    fn case(gpu: &Gpu, lengths: &[u32], capacity: u32, filled: impl Fn(u32) -> u32) {
        let mut random = Random::new(u64::from(capacity) + lengths.len() as u64);
        let mut edges = vec![0u32];
        lengths.iter().for_each(|length| edges.push(edges[edges.len() - 1] + length));
        let ranges: Vec<[u32; 2]> =
            edges.iter().zip(lengths).map(|(&first, &of)| [first, first + filled(of)]).collect();
        let total = edges[edges.len() - 1] as usize;
        // Few depths, so that many are equal; the values are a permutation, and so tell every pair apart.
        let mut values: Vec<u32> = (0..total as u32).collect();
        values.sort_by_key(|&v| v.wrapping_mul(0x9e37_79b9));
        let pairs: Vec<[u32; 2]> = values.iter().map(|&value| [random.word() >> 26, value]).collect();
        let splats: Vec<u32> = random.words(total + 1);
        edges.push(9);
        let buffers = [
            bytes(&[pairs, vec![[3; 2]; 2]].concat()),
            bytes(&edges),
            bytes(&splats),
            garbage(total + 4),
            garbage(total + 4),
            bytes(&ranges),
        ];
        let push = Push { columns: lengths.len() as u32, rows: 1 };
        for (pass, given) in variants(gpu, &PASS, &EMULATED) {
            for carried in [0, 1] {
                let given = [given.clone(), vec![("CARRIED", carried), ("CAPACITY", capacity)]].concat();
                let outcome = harness::run(gpu, pass, &given, &buffers, &push, lengths.len() as u32);
                let what = format!("lists of {lengths:?}, {} {given:?}", pass.kernel.name);
                // The pass leaves the pairs of long lists in order, and those of others as they are.
                for i in [1, 2, 3, 4, 5] {
                    assert!(outcome.device[i] == outcome.twin[i], "{what}: buffer {i} differs");
                }
            }
        }
    }

    pub fn run(gpu: &Gpu) {
        let around = [0, 1, 2, 3, 16, 17, 63, 64, 65, 255, 256, 257, 1000, 2047, 2048];
        case(gpu, &around, 2048, |of| of);
        case(gpu, &[0, 0, 0], 2048, |of| of);
        // Long lists: just longer, twice as long and one more, and far longer, than what is sorted in shared memory.
        case(gpu, &[2049, 4096, 4097, 20_000], 2048, |of| of);
        case(gpu, &[64, 65, 128, 129, 1000, 1024, 1025], 64, |of| of);
        // Places that were counted and not filled.
        case(gpu, &[5, 300, 2049, 1], 2048, |of| of - of.div_ceil(3));
        // More places given out than counted.
        case(gpu, &[5, 300, 1], 2048, |of| of + 2);
    }
}
