//! A whole density change on the twins of its passes, in the order of the composer.

use super::density_model::{MEANS, Model, OPACITIES, QUATS, SCALES, WIDTHS};
use psrgs_vk::pass::{Pass, counters};
use psrgs_vk::pass::{
    densify_axes, densify_classify, densify_finish, densify_gather, densify_limit, densify_map, densify_means,
    densify_sample,
};
use psrgs_vk::train::density::DensityRules;
use psrgs_vk::twin::{self, TwinCall};

/// Runs a twin on buffers of words in binding order.
pub(crate) fn run(pass: &Pass, buffers: &mut [&mut Vec<u32>], push: &[u8], constants: &[u32], items: usize) {
    let mut bytes: Vec<Vec<u8>> = buffers.iter().map(|b| bytemuck::cast_slice(b.as_slice()).to_vec()).collect();
    let groups = items.div_ceil(64) as u32;
    twin::of(pass).expect("a twin")(&mut TwinCall { buffers: &mut bytes, push, constants, groups });
    for (buffer, bytes) in buffers.iter_mut().zip(bytes) {
        **buffer = bytemuck::pod_collect_to_vec(&bytes);
    }
}

fn scan(flags: &[u32], counters: &mut [u32]) -> Vec<u32> {
    let mut sum = 0;
    let offsets = flags
        .iter()
        .map(|f| {
            let before = sum;
            sum += f;
            before
        })
        .collect();
    counters[counters::SCAN_TOTAL] = sum;
    offsets
}

/// Changes the model. Without room, only its status and the needed capacity.
pub(crate) fn change(model: &mut Model, settings: &DensityRules, event: u32) {
    let n = model.capacity;
    let stride = n as u32;
    let mut c = model.counters.to_vec();
    let (mut flags, mut tally) = (vec![0xdead_beef; 4 * n], vec![0; 4]);
    {
        let Model { planes: [means, quats, scales, opacities, sh0, sh1, sh2, sh3], stats, scores, ids, .. } = model;
        if let Some(sampled) = &settings.sampled {
            let push = settings.sample_push(sampled, stride, event);
            let (flags, tally) = (&mut flags, &mut tally);
            let mut b = [&mut c, means, quats, scales, opacities, sh0, sh1, sh2, sh3, stats, scores, ids, flags, tally];
            run(&densify_sample::PASS, &mut b, bytemuck::bytes_of(&push), &[], n);
        } else {
            let mut b = [&mut c, means, quats, scales, opacities, sh0, sh1, sh2, sh3, stats, &mut flags, &mut tally];
            run(&densify_classify::PASS, &mut b, bytemuck::bytes_of(&settings.classify_push(stride)), &[], n);
        }
    }
    let mut offsets = scan(&flags, &mut c);
    if let Some(max_splats) = settings.max_splats {
        let push = densify_limit::Push { stride, max_splats, seed: settings.seed, event };
        run(&densify_limit::PASS, &mut [&mut c, &mut offsets, &mut flags], bytemuck::bytes_of(&push), &[], n);
        offsets = scan(&flags, &mut c);
    }
    let total = c[counters::SCAN_TOTAL] as usize;
    if c[counters::STATUS] == 0 {
        c[counters::WANT_SPLATS] = c[counters::WANT_SPLATS].max(total as u32);
        if total > n {
            c[counters::STATUS] = counters::SPLATS_BIT;
        }
    }
    // Indirect dispatches: nothing runs once the status is set.
    let go = c[counters::STATUS] == 0;
    let (old, new) = if go { (model.len(), total) } else { (0, 0) };

    let (mut map, mut old_ids) = (vec![0xdead_beef; n], model.ids.clone());
    let push = densify_map::Push { stride };
    let mut b = [&mut c, &mut flags, &mut offsets, &mut old_ids, &mut map, &mut model.ids];
    run(&densify_map::PASS, &mut b, bytemuck::bytes_of(&push), &[], old);

    if settings.sampled.is_some_and(|sampled| sampled.along_gradient) {
        let ([_, quats, scales, ..], moments) = (&mut model.planes, &mut model.moments[MEANS]);
        let mut b = [&mut c, quats, scales, moments, &mut map];
        let push = densify_axes::Push { packed_moments: 0 };
        run(&densify_axes::PASS, &mut b, bytemuck::bytes_of(&push), &[], new);
    }

    let [means, quats, scales, ..] = &mut model.planes;
    let mut source = means.clone();
    let along_axis = u32::from(settings.sampled.is_some());
    let push = densify_means::Push { seed: settings.seed, event, along_axis };
    let mut b = [&mut c, &mut map, &mut old_ids, &mut source, quats, scales, means];
    run(&densify_means::PASS, &mut b, bytemuck::bytes_of(&push), &[], new);

    let mut gather = |plane: &mut Vec<u32>, width: usize, mode: u32| {
        let keep = if mode == densify_gather::MODE_SHARE { settings.keep_opacity } else { 1.0 };
        let (push, mut source) = (densify_gather::Push { mode, keep }, plane.clone());
        let mut b = [&mut c, &mut map, &mut source, plane];
        run(&densify_gather::PASS, &mut b, bytemuck::bytes_of(&push), &[width as u32], new);
    };
    for (p, plane) in model.planes.iter_mut().enumerate().filter(|(p, _)| *p != MEANS) {
        debug_assert!(p >= QUATS);
        let mode = match (p, settings.sampled.is_some()) {
            (SCALES, true) => densify_gather::MODE_SHRINK_AXIS,
            (SCALES, false) => densify_gather::MODE_SHRINK,
            (OPACITIES, true) => densify_gather::MODE_SHARE,
            _ => densify_gather::MODE_COPY,
        };
        gather(plane, WIDTHS[p], mode);
    }
    for (p, plane) in model.moments.iter_mut().enumerate() {
        gather(plane, WIDTHS[p % 8], densify_gather::MODE_MOMENT);
    }
    gather(&mut model.stats, 4, densify_gather::MODE_ZERO);
    gather(&mut model.scores, 2, densify_gather::MODE_ZERO);

    let push = densify_finish::Push { stride };
    let mut b = [&mut c, &mut offsets, &mut tally];
    run(&densify_finish::PASS, &mut b, bytemuck::bytes_of(&push), &[], 1);
    model.counters.copy_from_slice(&c);
}
