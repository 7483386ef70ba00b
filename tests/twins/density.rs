//! Density changes of the twins against a plain reference: sets, moments, identities, draws, limits and overflow.

use super::density_model::{MEANS, Model, QUATS, Row, SCALES, below, uniform};
use super::{density_reference, density_twin};
use psrgs_vk::pass::counters::{self, BAD_SPLATS, CLONED, NEXT_ID, PRUNED, SPLIT, STATUS, WANT_SPLATS};
use psrgs_vk::scene::random::Random;
use psrgs_vk::train::density::{DensityRules, logit};
use psrgs_vk::twin::random::{bits, normals};

/// Rules with thresholds among the values of random rows.
pub(crate) fn rules() -> DensityRules {
    DensityRules {
        clone_threshold: 0.5,
        split_threshold: 0.625,
        split_absolute: false,
        split_scale: 1.5,
        prune_opacity: 0.4,
        prune_scale: Some(2.2),
        max_splats: None,
        sampled: None,
        keep_opacity: 1.0,
        seed: 7,
    }
}

pub(crate) fn random_rows(random: &mut Random, n: usize) -> (Vec<Row>, u32) {
    let mut id = 0;
    let rows = (0..n)
        .map(|_| {
            id += 1 + below(random, 3) as u32;
            let mut row = Row::random(random, id);
            if below(random, 20) == 0 {
                let p = below(random, 8);
                let k = below(random, row.planes[p].len());
                row.planes[p][k] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][below(random, 3)];
            }
            row
        })
        .collect();
    (rows, id + 1)
}

/// Equal up to the last bits of computed values: means and scales of children.
fn assert_same(got: &[Row], want: &[Row], born: u32) {
    assert_eq!(got.len(), want.len());
    for (g, w) in got.iter().zip(want) {
        let mut w = w.clone();
        if w.id >= born {
            for k in 0..3 {
                let sigma = w.planes[SCALES].iter().copied().fold(f32::MIN, f32::max).exp() * 1.6;
                let tolerance = 4e-6 * sigma + 1e-6 * w.planes[MEANS][k].abs();
                assert!((g.planes[MEANS][k] - w.planes[MEANS][k]).abs() <= tolerance, "{g:?} {w:?}");
                assert!((g.planes[SCALES][k] - w.planes[SCALES][k]).abs() <= 3e-7, "{g:?} {w:?}");
            }
            w.planes[MEANS].clone_from(&g.planes[MEANS]);
            w.planes[SCALES].clone_from(&g.planes[SCALES]);
        }
        assert_eq!(*g, w);
    }
}

/// Splats that just reach or just miss a threshold of [`rules`], each with the wanted numbers of kept rows, clones and
/// children.
pub(crate) fn borderline() -> Vec<(&'static str, Row, [usize; 3])> {
    // (score, views, log scale, logit) -> kept, clones, children; border ln 1.5, prune ln 2.2, logit of 0.4.
    let (border, giant, faint) = (1.5_f64.ln() as f32, 2.2_f64.ln() as f32, logit(0.4));
    let up = |x: f32| f32::from_bits(x.to_bits() + 1);
    let down = |x: f32| f32::from_bits(x.to_bits() - 1);
    [
        ("idle", 0.0, 3.0, 0.0, 0.0, [1, 0, 0]),
        ("never seen", 9.0, 0.0, 0.0, 0.0, [1, 0, 0]),
        ("clone threshold hit", 0.5, 3.0, 0.0, 0.0, [1, 1, 0]),
        ("clone threshold missed", down(0.5), 1.0, 0.0, 0.0, [1, 0, 0]),
        ("border scale counts as small", 0.5, 2.0, border, 0.0, [1, 1, 0]),
        ("just past the border, below the split threshold", 0.5, 2.0, up(border), 0.0, [1, 0, 0]),
        ("split threshold hit", 0.625, 1.0, up(border), 0.0, [0, 0, 2]),
        ("split threshold missed", down(0.625), 1.0, up(border), 0.0, [1, 0, 0]),
        ("opacity at its limit stays", 0.0, 1.0, 0.0, faint, [1, 0, 0]),
        // The logit is negative, so the next bit pattern is smaller.
        ("opacity below its limit goes", 0.0, 1.0, 0.0, up(faint), [0, 0, 0]),
        ("a faint clone goes with its source", 1.0, 1.0, 0.0, up(faint), [0, 0, 0]),
        ("children of a faint splat go", 1.0, 1.0, up(border), up(faint), [0, 0, 0]),
        ("size at its limit stays", 0.0, 1.0, giant, 0.0, [1, 0, 0]),
        ("size past its limit goes", 0.0, 1.0, up(giant), 0.0, [0, 0, 0]),
        ("a giant that is split lives on in its children", 1.0, 1.0, giant + 0.46, 0.0, [0, 0, 2]),
        ("unless they are giants too", 1.0, 1.0, giant + 0.48, 0.0, [0, 0, 0]),
        ("an infinite score is none", f32::INFINITY, 1.0, 0.0, 0.0, [1, 0, 0]),
        ("a NaN score is none", f32::NAN, 1.0, up(border), 0.0, [1, 0, 0]),
    ]
    .into_iter()
    .enumerate()
    .map(|(i, (what, score, views, scale, logit, expected))| {
        (what, Row::random(&mut Random::new(3), i as u32).with(score, views, scale, logit), expected)
    })
    .collect()
}

#[test]
fn thresholds_exactly_hit_and_children_pruned() {
    for (what, row, expected) in borderline() {
        let (random, id) = (&mut Random::new(3), row.id);
        let mut model = Model::new(&[row], 4, 100, random);
        density_twin::change(&mut model, &rules(), 1);
        let rows = model.rows();
        let kept = rows.iter().filter(|r| r.id == id).count();
        let counts = [kept, model.counters[CLONED] as usize, 2 * model.counters[SPLIT] as usize];
        assert_eq!(counts, expected, "{what}");
        assert_eq!(rows.len(), expected.iter().sum::<usize>(), "{what}");
    }
}

#[test]
fn absolute_gradients_split_but_do_not_clone() {
    let random = &mut Random::new(1);
    let s = DensityRules { split_absolute: true, split_threshold: 1.0, clone_threshold: 0.75, ..rules() };
    let small = Row::random(random, 1).with(0.5, 2.0, 0.0, 0.0);
    let large = Row::random(random, 2).with(0.5, 2.0, 0.5, 0.0);
    let mut model = Model::new(&[small, large], 8, 3, random);
    density_twin::change(&mut model, &s, 1);
    assert_eq!([model.counters[CLONED], model.counters[SPLIT], model.counters[PRUNED]], [0, 1, 0]);
    assert_eq!(model.rows().iter().map(|r| r.id).collect::<Vec<_>>(), [1, 3, 4]);
}

#[test]
fn random_models_follow_the_reference() {
    for n in [0, 1, 2, 63, 64, 65, 127, 128, 129, 300] {
        for (round, absolute) in [false, true].into_iter().enumerate() {
            let random = &mut Random::new(n as u64 + 1000 * round as u64);
            let (rows, born) = random_rows(random, n);
            let s = DensityRules { split_absolute: absolute, ..rules() };
            let (want, counts) = density_reference::change(&rows, &s, 9, born);
            let mut model = Model::new(&rows, 2 * n.max(1), born, random);
            density_twin::change(&mut model, &s, 9);
            assert_same(&model.rows(), &want, born);
            let c = model.counters;
            assert_eq!([c[CLONED], c[SPLIT], c[PRUNED]], [counts.cloned, counts.split, counts.pruned]);
            assert_eq!(c[BAD_SPLATS], counts.bad);
            assert_eq!(c[STATUS], 0);
            if n == 300 {
                let each = [counts.cloned, counts.split, counts.pruned, counts.bad];
                assert!(each.iter().all(|&c| c > 5), "the test data exercises every case: {each:?}");
            }
        }
    }
}

#[test]
fn everything_cloned_split_or_pruned() {
    let random = &mut Random::new(5);
    for n in [1, 64, 65] {
        let all = |score: f32, scale: f32, logit: f32, random: &mut Random| -> Vec<Row> {
            (0..n).map(|i| Row::random(random, i as u32).with(score, 1.0, scale, logit)).collect()
        };
        for (rows, expected) in [
            (all(1.0, 0.0, 0.0, random), [2 * n, n, 0, 0]),
            (all(1.0, 0.6, 0.0, random), [2 * n, 0, n, 0]),
            (all(1.0, 0.6, -9.0, random), [0, 0, 0, n]),
        ] {
            let mut model = Model::new(&rows, 2 * n, n as u32, random);
            density_twin::change(&mut model, &rules(), 1);
            let c = model.counters;
            let got = [model.len(), c[CLONED] as usize, c[SPLIT] as usize, c[PRUNED] as usize];
            assert_eq!(got, expected);
        }
    }
}

#[test]
fn identities_ascend_and_are_never_used_again() {
    let random = &mut Random::new(8);
    let (rows, born) = random_rows(random, 200);
    let mut seen: std::collections::HashMap<u32, ()> = rows.iter().map(|r| (r.id, ())).collect();
    let mut model = Model::new(&rows, 4000, born, random);
    for event in 0..50 {
        let before: std::collections::HashSet<u32> = model.rows().iter().map(|r| r.id).collect();
        let next = model.counters[NEXT_ID];
        density_twin::change(&mut model, &DensityRules { max_splats: Some(400), ..rules() }, event);
        let rows = model.rows();
        assert!(rows.windows(2).all(|w| w[0].id < w[1].id));
        for id in rows.iter().map(|r| r.id).filter(|id| !before.contains(id)) {
            assert!(id >= next && seen.insert(id, ()).is_none(), "{id} was used before");
        }
        assert!(rows.iter().all(|r| r.id < model.counters[NEXT_ID]));
        assert!(rows.len() <= 400 && !rows.is_empty());
        // New scores and sizes, so that every round changes splats.
        let rows: Vec<Row> = rows
            .into_iter()
            .map(|r| {
                let (score, scale) = (uniform(random, 0.0, 1.0), uniform(random, -1.0, 0.7));
                let logit = uniform(random, -0.6, 1.0);
                r.with(score, 2.0, scale, logit)
            })
            .collect();
        let counters = model.counters;
        model = Model::new(&rows, 4000, 0, random);
        model.counters = counters;
    }
    assert!(seen.len() > 1000, "50 rounds bore only {} splats", seen.len());
}

#[test]
fn a_limit_spreads_growth_evenly_and_removes_nothing() {
    let random = &mut Random::new(4);
    let (rows, born) = random_rows(random, 150);
    let free = density_reference::change(&rows, &rules(), 2, born);
    let growth = free.1.cloned + free.1.split;
    for max_splats in [0, free.0.len() as u32 - growth, free.0.len() as u32 - 3, free.0.len() as u32, u32::MAX] {
        let s = DensityRules { max_splats: Some(max_splats), ..rules() };
        let mut model = Model::new(&rows, 300, born, random);
        density_twin::change(&mut model, &s, 2);
        let excess = (free.0.len() as u32).saturating_sub(max_splats).min(growth);
        assert_eq!(model.len() as u32, free.0.len() as u32 - excess);
        // As if sources, spread evenly in their order, had not reached a threshold. None of these sources is pruned.
        let mut calm = rows.clone();
        let grows = |r: &Row| {
            let (after, counts) = density_reference::change(std::slice::from_ref(r), &rules(), 2, born);
            counts.cloned + counts.split > 0 && !after.is_empty()
        };
        let sources: Vec<usize> = (0..rows.len()).filter(|&i| grows(&rows[i])).collect();
        assert_eq!(sources.len() as u32, growth);
        let place = bits([s.seed, 2, 0, 3])[0];
        let with_room = spread(growth, growth - excess, place);
        let withdrawn: Vec<usize> = sources.iter().zip(with_room).filter(|(_, room)| !room).map(|(&i, _)| i).collect();
        assert_eq!(withdrawn.len() as u32, excess);
        let ids: Vec<u32> = withdrawn.iter().map(|&i| rows[i].id).collect();
        withdrawn.iter().for_each(|&i| calm[i].stats = [0.0; 4]);
        let kept: Vec<u32> = model.rows().iter().map(|r| r.id).filter(|&id| id < born).collect();
        assert!(ids.iter().all(|id| kept.contains(id)), "a source without room stays as it is");
        // Giants without room stay, although a giant that does not split is pruned: compare all others.
        let (want, _) = density_reference::change(&calm, &DensityRules { prune_scale: None, ..rules() }, 2, born);
        let want: Vec<u32> = want.iter().map(|r| r.id).filter(|id| ids.contains(id)).collect();
        assert_eq!(want.len(), ids.len());
        // Sources with room are cloned or split: a clone keeps its source's row, a split removes it.
        let counted = model.counters[CLONED] + model.counters[SPLIT];
        assert_eq!(counted, growth - excess);
        for &i in sources.iter().filter(|i| !withdrawn.contains(i)) {
            let (after, alone) = density_reference::change(std::slice::from_ref(&rows[i]), &rules(), 2, born);
            assert_eq!(kept.contains(&rows[i].id), alone.split == 0, "of {} rows", after.len());
        }
    }
}

/// Which of `all` sources have room for `some`: an accumulator adds `some` per source, starting at `place`, and
/// a source has room where the accumulator passes `all`.
fn spread(all: u32, some: u32, place: u32) -> Vec<bool> {
    let mut sum = (place % all.max(1) + all - some) % all.max(1);
    let step = |_| {
        sum += some;
        let passes = sum >= all;
        sum -= if passes { all } else { 0 };
        passes
    };
    (0..all).map(step).collect()
}

#[test]
fn room_that_is_left_goes_to_sources_of_every_age() {
    let random = &mut Random::new(14);
    let rows: Vec<Row> = (0..1000).map(|i| Row::random(random, i).with(1.0, 1.0, 0.0, 0.0)).collect();
    let mut begins = std::collections::HashSet::new();
    for (event, room) in [(1, 100), (2, 250), (3, 333), (4, 999)] {
        let mut model = Model::new(&rows, 2000, 1000, random);
        density_twin::change(&mut model, &DensityRules { max_splats: Some(1000 + room), ..rules() }, event);
        // Clones have their sources' colours, and come in the order of their sources.
        let all = model.rows();
        let place = |row: &Row| rows.iter().position(|r| r.planes[MEANS] == row.planes[MEANS]).expect("a source");
        let cloned: Vec<usize> = all.iter().filter(|r| r.id >= 1000).map(place).collect();
        assert_eq!(cloned.len() as u32, room);
        let gaps: Vec<usize> = cloned.windows(2).map(|w| w[1] - w[0]).collect();
        let (least, most) = (1000 / room as usize, 1000_usize.div_ceil(room as usize));
        assert!(gaps.iter().all(|gap| (least..=most).contains(gap)), "{room}: {gaps:?}");
        begins.insert(cloned[0]);
    }
    assert!(begins.len() > 2, "every change begins elsewhere: {begins:?}");
}

#[test]
fn without_room_nothing_is_written() {
    let random = &mut Random::new(6);
    let rows: Vec<Row> = (0..70).map(|i| Row::random(random, i).with(1.0, 1.0, 0.6, 0.0)).collect();
    let before = Model::new(&rows, 139, 70, random);
    let mut after = before.clone();
    density_twin::change(&mut after, &rules(), 1);
    assert_eq!(after.counters[STATUS], counters::SPLATS_BIT);
    assert_eq!(after.counters[WANT_SPLATS], 140);
    let mut expected = before.counters;
    expected[STATUS] = counters::SPLATS_BIT;
    expected[WANT_SPLATS] = 140;
    expected[counters::SCAN_TOTAL] = 140;
    assert_eq!(after.counters, expected);
    assert_eq!((&after.planes, &after.moments), (&before.planes, &before.moments));
    assert_eq!((&after.stats, &after.ids), (&before.stats, &before.ids));
}

#[test]
fn children_have_the_parents_mean_and_covariance() {
    // 20,000 parents with one Gaussian and different identities: 40,000 draws.
    let n = 20_000;
    let parent = Row::random(&mut Random::new(2), 0).with(1.0, 1.0, 0.6, 0.0);
    let rows: Vec<Row> = (0..n).map(|i| Row { id: i, ..parent.clone() }).collect();
    let mut model = Model::new(&rows, 2 * n as usize, n, &mut Random::new(9));
    density_twin::change(&mut model, &rules(), 3);
    let draws: Vec<[f64; 3]> =
        model.rows().iter().map(|r| std::array::from_fn(|k| f64::from(r.planes[MEANS][k]))).collect();
    assert_eq!(draws.len(), 40_000);
    let m = draws.len() as f64;
    let q: [f64; 4] = std::array::from_fn(|k| f64::from(parent.planes[QUATS][k]));
    let norm = q.iter().map(|c| c * c).sum::<f64>().sqrt();
    let (w, u) = (q[0] / norm, [q[1] / norm, q[2] / norm, q[3] / norm]);
    // Columns of the rotation by v -> v + 2 w (u x v) + 2 u x (u x v), another formula than that of the passes.
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let axes: [[f64; 3]; 3] = std::array::from_fn(|j| {
        let e: [f64; 3] = std::array::from_fn(|k| f64::from(u8::from(k == j)));
        let c = cross(u, e);
        let cc = cross(u, c);
        std::array::from_fn(|k| e[k] + 2.0 * w * c[k] + 2.0 * cc[k])
    });
    let sigma: [f64; 3] = std::array::from_fn(|j| f64::from(parent.planes[SCALES][j]).exp());
    for i in 0..3 {
        let center = f64::from(parent.planes[MEANS][i]);
        let covariance = |j: usize| (0..3).map(|a| axes[a][i] * axes[a][j] * sigma[a] * sigma[a]).sum::<f64>();
        let mean = draws.iter().map(|d| d[i]).sum::<f64>() / m;
        // Five standard errors each: sqrt(S_ii / m), and sqrt((S_ii S_jj + S_ij^2) / m) for covariances.
        assert!((mean - center).abs() < 5.0 * (covariance(i) / m).sqrt(), "mean {i}");
        for j in 0..3 {
            let other = f64::from(parent.planes[MEANS][j]);
            let found = draws.iter().map(|d| (d[i] - center) * (d[j] - other)).sum::<f64>() / m;
            let jj = (0..3).map(|a| axes[a][j].powi(2) * sigma[a] * sigma[a]).sum::<f64>();
            let error = ((covariance(i) * jj + covariance(j).powi(2)) / m).sqrt();
            assert!((found - covariance(j)).abs() < 5.0 * error, "covariance {i} {j}");
        }
    }
    // The two children of one parent are independent of each other.
    let correlation: f64 = (0..n as usize)
        .map(|i| {
            (0..3)
                .map(|k| {
                    (draws[i][k] - f64::from(parent.planes[MEANS][k]))
                        * (draws[n as usize + i][k] - f64::from(parent.planes[MEANS][k]))
                })
                .sum::<f64>()
        })
        .sum::<f64>()
        / f64::from(n);
    let variance: f64 = sigma.iter().map(|s| s * s).sum();
    assert!(correlation.abs() < 5.0 * variance / f64::from(n).sqrt(), "siblings are correlated: {correlation}");
}

#[test]
fn draws_do_not_depend_on_the_place_in_the_buffers() {
    let random = &mut Random::new(12);
    let parents: Vec<Row> = (0..90).map(|i| Row::random(random, 3 * i).with(1.0, 1.0, 0.6, 0.0)).collect();
    let whole = {
        let mut model = Model::new(&parents, 200, 1000, random);
        density_twin::change(&mut model, &rules(), 4);
        model.rows()
    };
    // The parents among splats that stay: their children are equal, row by row.
    let mut mixed: Vec<Row> = parents.clone();
    mixed.extend((0..40).map(|i| Row::random(random, 3 * i + 1).with(0.0, 1.0, 0.0, 0.0)));
    mixed.sort_by_key(|r| r.id);
    let mut model = Model::new(&mixed, 333, 5000, random);
    density_twin::change(&mut model, &rules(), 4);
    let children: Vec<Row> = model.rows().into_iter().filter(|r| r.id >= 5000).collect();
    assert_eq!(children.len(), whole.len());
    for (a, b) in whole.iter().zip(&children) {
        assert_eq!(a.planes, b.planes);
    }
    // Another event and another seed draw other numbers.
    for (seed, event) in [(7, 5), (8, 4)] {
        let mut model = Model::new(&parents, 200, 1000, random);
        density_twin::change(&mut model, &DensityRules { seed, ..rules() }, event);
        assert!(model.rows().iter().zip(&whole).all(|(a, b)| a.planes[MEANS] != b.planes[MEANS]));
    }
}

#[test]
fn normals_in_f32_follow_f64() {
    let mut worst = 0.0_f64;
    let (mut sums, mut tails) = ([0.0_f64; 4], 0);
    let n = 200_000;
    for i in 0..n {
        let key = [17, 600, i, i & 1];
        let (single, double) = (normals::<f32>(key), normals::<f64>(key));
        for k in 0..3 {
            worst = worst.max((f64::from(single[k]) - double[k]).abs());
            (1..=4).for_each(|p| sums[p - 1] += double[k].powi(p as i32));
            tails += u32::from(double[k].abs() > 3.0);
        }
    }
    assert!(worst < 1.5e-6, "{worst}");
    // Moments 0, 1, 0, 3 with standard errors sqrt(1, 2, 15, 96) / sqrt(count); P(|x| > 3) = 0.0026998.
    let count = 3.0 * f64::from(n);
    for (p, (want, spread)) in [(0.0, 1.0), (1.0, 2.0), (0.0, 15.0), (3.0, 96.0_f64)].into_iter().enumerate() {
        let found = sums[p] / count;
        assert!((found - want).abs() < 5.0 * (spread / count).sqrt(), "moment {}: {found}", p + 1);
    }
    let expected = 0.002_699_8 * count;
    assert!((f64::from(tails) - expected).abs() < 5.0 * expected.sqrt(), "{tails} beyond 3 for {expected}");
}

#[test]
fn random_bits_are_those_of_the_paper() {
    // Computed from the definition with 64-bit integers and explicit remainders.
    let reference = |key: [u32; 4]| {
        let modulus = 1_u128 << 32;
        let mut v = key.map(|k| (u128::from(k) * 1_664_525 + 1_013_904_223) % modulus);
        for round in 0..2 {
            for (to, a, b) in [(0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2)] {
                v[to] = (v[to] + v[a] * v[b]) % modulus;
            }
            if round == 0 {
                v = v.map(|x| x ^ (x / 65_536));
            }
        }
        v.map(|x| x as u32)
    };
    for key in [[0; 4], [1, 2, 3, 4], [u32::MAX; 4], [7, 600, 123_456, 1]] {
        assert_eq!(bits(key), reference(key));
    }
    assert_ne!(bits([0, 0, 0, 0]), bits([0, 0, 0, 1]));
}

#[test]
fn a_splat_that_is_not_a_number_is_pruned_and_counted_once() {
    let random = &mut Random::new(21);
    for p in 0..8 {
        for poison in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut rows: Vec<Row> = (0..5).map(|i| Row::random(random, i).with(1.0, 1.0, 0.0, 0.0)).collect();
            let last = rows[3].planes[p].len() - 1;
            rows[3].planes[p][last] = poison;
            let mut model = Model::new(&rows, 20, 5, random);
            density_twin::change(&mut model, &rules(), 1);
            assert_eq!([model.counters[BAD_SPLATS], model.counters[PRUNED], model.counters[CLONED]], [1, 1, 4]);
            assert!(model.rows().iter().all(|r| r.id != 3 && r.planes.iter().flatten().all(|v| v.is_finite())));
            density_twin::change(&mut model, &rules(), 2);
            assert_eq!(model.counters[BAD_SPLATS], 1, "the count goes on from before");
        }
    }
}
