//! Prefix sum, radix sort and tile lists, as the renderer records them, against plain CPU code.

mod common;

use std::collections::BTreeMap;

use psrgs_vk::pass::counters;
use psrgs_vk::pass::plan::{self, Entry};
use psrgs_vk::raster::ListSort;
use psrgs_vk::raster::scan::{self, Scan, ScanExtent, Summand};
use psrgs_vk::raster::sort::{KeyCount, RadixSort, SortShape};
use psrgs_vk::raster::tiles::{Capacities, ENTRIES, FrameLists, SPLAT_ENTRIES, TileListInputs, TileLists};
use psrgs_vk::scene::random::Random;
use psrgs_vk::scene::tile::{TileGrid, list};
use psrgs_vk::vk::{Addresses, Buffer, BufferSlice, DeviceKind, Gpu, Groups, Memory, Subgroup};

fn words(seed: u64, count: usize) -> Vec<u32> {
    let mut random = Random::new(seed);
    (0..count).map(|_| (random.bits() >> 32) as u32).collect()
}

fn upload(gpu: &Gpu, name: &str, content: &[u32]) -> Buffer {
    let buffer = gpu.buffer(name, 4 * content.len().max(1) as u64, Memory::Device).unwrap();
    gpu.write(&buffer, content).unwrap();
    buffer
}

fn counters_with(gpu: &Gpu, set: &[(usize, u32)]) -> Buffer {
    let mut counts = [0u32; counters::COUNT];
    set.iter().for_each(|&(i, value)| counts[i] = value);
    upload(gpu, "counters", &counts)
}

/// Plans `entries` for a counter into a fresh args buffer.
fn planned(gpu: &Gpu, counts: &Buffer, counter: u32, entries: &[Entry]) -> Buffer {
    let args = upload(gpu, "args", &words(9, 128));
    let mut rec = gpu.recorder("plan").unwrap();
    let pipeline = gpu.pipeline(&plan::PASS.kernel, &[]).unwrap();
    let push = plan::Push::unlimited(counter, 0, entries);
    rec.dispatch(&pipeline, &[counts, &args], &push, Groups::Workgroups(1)).unwrap();
    rec.submit().unwrap();
    args
}

/// Sorts on the device, with the count from the host or a counter, and compares with a stable sort of 64-bit pairs
/// (key, position).
fn sort(gpu: &Gpu, shape: SortShape, keys: &[u32], bits: u32, counted: bool) {
    let n = keys.len();
    let what = format!("{shape:?}, {n} keys, {bits} bits, counted {counted}");
    let sorter = RadixSort::new(gpu, "test", shape, n as u64, bits).unwrap();
    // One more word behind the keys, which must not change.
    let with_tail = |content: Vec<u32>| [content, vec![0x1234_5678]].concat();
    let sides = |name: &str, content: Vec<u32>| {
        [upload(gpu, name, &with_tail(content)), upload(gpu, name, &with_tail(words(1, n)))]
    };
    let keys_buffers = sides("keys", keys.to_vec());
    let vals_buffers = sides("vals", (0..n as u32).collect());
    let counter = counters::VISIBLE as u32;
    let counts = counters_with(gpu, &[(counters::VISIBLE, n as u32)]);
    let [passes, table] = shape.entries(bits);
    let args = planned(gpu, &counts, counter, &[passes, table, Entry::fixed(1)]);
    let extent =
        if counted { KeyCount::Counted { counter, args: &args, first: 0, once: 2 } } else { KeyCount::Host(n as u32) };
    let mut rec = gpu.recorder("sort").unwrap();
    let k = [&keys_buffers[0], &keys_buffers[1]];
    let v = [&vals_buffers[0], &vals_buffers[1]];
    let side = sorter.record(&mut rec, k, v, &counts, extent, bits).unwrap();
    assert_eq!(side, shape.digits(bits).side());
    rec.submit().unwrap();
    let mask = ((1u64 << bits) - 1) as u32;
    let mut expected: Vec<u64> = keys.iter().zip(0u64..).map(|(&k, i)| u64::from(k & mask) << 32 | i).collect();
    expected.sort_unstable();
    let vals: Vec<u32> = gpu.read(v[side]).unwrap();
    let sorted: Vec<u32> = gpu.read(k[side]).unwrap();
    for (j, &pair) in expected.iter().enumerate() {
        let from = pair as u32;
        assert_eq!((vals[j], sorted[j]), (from, keys[from as usize]), "{what}: place {j}");
    }
    assert_eq!((vals[n], sorted[n]), (0x1234_5678, 0x1234_5678), "{what}: written past the end");
}

#[test]
fn the_shape_of_a_sort_fits_the_shared_memory() {
    let Some(gpu) = common::gpu() else { return };
    let shape = |shared_kib: u32, width: u32| {
        let mut caps = gpu.caps().clone();
        (caps.kind, caps.subgroup) = (DeviceKind::Discrete, Subgroup::Hardware(width));
        (caps.limits.workgroup_size, caps.limits.shared_bytes) = (1024, shared_kib << 10);
        SortShape::of(&caps)
    };
    assert_eq!(shape(48, 32), SortShape::Groups);
    // The minimum of shared memory in Vulkan.
    assert_eq!(shape(16, 32), SortShape::Groups);
    assert_eq!(shape(16, 8), SortShape::Runs);
}

#[test]
fn radix_sort_agrees_with_a_64_bit_sort() {
    let Some(gpu) = common::gpu() else { return };
    for shape in [SortShape::Runs, SortShape::Groups] {
        for n in [0, 1, 255, 256, 257, 8191, 8192, 8193, 30_000] {
            let random = words(n as u64, n);
            sort(&gpu, shape, &random, 32, true);
            sort(&gpu, shape, &random, 31, false);
            for bits in [1, 5, 9, 14] {
                sort(&gpu, shape, &random, bits, true);
            }
            sort(&gpu, shape, &vec![0xabcd_ef01; n], 32, true);
            let ascending: Vec<u32> = (0..n as u32).collect();
            sort(&gpu, shape, &ascending, 17, true);
            let descending: Vec<u32> = ascending.iter().rev().copied().collect();
            sort(&gpu, shape, &descending, 17, true);
        }
    }
    common::assert_no_messages(&gpu);
}

#[test]
fn radix_sort_of_a_million_and_more() {
    let Some(gpu) = common::gpu() else { return };
    for shape in [SortShape::Runs, SortShape::Groups] {
        sort(&gpu, shape, &words(3, 1_000_000), 32, true);
        // Tiles of a 4K image in 8x8 tiles, more numbers than 16 bits hold.
        let tiles: Vec<u32> = words(5, 3_000_001).iter().map(|w| w % 129_601).collect();
        sort(&gpu, shape, &tiles, 17, true);
    }
    common::assert_no_messages(&gpu);
}

/// More than 2^25 keys, so that no array of keys fits one descriptor of 128 MiB, and more workgroups than `plan` puts
/// on one axis in the groups shape. The keys are tile numbers of a 4K image.
fn sort_beyond_2_to_the_25(shape: SortShape, n: usize, bits: u32, counted: bool) {
    let Some(gpu) = common::gpu() else { return };
    let caps = gpu.caps();
    if caps.largest_buffer() < 4 * n as u64 + 4 {
        common::left_out(format_args!("{n} keys are more than a kernel can reach on this device"));
        return;
    }
    let keys: Vec<u32> = words(26, n).iter().map(|w| if bits == 17 { w % 129_601 } else { *w }).collect();
    let started = std::time::Instant::now();
    sort(&gpu, shape, &keys, bits, counted);
    let beyond = 4 * n as u64 > caps.limits.storage_range;
    assert_eq!(gpu.stats().by_address > 0, beyond || caps.addresses == Addresses::Always);
    let megabytes = gpu.memory_use().peak >> 20;
    println!(
        "{shape:?}: {n} pairs by {bits} bits in {:.1} s with checks, {megabytes} MiB",
        started.elapsed().as_secs_f64()
    );
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
}

#[test]
fn radix_sort_of_40_million_pairs() {
    sort_beyond_2_to_the_25(SortShape::Runs, 40_000_003, 17, true);
}

/// `cargo test --release --test sorting -- --ignored --nocapture`: some minutes and 2.5 GB on a CPU.
#[test]
#[ignore = "takes minutes on a CPU"]
fn radix_sort_of_2_to_the_26_pairs() {
    for shape in [SortShape::Runs, SortShape::Groups] {
        // One key more than 2^26, so that the groups shape has 65,537 workgroups.
        for (bits, counted) in [(17, true), (32, false)] {
            sort_beyond_2_to_the_25(shape, (1 << 26) + 1, bits, counted);
        }
    }
}

#[test]
#[ignore = "takes minutes on a CPU"]
fn prefix_sum_of_2_to_the_26_words() {
    prefix_sum((1 << 26) + 77);
}

#[test]
fn prefix_sum_of_millions() {
    prefix_sum((1 << 22) + 77);
}

fn prefix_sum(n: usize) {
    let Some(gpu) = common::gpu() else { return };
    // Small enough that a word holds the sum; a larger sum would be reported as the largest word.
    let source: Vec<u32> = words(8, n).into_iter().map(|w| w >> 23).collect();
    let input = upload(&gpu, "source", &source);
    let output = upload(&gpu, "target", &words(4, n));
    let counts = counters_with(&gpu, &[(counters::PAIRS, n as u32)]);
    let args = planned(&gpu, &counts, counters::PAIRS as u32, &[scan::entry(), Entry::fixed(1)]);
    let scan = Scan::new(&gpu, "test", n as u64).unwrap();
    for extent in [ScanExtent::host(n as u32), ScanExtent::counted(counters::PAIRS as u32, &args, 0, 1)] {
        let mut rec = gpu.recorder("scan").unwrap();
        let total = counters::SCAN_TOTAL as u32;
        scan.record(&mut rec, [&input, &output], &counts, extent, Summand::Words, total).unwrap();
        rec.submit().unwrap();
        let mut sum = 0u32;
        for (i, (&word, prefix)) in source.iter().zip(gpu.read::<u32>(&output).unwrap()).enumerate() {
            assert_eq!(prefix, sum, "word {i}");
            sum = sum.checked_add(word).expect("a word holds the sum");
        }
        assert_eq!(gpu.read::<u32>(&counts).unwrap()[counters::SCAN_TOTAL], sum);
    }
}

struct Scene {
    grid: TileGrid,
    rows: Vec<[f32; 12]>,
    tiles: Vec<Vec<u32>>,
}

impl Scene {
    /// Splats with many equal depths; every fifth is off screen.
    fn new(n: usize, grid: TileGrid) -> Scene {
        let random = words(n as u64 + 100, 6 * n);
        let unit = |w: u32| (w >> 8) as f32 / (1 << 24) as f32;
        let rows: Vec<[f32; 12]> = random
            .chunks(6)
            .enumerate()
            .map(|(i, r)| {
                let [s0, s1] = [0.6 * (3.5 * unit(r[2])).exp(), 0.6 * (3.5 * unit(r[3])).exp()];
                let (sin, cos) = (3.0 * unit(r[4])).sin_cos();
                let (a, b) = (1.0 / (s0 * s0), 1.0 / (s1 * s1));
                let off = if i % 5 == 0 { 1e4 } else { 0.0 };
                let (x, y) = (unit(r[0]) * grid.image[0] as f32 + off, unit(r[1]) * grid.image[1] as f32);
                let depth = 0.25 + (r[5] % 50) as f32;
                let (ca, cb, cc) = (cos * cos * a + sin * sin * b, cos * sin * (a - b), sin * sin * a + cos * cos * b);
                [x, y, ca, cb, cc, 0.01 + 0.9 * unit(r[4]), depth, 0.0, 0.0, 0.0, 0.0, 0.0]
            })
            .collect();
        let tiles = rows.iter().map(|r| list([r[0], r[1]], [r[2], r[3], r[4]], r[5], &grid)).collect();
        Scene { grid, rows, tiles }
    }

    fn pairs(&self) -> usize {
        self.tiles.iter().map(Vec::len).sum()
    }

    /// (tile, depth bits, splat) of every pair, sorted.
    fn expected(&self) -> Vec<(u32, u32, u32)> {
        let mut all: Vec<_> = self
            .tiles
            .iter()
            .zip(&self.rows)
            .zip(0..)
            .flat_map(|((tiles, row), i)| tiles.iter().map(move |&tile| (tile, row[6].to_bits(), i)))
            .collect();
        all.sort_unstable();
        all
    }
}

struct Frame {
    splat2d: Buffer,
    tile_counts: Buffer,
    counts: Buffer,
    args: Buffer,
}

fn frame(gpu: &Gpu, scene: &Scene) -> Frame {
    let rows: Vec<u32> = scene.rows.iter().flatten().map(|x| x.to_bits()).collect();
    let per_splat: Vec<u32> = scene.tiles.iter().map(|tiles| tiles.len() as u32).collect();
    Frame {
        splat2d: upload(gpu, "splat2d", &rows),
        tile_counts: upload(gpu, "tile_counts", &per_splat),
        counts: counters_with(gpu, &[(counters::SPLATS, scene.rows.len() as u32), (counters::PAIRS, 12345)]),
        args: upload(gpu, "args", &words(17, 128)),
    }
}

fn record<'a>(gpu: &Gpu, lists: &'a TileLists, frame: &'a Frame, grid: &TileGrid) -> FrameLists<'a> {
    let Frame { splat2d, tile_counts, counts, args } = frame;
    let mut rec = gpu.recorder("lists").unwrap();
    let first_entry = 32 - ENTRIES;
    let pipeline = gpu.pipeline(&plan::PASS.kernel, &[]).unwrap();
    let push = plan::Push::unlimited(counters::SPLATS as u32, first_entry, &SPLAT_ENTRIES).voiding(32);
    rec.dispatch(&pipeline, &[counts, args], &push, Groups::Workgroups(1)).unwrap();
    let inputs =
        TileListInputs { splat2d, tile_counts, counters: counts, args, first_entry, entries: 32, alpha_cutoff: None };
    let result = lists.record(&mut rec, inputs, grid).unwrap();
    rec.submit().unwrap();
    result
}

fn check(gpu: &Gpu, scene: &Scene, frame: &Frame, result: &FrameLists<'_>) {
    let expected = scene.expected();
    let counts: Vec<u32> = gpu.read(&frame.counts).unwrap();
    let visible = scene.tiles.iter().filter(|tiles| !tiles.is_empty()).count();
    assert_eq!(counts[counters::STATUS], 0);
    assert_eq!(counts[counters::VISIBLE] as usize, visible);
    assert_eq!(counts[counters::PAIRS] as usize, expected.len());
    let read = |slice: BufferSlice<'_>| gpu.read_slice::<u32>(slice, slice.bytes() as usize / 4).unwrap();
    let own = result.slots.expect("these lists have slots");
    let [splats, slots, slot_splat] = [result.sorted_splats, own.sorted_slots, own.slot_splat].map(read);
    for (j, &(_, _, splat)) in expected.iter().enumerate() {
        assert_eq!(splats[j], splat, "pair {j}");
        assert_eq!(slot_splat[slots[j] as usize], splat, "pair {j}");
    }
    let mut ranges = BTreeMap::new();
    for (j, &(tile, ..)) in expected.iter().enumerate() {
        ranges.entry(tile).or_insert([j as u32, 0])[1] = j as u32 + 1;
    }
    let [columns, rows] = scene.grid.counts();
    let found = read(result.tile_ranges);
    for tile in 0..columns * rows {
        let at = 2 * tile as usize;
        assert_eq!([found[at], found[at + 1]], ranges.get(&tile).copied().unwrap_or([0, 0]), "tile {tile}");
    }
    // A splat's slots are consecutive, in the order of the splats, and each slot belongs to one pair.
    let [listed, offsets] = [own.listed, own.slot_offsets].map(read);
    let mut slot = 0;
    for &splat in &listed[..visible] {
        assert_eq!(offsets[splat as usize] as usize, slot);
        let count = scene.tiles[splat as usize].len();
        assert!(slot_splat[slot..slot + count].iter().all(|&s| s == splat));
        slot += count;
    }
    assert!(listed[..visible].is_sorted());
    let mut of_pairs = slots[..expected.len()].to_vec();
    of_pairs.sort_unstable();
    assert!(of_pairs.into_iter().eq(0..expected.len() as u32), "a slot belongs to no pair, or to several");
}

const ORDERS: [ListSort; 2] = [ListSort::Global, ListSort::Tiles];

#[test]
fn tile_lists_hold_every_pair_in_depth_order() {
    let Some(gpu) = common::gpu() else { return };
    let grids =
        [TileGrid::new([640, 360], [16, 16]), TileGrid::new([250, 131], [8, 8]), TileGrid::new([64, 64], [16, 16])];
    let [runs, groups] = [SortShape::Runs, SortShape::Groups];
    for (order, shape) in [(ListSort::Global, runs), (ListSort::Global, groups), (ListSort::Tiles, runs)] {
        for (grid, n) in grids.into_iter().zip([5000, 1025, 1]) {
            let scene = Scene::new(n, grid);
            let capacities = Capacities { splats: n as u64, pairs: scene.pairs() as u64, tiles: 1000 };
            let lists = TileLists::with_shape(&gpu, capacities, order, shape).unwrap();
            let frame = frame(&gpu, &scene);
            // Twice: the second run starts with the buffers of the first.
            for _ in 0..2 {
                let result = record(&gpu, &lists, &frame, &scene.grid);
                check(&gpu, &scene, &frame, &result);
            }
        }
    }
    common::assert_no_messages(&gpu);
}

#[test]
fn no_splats_and_all_culled_give_empty_lists() {
    let Some(gpu) = common::gpu() else { return };
    let grid = TileGrid::new([100, 100], [16, 16]);
    let mut culled = Scene::new(100, grid);
    culled.tiles.iter_mut().for_each(Vec::clear);
    let mut none = Scene::new(1, grid);
    none.tiles[0].clear();
    let cases = [(&culled, 100), (&none, 0)].map(|case| ORDERS.map(|order| (case, order)));
    for ((scene, splats), order) in cases.into_iter().flatten() {
        let lists = TileLists::new(&gpu, Capacities { splats: 100, pairs: 10, tiles: 100 }, order).unwrap();
        let frame = frame(&gpu, scene);
        gpu.write(&frame.counts, &[0u32, splats]).unwrap();
        let result = record(&gpu, &lists, &frame, &grid);
        check(&gpu, scene, &frame, &result);
    }
}

#[test]
fn too_many_pairs_set_the_status_and_emit_nothing() {
    let Some(gpu) = common::gpu() else { return };
    ORDERS.into_iter().for_each(|order| too_many_pairs(&gpu, order));
}

fn too_many_pairs(gpu: &Gpu, order: ListSort) {
    let grid = TileGrid::new([640, 360], [16, 16]);
    let scene = Scene::new(2000, grid);
    let pairs = scene.pairs() as u64;
    let small = TileLists::new(gpu, Capacities { splats: 2000, pairs: pairs - 1, tiles: 1000 }, order).unwrap();
    let frame = frame(gpu, &scene);
    let result = record(gpu, &small, &frame, &grid);
    let counts: Vec<u32> = gpu.read(&frame.counts).unwrap();
    assert_eq!(counts[counters::STATUS], counters::PAIRS_BIT);
    assert_eq!(u64::from(counts[counters::WANT_PAIRS]), pairs);
    let ranges: Vec<u32> = gpu.read_slice(result.tile_ranges, 2000).unwrap();
    assert!(ranges.iter().all(|&word| word == 0), "a void event has lists");
    // Later events are void as well and do not change the counts.
    record(gpu, &small, &frame, &grid);
    assert_eq!(gpu.read::<u32>(&frame.counts).unwrap(), counts);
    let args: Vec<[u32; 4]> = gpu.read(&frame.args).unwrap();
    assert!(args.iter().all(|entry| *entry == [0; 4]));
    // With a cleared status and enough room, the frame is complete.
    let large = TileLists::new(gpu, Capacities { splats: 2000, pairs, tiles: 1000 }, order).unwrap();
    gpu.write(&frame.counts, &[0u32]).unwrap();
    let result = record(gpu, &large, &frame, &grid);
    check(gpu, &scene, &frame, &result);
}
