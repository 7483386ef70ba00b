//! Models in the format SOG.
#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use psrgs_vk::format::splats::sog;
use psrgs_vk_fuzz::{begin, seeds, within};

fuzz_target!(init: begin(seeds::splats::sog), |data: &[u8]| {
    within(data.len(), 4096, || seeds::splats::check(sog::decode(Path::new("input.sog"), data, false)));
});
