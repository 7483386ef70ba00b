//! Files of ground control points, and reference systems. The first byte chooses.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use psrgs_vk::dataset::georeference::ControlPoints;
use psrgs_vk::geodesy::{Georeference, ReferenceSystem};
use psrgs_vk::scene::{Coordinates, Geodetic};
use psrgs_vk_fuzz::{Scratch, begin, choice, seeds, within};

static FOLDER: LazyLock<Scratch> = LazyLock::new(Scratch::new);
const PLACE: Geodetic = Geodetic { latitude: 47.65, longitude: 10.3, altitude: 740.0 };

fuzz_target!(init: begin(seeds::places::control_points), |data: &[u8]| {
    let (kind, bytes) = choice(data);
    let file = FOLDER.put("gcp_list.txt", bytes);
    within(bytes.len(), 1024, || match kind % 2 {
        0 => match ControlPoints::read(&file) {
            Ok(points) => {
                assert!(!points.marks.is_empty());
                for mark in &points.marks {
                    assert!(mark.place.iter().chain(&mark.pixel).all(|v| v.is_finite()), "{mark:?}");
                }
            }
            Err(error) => assert!(!error.to_string().is_empty()),
        },
        _ => {
            let Ok(system) = ReferenceSystem::parse(&String::from_utf8_lossy(bytes)) else { return };
            system.to_geodetic(system.from_geodetic(PLACE));
            assert!(!system.wkt().is_empty());
            let coordinates = Coordinates::EastNorthUp { origin: PLACE };
            if let Ok(found) = Georeference::of_coordinates(&coordinates, Some(system)) {
                let at = found.to_map([1.0, 2.0, 3.0]);
                assert!(at.iter().all(|v| v.is_finite()), "{at:?}");
            }
        }
    });
});
