//! Models in the format SPZ.
#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use psrgs_vk::format::splats::spz;
use psrgs_vk_fuzz::{begin, seeds, within};

fuzz_target!(init: begin(seeds::splats::spz), |data: &[u8]| {
    within(data.len(), 4096, || seeds::splats::check(spz::decode(Path::new("input.spz"), data, false)));
});
