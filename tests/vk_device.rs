//! Choice of a device and its reasons, limits of memory, times and counters, the last command before a lost device.

mod common;

use psrgs_vk::pass::{fill, subgroup_probe};
use psrgs_vk::vk::{
    DeviceKind, Error, FloatAtomics, Gpu, Groups, Memory, OpenOptions, PipelineEvent, Subgroup, Ticket, devices,
};

#[test]
fn devices_are_chosen_by_index_or_part_of_a_name() {
    if common::gpu().is_none() {
        return;
    }
    let found = devices().unwrap();
    assert!(!found.is_empty());
    let open = |wanted: &str| Gpu::open(&OpenOptions { device: Some(wanted.to_owned()), ..OpenOptions::default() });
    let name = &found[0].name;
    let part = name[..name.len().min(5)].to_uppercase();
    assert_eq!(open("0").unwrap().caps().device, *name);
    assert!(open(&part).unwrap().caps().device.to_uppercase().contains(&part));
    for wanted in ["99", "no such device"] {
        let error = open(wanted).err().unwrap();
        assert!(matches!(error, Error::NoDevice { .. }));
        let text = error.to_string();
        assert!(text.contains(wanted) && text.contains(name), "{text}");
    }
    // The default prefers hardware.
    let default = Gpu::open(&OpenOptions::default()).unwrap();
    if found.iter().any(|d| d.kind == DeviceKind::Discrete && d.unusable.is_none()) {
        assert_eq!(default.caps().kind, DeviceKind::Discrete);
    }
}

#[test]
fn every_choice_has_a_reason_and_can_be_forced() {
    let Some(gpu) = common::gpu_with(|o| (o.float_atomics, o.emulate_subgroup) = (None, None)) else { return };
    let caps = gpu.caps();
    assert!(caps.choices.iter().all(|c| !c.picked.is_empty() && !c.why.is_empty()));
    if caps.kind == DeviceKind::Cpu {
        // Not the nominal heap of a software driver.
        assert!(caps.memory_limit != caps.heaps[0].bytes);
    }
    let forced = common::gpu_with(|o| {
        o.float_atomics = Some(FloatAtomics::CompareAndSwap);
        o.emulate_subgroup = Some(64);
    });
    let forced = forced.unwrap();
    assert_eq!(forced.caps().buffer_floats, FloatAtomics::CompareAndSwap);
    assert_eq!(forced.caps().shared_floats, FloatAtomics::CompareAndSwap);
    assert_eq!(forced.caps().subgroup, Subgroup::Emulated(64));
    assert!(forced.caps().choices.iter().filter(|c| c.why == "forced").count() >= 3);
}

#[test]
fn hardware_subgroups_have_the_width_that_was_picked() {
    let Some(gpu) = common::gpu_with(|o| o.emulate_subgroup = None) else { return };
    let Subgroup::Hardware(width) = gpu.caps().subgroup else {
        common::left_out("subgroups are emulated on this device");
        return;
    };
    assert!(width.is_power_of_two());
    gpu.pipeline(&subgroup_probe::SUBGROUP.kernel, &[]).unwrap();
    common::assert_no_messages(&gpu);
}

#[test]
fn memory_is_refused_with_numbers_and_comes_back() {
    let Some(gpu) = common::gpu_with(|o| o.max_device_memory = Some(1 << 20)) else { return };
    let base = gpu.memory_use().current;
    let half = gpu.buffer("half", 512 << 10, Memory::Device).unwrap();
    match gpu.buffer("too much", 768 << 10, Memory::Device) {
        Err(Error::OutOfDeviceMemory { requested, name, in_use, limit }) => {
            assert!(requested >= 768 << 10 && in_use >= 512 << 10);
            assert_eq!((name.as_str(), limit), ("too much", 1 << 20));
        }
        other => panic!("{other:?}"),
    }
    drop(half);
    assert_eq!(gpu.memory_use().current, base);
    let most = gpu.buffer("most", 768 << 10, Memory::Device).unwrap();
    assert!(gpu.memory_use().peak >= 768 << 10);
    drop(most);
    // Past any single allocation.
    assert!(
        matches!(gpu.buffer("vast", 1 << 60, Memory::Device), Err(Error::BufferTooLarge { bytes, .. }) if bytes == 1 << 60)
    );
}

#[test]
fn a_binding_past_the_devices_range_is_refused() {
    let Some(gpu) = common::gpu_with(|o| o.addresses = Some(false)) else { return };
    let limit = gpu.caps().limits.storage_range;
    if limit > 1 << 30 {
        common::left_out(format_args!("one binding of this device holds {limit} bytes"));
        return;
    }
    let large = gpu.buffer("large", limit + 64, Memory::Device).unwrap();
    let pipeline = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    let mut rec = gpu.recorder("large").unwrap();
    let push = fill::Push { count: 16, value: 5 };
    let error = rec.dispatch(&pipeline, &[&large], &push, Groups::Items(16)).unwrap_err();
    assert!(matches!(error, Error::BindingTooLarge { bytes, .. } if bytes == limit + 64), "{error}");
    // A slice reaches the end of the buffer.
    rec.dispatch(&pipeline, &[large.slice(limit..limit + 64)], &push, Groups::Items(16)).unwrap();
    rec.submit().unwrap();
    assert_eq!(gpu.read_at::<u32>(&large, limit, 16).unwrap(), [5; 16]);
    common::assert_no_messages(&gpu);
}

#[test]
fn times_come_by_pass_and_waits_are_counted() {
    let Some(gpu) = common::gpu() else { return };
    let target = gpu.buffer("target", 4 << 20, Memory::Device).unwrap();
    let pipeline = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    let record = |profile: bool| {
        let mut rec = gpu.recorder("timed").unwrap();
        rec.profile(profile);
        rec.fill(&target, 0).unwrap();
        rec.dispatch(&pipeline, &[&target], &fill::Push { count: 1 << 20, value: 1 }, Groups::Items(1 << 20)).unwrap();
        rec.submit().unwrap()
    };
    let first = record(true);
    let second = record(false);
    gpu.wait(first).unwrap();
    gpu.wait(second).unwrap();
    assert!(gpu.is_done(second).unwrap());
    let stats = gpu.stats();
    assert_eq!((stats.submits, stats.dispatches, stats.transfers), (2, 2, 2));
    assert_eq!((stats.host_waits, stats.pacing_waits), (1, 1));
    gpu.wait(Ticket::default()).unwrap();
    assert_eq!(gpu.stats().host_waits, 1);
    if gpu.caps().limits.timestamp_ns == 0.0 {
        common::left_out("no timestamps on this device");
        return;
    }
    let times = gpu.timings(first).unwrap().unwrap();
    let names: Vec<&str> = times.iter().map(|t| t.pass.as_str()).collect();
    assert_eq!(names, ["clear", "fill"]);
    assert!(times.iter().all(|t| t.ns > 0.0 && t.ns < 60e9), "{times:?}");
    assert!(gpu.timings(first).unwrap().is_none() && gpu.timings(second).unwrap().is_none());
}

#[test]
fn breadcrumbs_name_the_last_command_that_started() {
    let Some(gpu) = common::gpu_with(|o| o.breadcrumbs = true) else { return };
    let target = gpu.buffer("target", 4 * 64, Memory::Device).unwrap();
    let pipeline = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    let push = fill::Push { count: 64, value: 1 };
    for last_is_dispatch in [true, false] {
        let mut rec = gpu.recorder("crumbs").unwrap();
        rec.fill(&target, 0).unwrap();
        rec.dispatch(&pipeline, &[&target], &push, Groups::Items(64)).unwrap();
        if !last_is_dispatch {
            rec.fill(&target, 2).unwrap();
        }
        let ticket = rec.submit().unwrap();
        // Not `wait`: on a lost device, commands are still in flight.
        while !gpu.is_done(ticket).unwrap() {
            std::thread::yield_now();
        }
        assert_eq!(gpu.last_started(), if last_is_dispatch { "fill of crumbs" } else { "clear of crumbs" });
    }
    common::assert_no_messages(&gpu);
}

#[test]
fn pipelines_are_kept_on_disk() {
    let folder = tempfile::tempdir().unwrap();
    let with_cache = || common::gpu_with(|o| o.pipeline_cache = Some(folder.path().join("deep")));
    let Some(gpu) = with_cache() else { return };
    gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    gpu.save_pipeline_cache().unwrap();
    drop(gpu);
    let files: Vec<_> = std::fs::read_dir(folder.path().join("deep")).unwrap().map(|e| e.unwrap().path()).collect();
    assert_eq!(files.len(), 1, "{files:?}");
    assert!(std::fs::metadata(&files[0]).unwrap().len() > 20);
    // Read from the file, and from a damaged file.
    with_cache().unwrap().pipeline(&fill::PASS.kernel, &[]).unwrap();
    std::fs::write(&files[0], b"not a cache").unwrap();
    with_cache().unwrap().pipeline(&fill::PASS.kernel, &[]).unwrap();
}

#[test]
fn a_pipeline_is_told_of_once_before_and_after_it_is_made() {
    let Some(gpu) = common::gpu() else { return };
    let (tell, told) = std::sync::mpsc::channel();
    gpu.watch_pipelines(move |event| tell.send(event).unwrap());
    for _ in 0..2 {
        gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    }
    let events: Vec<PipelineEvent> = told.try_iter().collect();
    assert!(
        matches!(events[..], [PipelineEvent::Begun { kernel: "fill" }, PipelineEvent::Made { kernel: "fill", .. }]),
        "{events:?}"
    );
}
