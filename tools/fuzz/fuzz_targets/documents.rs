//! The small files beside a model, and the parameters of a world. The first byte chooses the file.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use psrgs_vk::eval::Metrics;
use psrgs_vk::format::{ExposureFile, FrameFile, read_transform};
use psrgs_vk::geodesy::Georeference;
use psrgs_vk::world::WorldParams;
use psrgs_vk_fuzz::{Scratch, begin, choice, seeds, within};

static FOLDER: LazyLock<Scratch> = LazyLock::new(Scratch::new);

fuzz_target!(init: begin(seeds::documents::beside_models), |data: &[u8]| {
    let (kind, bytes) = choice(data);
    let file = FOLDER.put("input", bytes);
    within(bytes.len(), 1024, || match kind % 5 {
        0 => {
            if let Ok(frame) = FrameFile::read(&file) {
                frame.write(&file).expect("a frame that was read can be written");
                assert_eq!(FrameFile::read(&file).expect("and read again"), frame);
                if let Some(map) = &frame.map {
                    drop(Georeference::of_record(map, frame.coordinates.as_ref()).map(|found| found.to_map([1.0; 3])));
                }
            }
        }
        1 => {
            if let Ok(similarity) = read_transform(&file) {
                assert!(similarity.scale > 0.0 && similarity.scale.is_finite());
                assert!(similarity.rotation.iter().flatten().chain(&similarity.translation).all(|v| v.is_finite()));
            }
        }
        2 => drop(ExposureFile::read(&file)),
        3 => drop(Metrics::read(&file)),
        _ => {
            let text = std::str::from_utf8(bytes).unwrap_or_default();
            drop(toml::from_str::<WorldParams>(text).map(|params| params.validate()));
        }
    });
});
