//! Density changes on the device against the twins: bit for bit where words are copied and counted.

use std::collections::BTreeMap;

use super::common::{assert_no_messages, gpu};
use super::densify_passes::{offset_error, shared_logit_error};
use super::density::{borderline, random_rows, rules};
use super::density_model::{MEANS, Model, OPACITIES, QUATS, Row, SCALES, WIDTHS, below, uniform};
use super::density_twin;
use super::harness::rounds_alike;
use glam::{DQuat, DVec3};
use psrgs_vk::pass::counters::{self, SPLATS_BIT, STATUS, WANT_SPLATS};
use psrgs_vk::pass::{densify_stats, opacity_reset};
use psrgs_vk::raster::sort::SortShape;
use psrgs_vk::scene::random::Random;
use psrgs_vk::train::density::{
    ARGS, DensityControl, DensityModel as DeviceModel, DensityRules, SCRATCH_BYTES, SCRATCH_LEAST, SampledGrowth,
    Scratch, logit,
};
use psrgs_vk::twin::densify_stats::add_view;
use psrgs_vk::vk::{Buffer, Gpu, Groups, Memory, Recorder};

/// The entry of `args` that density control begins with in these tests.
const FIRST_ENTRY: u32 = 5;

pub(crate) struct OnDevice {
    gpu: Gpu,
    capacity: usize,
    planes: [Buffer; 8],
    first_moments: [Buffer; 8],
    second_moments: [Buffer; 8],
    stats: Buffer,
    scores: Buffer,
    ids: Buffer,
    counters: Buffer,
    args: Buffer,
    scratch: [Buffer; 2],
    control: DensityControl,
}

impl OnDevice {
    pub(crate) fn new(gpu: &Gpu, model: &Model) -> Self {
        Self::in_scene(gpu, model, 5.0, SortShape::of(gpu.caps()))
    }

    /// In a scene of the given extent, with sorts of the given shape.
    pub(crate) fn in_scene(gpu: &Gpu, model: &Model, extent: f64, shape: SortShape) -> Self {
        let buffer = |name: &str, words: &[u32]| {
            let buffer = gpu.buffer(name, 4 * words.len() as u64, Memory::Device).unwrap();
            gpu.write(&buffer, words).unwrap();
            buffer
        };
        Self {
            gpu: gpu.clone(),
            capacity: model.capacity,
            planes: std::array::from_fn(|p| buffer(&format!("plane {p}"), &model.planes[p])),
            first_moments: std::array::from_fn(|p| buffer(&format!("m {p}"), &model.moments[p])),
            second_moments: std::array::from_fn(|p| buffer(&format!("v {p}"), &model.moments[8 + p])),
            stats: buffer("stats", &model.stats),
            scores: buffer("scores", &model.scores),
            ids: buffer("ids", &model.ids),
            counters: buffer("counters", &model.counters),
            args: buffer("args", &[u32::MAX; 4 * 32]),
            scratch: ["rows", "words"].map(|name| {
                let bytes = (SCRATCH_BYTES * model.capacity as u64).max(SCRATCH_LEAST);
                gpu.buffer(name, bytes, Memory::Device).unwrap()
            }),
            control: DensityControl::new(gpu, model.capacity as u32, FIRST_ENTRY, extent, shape).unwrap(),
        }
    }

    pub(crate) fn record(&self, rec: &mut Recorder, rules: &DensityRules, event: u32) {
        self.control.record(rec, &self.view(), rules, event).unwrap();
    }

    fn view(&self) -> DeviceModel<'_> {
        DeviceModel {
            planes: &self.planes,
            plain: false,
            first_moments: &self.first_moments,
            second_moments: Some(&self.second_moments),
            stats: &self.stats,
            scores: Some(&self.scores),
            ids: &self.ids,
            counters: &self.counters,
            args: &self.args,
            scratch: Scratch { rows: &self.scratch[0], words: &self.scratch[1] },
        }
    }

    pub(crate) fn read(&self) -> Model {
        let words = |b: &Buffer| self.gpu.read::<u32>(b).unwrap();
        let moments = |p: usize| if p < 8 { &self.first_moments[p] } else { &self.second_moments[p - 8] };
        Model {
            capacity: self.capacity,
            planes: std::array::from_fn(|p| words(&self.planes[p])),
            moments: std::array::from_fn(|p| words(moments(p))),
            stats: words(&self.stats),
            scores: words(&self.scores),
            ids: words(&self.ids),
            counters: words(&self.counters).try_into().unwrap(),
        }
    }

    /// As [`Self::read`], with the rows in the order of birth, which is the twin's order.
    pub(crate) fn read_by_birth(&self) -> Model {
        let model = self.read();
        let mut order: Vec<usize> = (0..model.len()).collect();
        order.sort_by_key(|&row| model.ids[row]);
        let sorted = |words: Vec<u32>, width: usize| -> Vec<u32> {
            let live = order.iter().flat_map(|row| &words[width * row..width * (row + 1)]);
            live.chain(&words[width * order.len()..]).copied().collect()
        };
        let mut widths = WIDTHS.into_iter().cycle();
        let mut plane = |words| sorted(words, widths.next().unwrap());
        Model {
            planes: model.planes.map(&mut plane),
            moments: model.moments.map(&mut plane),
            stats: sorted(model.stats, 4),
            scores: sorted(model.scores, 2),
            ids: sorted(model.ids, 1),
            ..model
        }
    }

    /// Several changes in one submission: the host knows no count in between.
    pub(crate) fn change(&self, rules: &DensityRules, events: &[u32]) {
        let mut rec = self.gpu.recorder("density").unwrap();
        for &event in events {
            self.record(&mut rec, rules, event);
        }
        let ticket = rec.submit().unwrap();
        self.gpu.wait(ticket).unwrap();
        let args = self.gpu.read::<u32>(&self.args).unwrap();
        let own = 4 * FIRST_ENTRY as usize..4 * (FIRST_ENTRY + ARGS) as usize;
        assert!(args.iter().enumerate().all(|(i, a)| own.contains(&i) || *a == u32::MAX), "entries of others");
    }
}

/// All live rows are equal in every bit, except for means of children, which use the device's square root and division.
pub(crate) fn assert_same(gpu: &Gpu, got: &Model, want: &Model, born: u32) {
    assert_same_but_for(gpu, got, want, |row| row.id >= born);
}

/// As [`assert_same`], where all rows but those of `moved` have the mean of their source.
fn assert_same_but_for(gpu: &Gpu, got: &Model, want: &Model, moved: impl Fn(&Row) -> bool) {
    assert_eq!(got.counters, want.counters);
    let n = want.len();
    for (p, (got, want)) in got.planes.iter().zip(&want.planes).enumerate().filter(|(p, _)| *p != MEANS) {
        let live = ..WIDTHS[p] * n;
        let near = |(g, w): (&u32, &u32)| {
            let (g, w) = (f32::from_bits(*g), f32::from_bits(*w));
            let bound = if rounds_alike(gpu) { 2e-6 * (1.0 + w.abs()) } else { shared_logit_error(gpu, w) };
            g.to_bits() == w.to_bits() || p == OPACITIES && (g - w).abs() <= bound
        };
        assert!(got[live].iter().zip(&want[live]).all(near), "plane {p}");
    }
    for (p, (got, want)) in got.moments.iter().zip(&want.moments).enumerate() {
        let live = ..WIDTHS[p % 8] * n;
        assert!(got[live] == want[live], "moments {p}");
    }
    assert_eq!(got.stats[..4 * n], want.stats[..4 * n]);
    assert_eq!(got.scores[..2 * n], want.scores[..2 * n]);
    assert_eq!(got.ids[..n], want.ids[..n]);
    for (g, w) in got.rows().iter().zip(want.rows()) {
        if !moved(&w) {
            assert!((0..3).all(|k| g.planes[MEANS][k].to_bits() == w.planes[MEANS][k].to_bits()));
        } else {
            let sigma = w.planes[SCALES].iter().copied().fold(f32::MIN, f32::max).exp() * 1.6;
            for k in 0..3 {
                let (g, w) = (g.planes[MEANS][k], w.planes[MEANS][k]);
                let bound = 1e-6 * (6.0 * sigma + w.abs()) + offset_error(gpu) as f32 * 6.0 * sigma;
                assert!((g - w).abs() <= bound, "{g} for {w}");
            }
        }
    }
}

/// Every word is equal, including spare room, except the counters.
fn assert_unchanged(got: &Model, want: &Model) {
    for p in 0..8 {
        assert!(got.planes[p] == want.planes[p], "plane {p}");
    }
    for p in 0..16 {
        assert!(got.moments[p] == want.moments[p], "moments {p}");
    }
    assert!(got.stats == want.stats && got.scores == want.scores && got.ids == want.ids, "statistics or identities");
}

#[test]
fn device_follows_the_twin() {
    let Some(gpu) = gpu() else { return };
    for n in [0, 1, 2, 63, 64, 65, 257, 1025] {
        for max_splats in [None, Some(n as u32 + 3)] {
            let random = &mut Random::new(n as u64);
            let (rows, born) = random_rows(random, n);
            let mut want = Model::new(&rows, 2 * n + 1, born, random);
            let rules = DensityRules { max_splats, split_absolute: n % 2 == 0, ..rules() };
            let device = OnDevice::new(&gpu, &want);
            device.change(&rules, &[9]);
            density_twin::change(&mut want, &rules, 9);
            let got = device.read_by_birth();
            assert_same(&gpu, &got, &want, born);
            // Room that stays spare keeps its contents.
            let spare = n.max(want.len());
            assert_eq!(got.ids[spare..], want.ids[spare..]);
        }
    }
    assert_no_messages(&gpu);
}

#[test]
fn sampled_growth_follows_the_twin() {
    let Some(gpu) = gpu() else { return };
    let sampled = SampledGrowth {
        low_threshold: 0.4,
        high_threshold: 0.2,
        absolute: true,
        rate: 0.5,
        mask_share: 0.5,
        error_share: 0.5,
        prune_unseen: true,
        along_gradient: false,
    };
    for (n, along_gradient) in [(0, true), (1, true), (64, false), (64, true), (1025, false), (1025, true)] {
        let random = &mut Random::new(n as u64);
        let (rows, born) = random_rows(random, n);
        let mut want = Model::new(&rows, 2 * n + 1, born, random);
        let sampled = SampledGrowth { along_gradient, ..sampled };
        let rules = DensityRules { sampled: Some(sampled), keep_opacity: 0.9, ..rules() };
        let device = OnDevice::new(&gpu, &want);
        device.change(&rules, &[9]);
        density_twin::change(&mut want, &rules, 9);
        // A splat that becomes a child keeps its identity. Its mean goes through a root and a division, as of every
        // child.
        let centres: BTreeMap<u32, &[f32]> = rows.iter().map(|row| (row.id, &row.planes[MEANS][..])).collect();
        let exact = rounds_alike(&gpu);
        let moved = |row: &Row| row.id >= born || !exact && centres[&row.id] != row.planes[MEANS];
        assert_same_but_for(&gpu, &device.read_by_birth(), &want, moved);
        assert_eq!(want.counters[counters::CLONED], 0);
        assert!(n < 64 || want.counters[counters::SPLIT] > 0 && want.counters[counters::PRUNED] > 0);
    }
    assert_no_messages(&gpu);
}

/// Two children along the longest axis, or along the axis of the largest change of the loss, have together the mean,
/// the covariance and the opacity at the centre of their parent.
#[test]
fn children_along_the_axis_are_their_parent_together() {
    let cases = [([0.3_f64, -1.0, -0.5], 1.5_f64), ([-4.0, -2.0, -2.5], -3.0), ([0.0, 0.0, 0.0], 6.0)];
    let mut axes = Vec::new();
    for ((log_scales, logit), gradient) in cases.iter().flat_map(|&case| {
        let along = [None, Some(DVec3::ZERO), Some(DVec3::X), Some(DVec3::Y), Some(DVec3::Z)];
        along.map(|gradient| (case, gradient))
    }) {
        let mut random = Random::new(1);
        let mut row = Row::random(&mut random, 0);
        row.planes[SCALES] = log_scales.map(|s| s as f32).to_vec();
        row.planes[OPACITIES] = vec![logit as f32];
        row.moments[MEANS] = gradient.unwrap_or(DVec3::X).as_vec3().to_array().to_vec();
        (row.stats, row.scores) = ([1.0, 1.0, 1.0, 1.0], [1.0, 1.0]);
        let mut model = Model::new(&[row.clone()], 2, 1, &mut random);
        let sampled = SampledGrowth {
            low_threshold: 0.1,
            high_threshold: 0.1,
            absolute: true,
            rate: 1.0,
            mask_share: 0.0,
            error_share: 0.0,
            prune_unseen: false,
            along_gradient: gradient.is_some(),
        };
        let rules = DensityRules { sampled: Some(sampled), ..DensityRules::reference(100.0, 0) };
        density_twin::change(&mut model, &rules, 3);
        let [a, b]: [Row; 2] = model.rows().try_into().unwrap();
        let [w, x, y, z] = [0, 1, 2, 3].map(|k| f64::from(row.planes[QUATS][k]));
        let in_axes = DQuat::from_xyzw(x, y, z, w).normalize().inverse() * gradient.unwrap_or(DVec3::ZERO);
        let lengths = match in_axes == DVec3::ZERO {
            true => log_scales,
            false => std::array::from_fn(|k| in_axes[k].abs() * log_scales[k].exp()),
        };
        let axis = (0..3).max_by(|&i, &j| lengths[i].total_cmp(&lengths[j]).then(j.cmp(&i))).unwrap();
        axes.push(axis);
        let apart: Vec<f64> = (0..3).map(|k| f64::from(a.planes[MEANS][k] - b.planes[MEANS][k])).collect();
        let half = 0.5 * apart.iter().map(|d| d * d).sum::<f64>().sqrt();
        for (k, log_scale) in log_scales.into_iter().enumerate() {
            let middle = 0.5 * f64::from(a.planes[MEANS][k] + b.planes[MEANS][k]);
            assert!((middle - f64::from(row.planes[MEANS][k])).abs() < 1e-6, "the mean stays");
            let variance = (2.0 * f64::from(a.planes[SCALES][k])).exp() + if k == axis { half * half } else { 0.0 };
            assert!((variance / (2.0 * log_scale).exp() - 1.0).abs() < 1e-5, "the covariance along axis {k}");
        }
        let opacity = |logit: f64| 1.0 / (1.0 + (-logit).exp());
        let child = opacity(f64::from(a.planes[OPACITIES][0]));
        let own = (half / f64::from(a.planes[SCALES][axis]).exp()).powi(2);
        let shown = 1.0 - (1.0 - child * (-0.5 * own).exp()).powi(2);
        assert!(child <= opacity(logit) + 1e-6 && shown <= opacity(logit) + 1e-5, "{shown} of {}", opacity(logit));
        // Opacity is reduced only where a child would be more opaque than its parent.
        assert!(
            child < 0.999 * opacity(logit) && (shown - opacity(logit)).abs() < 1e-5 || child > 0.999 * opacity(logit)
        );
    }
    assert!((0..3).all(|axis| axes.contains(&axis)), "{axes:?}");
    assert!(
        axes.chunks(5).any(|case| case[2..].iter().any(|axis| *axis != case[0])),
        "the gradient does not choose the axis: {axes:?}"
    );
}

#[test]
fn thresholds_are_exact_on_the_device() {
    let Some(gpu) = gpu() else { return };
    let rows: Vec<Row> = borderline().into_iter().map(|(_, row, _)| row).collect();
    let mut want = Model::new(&rows, 2 * rows.len(), 100, &mut Random::new(2));
    let device = OnDevice::new(&gpu, &want);
    device.change(&rules(), &[1]);
    density_twin::change(&mut want, &rules(), 1);
    assert_same(&gpu, &device.read_by_birth(), &want, 100);
}

#[test]
fn changes_in_one_submission_follow_each_other() {
    let Some(gpu) = gpu() else { return };
    let random = &mut Random::new(31);
    let (rows, born) = random_rows(random, 500);
    let mut want = Model::new(&rows, 1000, born, random);
    // Statistics are reset by the first change, so a second one only prunes;
    // with thresholds of 0 everything grows again.
    let rules = DensityRules { clone_threshold: 0.0, max_splats: Some(900), ..rules() };
    let device = OnDevice::new(&gpu, &want);
    device.change(&rules, &[3, 6, 9]);
    for event in [3, 6, 9] {
        density_twin::change(&mut want, &rules, event);
    }
    assert!(want.len() > rows.len());
    assert_same(&gpu, &device.read_by_birth(), &want, born);
    assert_no_messages(&gpu);
}

#[test]
fn everything_cloned_split_or_pruned_on_the_device() {
    let Some(gpu) = gpu() else { return };
    for n in [1, 64, 65] {
        for (scale, logit) in [(0.0, 0.0), (0.6, 0.0), (0.6, -9.0)] {
            let random = &mut Random::new(5);
            let rows: Vec<Row> = (0..n).map(|i| Row::random(random, i as u32).with(1.0, 1.0, scale, logit)).collect();
            let mut want = Model::new(&rows, 2 * n, n as u32, random);
            let device = OnDevice::new(&gpu, &want);
            device.change(&rules(), &[1]);
            density_twin::change(&mut want, &rules(), 1);
            assert_eq!(want.len(), if logit < 0.0 { 0 } else { 2 * n });
            assert_same(&gpu, &device.read_by_birth(), &want, n as u32);
        }
    }
}

#[test]
fn overflow_writes_nothing_on_the_device() {
    let Some(gpu) = gpu() else { return };
    let random = &mut Random::new(6);
    let rows: Vec<Row> = (0..70).map(|i| Row::random(random, i).with(1.0, 1.0, 0.6, 0.0)).collect();
    let before = Model::new(&rows, 139, 70, random);
    let device = OnDevice::new(&gpu, &before);
    // The second change would fit. It must not run either, because the first is lost.
    device.change(&rules(), &[1]);
    device.change(&DensityRules { max_splats: Some(100), ..rules() }, &[2]);
    let after = device.read();
    let mut expected = before.counters;
    expected[STATUS] = SPLATS_BIT;
    expected[WANT_SPLATS] = 140;
    expected[counters::SCAN_TOTAL] = after.counters[counters::SCAN_TOTAL];
    assert_eq!(after.counters, expected);
    assert_unchanged(&after, &before);
    // With room and a cleared status, the lost change gives the result without overflow.
    let mut roomy = Model::new(&rows, 200, 70, random);
    let grown = OnDevice::new(&gpu, &roomy);
    grown.change(&rules(), &[1]);
    density_twin::change(&mut roomy, &rules(), 1);
    assert_same(&gpu, &grown.read_by_birth(), &roomy, 70);
}

#[test]
fn no_barrier_of_a_change_is_idle() {
    let Some(gpu) = gpu() else { return };
    let random = &mut Random::new(3);
    let (rows, born) = random_rows(random, 70);
    let device = OnDevice::new(&gpu, &Model::new(&rows, 140, born, random));
    let mut rec = gpu.recorder("density").unwrap();
    let rules = DensityRules { max_splats: Some(100), ..rules() };
    device.control.record(&mut rec, &device.view(), &rules, 1).unwrap();
    device.control.record_reset(&mut rec, &device.view(), 0.01).unwrap();
    let (barriers, idle) = gpu.missed_barriers(&rec).unwrap();
    assert!(barriers > 40 && idle.is_empty(), "of {barriers} barriers: {idle:?}");
}

#[test]
fn opacity_reset_caps_and_forgets() {
    let Some(gpu) = gpu() else { return };
    for n in [0, 1, 64, 65, 200] {
        for status in [0, SPLATS_BIT] {
            let random = &mut Random::new(40);
            let rows: Vec<Row> = (0..n)
                .map(|i| {
                    let opacity =
                        [uniform(random, -8.0, 3.0), logit(0.01), -f32::INFINITY, f32::INFINITY][below(random, 4)];
                    Row::random(random, i).with(0.0, 1.0, 0.0, opacity)
                })
                .collect();
            let mut model = Model::new(&rows, 201, n, random);
            model.counters[STATUS] = status;
            let device = OnDevice::new(&gpu, &model);
            let mut rec = gpu.recorder("reset").unwrap();
            device.control.record_reset(&mut rec, &device.view(), 0.01).unwrap();
            gpu.wait(rec.submit().unwrap()).unwrap();
            let got = device.read();
            let mut want = model.clone();
            for i in 0..if status == 0 { n as usize } else { 0 } {
                let capped = f32::from_bits(want.planes[OPACITIES][i]).min((0.01_f64 / 0.99).ln() as f32);
                want.planes[OPACITIES][i] = capped.to_bits();
                want.moments[OPACITIES][i] = 0;
                want.moments[8 + OPACITIES][i] = 0;
            }
            assert_unchanged(&got, &want);
            assert_eq!(got.counters, want.counters);
            if status == 0 {
                let mut twin = model;
                let (mut counts, push) = (twin.counters.to_vec(), opacity_reset::Push { logit_cap: logit(0.01) });
                let (first, second) = twin.moments.split_at_mut(8);
                let [opacities, first, second] =
                    [&mut twin.planes[OPACITIES], &mut first[OPACITIES], &mut second[OPACITIES]];
                let mut buffers = [&mut counts, opacities, first, second];
                density_twin::run(&opacity_reset::PASS, &mut buffers, bytemuck::bytes_of(&push), &[], n as usize);
                assert_unchanged(&twin, &want);
            }
        }
    }
    assert_no_messages(&gpu);
}

#[test]
fn statistics_follow_f64() {
    let Some(gpu) = gpu() else { return };
    let pipeline = gpu.pipeline(&densify_stats::PASS.kernel, &[]).unwrap();
    for n in [1, 63, 64, 65, 500] {
        let random = &mut Random::new(50 + n as u64);
        let room = n + 3;
        let mut tile_counts: Vec<u32> = (0..room).map(|_| below(random, 3) as u32).collect();
        tile_counts[0] = 1;
        let grad2d: Vec<f32> = (0..12 * room).map(|_| uniform(random, -1e-3, 1e-3)).collect();
        let stats: Vec<f32> = (0..4 * room).map(|_| uniform(random, 0.0, 2.0)).collect();
        let mut counts = [0_u32; counters::COUNT];
        counts[counters::SPLATS] = n as u32;

        let upload = |name: &str, words: &[u32]| {
            let buffer = gpu.buffer(name, 4 * words.len() as u64, Memory::Device).unwrap();
            gpu.write(&buffer, words).unwrap();
            buffer
        };
        let floats = |name: &str, values: &[f32]| upload(name, bytemuck::cast_slice(values));
        let buffers = [
            upload("counters", &counts),
            upload("tile_counts", &tile_counts),
            floats("grad2d", &grad2d),
            floats("stats", &stats),
        ];
        let mut rec = gpu.recorder("stats").unwrap();
        let push = densify_stats::Push { half_width: 320.0, half_height: 180.0 };
        rec.dispatch(&pipeline, &buffers.each_ref(), &push, Groups::Items(room as u64)).unwrap();
        gpu.wait(rec.submit().unwrap()).unwrap();
        let got: Vec<f32> = gpu.read(&buffers[3]).unwrap();

        let words = |v: &[f32]| v.iter().map(|x| x.to_bits()).collect::<Vec<u32>>();
        let mut twin = [counts.to_vec(), tile_counts.clone(), words(&grad2d), words(&stats)];
        let mut all: Vec<&mut Vec<u32>> = twin.iter_mut().collect();
        density_twin::run(&densify_stats::PASS, &mut all, bytemuck::bytes_of(&push), &[], room);
        for (t, g) in twin[3].iter().map(|w| f32::from_bits(*w)).zip(&got) {
            assert!((t - g).abs() <= 4e-7 * g.abs(), "{t} {g}");
        }

        let wide = |v: &[f32]| v.iter().map(|x| f64::from(*x)).collect::<Vec<f64>>();
        for i in 0..room {
            let before = &stats[4 * i..4 * i + 4];
            let after = &got[4 * i..4 * i + 4];
            if i >= n || tile_counts[i] == 0 {
                assert_eq!(after, before, "splat {i} was not on screen");
                continue;
            }
            let g = wide(&grad2d[12 * i..12 * i + 12]);
            let want = add_view(std::array::from_fn(|k| f64::from(before[k])), &g, [320.0, 180.0]);
            for k in 0..3 {
                assert!((f64::from(after[k]) - want[k]).abs() <= 4e-7 * want[k], "{after:?} {want:?}");
            }
            assert_eq!(after[3], before[3], "the optimiser's");
        }
    }
    assert_no_messages(&gpu);
}
