//! The position that a photograph notes in EXIF and XMP.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use psrgs_vk::dataset::georeference::noted_position;
use psrgs_vk_fuzz::{Scratch, begin, seeds, within};

static FOLDER: LazyLock<Scratch> = LazyLock::new(Scratch::new);

fuzz_target!(init: begin(seeds::places::photographs), |data: &[u8]| {
    let file = FOLDER.put("a.jpg", data);
    within(data.len(), 64, || {
        let Some(at) = noted_position(&file) else { return };
        assert!(at.latitude.abs() <= 90.0 && at.longitude.abs() <= 180.0, "{at:?}");
        assert!(at.altitude.is_none_or(f64::is_finite), "{at:?}");
        assert!([at.horizontal, at.vertical].into_iter().flatten().all(|metres| metres > 0.0), "{at:?}");
    });
});
