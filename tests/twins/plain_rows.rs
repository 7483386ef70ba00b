//! Rows whose harmonics end at degree 1 (plain rows): equal bits as with degree 1 in use, and upper planes that end
//! before the plain rows.

use psrgs_vk::pass::camera::Projection;
use psrgs_vk::pass::project_backward::Penalties;
use psrgs_vk::pass::project_backward_adam::StepCounts;
use psrgs_vk::pass::{Pass, counters, project, project_backward_adam, project_backward_adam_packed};
use psrgs_vk::vk::Gpu;

use super::common;
use super::harness::{self, bytes, garbage};
use super::project_backward_adam::{Case, Form, ROWS, case, plain};
use super::project_backward_adam_packed::packed;
use super::projection_scene as scene;

const N: usize = 300;
/// Number of rows with all harmonics: a workgroup and a part of one.
const FULL: usize = 101;
/// Planes of harmonics above degree 1 among a model's planes.
const SH_HIGHER: std::ops::Range<usize> = 5..8;

fn counts(plain: u32) -> Vec<u8> {
    let mut words: Vec<u32> = scene::counts(N).chunks_exact(4).map(bytemuck::pod_read_unaligned).collect();
    words[counters::PLAIN] = plain;
    bytes(&words)
}

/// The buffers with counters of `plain` plain rows, and the upper planes of the models at `models` cut before these
/// rows.
fn cut(buffers: &[Vec<u8>], models: &[usize], plain: u32) -> Vec<Vec<u8>> {
    let mut out = buffers.to_vec();
    out[0] = counts(plain);
    let full = N.saturating_sub(plain as usize);
    for plane in models.iter().flat_map(|first| SH_HIGHER.map(move |k| first + k)) {
        out[plane].truncate(48 * full);
        out[plane].extend(garbage(8));
    }
    out
}

/// The bytes of `rows` in a buffer with `width` floats per row.
fn rows(buffer: &[u8], width: usize, rows: std::ops::Range<usize>) -> &[u8] {
    &buffer[4 * width * rows.start..4 * width * rows.end]
}

#[test]
fn plain_rows_are_drawn_with_degree_1() {
    let Some(gpu) = common::gpu() else { return };
    for degree in 0..4 {
        let at = |degree, plain: u32| {
            let projection = Projection { sh_degree: degree, ..Projection::default() };
            let buffers = cut(&scene::project_buffers(&scene::ordinary(N, 90)), &[1], plain);
            let constants = [("TILE_W", 16), ("TILE_H", 16), ("AUX", 1)];
            let outcome = harness::run(&gpu, &project::PASS, &constants, &buffers, &scene::push(&projection), 5);
            assert_eq!(outcome.device[0], buffers[0], "degree {degree}: bad splats");
            outcome.device
        };
        let some = at(degree, (N - FULL) as u32);
        let (all, low, none) = (at(degree, 0), at(degree.min(1), 0), at(degree, u32::MAX));
        for (k, width) in [(9, 12), (10, 1), (11, 4)] {
            let of = |from: &[Vec<u8>], range| rows(&from[k], width, range).to_vec();
            assert_eq!(of(&some, 0..FULL), of(&all, 0..FULL), "degree {degree}, buffer {k}");
            assert_eq!(of(&some, FULL..N), of(&low, FULL..N), "degree {degree}, buffer {k}");
            assert_eq!(of(&none, 0..N), of(&low, 0..N), "degree {degree}, buffer {k}: all are plain");
        }
        assert_eq!(all[9] == low[9], degree < 2, "degree {degree}: colours do not tell the cases apart");
    }
    common::assert_no_messages(&gpu);
}

/// The buffers after a step of the pass.
fn stepped(gpu: &Gpu, pass: &Pass, case: &Case, buffers: &[Vec<u8>]) -> Vec<Vec<u8>> {
    harness::run(gpu, pass, &case.given(), buffers, &case.push, N.div_ceil(64) as u32).device
}

fn steps_of(gpu: &Gpu, pass: &Pass, packs: bool) {
    let steps = StepCounts { most: 9, opacities: Some(4) };
    for (degree, most) in [(3, 3), (2, 2), (2, 3), (1, 3), (1, 1)] {
        // The splats with gradients do not depend on the degree in use.
        let of = |degree: u32, most: u32| {
            let form =
                Form { aux: false, penalties: Penalties { shrink: 0.6, ..Penalties::default() }, ..plain(steps) };
            let projection = Projection { sh_degree: degree, ..Projection::default() };
            case(&scene::ordinary(N, 91), &projection, most, form, |first, second| (first, second))
        };
        let (all, low) = (of(degree, most), of(degree.min(1), most.min(1)));
        let models: &[usize] = if packs { &[5, 13] } else { &[5, 13, 21] };
        let inputs = |from: &Case| {
            let mut buffers = from.buffers.clone();
            if packs {
                let words: Vec<Vec<u8>> = (13..21).map(|k| packed(&buffers[k], &buffers[k + 8])).collect();
                let stats = buffers.split_off(13).pop().expect("statistics come last");
                buffers.extend(words);
                buffers.push(stats);
            }
            buffers
        };
        let begin = inputs(&all);
        let some = stepped(gpu, pass, &all, &cut(&begin, models, (N - FULL) as u32));
        let whole = stepped(gpu, pass, &all, &begin);
        // Equal numbers, without reads and writes of harmonics above degree 1.
        let plain = stepped(gpu, pass, &low, &begin);
        for (&first, (k, width)) in
            models.iter().flat_map(|first| ROWS.into_iter().enumerate().map(move |r| (first, r)))
        {
            let (plane, what) =
                (first + k, format!("{}: degree {degree} of {most}, plane {}", pass.kernel.name, first + k));
            assert_eq!(rows(&some[plane], width, 0..FULL), rows(&whole[plane], width, 0..FULL), "{what}");
            if SH_HIGHER.contains(&k) {
                assert_eq!(some[plane].len(), 48 * FULL + garbage(8).len(), "{what}");
                assert_eq!(some[plane][48 * FULL..], garbage(8)[..], "{what}: beyond its rows");
            } else {
                assert_eq!(rows(&some[plane], width, FULL..N), rows(&plain[plane], width, FULL..N), "{what}");
                assert_ne!(rows(&some[plane], width, FULL..N), rows(&begin[plane], width, FULL..N), "{what}: stepped");
            }
        }
    }
}

#[test]
fn plain_rows_are_stepped_up_to_degree_1() {
    let Some(gpu) = common::gpu() else { return };
    steps_of(&gpu, &project_backward_adam::PASS, false);
    steps_of(&gpu, &project_backward_adam_packed::PASS, true);
    common::assert_no_messages(&gpu);
}
