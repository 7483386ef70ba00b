//! Depths and normals in OpenEXR files.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use psrgs_vk::format::image_out;
use psrgs_vk_fuzz::{Scratch, begin, seeds, within};

static FOLDER: LazyLock<Scratch> = LazyLock::new(Scratch::new);

fuzz_target!(init: begin(seeds::pictures::maps), |data: &[u8]| {
    let file = FOLDER.put("input.exr", data);
    within(data.len(), 1100 * 16, || {
        if let Ok(map) = image_out::read_depth(&file) {
            assert_eq!(map.values.len() as u64, u64::from(map.width) * u64::from(map.height));
        }
        if let Ok(map) = image_out::read_normals(&file) {
            assert_eq!(map.values.len() as u64, u64::from(map.width) * u64::from(map.height));
        }
    });
});
