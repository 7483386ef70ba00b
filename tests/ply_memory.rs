//! Memory use of the readers of PLY files, counted by an allocator of this test.

use std::alloc::{GlobalAlloc, Layout, System};
use std::fs;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use psrgs_vk::format::ply::{self, Cloud};

struct Counting;

static NOW: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is forwarded unchanged to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        PEAK.fetch_max(NOW.fetch_add(layout.size(), Relaxed) + layout.size(), Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(block, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Peak of the bytes in use while `read` runs, beyond those in use before.
fn peak<T>(read: impl FnOnce() -> T) -> usize {
    let before = NOW.load(Relaxed);
    PEAK.store(before, Relaxed);
    let kept = read();
    let most = PEAK.load(Relaxed) - before;
    drop(kept);
    most
}

/// A binary PLY of `rows` vertices with these properties, all 0 except for `rot_0`, which is 1.
fn ply_of(rows: usize, floats: &[&str], bytes: &[&str]) -> Vec<u8> {
    let properties = floats.iter().map(|name| format!("property float {name}\n"));
    let colours = bytes.iter().map(|name| format!("property uchar {name}\n"));
    let all: String = properties.chain(colours).collect();
    let mut file =
        format!("ply\nformat binary_little_endian 1.0\nelement vertex {rows}\n{all}end_header\n").into_bytes();
    let value = |name: &&str| if *name == "rot_0" { 1.0_f32 } else { 0.0 };
    let row: Vec<u8> = floats.iter().flat_map(|name| value(name).to_le_bytes()).collect();
    for _ in 0..rows {
        file.extend(&row);
        file.extend(vec![7; bytes.len()]);
    }
    file
}

/// The only test of this file, because nothing else may allocate meanwhile.
#[test]
fn reading_a_ply_takes_a_small_multiple_of_its_size() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("a.ply");
    let splat = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let splat: Vec<&str> = splat.split(' ').collect();
    for rows in [20_000, 200_000] {
        // Splats have 59 values in memory, and 14 in a file of degree 0.
        let bytes = ply_of(rows, &splat, &[]);
        fs::write(&file, &bytes).expect("written");
        let taken = peak(|| ply::read(&file).expect("a model"));
        assert!(taken < 6 * bytes.len() + (1 << 20), "{taken} bytes for {} of splats", bytes.len());
        let bytes = ply_of(rows, &["x", "y", "z"], &["red", "green", "blue"]);
        fs::write(&file, &bytes).expect("written");
        let taken = peak(|| Cloud::read(&file).expect("a cloud"));
        // Positions and colours are read as f64, 48 bytes for 15, into vectors that grow to twice their size.
        assert!(taken < 8 * bytes.len() + (1 << 20), "{taken} bytes for {} of points", bytes.len());
    }
    // A header that claims more rows than the file has: no memory for missing rows.
    let mut bytes = ply_of(1000, &splat, &[]);
    let at = bytes.windows(5).position(|five| five == b"1000\n").expect("the count");
    bytes.splice(at..at + 4, *b"900000000");
    fs::write(&file, &bytes).expect("written");
    let taken = peak(|| ply::read(&file).map(drop).expect_err("too few rows"));
    assert!(taken < 6 * bytes.len() + (1 << 20), "{taken} bytes for a claim");
}
