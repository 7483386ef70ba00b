//! `blend_forward` in all tile shapes against the f64 twin, within proven bounds, on scenes that broke rasterizers.

use psrgs_vk::pass::{Pass, blend_forward as passes};
use psrgs_vk::scene::tile::ALPHA_MIN;
use psrgs_vk::twin::blend_forward::{Blend, Blended, block_size, forward, masks};
use psrgs_vk::vk::{Gpu, Subgroup};

use super::blend_scene::{Doubt, EARLY_ALPHA_MIN, doubts, hard_scenes, widen};
use super::harness::{self, Outcome, bytes, garbage};

/// The shapes that run on this device, with the side of their tiles.
pub fn shapes(gpu: &Gpu) -> Vec<(&'static Pass, usize)> {
    let mut shapes = vec![(&passes::COLUMN_EMULATED, 8), (&passes::PIXEL, 16)];
    if matches!(gpu.caps().subgroup, Subgroup::Hardware(8)) {
        shapes.push((&passes::COLUMN, 8));
    }
    shapes
}

/// Push constants of a scene.
pub fn push(blend: &Blend<f32>) -> passes::Push {
    let [red, green, blue] = blend.background;
    passes::Push { width: blend.width as u32, height: blend.height as u32, red, green, blue }
}

/// Values as a buffer, never an empty one.
pub fn some<T: bytemuck::NoUninit>(values: &[T]) -> Vec<u8> {
    if values.is_empty() { garbage(16) } else { bytes(values) }
}

/// The buffers with which every blending pass begins.
pub fn inputs(blend: &Blend<f32>) -> Vec<Vec<u8>> {
    let normals = blend.normals.as_deref().unwrap_or(&[]);
    vec![some(&blend.splats), some(normals), some(&blend.sorted), bytes(&blend.ranges)]
}

/// Placeholders for what the PIXEL shape keeps for the backward pass.
pub fn nothing_kept(side: usize) -> Vec<Vec<u8>> {
    if side == 16 { vec![garbage(4), garbage(4)] } else { Vec::new() }
}

/// The forward pass of the PIXEL shape as in training, with blocks of `block` pixels and up to `chunks` chunks.
pub fn run_for_training(gpu: &Gpu, blend: &Blend<f32>, block: u32, chunks: u32) -> Outcome {
    let (pixels, aux) = (blend.width * blend.height, blend.normals.is_some());
    let (pairs, tiles) = (blend.sorted.len() as u64, blend.ranges.len() as u64);
    let mut buffers = inputs(blend);
    buffers.extend([
        garbage(4 * pixels),
        garbage(4 * pixels),
        garbage(pixels),
        bytes(&[0u32; passes::PAIR_COUNTS]),
        garbage(4),
        garbage(passes::mask_words(pairs, tiles, block) as usize),
        garbage((passes::state_floats(tiles, chunks, aux) as usize).max(4)),
    ]);
    let given = [
        ("AUX", u32::from(aux)),
        ("COUNT", 1),
        ("BLOCK", block),
        ("MASKS", 1),
        ("CHUNKS", chunks),
        ("ALPHA_MIN", blend.alpha_min.to_bits()),
    ];
    harness::run(gpu, &passes::PIXEL, &given, &buffers, &push(blend), blend.ranges.len() as u32)
}

/// Runs a shape on garbage-filled outputs.
pub fn run_shape(gpu: &Gpu, pass: &Pass, blend: &Blend<f32>) -> Outcome {
    let pixels = blend.width * blend.height;
    let mut buffers = inputs(blend);
    buffers.extend([
        garbage(4 * pixels),
        garbage(4 * pixels),
        garbage(pixels),
        bytes(&[0u32; passes::PAIR_COUNTS]),
        garbage(4),
    ]);
    buffers.extend(nothing_kept(blend.side));
    let mut given = vec![("AUX", u32::from(blend.normals.is_some())), ("COUNT", 1)];
    if blend.alpha_min != ALPHA_MIN {
        given.push(("ALPHA_MIN", blend.alpha_min.to_bits()));
    }
    harness::run(gpu, pass, &given, &buffers, &push(blend), blend.ranges.len() as u32)
}

struct Read {
    image: Vec<[f32; 4]>,
    aux: Vec<[f32; 4]>,
    last: Vec<u32>,
    counts: Vec<u32>,
}

fn compare(what: &str, got: &Read, want: &Blended<f64>, blend: &Blend<f64>, doubts: &[Doubt]) {
    let largest = |column: usize| blend.splats.iter().map(|s| s[column].abs()).fold(1.0f64, f64::max);
    let colour = [8, 9, 10].map(largest).into_iter().fold(1.0f64, f64::max);
    let mut undecided = 0;
    for (pixel, doubt) in doubts.iter().enumerate() {
        let (image, exact) = (got.image[pixel].map(f64::from), want.image[pixel]);
        assert!(image.iter().all(|v| v.is_finite()), "{what}: pixel {pixel} is {image:?}");
        if doubt.undecided {
            undecided += 1;
            continue;
        }
        assert_eq!(got.last[pixel], want.last[pixel], "{what}: last contributor of pixel {pixel}");
        let off_t = (image[3] - exact[3]).abs();
        assert!(
            off_t <= doubt.transmittance * exact[3] + 1e-9,
            "{what}: transmittance of pixel {pixel} off by {off_t:e}"
        );
        assert!(off_t <= 1e-3 * exact[3], "{what}: transmittance of pixel {pixel} off by {off_t:e}");
        let bound = doubt.weights * colour + 2.0 * doubt.transmittance * exact[3] + 1e-7;
        for k in 0..3 {
            let off = (image[k] - exact[k]).abs();
            assert!(off <= bound, "{what}: channel {k} of pixel {pixel} off by {off:e} > {bound:e}");
        }
        if blend.normals.is_some() {
            let bound = doubt.weights * largest(6) + 1e-7;
            for k in 0..4 {
                let off = (f64::from(got.aux[pixel][k]) - want.aux[pixel][k]).abs();
                assert!(off <= bound, "{what}: aux {k} of pixel {pixel} off by {off:e} > {bound:e}");
            }
        }
    }
    let share = undecided as f64 / doubts.len() as f64;
    assert!(share < 0.05, "{what}: {undecided} of {} pixels undecided", doubts.len());
    if undecided == 0 {
        assert_eq!(got.counts[..2], [want.evaluated, want.blended], "{what}: counts");
    }
}

/// Sizes of a subgroup's block in pixels: 4x2 to 16x16.
pub const BLOCKS: [u32; 6] = [8, 16, 32, 64, 128, 256];

/// The largest weights of splats, in scenes without pixels that f32 may decide differently. Larger earlier weights
/// stay.
fn weights(gpu: &Gpu) {
    for (pass, side) in shapes(gpu) {
        let mut compared = 0;
        for scene in hard_scenes() {
            let blend = scene.blend(side, false);
            let wide = widen::<f64>(&blend);
            let (want, doubts) = (forward(&wide), doubts(&wide));
            if doubts.iter().any(|doubt| doubt.undecided) || blend.splats.is_empty() {
                continue;
            }
            let bound = doubts.iter().map(|doubt| doubt.weights).fold(0.0, f64::max);
            let pixels = blend.width * blend.height;
            let before: Vec<f32> = (0..blend.splats.len()).map(|i| if i % 7 == 3 { 0.25 } else { 0.0 }).collect();
            let mut buffers = inputs(&blend);
            buffers.extend([garbage(4 * pixels), garbage(4 * pixels), garbage(pixels), garbage(4), bytes(&before)]);
            buffers.extend(nothing_kept(side));
            let given = [("AUX", 0), ("WEIGHTS", 1)];
            let outcome = harness::run(gpu, pass, &given, &buffers, &push(&blend), blend.ranges.len() as u32);
            for (who, got) in [("device", outcome.device::<f32>(8)), ("twin", outcome.twin(8))] {
                for (i, ((got, want), before)) in got.iter().zip(&want.weights).zip(&before).enumerate() {
                    let off = (f64::from(*got) - want.max(f64::from(*before))).abs();
                    let what = format!("{who}: {} of {}", pass.kernel.name, scene.name);
                    assert!(off <= bound, "{what}: weight of splat {i} is {got}, off by {off:e} > {bound:e}");
                }
            }
            compared += want.weights.iter().filter(|w| **w > 0.0).count();
        }
        assert!(compared > 500, "{compared} weights compared");
    }
}

/// Culling does not change the bits of image, auxiliary image and last contributors, and device and twin evaluate equal
/// numbers of splats in blocks.
fn culling(gpu: &Gpu) {
    let mut shares = [0.0; BLOCKS.len()];
    let scenes = hard_scenes();
    for scene in &scenes {
        let mut blend = scene.blend(16, true);
        let pixels = blend.width * blend.height;
        let mut buffers = inputs(&blend);
        buffers.extend([
            garbage(4 * pixels),
            garbage(4 * pixels),
            garbage(pixels),
            bytes(&[0u32; passes::PAIR_COUNTS]),
            garbage(4),
        ]);
        buffers.extend(nothing_kept(16));
        let run = |blend: &Blend<f32>, block: u32| {
            let given = [("AUX", 1), ("COUNT", 1), ("BLOCK", block)];
            harness::run(gpu, &passes::PIXEL, &given, &buffers, &push(blend), blend.ranges.len() as u32)
        };
        let want = run(&blend, 0);
        let all: Vec<u32> = want.device(7);
        for (share, block) in shares.iter_mut().zip(BLOCKS) {
            let got = run(&blend, block);
            assert!(got.device[4..7] == want.device[4..7], "{}, blocks of {block}: another image", scene.name);
            let counts: Vec<u32> = got.device(7);
            assert_eq!(counts[1], all[1], "{}, blocks of {block}: contributors", scene.name);
            blend.block = block_size(block);
            // Compared only where f32 cannot decide differently about stopping.
            if !doubts(&widen::<f64>(&blend)).iter().any(|d| d.undecided) {
                // Up to square roots that a device may round differently.
                let off = counts[0].abs_diff(forward(&blend).evaluated);
                assert!(200 * off <= all[0], "{}, blocks of {block}: {off} of {} evaluated", scene.name, all[0]);
            }
            *share += f64::from(counts[0]) / f64::from(all[0].max(1)) / scenes.len() as f64;
        }
    }
    println!("evaluated with blocks of {BLOCKS:?}: {shares:.3?} of all");
    assert!(shares[0] < 0.7 && shares.is_sorted(), "{shares:?}");
}

/// The bits that the backward pass reads are those of the test of blocks, for every splat that the forward pass reaches.
fn masks_of_blocks(gpu: &Gpu) {
    let mut compared = 0;
    for scene in hard_scenes() {
        let blend = scene.blend(16, false);
        for block in [8, 32, 64] {
            let got: Vec<u32> = run_for_training(gpu, &blend, block, 1).device(9);
            let (want, before) = (masks(&blend, block), garbage(got.len()));
            let before: Vec<u32> = bytemuck::pod_collect_to_vec(&before);
            assert_eq!(got.len(), want.len(), "{}", scene.name);
            for (word, ((got, want), before)) in got.iter().zip(&want).zip(&before).enumerate() {
                if got == before {
                    continue;
                }
                let what = format!("{}, blocks of {block}, word {word}: {got:#x} instead of {want:#x}", scene.name);
                // A device may round square roots differently.
                let off = (got ^ want).count_ones();
                assert!(off == 0 || !harness::rounds_alike(gpu) && off <= 1, "{what}");
                compared += 1;
            }
        }
    }
    assert!(compared > 1000, "{compared} words compared");
}

/// States at the ends of chunks leave the picture as it is but for the order of the sums.
fn states_of_chunks(gpu: &Gpu) {
    let mut longest = 0;
    for scene in hard_scenes() {
        for aux in [false, true] {
            let blend = scene.blend(16, aux);
            let wide = widen::<f64>(&blend);
            let (want, doubts) = (forward(&wide), doubts(&wide));
            let outcome = run_for_training(gpu, &blend, 32, 3);
            let rows = |i: usize| outcome.device::<[f32; 4]>(i);
            let got = Read { image: rows(4), aux: rows(5), last: outcome.device(6), counts: vec![0; 2] };
            let counted = Blended { evaluated: 0, blended: 0, ..want };
            compare(&format!("{}, aux {aux}, in chunks", scene.name), &got, &counted, &wide, &doubts);
            longest = blend.ranges.iter().map(|range| range[1] - range[0]).max().max(Some(longest)).unwrap_or(0);
        }
    }
    assert!(longest > 3 * 128, "no list has three chunks");
}

pub fn run(gpu: &Gpu) {
    weights(gpu);
    culling(gpu);
    masks_of_blocks(gpu);
    states_of_chunks(gpu);
    for (pass, side) in shapes(gpu) {
        for scene in hard_scenes() {
            for (aux, alpha_min) in [(false, ALPHA_MIN), (true, ALPHA_MIN), (false, EARLY_ALPHA_MIN)] {
                let blend = Blend { alpha_min, ..scene.blend(side, aux) };
                let wide = widen::<f64>(&blend);
                let (want, doubts) = (forward(&wide), doubts(&wide));
                let outcome = run_shape(gpu, pass, &blend);
                let what = format!("{} of {}, aux {aux}, skipped below {alpha_min}", pass.kernel.name, scene.name);
                for (who, buffers) in [("device", &outcome.device), ("twin", &outcome.twin)] {
                    let read = |i: usize| bytemuck::pod_collect_to_vec::<u8, f32>(&buffers[i]);
                    let got = Read {
                        image: read(4).chunks_exact(4).map(|p| [p[0], p[1], p[2], p[3]]).collect(),
                        aux: read(5).chunks_exact(4).map(|p| [p[0], p[1], p[2], p[3]]).collect(),
                        last: bytemuck::pod_collect_to_vec(&buffers[6]),
                        counts: bytemuck::pod_collect_to_vec(&buffers[7]),
                    };
                    compare(&format!("{who}: {what}"), &got, &want, &wide, &doubts);
                    if !aux {
                        assert!(buffers[5] == garbage(4 * doubts.len()), "{who}: {what}: aux was touched");
                    }
                }
            }
        }
    }
}
