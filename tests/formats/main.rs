//! Files written and read again: models, frames, checkpoints, pictures.

mod checkpoints;
mod clouds;
#[path = "../common/mod.rs"]
mod common;
mod compact;
mod globe;
mod levels;
mod merging;
mod meshes;
mod models;
mod pictures;
mod point_files;
mod projections;
mod readers;
mod similarities;

use std::fs;

use psrgs_vk::format::{FrameFile, ply};
use psrgs_vk::geodesy::Georeference;
use psrgs_vk::scene::random::Random;
use psrgs_vk::scene::{Coordinates, Frame, Gaussians, Geodetic};

/// Splats with random values, some special values among them.
pub(crate) fn splats(n: usize) -> Gaussians {
    let mut g = Gaussians::zeros(n);
    let mut random = Random::new(7);
    let [a, b, c, d] = &mut g.sh;
    for plane in [&mut g.means, &mut g.quats, &mut g.scales, &mut g.opacities, a, b, c, d] {
        plane.iter_mut().for_each(|v| *v = random.range(-3.0, 3.0) as f32);
    }
    if n > 1 {
        g.means[1] = -0.0;
        g.scales[2] = 0.0;
        g.scales[3] = -0.0;
        g.means[4] = f32::MIN_POSITIVE / 4.0;
    }
    g.normalise_quats();
    g
}

#[test]
fn frame_file_keeps_every_bit() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let model = folder.path().join("point_cloud.ply");
    assert_eq!(FrameFile::beside(&model).expect("no file is no error"), None);
    let frame = Frame { offset: [0.1 + 0.2, 4.6e6 / 3.0, -1e-300], scale: 5.0 / 17.3 };
    FrameFile::new(frame, None).write(&folder.path().join("frame.json")).expect("written");
    let read = FrameFile::beside(&model).expect("read").expect("there");
    assert_eq!((read.frame, read.shift), (frame, frame.offset));
    let grid = Coordinates::grid("WGS84 UTM 17N", Some("+proj=utm +zone=17".to_owned()), [500_123.5, 4.6e6]);
    for coordinates in
        [grid, Coordinates::EastNorthUp { origin: Geodetic { latitude: -1.5, longitude: 2.0, altitude: 0.1 } }]
    {
        let map = Georeference::of_coordinates(&coordinates, None).expect("a map").record([0.5, 2.0, 0.1]);
        assert!(map.is_some());
        // Files of earlier versions have no map.
        for map in [None, map] {
            let written = FrameFile::new(frame, Some(coordinates.clone())).with_map(map);
            written.write(&folder.path().join("frame.json")).expect("written");
            assert_eq!(FrameFile::beside(&model).expect("read"), Some(written));
        }
    }
    for broken in [
        "",
        "{",
        "{}",
        r#"{"offset":[0,0,0],"scale":0,"shift":[0,0,0]}"#,
        r#"{"offset":[0,0],"scale":1,"shift":[0,0,0]}"#,
    ] {
        fs::write(folder.path().join("frame.json"), broken).expect("written");
        let error = FrameFile::beside(&model).expect_err(broken).to_string();
        assert!(error.contains("frame.json: frame at line 1"), "{error}");
    }
}

#[cfg(unix)]
#[test]
fn files_have_ordinary_permissions() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().expect("temporary folder");
    let (ours, ordinary) = (folder.path().join("a.ply"), folder.path().join("b"));
    ply::save(&ours, &splats(1), &Frame::IDENTITY, false).expect("written");
    fs::write(&ordinary, "").expect("written");
    let mode = |file: &std::path::Path| fs::metadata(file).expect("file").permissions().mode();
    assert_eq!(mode(&ours), mode(&ordinary));
}
