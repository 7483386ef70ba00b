//! Stereo: pictures for sampling bit for bit; sweeps and the check of views against double precision, except where
//! rounding may decide.

use psrgs_vk::pass::stereo::{
    ARMS, BLOCKS, BlocksPush, FILTER, FLAG_START, FilterPush, LINK_ROWS, REFIT, RefitPush, SWEEP, SweepPush,
};
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::stereo::{Sweep, agreement, blocks, candidates, possible, refitted};
use psrgs_vk::vk::Gpu;

use super::harness::{self, Words, bytes, garbage};

const FOCAL: f32 = 30.0;

fn picture_rows(random: &mut Random, width: u32, height: u32) -> Vec<f32> {
    // Waves of a few pixels and a little noise, on the steps of 8-bit pictures.
    let (a, b, c) = (random.between(0.4, 0.9), random.between(0.3, 0.8), random.between(0.0, 6.0));
    (0..width * height)
        .map(|p| ((p % width) as f32, (p / width) as f32))
        .map(|(x, y)| 0.5 + 0.2 * (a * x + c).sin() + 0.2 * (b * y - 0.3 * x).cos() + random.between(-0.05, 0.05))
        .map(|v| (v.clamp(0.0, 1.0) * 255.0).round() / 255.0)
        .collect()
}

/// Rows of a source at `shift` from the reference, slightly turned. The transform back is not the inverse of the
/// transform to the source: a pass does not depend on it.
fn link(shift: [f32; 2], size: [u32; 2], turn: f32) -> [[f32; 4]; LINK_ROWS] {
    let [width, height] = size.map(|v| v as f32);
    let [x, y] = shift.map(|v| v * FOCAL);
    let there = |s: f32| {
        [[1.0, s * turn, s * 0.3, s * x], [-s * turn, 1.0, s * -0.2, s * y], [s * 2e-4, s * -1e-4, 1.0, s * 0.01]]
    };
    let (a, b) = (there(1.0), there(-1.0));
    [a[0], a[1], a[2], [width, height, 0.0, 0.0], b[0], b[1], b[2]]
}

fn wide(rows: &[[f32; 4]]) -> Vec<[f64; 4]> {
    rows.iter().map(|row| row.map(f64::from)).collect()
}

fn random_planes(random: &mut Random, count: u32) -> Vec<[f32; 4]> {
    let one = |random: &mut Random| {
        let none = random.between(0.0, 1.0) < 0.1;
        let score = if none { 0.0 } else { random.between(0.0, 1.2) };
        let slope = |random: &mut Random| random.between(-0.01, 0.01);
        [random.between(0.2, 0.9), slope(random), slope(random), score]
    };
    (0..count).map(|_| one(random)).collect()
}

fn blocks_case(gpu: &Gpu, width: u32, height: u32, first: u32) {
    let luma = picture_rows(&mut Random::new(3), width, height);
    let push = BlocksPush { width, height, first };
    let room = garbage(4 * (first + width * height) as usize + 8);
    let groups = (width * height).div_ceil(64);
    let outcome = harness::run(gpu, &BLOCKS, &[], &[bytes(&luma), room], &push, groups);
    outcome.assert_same_bits(&format!("blocks of {width}x{height}"));
}

/// Pictures of a reference and three sources of other sizes.
struct Pictures {
    stride: u32,
    blocks: Vec<[f32; 4]>,
    links: Vec<[f32; 4]>,
}

const SIZES: [[u32; 2]; 4] = [[21, 17], [21, 17], [24, 15], [18, 20]];

fn pictures(random: &mut Random) -> Pictures {
    let stride = 400;
    let mut all = Vec::new();
    for [width, height] in SIZES {
        let mut rows = blocks(width, height, &picture_rows(random, width, height));
        rows.resize(stride, [0.25; 4]);
        all.extend(rows);
    }
    let shifts = [[0.15, 0.02], [-0.1, 0.05], [0.03, -0.2]];
    let links = (0..3).flat_map(|s| link(shifts[s], SIZES[s + 1], 0.02 * s as f32)).collect();
    Pictures { stride: stride as u32, blocks: all, links }
}

/// The wanted row of a pixel; `None` where rounding may decide.
fn expected(sweep: &Sweep<'_, f64>, planes: &[[f64; 4]], pixel: u32) -> Option<[f64; 4]> {
    const BAND: f64 = 2e-4;
    let (window, middle) = (sweep.window(pixel), sweep.middle(pixel));
    let start = sweep.push.flags & FLAG_START != 0;
    let mut held = if start { [0.0; 4] } else { planes[pixel as usize] };
    if (window.variance - 4e-6).abs() < 1e-7 {
        return None;
    }
    for c in 0..sweep.tries() {
        let tried = candidates(sweep.push, planes, pixel, c, [held[0], held[1], held[2]]);
        let with = |factor: f64| {
            let moved = [tried[0] * factor, tried[1], tried[2]];
            let may = window.textured() && possible(sweep.push, moved, middle);
            if may { Some(window.score(sweep, moved, middle)) } else { None }
        };
        // The score jumps where a sample leaves the picture, or a hypothesis its valid range.
        let (score, below, above) = (with(1.0), with(1.0 - 1e-6), with(1.0 + 1e-6));
        let steady = match (score, below, above) {
            (None, None, None) => true,
            (Some(s), Some(b), Some(a)) => (s - b).abs() < BAND && (s - a).abs() < BAND,
            _ => false,
        };
        if !steady || score.is_some_and(|s| (s - held[3]).abs() < BAND && s > 0.0) {
            return None;
        }
        if let Some(score) = score.filter(|s| *s > held[3]) {
            held = [tried[0], tried[1], tried[2], score];
        }
    }
    Some(held)
}

fn sweep_case(gpu: &Gpu, side: u32, step: u32, flags: u32, best: u32) {
    let mut random = Random::new(u64::from(100 * side + 10 * step + flags + best));
    let made = pictures(&mut random);
    let [width, height] = SIZES[0];
    let planes = random_planes(&mut random, width * height);
    let start = flags & FLAG_START != 0;
    // Pixels of one colour, as in the sweeps; at the start all pixels, behind a part of the list that is not read.
    let list: Vec<u32> = (0..width * height).filter(|p| start || (p % width + p / width) % 2 == 1).collect();
    let first = if start { 7 } else { 0 };
    let push = SweepPush {
        width,
        height,
        stride: made.stride,
        sources: 3,
        best,
        first,
        count: list.len() as u32 - first,
        turn: 3,
        seed: 11,
        draws: if start { 2 } else { 4 },
        flags,
        focal_x: FOCAL,
        focal_y: 1.1 * FOCAL,
        centre_x: 10.0,
        centre_y: 8.6,
        least: 0.15,
        most: 1.0,
        amplitude: 0.05,
        slope: 0.005,
        by_distance: 0.08,
        by_luma: 12.0,
        facing: 0.3,
    };
    let buffers = [bytes(&made.blocks), bytes(&made.links), bytes(&list), bytes(&planes)];
    let groups = push.count.div_ceil(64);
    let outcome = harness::run(gpu, &SWEEP, &[("STEP", step), ("SIDE", side)], &buffers, &push, groups);

    let (blocks, links) = (wide(&made.blocks), wide(&made.links));
    let (wide_planes, sweep) = (wide(&planes), Sweep { push: &push, side, step, blocks: &blocks, links: &links });
    let name = format!("sweep of {side}x{side} taps, step {step}, flags {flags}");
    let (device, twin) = (outcome.device::<[f32; 4]>(3), outcome.twin::<[f32; 4]>(3));
    let (mut compared, mut changed) = (0, 0);
    for pixel in 0..width * height {
        let at = pixel as usize;
        if !list[first as usize..].contains(&pixel) {
            assert_eq!(device[at], planes[at], "{name}: pixel {pixel} is not of the call");
            assert_eq!(twin[at], planes[at], "{name}: pixel {pixel} is not of the call");
            continue;
        }
        let Some(want) = expected(&sweep, &wide_planes, pixel) else { continue };
        compared += 1;
        changed += u32::from(want[3] != wide_planes[at][3]);
        for (who, got) in [("device", device[at]), ("twin", twin[at])] {
            for k in 0..4 {
                let bound = if k == 3 { 1e-4 } else { 2e-6 };
                let off = (f64::from(got[k]) - want[k]).abs();
                assert!(off < bound, "{name}, {who}: pixel {pixel} has {got:?} instead of {want:?}");
            }
        }
    }
    println!("{name}: {compared} of {} pixels compared, {changed} changed", push.count);
    assert!(10 * compared > 8 * push.count, "{name}: only {compared} of {} pixels could be compared", push.count);
    assert!(4 * changed > compared, "{name}: only {changed} pixels changed");
    assert!(sweep.tries() == push.draws + if start { 1 } else { ARMS });
}

fn filter_case(gpu: &Gpu, needed: u32) {
    let mut random = Random::new(5 + u64::from(needed));
    let made = pictures(&mut random);
    let [width, height] = SIZES[0];
    // Nearly equal surfaces in all views, so that both outcomes are frequent.
    let planes: Vec<[f32; 4]> = random_planes(&mut random, 4 * made.stride)
        .iter()
        .map(|[d, gx, gy, score]| [0.5 + 0.02 * (d - 0.5), 0.1 * gx, 0.1 * gy, *score])
        .collect();
    let push =
        FilterPush { width, height, stride: made.stride, sources: 3, needed, pixels: 2.0, depth: 0.03, score: 0.2 };
    let buffers = [bytes(&planes), bytes(&made.links), garbage(4 * (width * height) as usize + 5)];
    let outcome = harness::run(gpu, &FILTER, &[], &buffers, &push, (width * height).div_ceil(64));
    let (planes, links) = (wide(&planes), wide(&made.links));
    let (device, twin) = (outcome.device::<[f32; 4]>(2), outcome.twin::<[f32; 4]>(2));
    let (mut compared, mut kept) = (0, 0);
    for pixel in 0..width * height {
        let want = agreement(&push, &planes, &links, pixel);
        if want.margin < 1e-4 {
            continue;
        }
        compared += 1;
        kept += u32::from(want.confidence > 0.0);
        for got in [device[pixel as usize], twin[pixel as usize]] {
            assert!((f64::from(got[3]) - want.confidence).abs() < 1e-6, "pixel {pixel}: {got:?} instead of {want:?}");
            let plane = if want.confidence > 0.0 { planes[pixel as usize] } else { [0.0; 4] };
            assert!((0..3).all(|k| f64::from(got[k]) == plane[k]), "pixel {pixel}: {got:?} instead of {plane:?}");
        }
    }
    assert!(10 * compared > 9 * width * height, "only {compared} pixels could be compared");
    assert!(compared / 10 < kept && kept < compared - compared / 10, "{kept} of {compared} kept");
    assert_eq!(outcome.device[2][16 * (width * height) as usize..], buffers[2][16 * (width * height) as usize..]);
}

fn refit_case(gpu: &Gpu, width: u32, height: u32, reach: u32) {
    let mut random = Random::new(u64::from(width + reach));
    // A slope with a step in it, noise, and holes.
    let one = |p: u32| {
        let (x, y) = ((p % width) as f32, (p / width) as f32);
        let step = if x + y > 20.0 { 0.1 } else { 0.0 };
        let d = 0.5 + 0.003 * x - 0.002 * y + step + random.between(-0.002, 0.002);
        let slopes = [0.003 + random.between(-0.001, 0.001), -0.002 + random.between(-0.001, 0.001)];
        if random.between(0.0, 1.0) < 0.2 { [0.0; 4] } else { [d, slopes[0], slopes[1], 0.7] }
    };
    let kept: Vec<[f32; 4]> = (0..width * height).map(one).collect();
    let push = RefitPush { width, height, reach, tolerance: 0.02 };
    let buffers = [bytes(&kept), garbage(4 * (width * height) as usize + 3)];
    let outcome = harness::run(gpu, &REFIT, &[], &buffers, &push, (width * height).div_ceil(64));
    let wide = wide(&kept);
    let (device, twin) = (outcome.device::<[f32; 4]>(1), outcome.twin::<[f32; 4]>(1));
    for pixel in 0..width * height {
        let want = refitted(&push, &wide, pixel);
        for got in [device[pixel as usize], twin[pixel as usize]] {
            let near = (0..4).all(|k| (f64::from(got[k]) - want[k]).abs() < 1e-6);
            assert!(near, "reach {reach}, pixel {pixel}: {got:?} instead of {want:?}");
        }
    }
}

pub fn run(gpu: &Gpu) {
    blocks_case(gpu, 13, 9, 5);
    blocks_case(gpu, 1, 1, 0);
    blocks_case(gpu, 70, 3, 64);
    sweep_case(gpu, 3, 2, 0, 1);
    sweep_case(gpu, 4, 2, 0, 2);
    sweep_case(gpu, 5, 1, 0, 3);
    sweep_case(gpu, 5, 1, FLAG_START, 2);
    sweep_case(gpu, 6, 2, FLAG_START, 1);
    filter_case(gpu, 1);
    filter_case(gpu, 2);
    refit_case(gpu, 19, 14, 3);
    refit_case(gpu, 5, 2, 1);
}
