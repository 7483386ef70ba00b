//! Surface models and orthophotos as GeoTIFF, and check points. The first byte chooses.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use psrgs_vk::format::georaster::GeoRaster;
use psrgs_vk::geodesy::ReferenceSystem;
use psrgs_vk::map::accuracy::CheckPoints;
use psrgs_vk_fuzz::{Scratch, begin, choice, seeds, within};

static FOLDER: LazyLock<Scratch> = LazyLock::new(Scratch::new);
static SYSTEM: LazyLock<Option<ReferenceSystem>> = LazyLock::new(|| ReferenceSystem::epsg(32_632).ok());

fuzz_target!(init: begin(seeds::places::rasters), |data: &[u8]| {
    let (kind, bytes) = choice(data);
    let file = FOLDER.put("input.tif", bytes);
    // Deflated floats, four bytes of each sample twice.
    within(bytes.len(), 4 * 2048 * 3, || match kind % 2 {
        0 => match GeoRaster::read(&file) {
            Ok(found) => {
                assert_eq!(found.values.len(), found.width * found.height * found.bands);
                let [east, north] = found.corner;
                let place = [east + 0.7 * found.pixel[0], north - 0.7 * found.pixel[1]];
                found.at(found.bands - 1, place);
            }
            Err(error) => assert!(error.to_string().contains("input.tif")),
        },
        _ => match CheckPoints::read(&file, SYSTEM.as_ref()) {
            Ok(found) => {
                assert_eq!(found.names.len(), found.places.len());
                assert!(!found.places.is_empty());
            }
            Err(error) => assert!(error.to_string().contains("input.tif")),
        },
    });
});
