//! Buffers that no descriptor covers. Kernels reach them by address, with the same bits as through descriptors. A
//! device that cannot do so reports an error.

mod common;

use common::plane_scene;
use psrgs_vk::pass::fill;
use psrgs_vk::raster::{GradientSum, TileShape, Variants, most_pairs, most_splats};
use psrgs_vk::train::{self, Message, Pacing, Residency, Settings, State, Trainer};
use psrgs_vk::vk::{Addresses, Error, Gpu, Groups, Memory, OpenOptions};

/// Bytes that one descriptor covers in the tests below.
const RANGE: u64 = 64 << 10;

/// A device with changed options; `None` where the device has no buffer addresses.
fn gpu(change: impl FnOnce(&mut OpenOptions)) -> Option<Gpu> {
    let gpu = common::gpu_with(change)?;
    if gpu.caps().addresses == Addresses::Never {
        common::left_out("buffers cannot be reached by address on this device");
        return None;
    }
    Some(gpu)
}

#[test]
fn only_what_no_descriptor_covers_goes_by_address() {
    let Some(gpu) = gpu(|o| (o.storage_range, o.addresses) = (Some(RANGE), None)) else { return };
    assert_eq!((gpu.caps().addresses, gpu.caps().limits.storage_range), (Addresses::BeyondRange, RANGE));
    let words = RANGE as u32 / 4 + 1000;
    let buffer = gpu.buffer("large", 4 * u64::from(words), Memory::Device).unwrap();
    let pipeline = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    let mut rec = gpu.recorder("fill").unwrap();
    let all = Groups::Items(u64::from(words));
    rec.dispatch(&pipeline, &[&buffer], &fill::Push { count: words, value: 7 }, all).unwrap();
    // Two parts of the buffer through descriptors, between uses of the whole: barriers do not depend on the form.
    for (from, value) in [(0, 8), (RANGE, 9)] {
        let push = fill::Push { count: 64, value };
        rec.dispatch(&pipeline, &[buffer.slice(from..from + 256)], &push, Groups::Items(64)).unwrap();
    }
    let before = gpu.stats();
    rec.submit().unwrap();
    let after = gpu.stats();
    assert_eq!((after.dispatches - before.dispatches, after.by_address - before.by_address), (3, 1));
    assert!(after.barriers > before.barriers, "no barrier between the buffer and its parts");
    let found: Vec<u32> = gpu.read(&buffer).unwrap();
    let start = RANGE as usize / 4;
    for (i, word) in found.iter().enumerate() {
        let want = if i < 64 {
            8
        } else if (start..start + 64).contains(&i) {
            9
        } else {
            7
        };
        assert_eq!(*word, want, "word {i}");
    }
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
}

#[test]
fn a_slice_by_address_begins_where_it_should() {
    let Some(gpu) = gpu(|o| o.addresses = Some(true)) else { return };
    let buffer = gpu.buffer("sliced", 4096, Memory::Device).unwrap();
    let pipeline = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    let mut rec = gpu.recorder("slices").unwrap();
    rec.fill(&buffer, 1).unwrap();
    let step = gpu.caps().limits.storage_alignment;
    assert!((16..=1024).contains(&step));
    let push = fill::Push { count: 4, value: 2 };
    rec.dispatch(&pipeline, &[buffer.slice(step..step + 16)], &push, Groups::Items(4)).unwrap();
    let error = rec.dispatch(&pipeline, &[buffer.slice(4..20)], &push, Groups::Items(4)).unwrap_err();
    assert!(matches!(error, Error::BadRange { offset: 4, .. }), "{error}");
    rec.submit().unwrap();
    assert_eq!(gpu.stats().by_address, 1);
    let first = step as usize / 4;
    for (i, word) in gpu.read::<u32>(&buffer).unwrap().into_iter().enumerate() {
        assert_eq!(word, if (first..first + 4).contains(&i) { 2 } else { 1 }, "word {i}");
    }
    common::assert_no_messages(&gpu);
}

/// Beyond a descriptor's range, a variant of its own reads rows as texels where the device supports texel buffers.
#[test]
fn rows_beyond_a_descriptor_are_read_as_texels() {
    use psrgs_vk::pass::{ALL, slot_sum};
    let Some(gpu) = gpu(|o| (o.storage_range, o.addresses, o.texels) = (Some(RANGE), None, Some(true))) else { return };
    if !gpu.caps().texels {
        common::left_out("the device has no texels of the formats");
        return;
    }
    let views = slot_sum::PASS.kernel.spirv.texels_by_address.expect("its rows are only read").views;
    assert!(views.iter().all(|view| view.at >= 64 && u64::from(view.binding) + 64 == u64::from(view.at)));
    // A kernel that writes the rows that it reads has no texel variant.
    let written = |name: &str| ALL.iter().find(|pass| pass.kernel.name == name).expect("a pass").kernel.spirv;
    let fused = written("project_backward_adam");
    assert!(fused.texels.is_some() && fused.texels_by_address.is_none());
}

#[test]
fn guards_notice_a_write_past_the_end_by_address() {
    let Some(gpu) = gpu(|o| (o.addresses, o.canaries) = (Some(true), true)) else { return };
    let buffer = gpu.buffer("overrun", 1024, Memory::Device).unwrap();
    let pipeline = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    let run = |count: u32| {
        let mut rec = gpu.recorder("fill").unwrap();
        let push = fill::Push { count, value: 3 };
        rec.dispatch(&pipeline, &[&buffer], &push, Groups::Items(u64::from(count))).unwrap();
        rec.submit().unwrap();
        gpu.check_canaries()
    };
    run(256).unwrap();
    let error = run(258).unwrap_err();
    assert!(matches!(&error, Error::Overrun { buffer, offset: 1024, value: 3, .. } if buffer == "overrun"), "{error}");
    run(256).unwrap();
}

/// Everything about a run that must not depend on the variant of its kernels.
#[derive(Debug, PartialEq)]
struct Told {
    losses: Vec<u32>,
    changes: Vec<[u32; 3]>,
    grown: Vec<&'static str>,
}

fn settings(deterministic: bool) -> Settings {
    let mut s = Settings::default();
    s.run.iterations = 30;
    s.run.deterministic = deterministic;
    s.run.eval_every = 0;
    s.density.densify_from = 5;
    s.density.densify_until = 30;
    s.density.densify_interval = 8;
    s.density.opacity_reset_interval = 20;
    s.model.sh_interval = 10;
    s
}

fn train(gpu: &Gpu, settings: &Settings, pacing: Pacing) -> Result<(State, Told, Variants), train::Error> {
    let mut trainer = Trainer::new(gpu, plane_scene::input(4, 48, 40, 300), settings, pacing, None)?;
    let mut told = Told { losses: Vec::new(), changes: Vec::new(), grown: Vec::new() };
    while let Some(message) = trainer.next_message()? {
        match message {
            Message::Step { step, loss, .. } => {
                told.losses.truncate(step as usize - 1);
                told.losses.push(loss.to_bits());
            }
            Message::Density { cloned, split, pruned, .. } => told.changes.push([cloned, split, pruned]),
            Message::Grown { what, .. } => told.grown.push(what),
            _ => {}
        }
    }
    let end = trainer.snapshot()?;
    Ok((end.state, told, end.variants))
}

fn assert_same(a: &State, b: &State) {
    assert_eq!((&a.ids, &a.counters), (&b.ids, &b.counters));
    let bits = |v: &[f32]| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    let planes =
        |s: &State| -> Vec<[Vec<f32>; 8]> { [s.params.clone()].into_iter().chain(s.moments.clone()).collect() };
    for (n, (x, y)) in planes(a).iter().zip(planes(b)).enumerate() {
        for k in 0..8 {
            assert!(bits(&x[k]) == bits(&y[k]), "plane {k} of {}", ["the parameters", "m", "v"][n]);
        }
    }
    assert_eq!(bits(&a.stats), bits(&b.stats));
}

/// Small capacities: buffers grow past the range of a descriptor during the run.
const SMALL: Pacing = Pacing {
    events_in_flight: 4,
    splat_capacity: 320,
    pair_capacity: 1000,
    photographs: Residency::Auto,
    decoded_ahead: 4,
    decoders: 0,
};

#[test]
fn training_by_address_equals_training_through_descriptors() {
    let Some(through) = common::gpu_with(|o| o.addresses = Some(false)) else { return };
    let Some(always) = gpu(|o| o.addresses = Some(true)) else { return };
    let Some(across) = gpu(|o| (o.storage_range, o.addresses) = (Some(RANGE), None)) else { return };
    let [a, b, c] = [&through, &always, &across].map(|gpu| train(gpu, &settings(true), SMALL).unwrap());
    assert!(a.1.changes.iter().any(|change| change[0] + change[1] > 0), "nothing was densified");
    assert!(a.1.grown.contains(&"pairs"), "{:?}", a.1.grown);
    assert_eq!((&b.1, &c.1), (&a.1, &a.1));
    assert_same(&b.0, &a.0);
    assert_same(&c.0, &a.0);
    assert_eq!(through.stats().by_address, 0);
    assert_eq!(always.stats().by_address, always.stats().dispatches);
    let stats = across.stats();
    assert!(stats.by_address > 100 && stats.by_address < stats.dispatches, "{stats:?}");
    for gpu in [through, always, across] {
        gpu.check_canaries().unwrap();
        common::assert_no_messages(&gpu);
    }
}

#[test]
fn pairs_beyond_the_slots_use_atomics_unless_forbidden() {
    let Some(gpu) = common::gpu_with(|o| (o.storage_range, o.addresses) = (Some(RANGE), Some(false))) else { return };
    let slots = Variants { gradients: GradientSum::Slots, ..Variants::choose(&gpu, true) };
    let most = most_pairs(&gpu, slots);
    assert_eq!((u64::from(most), u64::from(most_splats(&gpu))), (RANGE / 48, RANGE / 48));
    let mut quick = settings(false);
    quick.stepping.gradient_sum = Some(GradientSum::Slots);
    // Small tiles, so that splats have many pairs.
    quick.blending.tile_shape = Some(TileShape::Column);
    quick.density.max_splats = Some(1000);
    let (state, told, variants) = train(&gpu, &quick, Pacing::default()).unwrap();
    assert_ne!(variants.gradients, GradientSum::Slots, "slots were used for more than {most} pairs");
    assert!(told.grown.contains(&"pairs"));
    assert!(told.losses.len() == 30 && told.losses.iter().all(|loss| f32::from_bits(*loss).is_finite()));
    assert!(state.ids.len() > 100);
    // Sums by atomics are not repeatable, so a deterministic run reports what does not fit.
    quick.run.deterministic = true;
    match train(&gpu, &quick, Pacing::default()) {
        Err(train::Error::TooMany { what, wanted, limit, .. }) => {
            assert!(what.contains("pairs") && wanted > limit && limit == u64::from(most));
        }
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("it fitted"),
    }
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
}

#[test]
fn limits_follow_what_can_be_reached() {
    let Some(gpu) = gpu(|o| (o.storage_range, o.addresses) = (Some(RANGE), None)) else { return };
    let caps = gpu.caps();
    let largest = caps.limits.allocation;
    assert_eq!(caps.largest_buffer(), largest);
    let words = (largest / 4).min(i32::MAX as u64);
    assert_eq!(u64::from(most_splats(&gpu)), words / 12);
    let atomic = Variants { gradients: GradientSum::Atomic, ..Variants::choose(&gpu, true) };
    assert_eq!(u64::from(most_pairs(&gpu, atomic)), words);
    let error = gpu.buffer("vast", largest + 1, Memory::Device).unwrap_err();
    assert!(
        matches!(&error, Error::BufferTooLarge { buffer, bytes, limit } if buffer == "vast" && *bytes == largest + 1 && *limit == largest)
    );
    let text = error.to_string();
    assert!(text.contains(&largest.to_string()) && text.contains(&(largest + 1).to_string()), "{text}");
    let choice = caps.choices.iter().find(|c| c.what == "buffers by address").unwrap();
    assert!(choice.picked.contains("65536"), "{choice:?}");
}
