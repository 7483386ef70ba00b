//! nerfstudio's `transforms.json`, beside photographs, a mask and points.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use psrgs_vk_fuzz::datasets::load;
use psrgs_vk_fuzz::{Scratch, begin, seeds, within};

static FOLDER: LazyLock<Scratch> = LazyLock::new(|| {
    let scratch = Scratch::new();
    let picture = seeds::pictures::photographs().swap_remove(0);
    for name in ["images/a.png", "images/b.png", "masks/a.png"] {
        scratch.put(name, &picture);
    }
    scratch.put("points.ply", &seeds::clouds::ply()[2]);
    scratch
});

fuzz_target!(init: begin(seeds::folders::transforms), |data: &[u8]| {
    FOLDER.put("transforms.json", data);
    within(data.len(), 256, || [false, true].map(|photographs| load(&FOLDER, photographs)));
});
