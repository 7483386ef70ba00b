//! A photograph alone, and as the photograph of a camera with a lens.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use psrgs_vk::dataset::Photograph;
use psrgs_vk_fuzz::datasets::load;
use psrgs_vk_fuzz::{Scratch, begin, seeds, within};

/// The camera has no size of its own: the photograph's counts.
const TRANSFORMS: &str = r#"{"camera_angle_x": 0.8, "k1": 0.02, "frames": [{"file_path": "images/a.png",
    "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}]}"#;

static FOLDER: LazyLock<Scratch> = LazyLock::new(|| {
    let scratch = Scratch::new();
    scratch.put("transforms.json", TRANSFORMS.as_bytes());
    scratch
});

fuzz_target!(init: begin(seeds::pictures::photographs), |data: &[u8]| {
    let file = FOLDER.put("images/a.png", data);
    // A byte may hold a thousand bytes of a picture, each of which may be eight pixels of 16 bytes.
    within(data.len(), 1100 * 128, || {
        if let Ok(photograph) = Photograph::read(&file) {
            assert_eq!(photograph.rgba8().len() as u64, 4 * u64::from(photograph.width) * u64::from(photograph.height));
        }
        for view in load(&FOLDER, true).iter().flat_map(|dataset| &dataset.views) {
            if let Ok(photograph) = view.photograph() {
                assert_eq!((photograph.width, photograph.height), (view.camera.width, view.camera.height));
            }
        }
    });
});
