//! OpenSfM's `reconstruction.json`.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use psrgs_vk_fuzz::datasets::load;
use psrgs_vk_fuzz::{Scratch, begin, seeds, within};

static FOLDER: LazyLock<Scratch> = LazyLock::new(Scratch::new);

fuzz_target!(init: begin(seeds::folders::reconstructions), |data: &[u8]| {
    FOLDER.put("reconstruction.json", data);
    within(data.len(), 256, || load(&FOLDER, false));
});
