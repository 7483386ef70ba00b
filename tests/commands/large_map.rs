//! `map` of 2,000 x 2,000 cells: windows without seams, overviews, cells without data, and memory.

use std::fs;
use std::path::Path;
use std::time::Duration;

use psrgs_vk::format::georaster::GeoRaster;
use tiff::decoder::{Decoder, DecodingResult};

use crate::mapping::cameras;
use crate::run::{command, shared, strs, text};

const SIDE: usize = 2000;
const GSD: f64 = 0.04;
/// Bytes that a map of many windows may take beyond one of 250 x 150 cells. Measured: 176 MiB, of which 134 are those of
/// one window of 1,024 x 1,024 cells; all cells at a time would take 500.
const MOST: u64 = 240 << 20;

/// Runs a command to its end; the result is the peak of the process's resident set in bytes, where the system tells.
fn peak_of(args: &[&str]) -> Option<u64> {
    let mut child = command(args).arg("-q").spawn().expect("the command starts");
    let file = format!("/proc/{}/status", child.id());
    let mut peak = None;
    let status = loop {
        // The highest mark so far; nothing is left of it at the end of the process.
        let mark = |text: String| -> Option<u64> {
            let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:").map(str::to_owned))?;
            line.trim().strip_suffix(" kB")?.parse().ok()
        };
        peak = peak.max(fs::read_to_string(&file).ok().and_then(mark));
        if let Some(status) = child.try_wait().expect("a status") {
            break status;
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    assert!(status.success(), "{args:?}");
    peak.map(|kib| kib * 1024)
}

/// Width, height and values of every picture of a file: the full one, then ever smaller ones.
fn levels(file: &Path) -> Vec<(u32, u32, Vec<f32>)> {
    let mut decoder = Decoder::new(fs::File::open(file).expect("a file")).expect("a TIFF");
    let mut found = Vec::new();
    loop {
        let (width, height) = decoder.dimensions().expect("a size");
        let DecodingResult::F32(values) = decoder.read_image().expect("a picture") else { panic!("no floats") };
        found.push((width, height, values));
        if !decoder.more_images() {
            return found;
        }
        decoder.next_image().expect("a picture");
    }
}

#[test]
fn maps_of_many_windows_have_no_seams_and_little_memory() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    let (model, data) = (shared.model(), cameras(shared, folder.path()));
    let gsd = GSD.to_string();
    let args = |out: &'static str, bounds: &'static str| {
        let ends = ["map", text(&model), "--cameras", text(&data), "--gsd", &gsd, "--bounds", bounds, "--out"];
        ends.into_iter().map(str::to_owned).chain([text(&path(out)).to_owned()]).collect::<Vec<_>>()
    };
    // Cells 900 to 1,150 from the west and 940 to 1,090 from the north: the corner of four windows of 1,024 cells.
    let [small, large] =
        [args("part", "-4,-3.6,6,2.4"), args("whole", "-40,-40,40,40")].map(|args| peak_of(&strs(&args)));
    println!("peaks: {small:?} and {large:?} bytes");
    let bounded = small.zip(large).is_none_or(|(small, large)| large < small + MOST);
    assert!(bounded, "{large:?} bytes, and {small:?} of a small map");
    for name in ["dsm.tif", "orthophoto.tif", "quality.tif"] {
        let [all, some] = ["whole", "part"].map(|out| GeoRaster::read(&path(out).join(name)).expect("a map"));
        assert_eq!((all.width, all.height, some.width, some.height), (SIDE, SIDE, 250, 150), "{name}");
        let bands = all.bands;
        let bits = |map: &GeoRaster, x: usize, y: usize| -> Vec<u32> {
            map.values[bands * (y * map.width + x)..][..bands].iter().map(|v| v.to_bits()).collect()
        };
        let known = some.values.iter().filter(|v| v.is_finite() && **v != 0.0).count();
        assert!(known > 1000, "{name}: {known} values");
        for (x, y) in (0..150).flat_map(|y| (0..250).map(move |x| (x, y))) {
            assert_eq!(bits(&some, x, y), bits(&all, 900 + x, 940 + y), "{name}: cell {x} {y}");
        }
    }
    let heights = levels(&path("whole").join("dsm.tif"));
    assert_eq!(
        heights.iter().map(|level| (level.0, level.1)).collect::<Vec<_>>(),
        [(2000, 2000), (1000, 1000), (500, 500)]
    );
    let is_known = |v: &f32| *v != psrgs_vk::format::geotiff::NO_DATA;
    let without = heights[0].2.iter().filter(|v| !is_known(v)).count();
    assert!(without > 1000 && without < SIDE * SIDE - 1000, "{without} cells without data");
    // An overview has the mean of those of four cells that have a height.
    for pair in heights.windows(2) {
        let ((width, _, fine), (half, _, coarse)) = (&pair[0], &pair[1]);
        for (k, got) in coarse.iter().enumerate() {
            let (x, y) = (2 * (k % *half as usize), 2 * (k / *half as usize));
            let at = |x: usize, y: usize| fine[y * *width as usize + x];
            let four = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
            let some: Vec<f64> = four.iter().filter(|v| is_known(v)).map(|v| f64::from(*v)).collect();
            if some.is_empty() {
                assert!(!is_known(got), "{got} at {k}");
            } else {
                let want = some.iter().sum::<f64>() / some.len() as f64;
                assert!((f64::from(*got) - want).abs() < 1e-3, "{got} for {want} at {k}");
            }
        }
    }
}
