//! Models as glTF, and `.splat` files, as the first byte says.
#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use psrgs_vk::format::splats::{gltf, splat};
use psrgs_vk_fuzz::{begin, choice, seeds, within};

fuzz_target!(init: begin(seeds::splats::glb), |data: &[u8]| {
    let (format, data) = choice(data);
    let file = Path::new("input.bin");
    within(data.len(), 4096, || {
        seeds::splats::check(if format % 2 == 0 { gltf::decode(file, data, false) } else { splat::decode(file, data, false) });
    });
});
