//! A panic of a host's callback reaches the host, and the engine stays usable.

use std::ffi::c_void;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use psrgs_vk::pass::fill;
use psrgs_vk::vk::ash::vk;
use psrgs_vk::vk::{
    Buffer, Gpu, Groups, HostAllocator, Memory, MemoryBlock, MemoryRequest, OpenOptions, QueueLock, Recorder,
};

use super::embed::host::memory::Allocator;
use super::{common, embed, host};

const NEVER: u8 = 0;
const FIRST: u8 = 1;
const SECOND: u8 = 2;

/// Panics at a chosen place.
struct Fuse(AtomicU8);

impl Fuse {
    fn pass(&self, place: u8) {
        assert_ne!(self.0.load(Ordering::SeqCst), place, "the host's own panic");
    }

    /// Runs `run`, which must end in the host's panic at `place`.
    fn blown<T>(&self, place: u8, run: impl FnOnce() -> T) {
        self.0.store(place, Ordering::SeqCst);
        let Err(panic) = catch_unwind(AssertUnwindSafe(run)) else { panic!("the panic was swallowed") };
        let said = panic.downcast_ref::<String>().cloned().unwrap_or_default();
        assert!(said.contains("the host's own panic"), "{said}");
        self.0.store(NEVER, Ordering::SeqCst);
    }
}

/// An engine whose host panics before taking the lock (the first place), or after giving the lock back (the second).
fn with_lock(host: &embed::host::Host) -> (Gpu, Arc<Fuse>) {
    let fuse = Arc::new(Fuse(AtomicU8::new(NEVER)));
    let (locks, unlocks, taken, given) = (fuse.clone(), fuse.clone(), host.turn.clone(), host.turn.clone());
    let mut description = host.describe(None);
    description.lock = Some(QueueLock {
        lock: Box::new(move || {
            locks.pass(FIRST);
            taken.take();
        }),
        unlock: Box::new(move || {
            given.give();
            unlocks.pass(SECOND);
        }),
    });
    // SAFETY: the handles are those of a live host that outlives the engine.
    let gpu = unsafe { Gpu::adopt(description, &OpenOptions::default()) }.unwrap();
    (gpu, fuse)
}

/// A dispatch that sets all words of a buffer.
fn set(gpu: &Gpu, target: &Buffer, value: u32) -> Recorder {
    let pipeline = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
    let mut rec = gpu.recorder("set").unwrap();
    rec.dispatch(&pipeline, &[target], &fill::Push { count: 16, value }, Groups::Items(16)).unwrap();
    rec
}

fn copy(gpu: &Gpu, from: &Buffer, to: &Buffer) -> Recorder {
    let mut rec = gpu.recorder("copy").unwrap();
    rec.copy(from, 0, to, 0, 64).unwrap();
    rec
}

#[test]
fn barriers_lost_with_a_panicked_lock_are_recorded_again() {
    let Some(host) = host() else { return };
    let (gpu, fuse) = with_lock(&host);
    let [source, target, never] = ["source", "target", "never"].map(|n| gpu.buffer(n, 64, Memory::Device).unwrap());
    set(&gpu, &source, 1).submit().unwrap();
    let before = (gpu.last_ticket(), gpu.stats());
    // The lost submit would have waited for the writer of the source.
    fuse.blown(FIRST, || copy(&gpu, &source, &never).submit());
    assert_eq!((gpu.last_ticket(), gpu.stats()), before, "nothing was submitted");
    // The copy needs the lost barrier: one barrier over everything, and no other, because nothing has used the target.
    let ticket = copy(&gpu, &source, &target).submit().unwrap();
    assert_eq!(gpu.stats().barriers, before.1.barriers + 1);
    gpu.wait(ticket).unwrap();
    assert_eq!(gpu.read::<u32>(&target).unwrap(), [1; 16]);
    gpu.check_canaries().unwrap();
    assert!(!host.turn.is_taken());
}

#[test]
fn work_behind_whose_submit_the_host_panicked_is_kept_track_of() {
    let Some(host) = host() else { return };
    let (gpu, fuse) = with_lock(&host);
    let [source, target] = ["source", "target"].map(|n| gpu.buffer(n, 64, Memory::Device).unwrap());
    let before = gpu.last_ticket();
    fuse.blown(SECOND, || set(&gpu, &source, 3).submit());
    let last = gpu.last_ticket();
    assert_eq!(last.value(), before.value() + 1, "the device has the work, and signals its value");
    gpu.wait(last).unwrap();
    assert_eq!(copy(&gpu, &source, &target).submit().unwrap().value(), last.value() + 1);
    assert_eq!(gpu.read::<u32>(&target).unwrap(), [3; 16]);
}

/// The host's allocator, which panics before giving memory (the first place) or in mapping memory (the second).
struct Nervous {
    inner: Arc<Allocator>,
    fuse: Arc<Fuse>,
}

// SAFETY: blocks are those of the inner allocator.
unsafe impl HostAllocator for Nervous {
    fn allocate(&self, request: &MemoryRequest<'_>) -> Result<MemoryBlock, vk::Result> {
        self.fuse.pass(FIRST);
        self.inner.allocate(request)
    }

    fn map(&self, block: &MemoryBlock) -> Result<NonNull<c_void>, vk::Result> {
        self.fuse.pass(SECOND);
        self.inner.map(block)
    }

    fn free(&self, block: MemoryBlock) {
        self.inner.free(block);
    }
}

#[test]
fn a_host_that_panics_in_its_allocator_loses_no_memory() {
    let Some(host) = host() else { return };
    let (inner, fuse) = (Allocator::new(&host), Arc::new(Fuse(AtomicU8::new(NEVER))));
    let allocator = Arc::new(Nervous { inner: inner.clone(), fuse: fuse.clone() });
    // SAFETY: the handles are those of a live host that outlives the engine.
    let gpu = unsafe { Gpu::adopt(host.describe(Some(allocator)), &OpenOptions::default()) }.unwrap();
    let before = (inner.lent().0, gpu.memory_use().current);
    for place in [FIRST, SECOND] {
        fuse.blown(place, || gpu.buffer("b", 64, Memory::Readback));
        assert_eq!((inner.lent().0, gpu.memory_use().current), before);
    }
    let buffer = gpu.buffer("b", 64, Memory::Device).unwrap();
    gpu.write(&buffer, &[5_u32; 16]).unwrap();
    assert_eq!(gpu.read::<u32>(&buffer).unwrap(), [5; 16]);
    common::assert_no_messages(&gpu);
}
