//! Laser scans, compressed or not.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use psrgs_vk::format::las;
use psrgs_vk_fuzz::{Scratch, begin, seeds, within};

static FOLDER: LazyLock<Scratch> = LazyLock::new(Scratch::new);

/// The decoder of LAZ panics on damaged data, and the reader contains it: only what leaves the reader is a finding, which libFuzzer's
/// wrapper sees as it unwinds. `PSRGS_FUZZ_PANICS=1` shows them all.
fn panics_may_be_contained() {
    if std::env::var_os("PSRGS_FUZZ_PANICS").is_none() {
        std::panic::set_hook(Box::new(|_| ()));
    } else {
        drop(std::panic::take_hook());
    }
}

fuzz_target!(init: { begin(seeds::clouds::scans); panics_may_be_contained() }, |data: &[u8]| {
    let file = FOLDER.put("input.las", data);
    within(data.len(), 1024, || {
        match las::read(&file) {
            Ok(positions) => assert!(positions.iter().flatten().all(|v| v.is_finite())),
            Err(error) => assert!(error.to_string().contains("input.las")),
        }
    });
});
