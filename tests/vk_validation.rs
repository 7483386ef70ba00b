//! The watchers detect errors: the Khronos layer, the hazard checker, and the guards behind buffers.

mod common;

use std::process::Command;

use psrgs_vk::pass::{fill, subgroup_probe};
use psrgs_vk::vk::{Buffer, Error, Gpu, Groups, Memory, OpenOptions, Recorder, Validation};

/// A device with the validation layer; `None`, with a printed reason, where there is no driver or no layer.
fn watched(check_hazards: bool) -> Option<Gpu> {
    let options =
        OpenOptions { validation: Validation::CoreAndSync, check_hazards, ..OpenOptions::from_env().unwrap() };
    match Gpu::open(&options) {
        Ok(gpu) => Some(gpu),
        Err(Error::NoVulkan(why)) => {
            common::skipped(format_args!("no Vulkan driver: {why}"));
            None
        }
        Err(error) => panic!("{error}"),
    }
}

#[test]
fn gpu_assisted_layer_reports_an_address_past_a_buffer() {
    let options = OpenOptions {
        validation: Validation::GpuAssisted,
        addresses: Some(true),
        canaries: false,
        ..OpenOptions::from_env().unwrap()
    };
    let gpu = match Gpu::open(&options) {
        Ok(gpu) => gpu,
        Err(Error::NoVulkan(why)) => return common::skipped(format_args!("no Vulkan driver: {why}")),
        Err(error) => panic!("{error}"),
    };
    let fill = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    let buffer = gpu.buffer("a hundred words", 4 * 100, Memory::Device).unwrap();
    let run = |count: u32| {
        let mut rec = gpu.recorder("words").unwrap();
        rec.dispatch(&fill, &[&buffer], &fill::Push { count, value: 7 }, Groups::Items(u64::from(count))).unwrap();
        gpu.wait(rec.submit().unwrap()).unwrap();
    };
    run(100);
    common::assert_no_messages(&gpu);
    assert_eq!(gpu.read::<u32>(&buffer).unwrap(), [7; 100]);
    // A shader that believes the buffer to be three words longer.
    run(103);
    let messages = gpu.validation_messages();
    let out_of_bounds = |m: &String| m.to_lowercase().contains("out of bounds") && m.contains("address");
    assert!(messages.iter().any(out_of_bounds), "{messages:?}");
}

#[test]
fn messages_outlive_the_device_and_know_its_end() {
    let Some(gpu) = watched(false) else { return };
    let messages = gpu.messages();
    let buffer = gpu.buffer("held", 64, Memory::Device).unwrap();
    drop(gpu);
    assert!(!messages.is_closed(), "a buffer holds the device");
    drop(buffer);
    assert!(messages.is_closed());
    assert_eq!(messages.all(), [""; 0]);
}

/// Writes a buffer in one dispatch and reads it in the next, which declares it `readonly`.
fn write_then_read(gpu: &Gpu) -> Recorder {
    let source = gpu.buffer("source", 4 * 128, Memory::Device).unwrap();
    let results = gpu.buffer("results", 4 * 128 * subgroup_probe::RESULTS as u64, Memory::Device).unwrap();
    let fill = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    let probe = gpu.pipeline(&subgroup_probe::EMULATED.kernel, &[]).unwrap();
    let mut rec = gpu.recorder("write then read").unwrap();
    rec.dispatch(&fill, &[&source], &fill::Push { count: 128, value: 1 }, Groups::Items(128)).unwrap();
    rec.dispatch(&probe, &[&source, &results], &subgroup_probe::Push { width: 32 }, Groups::Items(128)).unwrap();
    rec
}

#[test]
fn layer_reports_a_removed_barrier() {
    let Some(gpu) = watched(false) else { return };
    let ticket = write_then_read(&gpu).submit().unwrap();
    gpu.wait(ticket).unwrap();
    common::assert_no_messages(&gpu);
    let mut rec = write_then_read(&gpu);
    rec.omit_barrier(0);
    gpu.wait(rec.submit().unwrap()).unwrap();
    let messages = gpu.validation_messages();
    assert!(messages.iter().any(|m| m.contains("READ_AFTER_WRITE") || m.contains("READ-AFTER-WRITE")), "{messages:?}");
}

#[test]
fn checker_reports_a_removed_barrier_before_the_device_runs() {
    let Some(gpu) = common::gpu_with(|o| o.check_hazards = true) else { return };
    let mut rec = write_then_read(&gpu);
    rec.omit_barrier(0);
    let error = rec.submit().unwrap_err();
    assert!(
        matches!(&error, Error::Hazard(text) if text.contains("buffer source") && text.contains("fill")),
        "{error}"
    );
    assert_eq!(gpu.stats().submits, 0);
    // The engine stays usable, and no longer relies on the order of the refused submit.
    write_then_read(&gpu).submit().unwrap();
}

/// Fills, copies, uploads, indirect counts, dispatches over slices, and reads by the host.
fn everything(gpu: &Gpu, a: &Buffer, b: &Buffer, args: &Buffer, ring: &Buffer) -> Recorder {
    let fill = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    let probe = gpu.pipeline(&subgroup_probe::EMULATED.kernel, &[]).unwrap();
    let push = fill::Push { count: 128, value: 1 };
    let mut rec = gpu.recorder("everything").unwrap();
    rec.upload(args, 0, bytemuck::cast_slice(&[1_u32, 1, 1, 0])).unwrap();
    rec.fill(a, 3).unwrap();
    rec.dispatch(&fill, &[a], &push, Groups::Indirect(args, 0)).unwrap();
    rec.dispatch(&probe, &[a, b], &subgroup_probe::Push { width: 32 }, Groups::Items(128)).unwrap();
    rec.copy(b, 0, ring, 0, 64).unwrap();
    rec.dispatch(&fill, &[a], &push, Groups::Indirect(args, 0)).unwrap();
    rec.dispatch(&fill, &[b.slice(0..512)], &push, Groups::Items(128)).unwrap();
    rec.dispatch(&fill, &[b.slice(512..1024)], &push, Groups::Items(128)).unwrap();
    rec.copy(b, 256, a, 0, 512).unwrap();
    rec.copy(a, 0, b, 0, 256).unwrap();
    rec.fill(args, 0).unwrap();
    rec
}

#[test]
fn checker_misses_every_barrier_also_across_submits() {
    let Some(gpu) = common::gpu_with(|o| o.check_hazards = true) else { return };
    let a = gpu.buffer("a", 4 * 128, Memory::Device).unwrap();
    let b = gpu.buffer("b", 4 * 128 * subgroup_probe::RESULTS as u64, Memory::Device).unwrap();
    let args = gpu.buffer("args", 16, Memory::Device).unwrap();
    let ring = gpu.buffer("ring", 64, Memory::Readback).unwrap();
    let mut totals = Vec::new();
    for _ in 0..3 {
        let rec = everything(&gpu, &a, &b, &args, &ring);
        let (total, unmissed) = gpu.missed_barriers(&rec).unwrap();
        assert!(unmissed.is_empty(), "{unmissed:?}");
        totals.push(total);
        rec.submit().unwrap();
    }
    // From the second submit on, there are also barriers against the submit before.
    assert!(totals[0] >= 12 && totals[1] > totals[0] && totals[1] == totals[2], "{totals:?}");
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
}

#[test]
fn readers_and_strangers_run_without_barriers() {
    let Some(gpu) = common::gpu() else { return };
    let source = gpu.buffer("source", 4 * 128, Memory::Device).unwrap();
    let probe = gpu.pipeline(&subgroup_probe::EMULATED.kernel, &[]).unwrap();
    let mut rec = gpu.recorder("readers").unwrap();
    for _ in 0..4 {
        let results = gpu.buffer("results", 4 * 128 * subgroup_probe::RESULTS as u64, Memory::Device).unwrap();
        rec.dispatch(&probe, &[&source, &results], &subgroup_probe::Push { width: 32 }, Groups::Items(128)).unwrap();
    }
    let ticket = rec.submit().unwrap();
    gpu.wait(ticket).unwrap();
    assert_eq!((gpu.stats().dispatches, gpu.stats().barriers), (4, 0));
}

#[test]
fn guards_report_a_write_past_the_end() {
    let Some(gpu) = common::gpu_with(|o| o.canaries = true) else { return };
    let fill = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    let below = gpu.buffer("below", 4 * 100, Memory::Device).unwrap();
    let victim = gpu.buffer("victim", 4 * 100, Memory::Device).unwrap();
    let run = |count: u32| {
        let mut rec = gpu.recorder("faulty").unwrap();
        rec.fill(&below, 0).unwrap();
        rec.dispatch(&fill, &[&victim], &fill::Push { count, value: 0x77 }, Groups::Items(u64::from(count))).unwrap();
        rec.submit().unwrap();
    };
    run(100);
    gpu.check_canaries().unwrap();
    // A shader that believes the buffer to be three words longer.
    run(103);
    match gpu.check_canaries() {
        Err(Error::Overrun { buffer, size, offset, value }) => {
            assert_eq!((buffer.as_str(), size, offset, value), ("victim", 400, 400, 0x77));
        }
        other => panic!("the write past the end was not detected: {other:?}"),
    }
    // Reported once; the guard is whole again with the next submit.
    run(100);
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
}

/// Run by the test below in a process of its own, where the loader finds no layers.
#[test]
#[ignore = "a part of missing_layer_is_an_error"]
fn open_without_layers() {
    let options = OpenOptions { validation: Validation::CoreAndSync, ..OpenOptions::default() };
    println!("opened: {:?}", Gpu::open(&options).err());
}

#[test]
fn missing_layer_is_an_error() {
    if common::gpu().is_none() {
        return;
    }
    let empty = tempfile::tempdir().unwrap();
    let output = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "open_without_layers", "--ignored", "--nocapture"])
        .env("VK_LAYER_PATH", empty.path())
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("opened: Some(MissingLayer"), "{text}");
}
