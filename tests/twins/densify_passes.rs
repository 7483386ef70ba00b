//! The passes of density control one by one, on random words and around workgroup edges. `density` and `density_device`
//! test whole changes against an independent reference.

use psrgs_vk::pass::counters::{self, NEXT_ID, SCAN_TOTAL, SPLATS, STATUS};
use psrgs_vk::pass::{
    densify_axes, densify_classify, densify_finish, densify_gather, densify_limit, densify_map, densify_means,
    densify_sample, densify_scores, densify_stats, opacity_reset,
};
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::densify_means::child_mean;
use psrgs_vk::twin::project_backward_adam_packed;
use psrgs_vk::twin::scan::exclusive;
use psrgs_vk::vk::Gpu;

use super::harness::{self, Words, bytes, garbage};

const SIZES: [usize; 8] = [0, 1, 2, 63, 64, 65, 127, 300];

fn counts(set: &[(usize, u32)]) -> Vec<u8> {
    let mut counts = [7; counters::COUNT];
    counts[STATUS] = 0;
    set.iter().for_each(|&(counter, value)| counts[counter] = value);
    bytes(&counts)
}

fn groups(items: usize) -> u32 {
    items.div_ceil(64).max(1) as u32
}

fn floats(random: &mut Random, count: usize, low: f32, high: f32) -> Vec<f32> {
    (0..count).map(|_| random.between(low, high)).collect()
}

pub fn run(gpu: &Gpu) {
    for n in SIZES {
        let random = &mut Random::new(90 + n as u64);
        classify(gpu, random, n);
        sample(gpu, random, n);
        scores(gpu, random, n);
        let (flags, offsets, total) = flags(random, n);
        limit(gpu, n, &flags, &offsets, total);
        map(gpu, random, n, &flags, &offsets, total);
        axes(gpu, random, n);
        finish(gpu, n, &offsets, total);
        gather(gpu, random, n);
        means(gpu, random, n);
        stats(gpu, random, n);
        reset(gpu, random, n);
    }
}

/// Capacity for three more splats.
fn room(n: usize) -> usize {
    n + 3
}

/// Planes of a model in which about one splat in ten has a value that is not finite.
fn planes(random: &mut Random, stride: usize) -> [Vec<u8>; 8] {
    [3, 4, 3, 1, 12, 12, 12, 12].map(|width| {
        let mut plane = floats(random, width * stride, -1.0, 1.0);
        for value in &mut plane {
            if random.word().is_multiple_of(600) {
                *value = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][random.word() as usize % 3];
            }
        }
        bytes(&plane)
    })
}

fn classify(gpu: &Gpu, random: &mut Random, n: usize) {
    let stride = room(n);
    let planes = planes(random, stride);
    let stats: Vec<[f32; 4]> = (0..stride)
        .map(|_| {
            let views = (random.word() % 4) as f32;
            // Quarters, so that thresholds are hit exactly.
            [(random.word() % 5) as f32 * views / 4.0, (random.word() % 9) as f32 * views / 4.0, views, 0.0]
        })
        .collect();
    for (split_absolute, prune_large) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let push = densify_classify::Push {
            stride: stride as u32,
            clone_threshold: 0.5,
            split_threshold: 0.75,
            split_absolute,
            split_scale: 0.4,
            prune_opacity: -0.7,
            prune_scale: 0.8,
            prune_large,
        };
        let mut buffers = vec![counts(&[(SPLATS, n as u32)])];
        buffers.extend(planes.iter().cloned());
        buffers.extend([bytes(&stats), garbage(4 * stride), bytes(&[5_u32, 6, 7, 8])]);
        let outcome = harness::run(gpu, &densify_classify::PASS, &[], &buffers, &push, groups(stride));
        outcome.assert_same_bits(&format!("densify_classify of {n}"));
    }
}

fn sample(gpu: &Gpu, random: &mut Random, n: usize) {
    let stride = room(n);
    let planes = planes(random, stride);
    let stats: Vec<[f32; 4]> = (0..stride)
        .map(|_| {
            let views = (random.word() % 4) as f32;
            [(random.word() % 9) as f32 * views / 8.0, (random.word() % 9) as f32 * views / 4.0, views, 0.0]
        })
        .collect();
    let scores: Vec<[f32; 2]> =
        stats.iter().map(|s| [random.between(0.0, 1.2) * s[1], (random.word() % (1 + s[2] as u32)) as f32]).collect();
    let ids = random.words(stride);
    for (absolute, prune_large, prune_unseen) in [(0, 0, 0), (1, 1, 0), (1, 0, 1)] {
        let push = densify_sample::Push {
            stride: stride as u32,
            low_threshold: 0.75,
            high_threshold: 0.25,
            absolute,
            rate: 0.4,
            mask_share: 0.5,
            error_share: 0.25,
            prune_opacity: -0.7,
            prune_scale: 0.8,
            prune_large,
            prune_unseen,
            seed: 5,
            event: random.word(),
        };
        let mut buffers = vec![counts(&[(SPLATS, n as u32)])];
        buffers.extend(planes.iter().cloned());
        buffers.extend([bytes(&stats), bytes(&scores), bytes(&ids), garbage(4 * stride), bytes(&[5_u32, 6, 7, 8])]);
        let outcome = harness::run(gpu, &densify_sample::PASS, &[], &buffers, &push, groups(stride));
        outcome.assert_same_bits(&format!("densify_sample of {n}"));
    }
}

fn scores(gpu: &Gpu, random: &mut Random, n: usize) {
    let (room, width, height) = (room(n), 13, 7);
    let tile_counts: Vec<u32> = (0..room).map(|_| random.word() % 3).collect();
    // Centres on both sides of the image's borders.
    let splat2d = floats(random, 12 * room, -3.0, 16.0);
    let grad2d = floats(random, 12 * room, -1.0, 1.0);
    let pixels = (width * height) as usize;
    let (image, saliency) = (floats(random, 4 * pixels, 0.0, 1.0), floats(random, pixels, 0.0, 1.0));
    let before = floats(random, 2 * room, 0.0, 5.0);
    for (bits, masked) in [(8, 0), (8, 1), (16, 1)] {
        let photograph = random.words(pixels * bits / 8);
        let push = densify_scores::Push { width, height, masked, error: 0.3 };
        let buffers = [
            counts(&[(SPLATS, n as u32)]),
            bytes(&tile_counts),
            bytes(&splat2d),
            bytes(&grad2d),
            bytes(&image),
            bytes(&photograph),
            bytes(&saliency),
            bytes(&before),
        ];
        let given = [("PHOTOGRAPH_BITS", bits as u32)];
        let outcome = harness::run(gpu, &densify_scores::PASS, &given, &buffers, &push, groups(room));
        let (device, twin) = (outcome.device::<f32>(7), outcome.twin::<f32>(7));
        for (e, (d, t)) in device.iter().zip(&twin).enumerate() {
            let seen = e / 2 < n && tile_counts[e / 2] > 0;
            // Errors are counts, so they are equal. Square roots may differ in the last bits.
            let tolerance = if seen && e % 2 == 0 { 2e-6 * t.abs() } else { 0.0 };
            assert!((d - t).abs() <= tolerance, "densify_scores of splat {}: {d}, twin {t}", e / 2);
            assert!(seen || *d == before[e], "densify_scores of splat {}, which was not seen", e / 2);
        }
    }
}

/// Flags as `densify_classify` leaves them, their prefix sum and their sum.
fn flags(random: &mut Random, n: usize) -> (Vec<u32>, Vec<u32>, u32) {
    let stride = room(n);
    let mut flags = vec![0; 4 * stride];
    for i in 0..n {
        let row = [[1, 0, 0, 0], [1, 1, 0, 0], [0, 0, 1, 1], [0; 4]][random.word() as usize % 4];
        (0..4).for_each(|kind| flags[kind * stride + i] = row[kind]);
    }
    let (offsets, total) = exclusive(flags.iter().copied());
    (flags, offsets, total)
}

fn limit(gpu: &Gpu, n: usize, flags: &[u32], offsets: &[u32], total: u32) {
    let stride = room(n) as u32;
    for max_splats in [0, total.saturating_sub(5), total.saturating_sub(1), total, u32::MAX] {
        let push = densify_limit::Push { stride, max_splats, seed: 5, event: n as u32 };
        let buffers = [counts(&[(SPLATS, n as u32), (SCAN_TOTAL, total)]), bytes(offsets), bytes(flags)];
        let outcome = harness::run(gpu, &densify_limit::PASS, &[], &buffers, &push, groups(stride as usize));
        outcome.assert_same_bits(&format!("densify_limit of {n} to {max_splats}"));
    }
}

fn map(gpu: &Gpu, random: &mut Random, n: usize, flags: &[u32], offsets: &[u32], total: u32) {
    let push = densify_map::Push { stride: room(n) as u32 };
    let buffers = [
        counts(&[(SPLATS, n as u32), (NEXT_ID, 1000)]),
        bytes(flags),
        bytes(offsets),
        bytes(&random.words(room(n))),
        garbage(total as usize + 4),
        garbage(total as usize + 4),
    ];
    let outcome = harness::run(gpu, &densify_map::PASS, &[], &buffers, &push, groups(n));
    outcome.assert_same_bits(&format!("densify_map of {n}"));
}

fn axes(gpu: &Gpu, random: &mut Random, n: usize) {
    let rows = 2 * n;
    let map = entries(random, n.max(1), rows + 4);
    let quats = floats(random, 4 * room(n), -1.0, 1.0);
    let scales = floats(random, 3 * room(n), -12.0, 2.0);
    let mut moments = floats(random, 3 * room(n), -1e-6, 1e-6);
    // The first splat has no moments.
    moments[..3].fill(0.0);
    let packed: Vec<u32> = moments.iter().map(|m| project_backward_adam_packed::pack(*m, m * m + 1e-14, 0)).collect();
    for packed_moments in [0, 1] {
        let moments = if packed_moments == 0 { bytes(&moments) } else { bytes(&packed) };
        let push = densify_axes::Push { packed_moments };
        let buffers =
            [counts(&[(SCAN_TOTAL, rows as u32)]), bytes(&quats), bytes(&scales), moments.clone(), bytes(&map)];
        let outcome = harness::run(gpu, &densify_axes::PASS, &[], &buffers, &push, groups(rows));
        outcome.assert_same_bits(&format!("densify_axes of {rows}, packed {packed_moments}"));
        let found = outcome.device::<u32>(4);
        for (row, (entry, before)) in found.iter().zip(&map).enumerate() {
            let child = row < rows && entry >> 30 >= 2 && (before & 0x0fff_ffff) > 0;
            assert!(if child { entry >> 28 & 3 != 0 } else { entry == before }, "densify_axes, row {row}");
        }
    }
}

fn finish(gpu: &Gpu, n: usize, offsets: &[u32], total: u32) {
    let push = densify_finish::Push { stride: room(n) as u32 };
    for status in [0, counters::PAIRS_BIT, counters::SPLATS_BIT] {
        let counts = counts(&[(SPLATS, n as u32), (SCAN_TOTAL, total), (STATUS, status), (NEXT_ID, 1000)]);
        let buffers = [counts.clone(), bytes(offsets), bytes(&[3_u32, 4, 5, 6])];
        let outcome = harness::run(gpu, &densify_finish::PASS, &[], &buffers, &push, 1);
        outcome.assert_same_bits(&format!("densify_finish of {n} with status {status}"));
        assert_eq!(outcome.device[0] == counts, status != 0, "counts change exactly when the event stands");
    }
}

/// A map of `rows` rows onto `n` sources, along any axis.
fn entries(random: &mut Random, n: usize, rows: usize) -> Vec<u32> {
    (0..rows).map(|_| (random.word() % n as u32) | (random.word() << 28)).collect()
}

fn gather(gpu: &Gpu, random: &mut Random, n: usize) {
    let rows = if n == 0 { 0 } else { n + n / 2 };
    let map = entries(random, n.max(1), rows + 4);
    for width in [1, 3, 4, 12] {
        let plane = bytes(&floats(random, width as usize * room(n), -9.0, 9.0));
        for mode in [
            densify_gather::MODE_COPY,
            densify_gather::MODE_SHRINK,
            densify_gather::MODE_MOMENT,
            densify_gather::MODE_ZERO,
            densify_gather::MODE_SHRINK_AXIS,
            densify_gather::MODE_SHARE,
        ] {
            let push = densify_gather::Push { mode, keep: 0.9 };
            let target = garbage(width as usize * (rows + 4));
            let buffers = [counts(&[(SCAN_TOTAL, rows as u32)]), bytes(&map), plane.clone(), target];
            let given = [("WIDTH", width)];
            let outcome = harness::run(gpu, &densify_gather::PASS, &given, &buffers, &push, groups(rows));
            let what = format!("densify_gather of {rows} rows of {width}, mode {mode}");
            if mode != densify_gather::MODE_SHARE {
                outcome.assert_same_bits(&what);
                continue;
            }
            for (d, t) in outcome.device::<f32>(3).iter().zip(outcome.twin::<f32>(3)) {
                let bound = shared_logit_error(gpu, t);
                assert!(d.to_bits() == t.to_bits() || (d - t).abs() <= bound, "{what}: {d}, twin {t}");
            }
        }
    }
}

/// Largest difference from the twin of a logit that was shared or has faded. Logits come from divisions and a square
/// root; exponential and logarithm are sums of products that round alike everywhere. Near 0 and 1, a logit follows the
/// last bit of the opacity.
///
/// Vulkan promises a quotient within 2.5 ulp and a square root, 1 / inversesqrt, within 4.5, beside half an ulp of the
/// twin. So o = 1 / (1 + e) has 3 ulp. o / (1 + s) with s = sqrt(1 - o) adds these 3 ulp times o / (2 s (1 + s)), up to
/// 2.3 where a child does not just keep o (s > 0.18), 5 ulp of s / (1 + s), 3 ulp of the quotient, 1 ulp of each of two
/// products: less than 17 ulp in all. The logit's error is the relative error of the opacity over
/// 1 - o = 1 / (1 + exp(logit)).
pub(super) fn shared_logit_error(gpu: &Gpu, logit: f32) -> f32 {
    let last_bit = 2e-7 * (2.0 + logit.abs().min(16.0).exp());
    let promised = 17.0 * f32::EPSILON * (1.0 + logit.min(16.0).exp());
    last_bit + if harness::rounds_alike(gpu) { 0.0 } else { promised }
}

/// Additional relative error of a child's offset from its parent, where roots and quotients are not correctly rounded.
/// With Vulkan's 4.5 and 2.5 ulp: a normal has a root, and a rotation has products of two components of the quaternion,
/// each divided by the root of a sum.
pub(super) fn offset_error(gpu: &Gpu) -> f64 {
    if harness::rounds_alike(gpu) { 0.0 } else { (4.5 + 2.0 * (4.5 + 2.5)) * f64::from(f32::EPSILON) }
}

fn means(gpu: &Gpu, random: &mut Random, n: usize) {
    let rows = if n == 0 { 0 } else { 2 * n };
    let map = entries(random, n.max(1), rows + 4);
    let old_ids = random.words(room(n));
    let source = floats(random, 3 * room(n), -2.0, 2.0);
    let mut quats = floats(random, 4 * room(n), -1.0, 1.0);
    // A zero quaternion is no rotation.
    quats[..4].fill(0.0);
    let scales = floats(random, 3 * room(n), -12.0, 2.0);
    let push = densify_means::Push { seed: random.word(), event: random.word(), along_axis: 0 };
    let buffers = [
        counts(&[(SCAN_TOTAL, rows as u32)]),
        bytes(&map),
        bytes(&old_ids),
        bytes(&source),
        bytes(&quats),
        bytes(&scales),
        garbage(3 * (rows + 4)),
    ];
    let outcome = harness::run(gpu, &densify_means::PASS, &[], &buffers, &push, groups(rows));
    let (device, twin) = (outcome.device::<[f32; 3]>(6), outcome.twin::<[f32; 3]>(6));
    for row in 0..rows + 4 {
        let (i, kind) = ((map[row] & 0x0fff_ffff) as usize, map[row] >> 30);
        if row >= rows || kind < 2 {
            assert_eq!(device[row].map(f32::to_bits), twin[row].map(f32::to_bits), "densify_means, row {row}");
            continue;
        }
        let wide = |v: &[f32], k: usize| f64::from(v[k]);
        let mean: [f64; 3] = std::array::from_fn(|k| wide(&source, 3 * i + k));
        let log_scales: [f64; 3] = std::array::from_fn(|k| wide(&scales, 3 * i + k));
        let quat = std::array::from_fn(|k| wide(&quats, 4 * i + k));
        let want = child_mean(mean, quat, log_scales, [push.seed, push.event, old_ids[i], kind - 2]);
        let sigma = log_scales.iter().map(|s| s.exp()).fold(0.0, f64::max);
        for k in 0..3 {
            // Normals within 1.5e-6, a rotation of a vector up to 10 sigma long in f32, and the sum's own rounding.
            let tolerance =
                sigma * (3.0 * 1.5e-6 + 10.0 * (6e-7 + offset_error(gpu))) + 1.2e-7 * (want[k].abs() + mean[k].abs());
            for (found, who) in [(device[row][k], "device"), (twin[row][k], "twin")] {
                let error = (f64::from(found) - want[k]).abs();
                assert!(error <= tolerance, "densify_means, row {row}: {who} {found} for {}", want[k]);
            }
        }
    }
}

fn stats(gpu: &Gpu, random: &mut Random, n: usize) {
    let room = room(n);
    let tile_counts: Vec<u32> = (0..room).map(|_| random.word() % 3).collect();
    let grad2d = floats(random, 12 * room, -1.0, 1.0);
    let before = floats(random, 4 * room, 0.0, 5.0);
    let push = densify_stats::Push { half_width: 160.5, half_height: 90.0 };
    let buffers = [counts(&[(SPLATS, n as u32)]), bytes(&tile_counts), bytes(&grad2d), bytes(&before)];
    let outcome = harness::run(gpu, &densify_stats::PASS, &[], &buffers, &push, groups(room));
    let (device, twin) = (outcome.device::<f32>(3), outcome.twin::<f32>(3));
    for (e, (d, t)) in device.iter().zip(&twin).enumerate() {
        // The fourth column belongs to the optimiser.
        let (i, seen) = (e / 4, e / 4 < n && e % 4 < 3 && tile_counts[e / 4] > 0);
        assert!((d - t).abs() <= if seen { 2e-6 * t.abs() } else { 0.0 }, "densify_stats of splat {i}: {d}, twin {t}");
        assert!(seen || *d == before[e], "densify_stats of splat {i}, which was not seen");
    }
}

fn reset(gpu: &Gpu, random: &mut Random, n: usize) {
    let opacities = floats(random, room(n), -9.0, 3.0);
    let push = opacity_reset::Push { logit_cap: -4.595 };
    let buffers = [counts(&[(SPLATS, n as u32)]), bytes(&opacities), garbage(room(n)), garbage(room(n))];
    let outcome = harness::run(gpu, &opacity_reset::PASS, &[], &buffers, &push, groups(n));
    outcome.assert_same_bits(&format!("opacity_reset of {n}"));
}
