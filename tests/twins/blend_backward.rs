//! `blend_backward` in all tile shapes and kinds of sums against the f64 twin. Contributors are those of the forward
//! pass, and two runs with slots have equal bits.

use psrgs_vk::pass::{Pass, blend_backward as passes, blend_forward::PAIR_COUNTS};
use psrgs_vk::scene::random::Random;
use psrgs_vk::scene::tile::ALPHA_MIN;
use psrgs_vk::twin::blend_backward::{PairGrads, Upstream, backward};
use psrgs_vk::twin::blend_forward::{Blend, forward, masks};
use psrgs_vk::vk::{FloatAtomics, Gpu, Subgroup};

use super::blend_forward::{inputs, push, run_for_training, run_shape, shapes, some};
use super::blend_scene::{EARLY_ALPHA_MIN, doubts, hard_scenes, widen};
use super::common::guards::Guards;
use super::harness::{self, bytes, garbage};

#[derive(Clone, Copy, PartialEq)]
enum Rows {
    Slots,
    Sums,
}

/// Passes that run on this device, each with side of the tiles, target of the sums, and width of emulated subgroups.
fn variants(gpu: &Gpu) -> Vec<(&'static Pass, usize, Rows, Option<u32>)> {
    let mut all = vec![
        (&passes::COLUMN_EMULATED_SLOTS, 8, Rows::Slots, None),
        (&passes::PIXEL_EMULATED_SLOTS, 16, Rows::Slots, Some(32)),
        (&passes::PIXEL_CAS, 16, Rows::Sums, None),
        (&passes::PIXEL_EMULATED_CAS, 16, Rows::Sums, Some(32)),
        (&passes::PIXEL_EMULATED_CAS, 16, Rows::Sums, Some(64)),
    ];
    let eight = matches!(gpu.caps().subgroup, Subgroup::Hardware(8));
    let atomics = gpu.caps().buffer_floats == FloatAtomics::Native;
    if eight {
        all.extend([(&passes::COLUMN_SLOTS, 8, Rows::Slots, None), (&passes::COLUMN_CAS, 8, Rows::Sums, None)]);
    }
    if matches!(gpu.caps().subgroup, Subgroup::Hardware(_)) {
        all.push((&passes::PIXEL_SLOTS, 16, Rows::Slots, None));
    }
    if atomics {
        all.push((&passes::PIXEL_ATOMIC, 16, Rows::Sums, None));
    }
    if eight && atomics {
        all.push((&passes::COLUMN_ATOMIC, 8, Rows::Sums, None));
    }
    all
}

/// The slot of each sorted pair; slots are numbered splat by splat.
fn slots(blend: &Blend<f32>) -> Vec<u32> {
    let mut order: Vec<usize> = (0..blend.sorted.len()).collect();
    order.sort_by_key(|&pair| blend.sorted[pair]);
    let mut slots = vec![0; order.len()];
    for (slot, pair) in order.into_iter().enumerate() {
        slots[pair] = slot as u32;
    }
    slots
}

/// Random gradients, 0 at pixels where f32 may decide differently.
fn upstream(blend: &Blend<f64>, seed: u64, clamp_gradient_passes: bool) -> Upstream<f64> {
    let mut draws = Random::new(seed);
    let (out, doubts) = (forward(blend), doubts(blend));
    let mut grads = || -> Vec<[f64; 4]> {
        let value = |keep: bool, d: &mut Random| if keep { f64::from(d.range(-1.0, 1.0) as f32) } else { 0.0 };
        doubts.iter().map(|doubt| std::array::from_fn(|_| value(!doubt.undecided, &mut draws))).collect()
    };
    let image = out.image.iter().map(|p| p.map(|v| f64::from(v as f32))).collect();
    let (grad_image, grad_aux) = (grads(), grads());
    Upstream { image, last: out.last, grad_image, grad_aux, clamp_gradient_passes }
}

fn narrow(values: &[[f64; 4]]) -> Vec<u8> {
    bytes(&values.iter().map(|v| v.map(|x| x as f32)).collect::<Vec<_>>())
}

/// Buffers of a pass: outputs are garbage where the pass must write every word, and zeros where it adds.
fn buffers(blend: &Blend<f32>, up: &Upstream<f64>, rows: Rows) -> Vec<Vec<u8>> {
    let mut all = inputs(blend);
    all.extend([narrow(&up.image), bytes(&up.last), narrow(&up.grad_image), narrow(&up.grad_aux)]);
    match rows {
        Rows::Slots => {
            let pairs = blend.sorted.len().max(1);
            all.extend([some(&slots(blend)), garbage(12 * pairs), garbage(4 * pairs)]);
        }
        Rows::Sums => {
            let n = blend.splats.len().max(1);
            all.extend([bytes(&vec![0.0f32; 12 * n]), bytes(&vec![0.0f32; 4 * n])]);
        }
    }
    all.push(bytes(&[0u32; PAIR_COUNTS]));
    all
}

/// As `buffers`, with what the pass reads of masks and states.
fn buffers_with(pass: &Pass, blend: &Blend<f32>, up: &Upstream<f64>, rows: Rows, kept: [Vec<u8>; 2]) -> Vec<Vec<u8>> {
    let mut all = buffers(blend, up, rows);
    let names = pass.kernel.bindings.iter().map(|binding| binding.name);
    let [masks, states] = kept;
    all.extend(names.filter_map(|name| match name {
        "masks" => Some(masks.clone()),
        "states" => Some(states.clone()),
        _ => None,
    }));
    all
}

/// Index of the first of the buffers that the pass writes: rows, normals, counts.
fn outputs(rows: Rows) -> usize {
    if rows == Rows::Slots { 9 } else { 8 }
}

/// Sums per splat in f64, from rows of `width` floats per pair (slots) or per splat.
fn per_splat(blend: &Blend<f32>, rows: Rows, width: usize, buffer: &[u8]) -> Vec<f64> {
    let values: Vec<f32> = bytemuck::pod_collect_to_vec(buffer);
    let n = blend.splats.len();
    let mut sums = vec![0.0; width * n];
    match rows {
        Rows::Sums => sums.iter_mut().zip(&values).for_each(|(s, &v)| *s = f64::from(v)),
        Rows::Slots => {
            for (&slot, &splat) in slots(blend).iter().zip(&blend.sorted) {
                for k in 0..width {
                    sums[width * splat as usize + k] += f64::from(values[width * slot as usize + k]);
                }
            }
        }
    }
    sums
}

fn exact(blend: &Blend<f64>, grads: &PairGrads<f64>) -> (Vec<f64>, Vec<f64>) {
    let n = blend.splats.len();
    let (mut rows, mut normals) = (vec![0.0; 12 * n], vec![0.0; 4 * n]);
    for (pair, &splat) in blend.sorted.iter().enumerate() {
        for k in 0..12 {
            rows[12 * splat as usize + k] += grads.rows[pair][k];
        }
        for k in 0..4 {
            normals[4 * splat as usize + k] += grads.normals[pair][k];
        }
    }
    (rows, normals)
}

/// Sums per splat of the absolute contributions of pixels (of up to four together in tiles of 16). Errors of sums that
/// cancel are small against them.
fn sizes(blend: &Blend<f64>, up: &Upstream<f64>) -> (Vec<f64>, Vec<f64>) {
    let n = blend.splats.len();
    let (mut rows, mut normals) = (vec![0.0; 12 * n], vec![0.0; 4 * n]);
    for class in 0..64 {
        let mut some = up.clone();
        for pixel in 0..blend.width * blend.height {
            if pixel % blend.width % 8 != class % 8 || pixel / blend.width % 8 != class / 8 {
                (some.grad_image[pixel], some.grad_aux[pixel]) = ([0.0; 4], [0.0; 4]);
            }
        }
        let grads = backward(blend, &some);
        for (pair, &splat) in blend.sorted.iter().enumerate() {
            for k in 0..12 {
                rows[12 * splat as usize + k] += grads.rows[pair][k].abs();
            }
            for k in 0..4 {
                normals[4 * splat as usize + k] += grads.normals[pair][k].abs();
            }
        }
    }
    (rows, normals)
}

/// The sums that `check` compares.
struct Compared<'a> {
    /// Bound of an element's error relative to the size of its contributions: 1e-4, and two roundings per layer of the
    /// transmittance and the colour behind the splat, which the backward pass recovers.
    bound: f64,
    width: usize,
    got: &'a [f64],
    want: &'a [f64],
    sizes: &'a [f64],
}

fn check(what: &str, columns: std::ops::Range<usize>, compared: &Compared<'_>) {
    let family = |values: &[f64]| -> Vec<f64> {
        values.chunks_exact(compared.width).flat_map(|row| row[columns.clone()].to_vec()).collect()
    };
    let (got, want, sizes) = (family(compared.got), family(compared.want), family(compared.sizes));
    let what = format!("{what}, columns {columns:?}");
    for (k, ((g, w), size)) in got.iter().zip(&want).zip(&sizes).enumerate() {
        let off = (g - w).abs();
        assert!(
            off <= compared.bound * size + 1e-30,
            "{what}: element {k} is {g:e} instead of {w:e}, of contributions of {size:e}"
        );
    }
    let got: Vec<f32> = got.into_iter().map(|v| v as f32).collect();
    // The other guards are also relative to the contributions, not to a sum that may cancel.
    let norm = |values: &[f64]| values.iter().map(|v| v * v).sum::<f64>().sqrt();
    let sum = |values: &[f64]| values.iter().map(|v| v.abs()).sum::<f64>();
    let of_norm = compared.bound / 4.0 * norm(&sizes) / norm(&want).max(1e-300);
    let of_sum = compared.bound / 8.0 * sum(&sizes) / sum(&want).max(1e-300);
    let cosine = of_norm * of_norm / 2.0 + 1e-14;
    Guards { element: f64::INFINITY, floor: 1.0, norm: of_norm, cosine, bias: of_sum }.check(
        &what,
        columns.len(),
        &got,
        &want,
    );
}

/// A scene with random upstream gradients, and the twin's results.
struct Case {
    name: String,
    blend: Blend<f32>,
    up: Upstream<f64>,
    constants: Vec<(&'static str, u32)>,
    want: (Vec<f64>, Vec<f64>),
    sizes: (Vec<f64>, Vec<f64>),
    longest: u32,
}

fn cases(side: usize) -> Vec<Case> {
    let mut cases = Vec::new();
    for (number, scene) in hard_scenes().into_iter().enumerate() {
        for (aux, alpha_min) in [(false, ALPHA_MIN), (true, ALPHA_MIN), (false, EARLY_ALPHA_MIN)] {
            // Every set of constants needs a pipeline.
            if alpha_min != ALPHA_MIN && number % 4 != 0 {
                continue;
            }
            let (sum_abs, passes) = (aux == (number % 2 == 0), aux != (number % 3 == 0));
            let blend = Blend { alpha_min, ..scene.blend(side, aux) };
            let wide = widen::<f64>(&blend);
            let up = upstream(&wide, 31 + number as u64, passes);
            let mut grads = backward(&wide, &up);
            if !sum_abs {
                grads.rows.iter_mut().for_each(|row| row[10..].fill(0.0));
            }
            let mut constants = vec![
                ("AUX", u32::from(aux)),
                ("COUNT", 1),
                ("ABS", u32::from(sum_abs)),
                ("CLAMP_GRADIENT_PASSES", u32::from(passes)),
            ];
            if alpha_min != ALPHA_MIN {
                constants.push(("ALPHA_MIN", alpha_min.to_bits()));
            }
            cases.push(Case {
                name: format!(
                    "{}, aux {aux}, abs {sum_abs}, clamped gradient {passes}, skipped below {alpha_min}",
                    scene.name
                ),
                want: exact(&wide, &grads),
                sizes: sizes(&wide, &up),
                longest: blend.ranges.iter().map(|r| r[1] - r[0]).max().unwrap_or(0),
                blend,
                up,
                constants,
            });
        }
    }
    cases
}

fn against_twin(gpu: &Gpu, pass: &Pass, case: &Case, rows: Rows, width: Option<u32>) {
    // lavapipe ends an invocation's loops after 65,535 iterations in all: too few for 15 emulated sums of 64 lanes.
    if width == Some(64) && case.longest > 65 && pass.kernel.name == passes::PIXEL_EMULATED_CAS.kernel.name {
        return;
    }
    let blend = &case.blend;
    let mut given = case.constants.clone();
    given.extend(width.map(|w| ("EMULATED_WIDTH", w)));
    let buffers = buffers_with(pass, blend, &case.up, rows, [garbage(4), garbage(4)]);
    let run = || harness::run(gpu, pass, &given, &buffers, &push(blend), blend.ranges.len() as u32);
    let outcome = run();
    let at = outputs(rows);
    let bound = 1e-4 + f64::from(case.longest) * 2.0f64.powi(-23);
    let by_address = outcome.by_address.iter().map(|got| ("device by address", got));
    for (who, got) in [("device", &outcome.device), ("twin", &outcome.twin)].into_iter().chain(by_address) {
        let what = format!("{who}: {} {width:?} of {}", pass.kernel.name, case.name);
        let sums = per_splat(blend, rows, 12, &got[at]);
        for columns in [0..2, 2..5, 5..6, 6..9, 9..10, 10..12] {
            let (want, sizes) = (&case.want.0, &case.sizes.0);
            check(&what, columns, &Compared { bound, width: 12, got: &sums, want, sizes });
        }
        if blend.normals.is_some() {
            let normals = per_splat(blend, rows, 4, &got[at + 1]);
            let (want, sizes) = (&case.want.1, &case.sizes.1);
            check(&what, 0..3, &Compared { bound, width: 4, got: &normals, want, sizes });
        } else {
            assert!(got[at + 1] == buffers[at + 1], "{what}: normals were touched");
        }
    }
    if rows == Rows::Slots {
        assert!(outcome.device == run().device, "{} of {}: two runs differ", pass.kernel.name, case.name);
    }
}

/// The backward pass blends the pairs that the forward pass of the same shape blended, also in undecided pixels.
fn contributors(gpu: &Gpu) {
    for (forward_pass, side) in shapes(gpu) {
        for scene in hard_scenes() {
            let blend = scene.blend(side, false);
            let out = run_shape(gpu, forward_pass, &blend);
            let counts: Vec<u32> = out.device(7);
            for (pass, tile, rows, width) in variants(gpu) {
                if tile != side || width == Some(64) {
                    continue;
                }
                let pixels = blend.width * blend.height;
                let up = Upstream {
                    image: Vec::new(),
                    last: Vec::new(),
                    grad_image: vec![[1.0; 4]; pixels],
                    grad_aux: vec![[1.0; 4]; pixels],
                    clamp_gradient_passes: false,
                };
                let mut buffers = buffers_with(pass, &blend, &up, rows, [garbage(4), garbage(4)]);
                buffers[4] = out.device[4].clone();
                buffers[5] = out.device[6].clone();
                let back = harness::run(gpu, pass, &[("COUNT", 1)], &buffers, &push(&blend), blend.ranges.len() as u32);
                let back: Vec<u32> = back.device(outputs(rows) + 2);
                assert_eq!(back[3], counts[1], "{} of {}: contributors", pass.kernel.name, scene.name);
            }
        }
    }
}

/// Chunks of a list, walked in parallel from the states of the forward pass, give the gradients of the whole list.
fn chunks(gpu: &Gpu, cases: &[Case]) {
    let mut split = 0;
    for case in cases {
        let blend = &case.blend;
        if blend.side != 16 || case.longest <= 128 {
            continue;
        }
        for (pass, side, rows, width) in variants(gpu) {
            // As in `against_twin`.
            if side != 16 || width == Some(64) && case.longest > 65 {
                continue;
            }
            let (block, count) = (32, 1 + split % 4);
            let forward = run_for_training(gpu, blend, block, count);
            let kept = [forward.device[9].clone(), forward.device[10].clone()];
            let mut buffers = buffers_with(pass, blend, &case.up, rows, kept);
            let at = outputs(rows);
            (buffers[4], buffers[5]) = (forward.device[4].clone(), forward.device[6].clone());
            let mut given = case.constants.clone();
            given.push(("CHUNKS", count));
            given.push(width.map_or(("BLOCK", block), |width| ("EMULATED_WIDTH", width)));
            let groups = blend.ranges.len() as u32 * count;
            let got = harness::run(gpu, pass, &given, &buffers, &push(blend), groups);
            let what = format!("{} of {}, {count} chunks", pass.kernel.name, case.name);
            // The transmittance from the device's forward pass has two roundings per layer too. What lies behind a chunk is
            // a sum, while the walk through a whole list damps errors: they count against the column's largest
            // contributions, too.
            let bound = 1e-4 + 2.0 * f64::from(case.longest) * 2.0f64.powi(-23);
            let sums = per_splat(blend, rows, 12, &got.device[at]);
            let most =
                |column: usize| case.sizes.0.iter().skip(column).step_by(12).fold(0.0f64, |most, s| most.max(*s));
            let largest: [f64; 12] = std::array::from_fn(most);
            let sizes: Vec<f64> =
                case.sizes.0.iter().enumerate().map(|(k, size)| size + largest[k % 12] / 100.0).collect();
            for columns in [0..2, 2..5, 5..6, 6..9, 9..10, 10..12] {
                let (want, sizes) = (&case.want.0, &sizes);
                check(&what, columns, &Compared { bound, width: 12, got: &sums, want, sizes });
            }
            split += 1;
        }
    }
    assert!(split > 12, "{split} lists were split");
}

/// Culling does not change the bits of a pair's gradients. Nor does it change sums per splat where pairs are added in a
/// fixed order: in a single tile, on a CPU, which runs the subgroups of a workgroup in turn. Subgroups of a GPU add in
/// the order of arrival, with and without culling. Contributors are equal everywhere. Tested with one set of constants,
/// because each set needs a pipeline.
fn culling(gpu: &Gpu, cases: &[Case]) {
    let (mut tiles, mut evaluated) = ([0, 0], [0, 0]);
    for case in cases.iter().filter(|case| case.blend.normals.is_some() && !case.up.clamp_gradient_passes) {
        for (pass, side, rows, _) in variants(gpu) {
            if side != 16 || !pass.kernel.constants.iter().any(|c| c.name == "BLOCK") {
                continue;
            }
            let at = outputs(rows);
            let run = |block: u32, masks: &[u32]| {
                let kept = [some(masks), garbage(4)];
                let buffers = buffers_with(pass, &case.blend, &case.up, rows, kept);
                let given = [("AUX", 1), ("COUNT", 1), ("BLOCK", block)];
                let groups = case.blend.ranges.len() as u32;
                harness::run(gpu, pass, &given, &buffers, &push(&case.blend), groups)
            };
            for block in [8, 32] {
                let masks = masks(&case.blend, block);
                let want = run(block, &vec![!0; masks.len()]);
                let all: Vec<u32> = want.device(at + 2);
                let got = run(block, &masks);
                let what = format!("{}, blocks of {block}, {}", pass.kernel.name, case.name);
                let single = case.blend.ranges.len() == 1;
                tiles[usize::from(single)] += 1;
                if single && harness::rounds_alike(gpu) {
                    assert!(got.device[..at + 2] == want.device[..at + 2], "{what}: other gradients");
                }
                let (bound, sizes) = (1e-4, &case.sizes.0);
                let [got_sums, want_sums] =
                    [&got.device, &want.device].map(|all| per_splat(&case.blend, rows, 12, &all[at]));
                check(&what, 0..12, &Compared { bound, width: 12, got: &got_sums, want: &want_sums, sizes });
                let (device, twin): (Vec<u32>, Vec<u32>) = (got.device(at + 2), got.twin(at + 2));
                assert_eq!(device[3], all[3], "{what}: contributors");
                // A subgroup with several blocks evaluates splats that touch any of its blocks.
                if gpu.caps().subgroup.width() <= block {
                    let off = device[2].abs_diff(twin[2]);
                    assert!(200 * off <= all[2], "{what}: {off} of {} evaluated", all[2]);
                }
                evaluated = [evaluated[0] + device[2], evaluated[1] + all[2]];
            }
        }
    }
    println!("evaluated with blocks and without: {evaluated:?}; several tiles and one: {tiles:?}");
    assert!(tiles.iter().all(|n| *n > 0), "{tiles:?}");
    assert!(evaluated[0] < evaluated[1] / 10 * 8, "{evaluated:?}");
}

pub fn run(gpu: &Gpu) {
    for side in [8, 16] {
        let cases = cases(side);
        for case in &cases {
            for (pass, tile, rows, width) in variants(gpu) {
                if tile == side {
                    against_twin(gpu, pass, case, rows, width);
                }
            }
        }
        if side == 16 {
            chunks(gpu, &cases);
            culling(gpu, &cases);
        }
    }
    contributors(gpu);
}
