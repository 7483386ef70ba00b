//! Point clouds on a map, read by laspy with lazrs, their reference system by pyproj.

use std::process::Command;

use psrgs_vk::format::las::{CloudPoint, Coordinates, Written, write};
use psrgs_vk::geodesy::ReferenceSystem;

use super::readers::{installed, run};

/// Prints what a program of another origin finds in each file.
const LASPY: &str = "
import sys, laspy
for name in sys.argv[1:]:
    cloud = laspy.read(name)
    header, crs = cloud.header, cloud.header.parse_crs()
    print(header.version, header.point_format.id, header.point_count, list(header.point_format.extra_dimension_names),
          (crs.source_crs if crs.is_bound else crs).to_epsg(), crs.axis_info[0].unit_name)
    for k in (0, 77777):
        print(*('%.4f' % v for v in cloud.xyz[k]), cloud.red[k], cloud.green[k], cloud.blue[k],
              *('%.4f' % cloud[name][k] for name in ('NormalX', 'NormalY', 'NormalZ', 'Error')))
";

fn point(k: u32) -> CloudPoint {
    let far = f64::from(k.wrapping_mul(2_654_435_761) >> 12) * 1e-3;
    CloudPoint {
        position: [500_000.25 + far, 4_600_000.5 - far, 100.0 + 0.001 * f64::from(k)],
        colour: [k as u8, 128, 255],
        normal: [0.6, 0.0, 0.8],
        error: 0.025 + 1e-6 * k as f32,
    }
}

#[test]
fn laspy_reads_points_and_pyproj_their_reference_system() {
    let Some(python) = installed("venv/bin/python", "python3") else { return };
    let folder = tempfile::tempdir().expect("temporary folder");
    for code in [32_632, 32_733, 25_832, 2154] {
        let wkt = ReferenceSystem::epsg(code).expect("a system").wkt();
        let files = ["a.las", "a.laz"].map(|name| folder.path().join(name));
        let at = Coordinates { wkt: Some(&wkt), step: 0.001, offset: [500_000.0, 4_600_000.0, 0.0] };
        for file in &files {
            let written = write(file, &at, (0..100_000).map(point)).expect("written");
            assert_eq!(written, Written { points: 100_000, left_out: 0 });
        }
        let head = format!("1.4 7 100000 ['NormalX', 'NormalY', 'NormalZ', 'Error'] {code} metre");
        let row = |k: u32| {
            let p = point(k);
            let [x, y, z] = p.position.map(|v| (v * 1000.0).round() / 1000.0);
            let [r, g, b] = p.colour.map(|c| u16::from(c) * 257);
            format!("{x:.4} {y:.4} {z:.4} {r} {g} {b} 0.6000 0.0000 0.8000 {:.4}", p.error)
        };
        let of_file = format!("{head}\n{}\n{}\n", row(0), row(77_777));
        let said = run(Command::new(&python).args(["-c", LASPY]).args(&files));
        assert_eq!(said, format!("{of_file}{of_file}"), "EPSG:{code}");
    }
}
