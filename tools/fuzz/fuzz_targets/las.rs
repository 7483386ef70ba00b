//! Laser scans, compressed or not.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use psrgs_vk::format::las;
use psrgs_vk_fuzz::{Scratch, begin, seeds, within};

static FOLDER: LazyLock<Scratch> = LazyLock::new(Scratch::new);

fuzz_target!(init: begin(seeds::clouds::scans), |data: &[u8]| {
    let file = FOLDER.put("input.las", data);
    within(data.len(), 1024, || {
        match las::read(&file) {
            Ok(positions) => assert!(positions.iter().flatten().all(|v| v.is_finite())),
            Err(error) => assert!(error.to_string().contains("input.las")),
        }
    });
});
