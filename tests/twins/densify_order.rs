//! The passes that sort the rows of a density change into Morton order: on random words, around workgroup edges, and in
//! a whole change, which must give equal splats along the curve.

use psrgs_vk::pass::counters::{self, NEXT_ID, SCAN_TOTAL, SPLATS};
use psrgs_vk::pass::densify_order::{BIRTHS, CODES, CodesPush, FLAGS, ORDER, Push};
use psrgs_vk::raster::sort::SortShape;
use psrgs_vk::scene::random::Random;
use psrgs_vk::train::density::DensityRules;
use psrgs_vk::twin::densify_order::{cell, code};
use psrgs_vk::vk::Gpu;

use super::common::{assert_no_messages, gpu};
use super::density::{random_rows, rules};
use super::density_device::{OnDevice, assert_same};
use super::density_model::{MEANS, Model, Row, below};
use super::density_twin;
use super::harness::{self, Words, bytes, garbage};

fn counts(set: &[(usize, u32)]) -> Vec<u8> {
    let mut counts = [7; counters::COUNT];
    set.iter().for_each(|&(counter, value)| counts[counter] = value);
    bytes(&counts)
}

fn groups(items: usize) -> u32 {
    items.div_ceil(64).max(1) as u32
}

fn shuffled(random: &mut Random, n: usize) -> Vec<u32> {
    let mut order: Vec<u32> = (0..n as u32).collect();
    (1..n).for_each(|i| order.swap(i, random.word() as usize % (i + 1)));
    order
}

pub fn run(gpu: &Gpu) {
    for n in [0, 1, 2, 63, 64, 65, 127, 300] {
        let random = &mut Random::new(70 + n as u64);
        let room = n + 3;
        let push = Push { stride: room as u32 };
        let ids = bytes(&random.words(room));
        let buffers = [counts(&[(SPLATS, n as u32)]), ids, garbage(room + 2), garbage(room + 2)];
        let outcome = harness::run(gpu, &BIRTHS, &[], &buffers, &push, groups(room));
        outcome.assert_same_bits(&format!("densify_births of {n}"));
        assert_eq!(outcome.device::<u32>(2)[n..room], [u32::MAX; 3]);

        let buffers = [bytes(&shuffled(random, room)), bytes(&random.words(4 * room)), garbage(4 * room + 2)];
        let outcome = harness::run(gpu, &FLAGS, &[], &buffers, &push, groups(room));
        outcome.assert_same_bits(&format!("densify_flags of {n}"));

        let rows = n + n / 2;
        // Coordinates at every scale, among them zeros of both signs and the largest numbers.
        let mut means: Vec<f32> =
            (0..3 * room).map(|_| random.between(-1.0, 1.0) * random.between(-20.0, 8.0).exp2()).collect();
        for (at, odd) in [0.0, -0.0, f32::MAX, f32::MIN, 2.0, -2.0, 30.0, -30.0].into_iter().enumerate() {
            if let Some(x) = means.get_mut(7 * at) {
                *x = odd;
            }
        }
        let map: Vec<u32> = (0..rows + 4).map(|_| (random.word() % n.max(1) as u32) | (random.word() << 30)).collect();
        let buffers = [
            counts(&[(SCAN_TOTAL, rows as u32)]),
            bytes(&shuffled(random, room)),
            bytes(&means),
            bytes(&map),
            garbage(rows + 4),
            garbage(rows + 4),
        ];
        let outcome = harness::run(gpu, &CODES, &[], &buffers, &CodesPush { scale: 0.5 }, groups(rows));
        outcome.assert_same_bits(&format!("densify_codes of {rows}"));

        let buffers = [
            counts(&[(SCAN_TOTAL, rows as u32)]),
            bytes(&shuffled(random, rows)),
            bytes(&map),
            bytes(&random.words(rows + 4)),
            garbage(rows + 4),
            garbage(rows + 4),
        ];
        let outcome = harness::run(gpu, &ORDER, &[], &buffers, &(), groups(rows));
        outcome.assert_same_bits(&format!("densify_order of {rows}"));
    }
}

/// Cells against their documented bounds in f64.
#[test]
fn cells_double_in_size_away_from_the_origin() {
    let scale = 0.5;
    let begin = |q: u32| {
        let (octave, within) = (q / 128, f64::from(q % 128) / 128.0);
        (f64::from(1 << octave) * (1.0 + within) - 1.0) / f64::from(scale)
    };
    for q in 0..512 {
        let (low, high) = (begin(q) as f32, begin(q + 1) as f32);
        for x in [low, 0.5 * (low + high)] {
            assert_eq!(cell(x, scale), 512 + q, "{x}");
            assert!(x == 0.0 || cell(-x, scale) == 511 - q, "{x}");
        }
    }
    assert_eq!([cell(30.0, scale), cell(1e30, scale), cell(-f32::MAX, scale)], [1023, 1023, 0]);
    assert_eq!(code([30.0, -40.0, -40.0], scale), 0o1111111111);
    assert_eq!(code([-40.0, 30.0, -40.0], scale), 0o2222222222);
}

#[test]
fn a_change_in_morton_order_keeps_splats_along_the_curve() {
    let Some(gpu) = gpu() else { return };
    for n in [0, 1, 2, 64, 65, 500, 1025] {
        for (max_splats, shape) in [(None, SortShape::Runs), (Some(n as u32 + 3), SortShape::Groups)] {
            let random = &mut Random::new(n as u64);
            let (rows, born) = random_rows(random, n);
            let mut mixed: Vec<Row> = rows.clone();
            (1..n).for_each(|i| mixed.swap(i, below(random, i + 1)));
            let rules = DensityRules { max_splats, clone_threshold: 0.25, ..rules() };
            let (mut want, start) =
                (Model::new(&rows, 3 * n + 1, born, random), Model::new(&mixed, 3 * n + 1, born, random));
            let device = OnDevice::in_scene(&gpu, &start, 0.625, shape);
            device.change(&rules, &[9]);
            density_twin::change(&mut want, &rules, 9);
            let got = device.read();
            assert_same(&gpu, &device.read_by_birth(), &want, born);
            // Rows that were not born in this change keep their order.
            let along: Vec<(u32, u32)> = (got.rows().iter().filter(|row| row.id < born))
                .map(|row| (code(std::array::from_fn(|k| row.planes[MEANS][k]), 4.0), row.id))
                .collect();
            assert!(along.is_sorted(), "{along:?}");
            assert!(n < 500 || along.len() > 100 && got.counters[NEXT_ID] > born + 50, "{} of {n}", along.len());
            // Further changes until no room is left: then nothing is written.
            let zero = DensityRules { clone_threshold: 0.0, max_splats: None, ..rules };
            for event in [12, 15, 18] {
                device.change(&zero, &[event]);
                density_twin::change(&mut want, &zero, event);
            }
            let got = device.read();
            assert_eq!(got.counters[counters::STATUS], want.counters[counters::STATUS]);
            if n > 60 {
                assert_eq!(want.counters[counters::STATUS], counters::SPLATS_BIT);
                assert_eq!(device.read_by_birth().ids[..got.len()], want.ids[..want.len()]);
            }
        }
    }
    assert_no_messages(&gpu);
}
