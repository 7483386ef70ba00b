use super::*;

/// Origin, code, map coordinates of the origin, map coordinates of the point 400 m east, 300 m south and 60 m up of it,
/// convergence in degrees and scale: PROJ 9.5.1, by `+proj=topocentric`, `+proj=cart`, the projection and `proj_factors`.
type Known = ([f64; 3], u32, [f64; 2], [f64; 3], f64, f64);
const KNOWN: [Known; 12] = [
    // London
    (
        [51.5, -0.12, 80.0],
        32630,
        [699889.80699, 5709362.29282],
        [700301.32809, 5709078.24139, 140.01958],
        2.254652944,
        1.0000905894,
    ),
    // Sydney
    (
        [-33.86, 151.21, 45.5],
        32756,
        [334416.39399, 6251925.36035],
        [334821.52431, 6251632.39322, 105.51961],
        0.997553194,
        0.9999380062,
    ),
    // Quito
    (
        [-0.18, -78.47, 2850.0],
        32717,
        [781616.42385, 9980085.04809],
        [782016.43267, 9979784.95497, 2910.01964],
        -0.007953491,
        1.0005818883,
    ),
    // Nairobi N
    (
        [0.3, 36.9, 1700.0],
        32637,
        [266273.07362, 33181.45158],
        [266673.01596, 32881.37593, 1760.01964],
        -0.011000550,
        1.0002763023,
    ),
    // Bergen
    (
        [60.39, 5.32, 12.0],
        32632,
        [297230.22021, 6700510.17525],
        [297612.88256, 6700188.28188, 72.01956],
        -3.200503138,
        1.0001038550,
    ),
    // Longyearbyen
    (
        [78.22, 15.65, 30.0],
        32633,
        [514813.52726, 8683004.15328],
        [515216.66835, 8682708.73551, 90.01954],
        0.636311301,
        0.9996026816,
    ),
    // Fiji
    (
        [-17.8, 179.9999, 10.0],
        32760,
        [818052.32707, 8029394.47928],
        [818447.80234, 8029087.85213, 70.01963],
        -0.917829762,
        1.0008508873,
    ),
    // Punta Arenas
    (
        [-53.15, -70.9, 20.0],
        32719,
        [372939.16985, 4109356.89327],
        [373346.90233, 4109067.67583, 80.01957],
        1.520597716,
        0.9997981428,
    ),
    // Berlin GK
    (
        [52.52, 13.405, 75.0],
        25833,
        [391779.25925, 5820072.15909],
        [392172.42499, 5819763.48163, 135.01957],
        -1.265859404,
        0.9997437587,
    ),
    // Finland
    (
        [60.17, 24.94, 20.0],
        3879,
        [25496669.19188, 6673014.66647],
        [25497068.91423, 6672714.30695, 80.01956],
        -0.052050312,
        1.0000001359,
    ),
    // Lambert93
    (
        [45.76, 4.84, 220.0],
        2154,
        [843011.13551, 6519488.06230],
        [843417.64869, 6519197.72710, 280.01959],
        1.335118288,
        0.9991381056,
    ),
    // NAD83 UTM
    (
        [40.7, -74.0, 15.0],
        26918,
        [584482.35228, 4505935.86944],
        [584885.61030, 4505640.53700, 75.01960],
        0.652136906,
        0.9996878487,
    ),
];
const POINT: [f64; 3] = [400.0, -300.0, 60.0];

fn place([latitude, longitude, altitude]: [f64; 3]) -> Geodetic {
    Geodetic { latitude, longitude, altitude }
}

fn enu(origin: [f64; 3], code: Option<u32>) -> Result<Georeference, Error> {
    let system = code.map(ReferenceSystem::epsg).transpose()?;
    Georeference::of_coordinates(&Coordinates::EastNorthUp { origin: place(origin) }, system)
}

fn near(got: [f64; 3], want: [f64; 3], tolerance: f64, what: &str) {
    assert!((0..3).all(|k| (got[k] - want[k]).abs() <= tolerance), "{what}: {got:?} for {want:?}");
}

/// Degrees from the source's east to the target's, anticlockwise.
fn turn(similarity: &Similarity) -> f64 {
    let r = &similarity.rotation;
    r[1][0].atan2(r[0][0]).to_degrees()
}

#[test]
fn east_north_up_lands_where_proj_puts_points() {
    for (origin, code, at, moved, _, _) in KNOWN {
        let found = enu(origin, Some(code)).unwrap();
        let what = found.system().unwrap().to_string();
        near(found.to_map([0.0; 3]), [at[0], at[1], origin[2]], 2e-4, &what);
        near(found.to_map(POINT), moved, 2e-4, &what);
    }
}

#[test]
fn similarity_has_the_convergence_and_scale_of_proj() {
    for (mut origin, code, _, _, convergence, scale) in KNOWN {
        // On the ellipsoid: above it lengths on the map are shorter by the height over the Earth's radius.
        origin[2] = 0.0;
        let found = enu(origin, Some(code)).unwrap();
        let similarity = found.similarity_at([0.0; 3]);
        // A millimetre at a kilometre.
        assert!((turn(&similarity) - convergence).abs() < 5e-5, "{code}: {} {convergence}", turn(&similarity));
        assert!((similarity.scale - scale).abs() < 1e-6, "{code}: {} {scale}", similarity.scale);
        near(similarity.point([0.0; 3]), found.to_map([0.0; 3]), 1e-6, "at the point");
        near(similarity.point([100.0, 50.0, 0.0]), found.to_map([100.0, 50.0, 0.0]), 2e-3, "near the point");
    }
}

#[test]
fn default_system_is_the_zone_of_the_origin() {
    let zones = [32_630, 32_756, 32_717, 32_637, 32_632, 32_633, 32_760, 32_719];
    for ((origin, ..), code) in KNOWN.into_iter().zip(zones) {
        assert_eq!(enu(origin, None).unwrap().system().unwrap().code(), Some(code), "{origin:?}");
    }
    for pole in [85.0, -81.0] {
        let problem = enu([pole, 10.0, 0.0], None).unwrap_err();
        assert!(matches!(problem, Error::NoZone { .. }), "{problem}");
    }
}

#[test]
fn round_trips_stay_within_a_millimetre() {
    let utm = ReferenceSystem::epsg(32_632).unwrap();
    let grid = Coordinates::grid("WGS84 UTM 32N", None, [500_000.0, 4_600_000.0]);
    let tangent = Tangent::at(utm.to_geodetic([500_000.0, 4_600_000.0, 100.0]));
    let turned = Similarity::from_rows(&[[0.0, -2.0, 0.0, 7.0], [0.0, 0.0, -2.0, 5.0], [2.0, 0.0, 0.0, 9.0]]).unwrap();
    let ways = [
        Georeference::local(),
        Georeference::of_coordinates(&grid, None).unwrap(),
        Georeference::of_coordinates(&grid, Some(ReferenceSystem::epsg(25_833).unwrap())).unwrap(),
        Georeference::of_coordinates(&grid, Some(ReferenceSystem::epsg(31_467).unwrap())).unwrap(),
        Georeference::on_plane(tangent, &turned, Some(utm)).unwrap(),
        enu([41.5, 9.0, 200.0], None).unwrap(),
    ];
    for (k, way) in ways.iter().enumerate() {
        for p in [[0.0; 3], [812.25, -1500.5, 77.125], [-3000.0, 4000.0, -20.0]] {
            let there = way.to_map(p);
            near(way.to_dataset(there), p, 1e-3, &format!("way {k}"));
            near(way.to_map(way.to_dataset(there)), there, 1e-3, &format!("way {k}, again"));
        }
    }
}

#[test]
fn grid_of_opendronemap_is_moved_by_its_offset_alone() {
    let grid = Coordinates::grid("WGS84 UTM 17N", None, [500_123.0, 4_600_456.0]);
    let found = Georeference::of_coordinates(&grid, None).unwrap();
    assert_eq!(found.system().unwrap().code(), Some(32_617));
    assert_eq!(found.to_map([1.5, -2.5, 30.25]), [500_124.5, 4_600_453.5, 30.25]);
    assert_eq!(found.similarity_at([9.0; 3]).rotation, Similarity::IDENTITY.rotation);
}

#[test]
fn grid_whose_system_is_not_understood_needs_a_name() {
    let grid = Coordinates::grid("Site grid of 1931", None, [1000.0, 2000.0]);
    assert!(matches!(Georeference::of_coordinates(&grid, None), Err(Error::Unnamed { .. })));
    let told = ReferenceSystem::epsg(32_632).unwrap();
    let grid = Coordinates::grid("Site grid of 1931", None, [500_000.0, 4_600_000.0]);
    let found = Georeference::of_coordinates(&grid, Some(told)).unwrap();
    assert_eq!(found.to_map([1.0, 2.0, 3.0]), [500_001.0, 4_600_002.0, 3.0]);
}

#[test]
fn system_of_another_place_is_refused_with_a_better_one() {
    for (code, stretched) in [(32_617, true), (3857, true), (32_661, true)] {
        let problem = enu([51.5, -0.12, 0.0], Some(code)).unwrap_err();
        assert_eq!(matches!(problem, Error::Stretched { .. }), stretched, "{problem}");
        assert!(problem.to_string().contains("EPSG:32630"), "{problem}");
    }
}

#[test]
fn record_holds_the_matrix_about_its_point() {
    let found = enu([51.5, -0.12, 80.0], None).unwrap();
    let record = found.record([400.0, -300.0, 60.0]).unwrap();
    assert_eq!((record.epsg, record.heights.as_str()), (Some(32_630), "ellipsoid of WGS 84"));
    let at = Similarity::from_rows(&[record.dataset_to_map[0], record.dataset_to_map[1], record.dataset_to_map[2]]);
    near(at.unwrap().point(record.at), found.to_map(record.at), 1e-6, "matrix");
    assert!(Georeference::local().record([0.0; 3]).is_none());
}

/// An exported model has the record beside it, and not the dataset's grid.
#[test]
fn record_of_a_grid_suffices_where_the_map_is_the_grid() {
    let grid = Coordinates::grid("WGS84 UTM 32N", None, [500_000.0, 5_200_000.0]);
    let found = Georeference::of_coordinates(&grid, None).unwrap();
    let record = found.record([10.0, 20.0, 30.0]).unwrap();
    let again = Georeference::of_record(&record, None).unwrap();
    near(again.to_map([1.5, -2.0, 3.0]), [500_001.5, 5_199_998.0, 3.0], 1e-6, "the grid");
    let other = Georeference::of_coordinates(&grid, Some(ReferenceSystem::epsg(32_633).unwrap())).unwrap();
    let record = other.record([10.0, 20.0, 30.0]).unwrap();
    assert!(matches!(Georeference::of_record(&record, None), Err(Error::Unplaced)));
}
