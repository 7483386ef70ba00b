//! The true map of a world.

use psrgs_vk::format::georaster::GeoRaster;
use psrgs_vk::world::{Effects, LidarParams, World, WorldParams, generate};

use crate::small;

#[test]
fn the_true_map_has_the_heights_and_classes_of_the_world() {
    let dir = tempfile::tempdir().unwrap();
    let lidar = LidarParams { density: 0.02, ..LidarParams::default() };
    let effects = Effects { water: true, ..Effects::none() };
    let params = WorldParams { offpath: 0, max_side: 64, supersample: 1, lidar, effects, ..small() };
    generate(&params, dir.path(), &mut |_| {}).unwrap();
    let world = World::new(&params).unwrap();
    let way = world.georeference().unwrap();
    let read = |name: &str| GeoRaster::read(&dir.path().join("truth").join(name)).unwrap();
    let [heights, bares, colours, classes] = ["dsm.tif", "dtm.tif", "orthophoto.tif", "classes.tif"].map(read);
    let gsd = heights.pixel[0];
    assert_eq!([heights.epsg, colours.epsg, classes.epsg], [Some(32_632); 3]);
    assert_eq!((heights.pixel, heights.corner), (colours.pixel, colours.corner));
    assert_eq!((heights.pixel, heights.corner), (bares.pixel, bares.corner));
    assert!(heights.width as f64 * gsd >= params.extent && (heights.width as f64 - 3.0) * gsd < 1.1 * params.extent);
    // Lines lie at multiples of the cell's side.
    let along = heights.corner.map(|v| v / gsd);
    assert!(along.iter().all(|v| (v - v.round()).abs() < 1e-3), "{along:?}");
    let (mut ground, mut roofs, mut water) = (0, 0, 0);
    for k in 0..heights.width * heights.height {
        let (column, row) = ((k % heights.width) as f64 + 0.5, (k / heights.width) as f64 + 0.5);
        let level = way.to_map([0.0; 3])[2];
        let [x, y, _] = way.to_dataset([heights.corner[0] + gsd * column, heights.corner[1] - gsd * row, level]);
        let bare = way.to_map([x, y, world.terrain().height(x, y)])[2];
        assert!((f64::from(bares.values[k]) - bare).abs() < 2e-3, "{} is not {bare}", bares.values[k]);
        match classes.values[k] as u8 {
            2 => {
                assert!((f64::from(heights.values[k]) - bare).abs() < 2e-3, "{} is not {bare}", heights.values[k]);
                ground += 1;
            }
            6 => {
                assert!(f64::from(heights.values[k]) > bare, "{} is not above {bare}", heights.values[k]);
                roofs += 1;
            }
            // Water is ground.
            9 => {
                assert!((f64::from(heights.values[k]) - bare).abs() < 2e-3, "{} is not {bare}", heights.values[k]);
                water += 1;
            }
            _ => {}
        }
        assert_eq!(colours.values[4 * k + 3], 255.0);
    }
    assert!(ground > 1000 && roofs > 100 && water > 10, "{ground} {roofs} {water}");
}
