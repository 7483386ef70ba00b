//! Buffers, pipelines, recordings and tickets belong to one device. Memory that host and device share belongs to its
//! current user.

use psrgs_vk::pass::fill;
use psrgs_vk::vk::{Error, Gpu, Groups, Memory, Result, SubmitSync, Ticket};

use super::{adopt, common, host};

/// Checks that the error names an object of another device.
#[track_caller]
fn foreign<T>(result: Result<T>) {
    assert!(matches!(result, Err(Error::Foreign { .. } | Error::ForeignTicket { .. })), "{:?}", result.err());
}

/// A submit that has finished.
fn work(gpu: &Gpu) -> Ticket {
    let target = gpu.buffer("target", 64, Memory::Device).unwrap();
    let mut rec = gpu.recorder("work").unwrap();
    rec.fill(&target, 1).unwrap();
    let ticket = rec.submit().unwrap();
    gpu.wait(ticket).unwrap();
    ticket
}

#[test]
fn what_is_of_another_device_is_refused_by_name() {
    let (Some(gpu), Some(other)) = (common::gpu(), common::gpu()) else { return };
    let (mine, its) =
        (gpu.buffer("mine", 64, Memory::Device).unwrap(), other.buffer("its", 64, Memory::Device).unwrap());
    let landing = other.buffer("landing", 64, Memory::Readback).unwrap();
    let upload = other.buffer("upload", 64, Memory::Upload).unwrap();
    let [pipeline, its_pipeline] = [&gpu, &other].map(|gpu| gpu.pipeline(&fill::PASS.kernel, &[]).unwrap());
    let push = fill::Push { count: 1, value: 1 };
    let mut rec = gpu.recorder("mixed").unwrap();
    foreign(rec.fill(&its, 0));
    foreign(rec.fill(its.slice(0..4), 0));
    foreign(rec.copy(&its, 0, &mine, 0, 4));
    foreign(rec.copy(&mine, 0, &its, 0, 4));
    foreign(rec.upload(&its, 0, &[0; 4]));
    foreign(rec.dispatch(&pipeline, &[&its], &push, Groups::Items(1)));
    foreign(rec.dispatch(&pipeline, &[&mine], &push, Groups::Indirect(&its, 0)));
    foreign(rec.dispatch(&its_pipeline, &[&mine], &push, Groups::Items(1)));
    assert!(rec.is_empty());
    foreign(gpu.read::<u32>(&its));
    foreign(gpu.read_at::<u32>(&landing, 0, 1));
    foreign(gpu.read_slice::<u32>(its.slice(0..4), 1));
    foreign(gpu.read_ready::<u32>(&landing, 0, 1, Ticket::default()));
    foreign(gpu.write(&its, &[1_u32]));
    foreign(gpu.store(&upload, &[0; 4]));
    let recorder = other.recorder("its").unwrap();
    foreign(gpu.describe(&recorder));
    foreign(gpu.missed_barriers(&recorder));
    let said = gpu.read::<u32>(&its).unwrap_err().to_string();
    assert_eq!(said, "buffer its belongs to another device");
    // Nothing reached either device.
    assert_eq!([gpu.stats().submits, other.stats().submits], [0, 0]);
}

#[test]
fn a_ticket_of_another_device_is_refused() {
    let (Some(gpu), Some(other)) = (common::gpu(), common::gpu()) else { return };
    // Both have given out a first ticket, so that their numbers are equal.
    let (own, its) = (work(&gpu), work(&other));
    assert_eq!(own.value(), its.value());
    let landing = gpu.buffer("landing", 64, Memory::Readback).unwrap();
    foreign(gpu.wait(its));
    foreign(gpu.is_done(its));
    foreign(gpu.timings(its));
    foreign(gpu.read_ready::<u32>(&landing, 0, 1, its));
    assert!(gpu.is_done(own).unwrap());
    // A ticket that outlives its device belongs to no device.
    drop(other);
    foreign(gpu.is_done(its));
    foreign(common::gpu().unwrap().is_done(its));
    // The default ticket belongs to no submit and is done on every device.
    assert!(gpu.is_done(Ticket::default()).unwrap());
}

#[test]
fn a_range_that_a_later_submit_writes_is_not_ready() {
    let Some(host) = host() else { return };
    let gpu = adopt(&host);
    let (source, ring) =
        (gpu.buffer("source", 64, Memory::Device).unwrap(), gpu.buffer("ring", 64, Memory::Readback).unwrap());
    let timeline = host.timeline().unwrap();
    let submit = |value: u32, at: u64, wait: &[_]| {
        let mut rec = gpu.recorder("to the ring").unwrap();
        rec.fill(&source, value).unwrap();
        rec.copy(&source, 0, &ring, at, 16).unwrap();
        rec.submit_with(SubmitSync::new(wait, &[])).unwrap()
    };
    submit(1, 0, &[]);
    let first = submit(1, 16, &[]);
    gpu.wait(first).unwrap();
    // Waits for the host, which has not signalled yet.
    let second = submit(2, 0, &[timeline.at(1)]);
    let ready = |at: u64, by: Ticket| gpu.read_ready::<u32>(&ring, at, 1, by).unwrap();
    let [waited, raced, never, elsewhere] =
        [(0, second), (0, first), (12, Ticket::default()), (16, first)].map(|(at, by)| ready(at, by));
    timeline.signal(1).unwrap();
    gpu.wait(second).unwrap();
    assert_eq!(waited, None);
    assert_eq!(raced, None, "the device may write it at any moment");
    assert_eq!(never, None, "the device may write it at any moment, also without a ticket");
    assert_eq!(elsewhere, Some(vec![1]), "nothing in flight writes there");
    assert_eq!(ready(0, first), Some(vec![2]));
}

#[test]
fn memory_in_commands_of_the_host_is_kept_until_they_finish() {
    let Some(host) = host() else { return };
    let (gpu, other) = (adopt(&host), adopt(&host));
    let (ring, upload) =
        (gpu.buffer("ring", 64, Memory::Readback).unwrap(), gpu.buffer("upload", 64, Memory::Upload).unwrap());
    gpu.store(&upload, bytemuck::cast_slice(&[7_u32; 16])).unwrap();
    let (timeline, pool) = (host.timeline().unwrap(), host.commands().unwrap());
    let mut rec = gpu.recorder("for the host").unwrap();
    rec.copy(&upload, 0, &ring, 0, 64).unwrap();
    let commands = pool.begin().unwrap();
    // SAFETY: the recording is kept until the point is reached.
    let recording = unsafe {
        let recording = rec.record_into(commands).unwrap();
        host.device.end_command_buffer(commands).unwrap();
        recording
    };
    let lent = |result: Result<()>| matches!(result, Err(Error::InHostCommands { .. }));
    assert!(lent(gpu.read::<u32>(&ring).map(drop)) && lent(gpu.store(&upload, &[0; 4])));
    assert_eq!(gpu.read_ready::<u32>(&ring, 0, 1, Ticket::default()).unwrap(), None);
    // SAFETY: as above.
    unsafe { host.submit(commands, timeline.at(0), timeline.at(1)) }.unwrap();
    timeline.wait(1, u64::MAX).unwrap();
    let executed = recording.finished();
    assert_eq!(gpu.read_ready::<u32>(&ring, 0, 1, executed).unwrap(), Some(vec![7]));
    assert_eq!(gpu.read::<u32>(&ring).unwrap(), [7; 16]);
    gpu.store(&upload, &[0; 4]).unwrap();
    // A recording of one engine is no proof for buffers of another.
    let its = other.buffer("ring", 64, Memory::Readback).unwrap();
    foreign(other.read_ready::<u32>(&its, 0, 1, executed));
    // SAFETY: the command buffer has run.
    unsafe { pool.reset() }.unwrap();
}
