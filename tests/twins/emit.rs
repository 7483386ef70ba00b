//! `emit`: every counted pair and slot is written, and nothing else. Also pairs that carry splats, counts
//! that differ from the tiles, and a capacity that is too small.

use psrgs_vk::pass::counters;
use psrgs_vk::pass::emit::{PASS, Push};
use psrgs_vk::scene::random::Random;
use psrgs_vk::scene::tile::{TileGrid, count};
use psrgs_vk::twin::scan::exclusive;
use psrgs_vk::vk::Gpu;

use super::harness::{self, Words, bytes};

const POISON: u32 = u32::MAX;

/// Rows of `splat2d`: small, needles, giants, far away, on tile borders.
pub fn rows(random: &mut Random, n: usize, grid: &TileGrid) -> Vec<[f32; 12]> {
    (0..n)
        .map(|i| {
            let [width, height] = grid.image.map(|x| x as f32);
            let (mut x, mut y) = (random.between(-20.0, width + 20.0), random.between(-20.0, height + 20.0));
            let thin = random.between(-0.6, 2.0).exp();
            let long = thin * random.between(0.0, 3.0).exp();
            let [s0, s1] = match i % 5 {
                0 => [0.55 * 1000.0, 0.55],
                1 => [3000.0, 2000.0],
                2 => {
                    (x, y) = (x.floor() / 16.0 * 16.0, (y / 16.0).round() * 16.0);
                    [long, thin]
                }
                _ => [long, thin],
            };
            let (sin, cos) = random.between(0.0, 3.2).sin_cos();
            let (a, b) = (1.0 / (s0 * s0), 1.0 / (s1 * s1));
            let conic = [cos * cos * a + sin * sin * b, cos * sin * (a - b), sin * sin * a + cos * cos * b];
            let opacity = random.between(0.0, 1.0);
            [x, y, conic[0], conic[1], conic[2], opacity, random.between(0.2, 9.0), 0.0, 0.1, 0.2, 0.3, 0.0]
        })
        .collect()
}

/// Runs the pass; `adjust` may falsify the counts. Checks bits and poison.
fn case(gpu: &Gpu, n: usize, grid: &TileGrid, short: u32, adjust: impl Fn(usize, u32) -> u32) {
    let what = format!("emit of {n} splats, {grid:?}, {short} short");
    let mut random = Random::new(n as u64 + 61);
    let splat2d = rows(&mut random, n.max(1), grid);
    let tile_counts: Vec<u32> = splat2d
        .iter()
        .enumerate()
        .map(|(i, r)| adjust(i, count([r[0], r[1]], [r[2], r[3], r[4]], r[5], grid)))
        .collect();
    let mut order: Vec<u32> = (0..n as u32).filter(|&i| tile_counts[i as usize] > 0).collect();
    order.sort_by_key(|&i| i.wrapping_mul(0x9e37_79b9));
    let visible = order.len();
    let (mut offsets, pairs) = exclusive(order.iter().map(|&i| tile_counts[i as usize]));
    let (slot_offsets, of_slots) = exclusive(tile_counts.iter().copied());
    assert_eq!(of_slots, tile_counts.iter().sum::<u32>());
    offsets.extend([POISON; 4]);
    order.extend([POISON; 4]);
    let mut counts = [7u32; counters::COUNT];
    counts[counters::VISIBLE] = visible as u32;
    counts[counters::PAIRS] = pairs;
    let capacity = pairs.saturating_sub(short);
    let poison = bytes(&vec![POISON; pairs as usize + 100]);
    let buffers = [
        bytes(&splat2d),
        bytes(&tile_counts),
        bytes(&order),
        bytes(&offsets),
        bytes(&counts),
        poison.clone(),
        poison.clone(),
        poison,
        bytes(&slot_offsets),
    ];
    let [width, height] = grid.image;
    let [tile_width, tile_height] = grid.tile;
    let push = Push { width, height, tile_width, tile_height, capacity };
    let run = |given: &[(&str, u32)]| {
        let outcome = harness::run(gpu, &PASS, given, &buffers, &push, visible.div_ceil(64).max(1) as u32);
        outcome.assert_same_bits(&format!("{what}, {given:?}"));
        outcome
    };
    let outcome = run(&[]);
    // One tile per iteration, as in images with few tiles.
    if grid.counts().iter().product::<u32>() <= 32_767 {
        run(&[("PER_TURN", 1)]);
    }
    let carried = run(&[("CARRIED", 1)]);
    assert!(carried.device::<u32>(7).iter().all(|&w| w == POISON), "{what}: slots are written without slots");
    let [columns, rows] = grid.counts();
    for (i, most) in [(5, columns * rows + 1), (6, pairs), (7, n as u32)] {
        let words = outcome.device::<u32>(i);
        assert!(words.iter().any(|&w| w < most) || capacity == 0, "{what}: nothing is written");
        let (written, beyond) = words.split_at(capacity as usize);
        assert!(short > 0 || written.iter().all(|&w| w < most), "{what}: buffer {i} has a word that nobody wrote");
        assert!(beyond.iter().all(|&w| w == POISON), "{what}: buffer {i} is written past the capacity");
    }
}

pub fn run(gpu: &Gpu) {
    let grid = |image, tile| TileGrid::new(image, tile);
    // 129,600 tiles of one splat: more than the 65,535 iterations that lavapipe allows the loops of a thread.
    case(gpu, 2, &TileGrid::new([3840, 2160], [8, 8]), 0, |_, count| count);
    for n in [0, 1, 63, 64, 65, 129, 1000] {
        case(gpu, n, &grid([640, 360], [16, 16]), 0, |_, c| c);
        case(gpu, n, &grid([70, 53], [8, 8]), 0, |_, c| c);
        case(gpu, n, &grid([1, 1], [16, 16]), 0, |_, c| c);
    }
    // Wrong counts: the pass keeps to them.
    case(gpu, 500, &grid([640, 360], [16, 16]), 0, |i, c| match i % 3 {
        0 => c + 3,
        1 => c.saturating_sub(2),
        _ => c,
    });
    case(gpu, 500, &grid([640, 360], [16, 16]), 1000, |_, c| c);
}
