//! The mask of a photograph.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use psrgs_vk_fuzz::datasets::load;
use psrgs_vk_fuzz::{Scratch, begin, seeds, within};

static FOLDER: LazyLock<Scratch> = LazyLock::new(|| {
    let scratch = Scratch::new();
    let picture = seeds::pictures::photographs().swap_remove(1);
    for name in ["images/a.png", "images/b.png"] {
        scratch.put(name, &picture);
    }
    scratch.put("transforms.json", &seeds::folders::transforms()[2]);
    scratch
});

fuzz_target!(init: begin(seeds::pictures::photographs), |data: &[u8]| {
    FOLDER.put("masks/a.png", data);
    within(data.len(), 1100 * 128, || {
        for view in load(&FOLDER, true).iter().flat_map(|dataset| &dataset.views) {
            if let Ok(photograph) = view.photograph() {
                assert_eq!((photograph.width, photograph.height), (view.camera.width, view.camera.height));
            }
        }
    });
});
