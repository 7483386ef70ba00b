//! An allocator that counts bytes, and ends the process if a reader takes more memory than its file may cause.
//!
//! libFuzzer's `-malloc_limit_mb` sees single allocations, and only with a sanitizer. This allocator sees their sum in
//! every build.

use std::alloc::{GlobalAlloc, Layout, System};
use std::backtrace::Backtrace;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Bytes that a reader may take for any file: buffers, tables, stacks of threads.
const BASE: usize = 64 << 20;

static LIVE: AtomicUsize = AtomicUsize::new(0);
static LIMIT: AtomicUsize = AtomicUsize::new(usize::MAX);

struct Bounded;

#[global_allocator]
static ALLOCATOR: Bounded = Bounded;

fn take(bytes: usize) {
    let live = LIVE.fetch_add(bytes, Ordering::Relaxed).saturating_add(bytes);
    if live > LIMIT.load(Ordering::Relaxed) {
        over(bytes, live);
    }
}

fn give_back(bytes: usize) {
    LIVE.fetch_sub(bytes, Ordering::Relaxed);
}

#[cold]
fn over(bytes: usize, live: usize) {
    // The message takes memory too.
    let limit = LIMIT.swap(usize::MAX, Ordering::Relaxed);
    if limit == usize::MAX {
        return;
    }
    eprintln!("MEMORY: {bytes} bytes more make {live}, {limit} are allowed\n{}", Backtrace::force_capture());
    std::process::abort();
}

// `GlobalAlloc` requires unsafe code. Each call is passed on unchanged.
unsafe impl GlobalAlloc for Bounded {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        take(size);
        give_back(layout.size());
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        give_back(layout.size());
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// No bound until the next [`within`]: the message of a panic takes memory.
pub fn lift() {
    LIMIT.store(usize::MAX, Ordering::Relaxed);
}

/// Runs `work`, which may take 64 MiB and `bytes_for_each` bytes for each byte of its file.
pub fn within<T>(file: usize, bytes_for_each: usize, work: impl FnOnce() -> T) -> T {
    let allowed = BASE.saturating_add(file.saturating_mul(bytes_for_each));
    LIMIT.store(LIVE.load(Ordering::Relaxed).saturating_add(allowed), Ordering::Relaxed);
    let out = work();
    lift();
    out
}
