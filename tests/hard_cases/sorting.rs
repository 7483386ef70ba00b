//! Orders that depth does not decide, and lists that two kernels make.

use psrgs_vk::pass::counters;
use psrgs_vk::raster::{Planes, Renderer, Size, Target, Variants};
use psrgs_vk::vk::BufferSlice;

use super::common;
use super::common::splats::{camera, seeded, spread};
use super::device::{Scene, round, straight};

/// 1,000 splats at one depth: sort and reference keep the order of the rows, and every run gives the same bits.
#[test]
fn depth_ties_and_stability() {
    let Some(gpu) = common::gpu() else { return };
    let camera = straight(60, 44);
    let mut random = seeded(1);
    let splats: Vec<_> = (0..1000)
        .map(|_| {
            let at = [random.range(0.0, 60.0), random.range(0.0, 44.0)];
            let (sigma, opacity) = (random.range(1.0, 3.0), random.range(0.1, 0.9));
            round(&mut random, &camera, at, 3.0, sigma, opacity)
        })
        .collect();
    let scene = Scene::new(&splats, camera, false);
    assert!(scene.splats.iter().all(|s| s.mean[2] == 3.0));
    let backwards = Scene::new(&splats.iter().rev().cloned().collect::<Vec<_>>(), camera, false);
    let [image, other] = [&scene, &backwards].map(Scene::wanted);
    let differ = image.colour.iter().zip(&other.colour).filter(|(a, b)| (a[0] - b[0]).abs() > 1e-3).count();
    assert!(differ > 500, "the order matters in {differ} pixels only");
    for variants in Variants::possible(&gpu) {
        for (scene, image) in [(&scene, &image), (&backwards, &other)] {
            let first = scene.picture(&gpu, variants);
            assert!(first == scene.picture(&gpu, variants), "{variants}: two pictures differ");
            // Ties count as decisions, so margins do not show where rounding may flip another decision. A flipped
            // decision adds or removes an alpha of 1/255 in few pixels. A wrong order shows in most pixels.
            let off: Vec<f64> = (0..scene.pixels())
                .map(|i| (0..3).map(|c| (f64::from(first[4 * i + c]) - image.colour[i][c]).abs()).fold(0.0, f64::max))
                .collect();
            let (many, most) = (off.iter().filter(|e| **e > 2e-5).count(), off.iter().fold(0.0f64, |m, e| m.max(*e)));
            assert!(most < 0.01 && many * 100 < off.len(), "{variants}: {many} pixels differ, by up to {most:e}");
        }
    }
}

/// `emit` writes as many pairs as `project` counts. With every list poisoned before, needles, giants and splats on the
/// borders of tiles leave no slot unwritten, and the render has the same bits.
#[test]
fn tile_counts_and_poisoned_slots() {
    let Some(gpu) = common::gpu() else { return };
    let camera = camera(150, 70);
    let mut random = seeded(2);
    let mut splats: Vec<_> = (0..400).map(|_| spread(&mut random, &camera, 1.4)).collect();
    for i in 0..200 {
        // Centres on corners of tiles; needles and discs of every size.
        let at = [8.0 * f64::from(i % 19), 8.0 * f64::from(i / 19)];
        let mut splat = round(&mut random, &camera, at, 2.0, 0.3 + 0.1 * f64::from(i), 0.3);
        splat.log_scale[i as usize % 3] -= f64::from(i % 8);
        splat.quat = std::array::from_fn(|_| random.symmetric());
        splats.push(splat);
    }
    let scene = Scene::new(&splats, camera, false);
    let n = splats.len() as u32;
    for variants in Variants::possible(&gpu) {
        let side = variants.tile.size();
        let tiles = 150u32.div_ceil(side) * 70u32.div_ceil(side);
        let size = Size {
            splats: n,
            pairs: n * tiles,
            tiles,
            aux: false,
            train: false,
            listed: false,
            absolute: false,
            count: false,
            clamp_gradient_passes: false,
        };
        let renderer = Renderer::new(&gpu, variants, size).unwrap();
        let model = Planes::new(&gpu, "", n).unwrap();
        model.write(&gpu, &scene.model).unwrap();
        let target = Target::new(&gpu, "", 150 * 70, false).unwrap();
        let mut words = [0u32; counters::COUNT];
        words[counters::SPLATS] = n;
        gpu.write(&renderer.counters, &words).unwrap();
        let mut rec = gpu.recorder("first").unwrap();
        let lists = renderer.record_forward(&mut rec, &model, &scene.shot, &target, false).unwrap();
        rec.submit().unwrap();
        let clean: Vec<u32> = gpu.read(&target.image).unwrap();
        let mut rec = gpu.recorder("poisoned").unwrap();
        rec.fill(lists.sorted_splats, u32::MAX).unwrap();
        rec.fill(lists.tile_ranges, u32::MAX).unwrap();
        if let Some(slots) = lists.slots {
            rec.fill(slots.slot_splat, u32::MAX).unwrap();
            rec.fill(slots.sorted_slots, u32::MAX).unwrap();
        }
        let lists = renderer.record_forward(&mut rec, &model, &scene.shot, &target, false).unwrap();
        rec.submit().unwrap();
        let counts: Vec<u32> = gpu.read(&renderer.counters).unwrap();
        let pairs = counts[counters::PAIRS] as usize;
        let read = |slice: BufferSlice<'_>, words: usize| gpu.read_slice::<u32>(slice, words).unwrap();
        let sorted = read(lists.sorted_splats, pairs);
        assert!(pairs > 2000 && sorted.iter().all(|i| *i < n), "{variants}: a slot was not written");
        let ranges = read(lists.tile_ranges, 2 * tiles as usize);
        let mut held = 0;
        for range in ranges.chunks_exact(2) {
            assert!(range[0] <= range[1] && range[1] as usize <= pairs, "{variants}: {range:?}");
            let mut of_tile = sorted[range[0] as usize..range[1] as usize].to_vec();
            held += of_tile.len();
            of_tile.sort_unstable();
            assert!(of_tile.windows(2).all(|w| w[0] < w[1]), "{variants}: a splat is twice in a tile");
        }
        assert_eq!(held, pairs, "{variants}: pairs counted and pairs in tiles");
        assert!(gpu.read::<u32>(&target.image).unwrap() == clean, "{variants}: the poison shows");
    }
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
}
