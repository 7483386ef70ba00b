//! Reference systems against PROJ itself, by pyproj, which `tools/readers` installs.

use std::process::Command;

use psrgs_vk::geodesy::{Georeference, ReferenceSystem, Tangent};
use psrgs_vk::scene::{Coordinates, Geodetic};

use super::common::skipped;
use super::readers::{installed, run};

/// Prints easting, northing, convergence in degrees and the scale along the meridian for each system and place, then the
/// EPSG code and the projected point of the WKT that was given.
const PYPROJ: &str = "\
import sys, pyproj
for name, wkt, lon, lat in zip(*[iter(sys.argv[1:])] * 4):
    lon, lat = float(lon), float(lat)
    wgs84 = pyproj.CRS('+proj=longlat +datum=WGS84 +type=crs')
    crs = pyproj.CRS(name if name.startswith('EPSG') else name + ' +type=crs')
    x, y = pyproj.Transformer.from_crs(wgs84, crs, always_xy=True).transform(lon, lat)
    f = pyproj.Proj(crs).get_factors(lon, lat)
    back = pyproj.CRS.from_wkt(wkt)
    u, v = pyproj.Transformer.from_crs(wgs84, back, always_xy=True).transform(lon, lat)
    print(x, y, f.meridian_convergence, f.meridional_scale, back.to_epsg(20) or 0, u, v)
";

/// Systems whose datum is WGS 84 or differs from it by nothing that PROJ converts, and places in them; then systems with a
/// shift of the datum, as PROJ strings, because PROJ knows better shifts for the codes.
const SYSTEMS: [(&str, [f64; 2]); 26] = [
    ("EPSG:32601", [-177.0, 60.5]),
    ("EPSG:32617", [-82.9, 27.95]),
    ("EPSG:32632", [10.3, 47.65]),
    ("EPSG:32633", [12.001, 0.02]),
    ("EPSG:32660", [179.9, 5.0]),
    ("EPSG:32701", [-179.9, -16.5]),
    ("EPSG:32719", [-70.9, -53.15]),
    ("EPSG:32735", [28.05, -26.2]),
    ("EPSG:32756", [151.21, -33.86]),
    ("EPSG:32661", [45.0, 84.5]),
    ("EPSG:25832", [7.0, 51.5]),
    ("EPSG:25833", [13.405, 52.52]),
    ("EPSG:2154", [4.84, 45.76]),
    ("EPSG:3879", [24.94, 60.17]),
    ("EPSG:3067", [24.94, 60.17]),
    ("EPSG:2180", [19.9, 50.06]),
    ("EPSG:3006", [18.07, 59.33]),
    ("EPSG:2193", [174.78, -41.29]),
    ("EPSG:31983", [-46.63, -23.55]),
    ("EPSG:3031", [45.0, -72.0]),
    ("+proj=utm +zone=17 +ellps=GRS80 +units=m", [-80.5, 35.2]),
    ("+proj=lcc +lat_1=49 +lat_2=44 +lat_0=46.5 +lon_0=3 +x_0=700000 +y_0=6600000 +ellps=GRS80", [2.35, 48.86]),
    (
        "+proj=tmerc +lat_0=49 +lon_0=-2 +k=0.9996012717 +x_0=400000 +y_0=-100000 +ellps=airy \
         +towgs84=446.448,-125.157,542.06,0.15,0.247,0.842,-20.489 +units=m",
        [-1.5, 52.5],
    ),
    (
        "+proj=somerc +lat_0=46.9524055555556 +lon_0=7.43958333333333 +k_0=1 +x_0=2600000 +y_0=1200000 +ellps=bessel \
         +towgs84=674.374,15.056,405.346,0,0,0,0 +units=m",
        [8.54, 47.38],
    ),
    (
        "+proj=sterea +lat_0=52.1561605555556 +lon_0=5.38763888888889 +k=0.9999079 +x_0=155000 +y_0=463000 \
         +ellps=bessel +towgs84=565.4171,50.3319,465.5524,1.9342,-1.6677,9.1019,4.0725 +units=m",
        [4.9, 52.37],
    ),
    (
        "+proj=tmerc +lat_0=0 +lon_0=9 +k=1 +x_0=3500000 +y_0=0 +ellps=bessel \
         +towgs84=598.1,73.7,418.2,0.202,0.045,-2.455,6.7 +units=m",
        [9.18, 48.78],
    ),
];

#[test]
fn systems_agree_with_proj_to_a_millimetre() {
    let Some(python) = installed("venv/bin/python", "python3") else { return };
    if !Command::new(&python).args(["-c", "import pyproj"]).output().is_ok_and(|output| output.status.success()) {
        skipped("pyproj is not there (tools/readers installs it)");
        return;
    }
    let systems = SYSTEMS.map(|(name, _)| ReferenceSystem::parse(name).unwrap_or_else(|e| panic!("{e}")));
    let mut command = Command::new(python);
    command.args(["-c", PYPROJ]);
    for ((name, [longitude, latitude]), system) in SYSTEMS.iter().zip(&systems) {
        command.args([(*name).to_owned(), system.wkt(), longitude.to_string(), latitude.to_string()]);
    }
    let said = run(&mut command);
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(lines.len(), SYSTEMS.len(), "{said}");
    for (line, ((name, [longitude, latitude]), system)) in lines.iter().zip(SYSTEMS.iter().zip(systems)) {
        let numbers: Vec<f64> = line.split(' ').map(|word| word.parse().expect("a number")).collect();
        let place = Geodetic { latitude: *latitude, longitude: *longitude, altitude: 0.0 };
        let [x, y, _] = system.from_geodetic(place);
        assert!((x - numbers[0]).hypot(y - numbers[1]) < 1e-3, "{name}: {x} {y} for {line}");
        let back = system.to_geodetic([x, y, 0.0]);
        let [east, north, _] = Tangent::at(place).from_geodetic(back);
        assert!(east.hypot(north) < 1e-3, "{name}: {east} {north} after the way back");
        // WKT of a code is that code; WKT of a PROJ string leads to the same point. With a shift of the datum, PROJ itself
        // comes to points 3 mm apart by its two ways.
        let most = if name.contains("towgs84") { 1e-2 } else { 1e-3 };
        match system.code() {
            Some(code) => assert_eq!(numbers[4], f64::from(code), "{name}"),
            None => assert!((x - numbers[5]).hypot(y - numbers[6]) < most, "{name}: {line}"),
        }
        let found = Georeference::of_coordinates(&Coordinates::EastNorthUp { origin: place }, Some(system));
        let Ok(found) = found else {
            assert!(["EPSG:32661", "EPSG:3031"].contains(name), "{name}: {found:?}");
            continue;
        };
        let similarity = found.similarity_at([0.0; 3]);
        let r = similarity.rotation;
        let turned = (r[1][0].atan2(r[0][0]).to_degrees() - numbers[2]).to_radians();
        // A millimetre at 100 m; a shift of the datum turns and scales by as much as some 1e-5.
        let most = if name.contains("towgs84") { 6e-5 } else { 1e-6 };
        assert!(turned.abs() < most && (similarity.scale - numbers[3]).abs() < most.max(1e-6), "{name}: {line}");
    }
}
