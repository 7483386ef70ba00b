//! The device layer on small tasks: fills between garbage, folded and indirect dispatches, copies, reads and writes.

mod common;

use psrgs_vk::pass::fill;
use psrgs_vk::vk::{Error, Groups, Memory};

#[test]
fn fill_writes_its_words_and_no_others() {
    let Some(gpu) = common::gpu() else { return };
    for count in [0_u32, 1, 63, 64, 65, 1000] {
        let words = 1024;
        let target = gpu.buffer("target", 4 * words, Memory::Device).unwrap();
        gpu.write(&target, &vec![0xdead_beef_u32; words as usize]).unwrap();
        let pipeline = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
        let mut rec = gpu.recorder("fill").unwrap();
        rec.dispatch(&pipeline, &[&target], &fill::Push { count, value: 7 }, Groups::Items(u64::from(count))).unwrap();
        rec.submit().unwrap();
        let got: Vec<u32> = gpu.read(&target).unwrap();
        assert!(got[..count as usize].iter().all(|&w| w == 7));
        assert!(got[count as usize..].iter().all(|&w| w == 0xdead_beef));
    }
    common::assert_no_messages(&gpu);
}

#[test]
fn seventy_thousand_workgroups_fold() {
    let Some(gpu) = common::gpu() else { return };
    let count = 70_000 * 64;
    let target = gpu.buffer("target", 4 * count, Memory::Device).unwrap();
    let pipeline = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    for groups in [Groups::Items(count), Groups::Workgroups(70_000)] {
        let mut rec = gpu.recorder("many").unwrap();
        rec.fill(&target, 1).unwrap();
        rec.dispatch(&pipeline, &[&target], &fill::Push { count: count as u32 - 1, value: 2 }, groups).unwrap();
        rec.submit().unwrap();
        let got: Vec<u32> = gpu.read(&target).unwrap();
        assert!(got[..count as usize - 1].iter().all(|&w| w == 2));
        assert_eq!(got[count as usize - 1], 1);
    }
    common::assert_no_messages(&gpu);
}

#[test]
fn indirect_counts_come_from_the_device() {
    let Some(gpu) = common::gpu() else { return };
    let args = gpu.buffer("args", 64, Memory::Device).unwrap();
    let target = gpu.buffer("target", 4 * 256, Memory::Device).unwrap();
    let pipeline = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    let mut rec = gpu.recorder("indirect").unwrap();
    rec.fill(&args, 0).unwrap();
    rec.fill(&target, 9).unwrap();
    rec.upload(&args, 16, bytemuck::cast_slice(&[2_u32, 1, 1])).unwrap();
    let push = fill::Push { count: 256, value: 5 };
    rec.dispatch(&pipeline, &[&target], &push, Groups::Indirect(&args, 16)).unwrap();
    // Zero workgroups: no word may change.
    let nothing = fill::Push { count: 256, value: 6 };
    rec.dispatch(&pipeline, &[&target], &nothing, Groups::Indirect(&args, 0)).unwrap();
    rec.submit().unwrap();
    let got: Vec<u32> = gpu.read(&target).unwrap();
    assert!(got[..128].iter().all(|&w| w == 5));
    assert!(got[128..].iter().all(|&w| w == 9));
    common::assert_no_messages(&gpu);
}

#[test]
fn copies_slices_and_reads() {
    let Some(gpu) = common::gpu() else { return };
    let a = gpu.buffer("a", 1024, Memory::Device).unwrap();
    let b = gpu.buffer("b", 1024, Memory::Device).unwrap();
    let ring = gpu.buffer("ring", 64, Memory::Readback).unwrap();
    let values: Vec<u32> = (0..256).collect();
    gpu.write(&a, &values).unwrap();
    let pipeline = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    let mut rec = gpu.recorder("copies").unwrap();
    rec.fill(&b, 0).unwrap();
    rec.copy(&a, 4, &b, 512, 16).unwrap();
    rec.fill(b.slice(0..8), 77).unwrap();
    let push = fill::Push { count: 2, value: 42 };
    rec.dispatch(&pipeline, &[b.slice(256..512)], &push, Groups::Items(2)).unwrap();
    rec.copy(&b, 512, &ring, 16, 16).unwrap();
    let ticket = rec.submit().unwrap();
    gpu.wait(ticket).unwrap();
    assert_eq!(gpu.read_ready::<u32>(&ring, 16, 4, ticket).unwrap(), Some(vec![1, 2, 3, 4]));
    let got: Vec<u32> = gpu.read(&b).unwrap();
    assert_eq!(got[..3], [77, 77, 0]);
    assert_eq!(got[64..67], [42, 42, 0]);
    assert_eq!(got[127..133], [0, 1, 2, 3, 4, 0]);
    assert_eq!(gpu.read_at::<u32>(&a, 1020, 1).unwrap(), [255]);
    common::assert_no_messages(&gpu);
}

#[test]
fn many_submits_recycle_and_buffers_are_freed() {
    let Some(gpu) = common::gpu() else { return };
    let before = gpu.memory_use().current;
    let pipeline = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    let sum = gpu.buffer("sum", 4 * 64, Memory::Device).unwrap();
    for i in 0..300_u32 {
        let short = gpu.buffer("short-lived", 4 * 64, Memory::Device).unwrap();
        let mut rec = gpu.recorder("many").unwrap();
        for _ in 0..3 {
            rec.dispatch(&pipeline, &[&short], &fill::Push { count: 64, value: i }, Groups::Items(64)).unwrap();
        }
        rec.copy(&short, 0, &sum, 0, 256).unwrap();
        let ticket = rec.submit().unwrap();
        if i % 10 == 9 {
            gpu.wait(ticket).unwrap();
        }
    }
    assert_eq!(gpu.read::<u32>(&sum).unwrap(), vec![299; 64]);
    let stats = gpu.stats();
    assert_eq!((stats.dispatches, stats.host_waits, stats.pacing_waits), (900, 31, 0));
    drop(sum);
    drop(pipeline);
    drop(gpu.recorder("retire"));
    // No staging memory remains, because nothing was uploaded.
    assert_eq!(gpu.memory_use().current, before);
    assert!(gpu.memory_use().peak > before);
    common::assert_no_messages(&gpu);
}

#[test]
fn misuse_is_refused_with_names() {
    let Some(gpu) = common::gpu() else { return };
    let small = gpu.buffer("small", 64, Memory::Device).unwrap();
    let pipeline = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    let mut rec = gpu.recorder("wrong").unwrap();
    let push = fill::Push { count: 1, value: 1 };
    assert!(matches!(rec.fill(small.slice(32..128), 0), Err(Error::BadRange { .. })));
    assert!(matches!(rec.fill(small.slice(2..6), 0), Err(Error::BadRange { .. })));
    assert!(matches!(rec.copy(&small, 0, &small, 8, 16), Err(Error::BadRange { .. })));
    assert!(matches!(rec.upload(&small, 60, &[0; 8]), Err(Error::BadRange { .. })));
    assert!(matches!(gpu.read_at::<u32>(&small, 0, 17), Err(Error::BadRange { .. })));
    let two = rec.dispatch(&pipeline, &[&small, &small], &push, Groups::Items(1));
    assert!(two.unwrap_err().to_string().contains("2 buffers given for 1 bindings"));
    let short = rec.dispatch(&pipeline, &[&small], &1_u32, Groups::Items(1));
    assert!(short.unwrap_err().to_string().contains("4 bytes of push constants given, 8 expected"));
    assert!(gpu.pipeline(&fill::PASS.kernel, &[("NOPE", 1)]).unwrap_err().to_string().contains("NOPE"));
    assert!(rec.is_empty());
}

/// Without a driver, every test of a device would silently pass.
#[test]
fn without_a_driver_a_test_says_that_it_is_skipped_or_fails() {
    let folder = tempfile::tempdir().unwrap();
    let list = folder.path().join("skipped.txt");
    let run = |all: &str| {
        let mut test = std::process::Command::new(std::env::current_exe().unwrap());
        test.args(["--exact", "fill_writes_its_words_and_no_others"]);
        for name in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
            test.env(name, folder.path().join("nowhere.json"));
        }
        test.env("PSRGS_REQUIRE_ALL", all).env("PSRGS_SKIPPED", &list);
        let output = test.output().unwrap();
        let said = [&output.stdout[..], &output.stderr].concat();
        (output.status.success(), String::from_utf8_lossy(&said).into_owned())
    };
    let told = "skipped: fill_writes_its_words_and_no_others: no Vulkan driver";
    let (passes, said) = run("0");
    assert!(passes && said.contains(told), "{said}");
    assert!(std::fs::read_to_string(&list).unwrap().starts_with(told));
    let (passes, said) = run("1");
    assert!(!passes && said.contains("no Vulkan driver"), "{said}");
}

/// New buffers are filled with NaNs on request, so that no pass and no resumed training can rely on zeros.
#[test]
fn new_buffers_hold_no_numbers_where_that_is_asked_for() {
    let Some(gpu) = common::gpu_with(|options| options.garbage = true) else { return };
    for memory in [Memory::Device, Memory::Readback] {
        let buffer = gpu.buffer("new", 40, memory).unwrap();
        let words: Vec<f32> = gpu.read(&buffer).unwrap();
        assert!(words.iter().all(|v| v.is_nan()), "{memory:?}: {words:?}");
        if memory == Memory::Device {
            gpu.write(&buffer, &[1.5_f32; 4]).unwrap();
            let words: Vec<f32> = gpu.read(&buffer).unwrap();
            assert!(words[..4] == [1.5; 4] && words[4..].iter().all(|v| v.is_nan()), "{words:?}");
        }
    }
    common::assert_no_messages(&gpu);
}
