//! Files of nerfstudio and OpenSfM, written here in the form of those programs.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use psrgs_vk::dataset::lens::Distortion;
use psrgs_vk::dataset::{Dataset, Error, Format, LoadOptions, Role, Split, Warning};
use psrgs_vk::scene::{Camera, Coordinates, Geodetic};
use serde_json::{Value, json};

use crate::colmap_folder::{Folder, ImageRow};
use crate::{NAMES, load};

/// An offset as far from the origin as geo-referenced coordinates.
const UTM: [f64; 3] = [5e5, 4.6e6, 100.0];

fn rotation(image: &ImageRow) -> [[f64; 3]; 3] {
    let length = image.quaternion.iter().map(|q| q * q).sum::<f64>().sqrt();
    let [w, x, y, z] = image.quaternion.map(|q| q / length);
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// A ring of cameras, each turned a little about its centre by a rotation of its own.
pub(crate) fn turned_ring(offset: [f64; 3]) -> Folder {
    turned(&NAMES.map(str::to_owned), offset)
}

/// As [`turned_ring`], with these names.
pub(crate) fn turned(names: &[String], offset: [f64; 3]) -> Folder {
    let mut folder = Folder::ring(&names.iter().map(String::as_str).collect::<Vec<_>>(), offset);
    for (i, image) in folder.images.iter_mut().enumerate() {
        let before = rotation(image);
        let center: [f64; 3] = [0, 1, 2].map(|k| -(0..3).map(|j| before[j][k] * image.translation[j]).sum::<f64>());
        image.quaternion = [0.02 * i as f64 - 0.03, 1.0, 0.1 + 0.05 * i as f64, -0.07];
        image.translation = rotation(image).map(|row| -(0..3).map(|k| row[k] * center[k]).sum::<f64>());
    }
    folder
}

/// The folder as ns-process-data writes it.
pub(crate) fn transforms(folder: &Folder) -> Value {
    let frames: Vec<Value> = folder
        .images
        .iter()
        .map(|image| {
            let r = rotation(image);
            let row = |i: usize| {
                let center = -(0..3).map(|k| r[k][i] * image.translation[k]).sum::<f64>();
                json!([r[0][i], -r[1][i], -r[2][i], center])
            };
            json!({
                "file_path": format!("./images/{}", image.name),
                "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
                "colmap_im_id": image.id,
            })
        })
        .collect();
    json!({
        "w": 24, "h": 16, "fl_x": 20.5, "fl_y": 21.25, "cx": 11.125, "cy": 8.75,
        "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0, "camera_model": "OPENCV",
        "frames": frames,
        "applied_transform": [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [-0.0, -1.0, -0.0, -0.0]],
        "ply_file_path": "sparse_pc.ply",
    })
}

/// The points as a PLY file, as text or little endian, positions in double precision.
pub(crate) fn cloud(folder: &Folder, text: bool) -> Vec<u8> {
    let kind = if text { "ascii" } else { "binary_little_endian" };
    let mut out = format!("ply\nformat {kind} 1.0\nelement vertex {}\n", folder.points.len());
    for (name, kind) in [
        ("x", "double"),
        ("y", "double"),
        ("z", "double"),
        ("nx", "float"),
        ("red", "uint8"),
        ("green", "uint8"),
        ("blue", "uint8"),
    ] {
        let _ = writeln!(out, "property {kind} {name}");
    }
    out.push_str("end_header\n");
    let mut out = out.into_bytes();
    for p in &folder.points {
        let ([x, y, z], [r, g, b]) = (p.position, p.colour);
        if text {
            out.extend(format!("{x} {y} {z} 0 {r} {g} {b}\n").into_bytes());
        } else {
            [x, y, z].iter().for_each(|v| out.extend(v.to_le_bytes()));
            out.extend(0.0_f32.to_le_bytes());
            out.extend([r, g, b]);
        }
    }
    out
}

pub(crate) fn nerfstudio(folder: &Folder, text: bool) -> tempfile::TempDir {
    let root = tempfile::tempdir().expect("temporary folder");
    folder.write_photographs(&root.path().join("images"));
    write_json(&root.path().join("transforms.json"), &transforms(folder));
    fs::write(root.path().join("sparse_pc.ply"), cloud(folder, text)).expect("points");
    root
}

pub(crate) fn write_json(file: &Path, value: &Value) {
    fs::create_dir_all(file.parent().expect("parent")).expect("folder");
    fs::write(file, serde_json::to_string_pretty(value).expect("JSON")).expect("written");
}

/// The axis times the angle of a rotation.
fn vector(r: &[[f64; 3]; 3]) -> [f64; 3] {
    // From the quaternion: stable for rotations near 180 degrees, as of these cameras.
    let w = 0.5 * (1.0 + r[0][0] + r[1][1] + r[2][2]).max(0.0).sqrt();
    let x = 0.5 * (1.0 + r[0][0] - r[1][1] - r[2][2]).max(0.0).sqrt();
    let (y, z) = ((r[0][1] + r[1][0]) / (4.0 * x), (r[0][2] + r[2][0]) / (4.0 * x));
    let w = w * (r[2][1] - r[1][2]).signum();
    let length = (x * x + y * y + z * z).sqrt();
    let angle = 2.0 * length.atan2(w);
    [x, y, z].map(|v| v * angle / length)
}

/// The folder as OpenSfM writes it.
pub(crate) fn reconstruction(folder: &Folder) -> Value {
    let shots: serde_json::Map<String, Value> = folder
        .images
        .iter()
        .map(|image| {
            let shot = json!({
                "rotation": vector(&rotation(image)), "translation": image.translation, "camera": "v2 dji 24 16 brown \
                 0.85",
                "orientation": 1, "capture_time": 0.0, "gps_dop": 10.0, "gps_position": [0.0, 0.0, 0.0],
            });
            (image.name.clone(), shot)
        })
        .collect();
    let points: serde_json::Map<String, Value> = folder
        .points
        .iter()
        .map(|p| (p.id.to_string(), json!({"color": p.colour.map(f64::from), "coordinates": p.position})))
        .collect();
    let camera = json!({
        "projection_type": "brown", "width": 24, "height": 16,
        "focal_x": 20.5 / 24.0, "focal_y": 21.25 / 24.0, "c_x": (11.125 - 12.0) / 24.0, "c_y": (8.75 - 8.0) / 24.0,
        "k1": 0.0, "k2": 0.0, "k3": 0.0, "p1": 0.0, "p2": 0.0,
    });
    json!([{
        "cameras": {"v2 dji 24 16 brown 0.85": camera}, "shots": shots, "points": points,
        "biases": {}, "rig_cameras": {}, "rig_instances": {},
        "reference_lla": {"latitude": 41.5, "longitude": 2.1, "altitude": 0.0},
    }])
}

pub(crate) fn opensfm(folder: &Folder, file: &str) -> tempfile::TempDir {
    let root = tempfile::tempdir().expect("temporary folder");
    folder.write_photographs(&root.path().join("images"));
    write_json(&root.path().join(file), &reconstruction(folder));
    root
}

fn same_camera(a: &Camera, b: &Camera, what: &str) {
    let values = |c: &Camera| {
        let [p, q, r] = c.rotation;
        [p, q, r, c.translation, [c.fx, c.fy, c.cx], [c.cy, f64::from(c.width), f64::from(c.height)]].concat()
    };
    for (x, y) in values(a).iter().zip(values(b)) {
        assert!((x - y).abs() < 1e-9 * x.abs().max(1.0), "{what}: {x} and {y}\n{a:?}\n{b:?}");
    }
}

#[test]
fn all_formats_give_the_same_dataset_also_far_from_the_origin() {
    let near = load(turned_ring([0.0; 3]).dataset(false).path()).expect("near");
    for offset in [[0.0; 3], UTM] {
        let folder = turned_ring(offset);
        let all = [
            (Format::Colmap, folder.dataset(false)),
            (Format::Colmap, folder.dataset(true)),
            (Format::Nerfstudio, nerfstudio(&folder, true)),
            (Format::Nerfstudio, nerfstudio(&folder, false)),
            (Format::Opensfm, opensfm(&folder, "reconstruction.json")),
            (Format::Opensfm, opensfm(&folder, "opensfm/reconstruction.json")),
        ];
        for (format, root) in &all {
            let dataset = load(root.path()).unwrap_or_else(|e| panic!("{format}: {e}"));
            let what = format!("{format} at {offset:?}");
            assert_eq!(dataset.format, *format);
            assert!(dataset.warnings.is_empty(), "{what}: {:?}", dataset.warnings);
            assert_eq!(dataset.views.iter().map(|v| v.name.as_str()).collect::<Vec<_>>(), NAMES, "{what}");
            assert!((dataset.extent / near.extent - 1.0).abs() < 1e-6, "{what}: extent {}", dataset.extent);
            for i in 0..NAMES.len() {
                let (a, b) = (dataset.scene_camera(i).expect("camera"), near.scene_camera(i).expect("camera"));
                for (x, y) in a.center().iter().zip(b.center()) {
                    assert!((x - y).abs() < 1e-6 * 5.0, "{what}: centre {x} instead of {y}");
                }
                for (x, y) in a.rotation.as_flattened().iter().zip(b.rotation.as_flattened()) {
                    assert!((x - y).abs() < 1e-9, "{what}: rotation {x} instead of {y}");
                }
                same_camera(
                    &Camera { translation: [0.0; 3], rotation: b.rotation, ..a },
                    &Camera { translation: [0.0; 3], ..b },
                    &what,
                );
            }
            assert_eq!(dataset.points.len(), 12, "{what}");
            for found in &dataset.points {
                let here = dataset.frame.to_scene(found.position);
                let want = near.points.iter().find(|p| p.colour == found.colour).expect("a point of this colour");
                for (x, y) in here.iter().zip(near.frame.to_scene(want.position)) {
                    assert!((x - y).abs() < 1e-6 * 5.0, "{what}: point at {x} instead of {y}");
                }
            }
            assert_eq!(dataset.coordinates.is_some(), *format == Format::Opensfm);
        }
    }
}

#[test]
fn the_format_is_found_or_asked_for() {
    let folder = turned_ring([0.0; 3]);
    let root = folder.dataset(false);
    write_json(&root.path().join("transforms.json"), &transforms(&folder));
    fs::write(root.path().join("sparse_pc.ply"), cloud(&folder, true)).expect("points");
    let dataset = load(root.path()).expect("loads");
    assert_eq!(dataset.format, Format::Colmap);
    let several = Warning::SeveralFormats { used: Format::Colmap, others: vec![Format::Nerfstudio] };
    assert_eq!(dataset.warnings, [several]);
    let asked = |format| Dataset::load(root.path(), &LoadOptions { format: Some(format), ..LoadOptions::default() });
    let dataset = asked(Format::Nerfstudio).expect("loads");
    assert_eq!((dataset.format, dataset.warnings.len()), (Format::Nerfstudio, 0));
    let error = asked(Format::Opensfm).expect_err("is not there").to_string();
    assert!(error.contains("no dataset here") && error.contains("reconstruction.json"), "{error}");
    let empty = tempfile::tempdir().expect("temporary folder");
    let error = load(empty.path()).expect_err("nothing").to_string();
    for word in ["sparse/0", "transforms.json", "reconstruction.json"] {
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn frames_may_have_lenses_of_their_own() {
    let folder = turned_ring([0.0; 3]);
    let root = nerfstudio(&folder, true);
    let file = root.path().join("transforms.json");
    let mut value = transforms(&folder);
    value["frames"][1]["fl_x"] = json!(30.0);
    value["frames"][1]["k1"] = json!(-0.05);
    value["frames"][2]["camera_model"] = json!("OPENCV_FISHEYE");
    value["frames"][2]["k4"] = json!(0.001);
    write_json(&file, &value);
    let dataset = load(root.path()).expect("loads");
    assert!(dataset.views[0].lens.is_none() && dataset.views[0].camera.fx == 20.5);
    let lens = dataset.views[1].lens.expect("a lens");
    assert_eq!((lens.focal, lens.distortion), ([30.0, 21.25], Distortion::brown([-0.05, 0.0, 0.0], [0.0; 2])));
    let lens = dataset.views[2].lens.expect("a lens");
    assert_eq!(lens.distortion, Distortion::Fisheye { k: [0.0, 0.0, 0.0, 0.001] });
    assert_eq!(dataset.views[2].model, "OPENCV_FISHEYE");
    // As in instant-ngp's synthetic scenes: an angle of view, no size, no extensions, no points.
    let frames: Vec<Value> = value["frames"]
        .as_array()
        .expect("frames")
        .iter()
        .zip(NAMES)
        .map(|(frame, name)| json!({"file_path": format!("./images/{}", &name[..1]), "transform_matrix": frame["transform_matrix"]}))
        .collect();
    write_json(&file, &json!({"camera_angle_x": 0.8, "frames": frames}));
    let dataset = load(root.path()).expect("loads");
    let camera = dataset.views[0].camera;
    assert!((camera.fx - 12.0 / 0.4_f64.tan()).abs() < 1e-12 && camera.fy == camera.fx);
    assert_eq!((camera.cx, camera.cy, dataset.views[0].name.as_str()), (12.0, 8.0, "a.png"));
    assert_eq!(dataset.warnings, [Warning::NoPoints { file: None }]);
}

/// `is_fisheye` stands in the place of a camera model, at the top or in a frame.
#[test]
fn fisheyes_of_instant_ngp_are_fisheyes() {
    let folder = turned_ring([0.0; 3]);
    let root = nerfstudio(&folder, true);
    let file = root.path().join("transforms.json");
    let mut value = transforms(&folder);
    value.as_object_mut().expect("an object").remove("camera_model");
    for (key, k) in [("k1", 0.02), ("k2", -0.01), ("k3", 0.003), ("k4", -0.0004)] {
        value[key] = json!(k);
    }
    value["is_fisheye"] = json!(true);
    value["frames"][1]["is_fisheye"] = json!(false);
    write_json(&file, &value);
    let dataset = load(root.path()).expect("loads");
    let fisheye = Distortion::Fisheye { k: [0.02, -0.01, 0.003, -0.0004] };
    assert_eq!(dataset.views[0].lens.expect("a lens").distortion, fisheye);
    assert_eq!((dataset.views[0].model.as_str(), dataset.views[1].model.as_str()), ("OPENCV_FISHEYE", "OPENCV"));
    let plain = dataset.views[1].lens.expect("a lens").distortion;
    assert!(matches!(plain, Distortion::Brown { numerator: [0.02, ..], .. }), "{plain:?}");
    // Stated twice with equal values.
    value["frames"][1] = transforms(&folder)["frames"][1].clone();
    value["camera_model"] = json!("OPENCV_FISHEYE");
    write_json(&file, &value);
    assert_eq!(load(root.path()).expect("loads").views[1].lens.expect("a lens").distortion, fisheye);
    for (model, flag) in [("OPENCV", true), ("PINHOLE", true), ("OPENCV_FISHEYE", false)] {
        value["camera_model"] = json!(model);
        value["is_fisheye"] = json!(flag);
        write_json(&file, &value);
        complains(root.path(), &["transforms.json", "is_fisheye of frame './images/a.png'", model, "remove the one"]);
    }
}

#[test]
fn opensfm_cameras_are_normalised_by_the_longer_side() {
    let folder = turned_ring([0.0; 3]);
    let root = opensfm(&folder, "reconstruction.json");
    let file = root.path().join("reconstruction.json");
    let mut value = reconstruction(&folder);
    let id = "v2 dji 24 16 brown 0.85";
    for (entry, distortion, focal) in [
        (
            json!({"projection_type": "perspective", "width": 24, "height": 16, "focal": 0.9, "k1": -0.1, "k2": 0.01}),
            Distortion::brown([-0.1, 0.01, 0.0], [0.0; 2]),
            0.9,
        ),
        (
            json!({"projection_type": "fisheye", "width": 24, "height": 16, "focal": 0.5, "k1": 0.02, "k2": -0.01}),
            Distortion::Fisheye { k: [0.02, -0.01, 0.0, 0.0] },
            0.5,
        ),
        (
            json!({"projection_type": "fisheye_opencv", "width": 24, "height": 16, "focal_x": 0.5, "focal_y": 0.5,
                   "c_x": 0.0, "c_y": 0.0, "k1": 0.02, "k2": -0.01, "k3": 0.003, "k4": -0.0004}),
            Distortion::Fisheye { k: [0.02, -0.01, 0.003, -0.0004] },
            0.5,
        ),
        (
            json!({"projection_type": "brown", "width": 24, "height": 16, "focal_x": 0.7, "focal_y": 0.7, "c_x": 0.0, "c_y": 0.0,
                   "k1": 0.1, "k2": 0.2, "k3": 0.3, "p1": 0.01, "p2": 0.02}),
            Distortion::brown([0.1, 0.2, 0.3], [0.01, 0.02]),
            0.7,
        ),
    ] {
        value[0]["cameras"][id] = entry;
        write_json(&file, &value);
        let lens = load(root.path()).expect("loads").views[0].lens.expect("a lens");
        assert_eq!((lens.focal, lens.center, lens.distortion), ([24.0 * focal; 2], [12.0, 8.0], distortion));
    }
    // Photographs without GPS.
    let origin = Geodetic { latitude: 41.5, longitude: 2.1, altitude: 0.0 };
    assert_eq!(load(root.path()).expect("loads").coordinates, Some(Coordinates::EastNorthUp { origin }));
    value[0]["reference_lla"] = json!({"latitude": 0.0, "longitude": 0.0, "altitude": 0.0});
    write_json(&file, &value);
    assert_eq!(load(root.path()).expect("loads").coordinates, None);
    // A second part without a common frame.
    let mut part = reconstruction(&folder)[0].clone();
    part["shots"].as_object_mut().expect("shots").remove("a.png");
    value.as_array_mut().expect("parts").insert(0, part);
    write_json(&file, &value);
    let dataset = load(root.path()).expect("loads");
    assert_eq!((dataset.views.len(), &dataset.warnings[0]), (3, &Warning::OtherParts { used: 3, parts: 1, shots: 2 }));
}

/// A run with GPS moves the reconstruction into the grid of a map. `reference_lla` stays in the file and is not the
/// origin any more.
#[test]
fn georeferenced_opendronemap_is_in_the_grid_of_its_coords_file() {
    let folder = turned_ring([0.0; 3]);
    let root = opensfm(&folder, "opensfm/reconstruction.json");
    let georeferencing = root.path().join("odm_georeferencing");
    let coords = georeferencing.join("coords.txt");
    let known = || load(root.path()).expect("loads").coordinates;
    std::fs::create_dir(&georeferencing).expect("a folder");
    std::fs::write(root.path().join("opensfm/reconstruction.topocentric.json"), "[]").expect("written");
    let dataset = load(root.path()).expect("loads");
    assert_eq!(dataset.coordinates, None, "a grid without its offset");
    assert!(
        matches!(&dataset.warnings[..], [Warning::CoordinatesUnknown { file, .. }] if *file == coords),
        "{:?}",
        dataset.warnings
    );
    for (name, epsg) in [("WGS84 UTM 17N", Some(32_617)), ("WGS84 UTM 2S", Some(32_702)), ("EPSG:2056", None)] {
        std::fs::write(&coords, format!("\u{feff}{name}\r\n500123 4600987\r\n1.0 2.0 3.0\r\n")).expect("written");
        let grid = Coordinates::Grid { crs: name.to_owned(), epsg, proj: None, offset: [500_123.0, 4_600_987.0] };
        assert_eq!(known(), Some(grid));
    }
    std::fs::write(georeferencing.join("proj.txt"), "+proj=utm +zone=17 +datum=WGS84\n").expect("written");
    assert!(
        matches!(known(), Some(Coordinates::Grid { proj: Some(proj), .. }) if proj == "+proj=utm +zone=17 +datum=WGS84")
    );
    for broken in ["", "WGS84 UTM 17N\n", "1 2\n3 4\n", "WGS84 UTM 17N\nfar away\n", "WGS84 UTM 17N\n1 inf\n"] {
        std::fs::write(&coords, broken).expect("written");
        let dataset = load(root.path()).expect("loads");
        assert_eq!((dataset.coordinates, dataset.warnings.len()), (None, 1), "{broken:?}");
    }
}

#[test]
fn what_is_wrong_in_a_file_is_named_with_its_place() {
    let folder = turned_ring([0.0; 3]);
    type Change = fn(&mut Value);
    let frames: [(Change, &[&str]); 9] = [
        (|v| v["fl_x"] = json!("wide"), &["fl_x", "wide"]),
        (|v| v["fl_x"] = json!(-3), &["fl_x of frame './images/a.png'", "is -3"]),
        (|v| v["fl_x"] = Value::Null, &["fl_x of frame", "is missing"]),
        (|v| v["w"] = json!(0), &["w of frame", "is 0"]),
        (|v| v["camera_model"] = json!("EQUIRECTANGULAR"), &["camera_model", "EQUIRECTANGULAR", "panorama"]),
        (
            |v| v["frames"][1]["transform_matrix"][0][0] = json!(7),
            &["transform_matrix of frame './images/b.png'", "no rotation"],
        ),
        (|v| v["frames"][2]["transform_matrix"] = json!([[1, 0, 0]]), &["transform_matrix of frame './images/c.png'"]),
        (|v| v["frames"][2]["file_path"] = json!(["c"]), &["file_path"]),
        (|v| drop(v.as_object_mut().map(|o| o.remove("frames"))), &["frames at line", "missing field"]),
    ];
    for (change, words) in frames {
        let root = nerfstudio(&folder, true);
        let mut value = transforms(&folder);
        change(&mut value);
        write_json(&root.path().join("transforms.json"), &value);
        complains(root.path(), &[&["transforms.json", "at line"], words].concat());
    }
    let parts: [(Change, &[&str]); 7] = [
        (|v| v[0]["shots"]["b.png"]["camera"] = json!("other"), &["camera of shot 'b.png'", "other"]),
        (|v| v[0]["shots"]["b.png"]["rotation"] = json!([0, 1]), &["rotation"]),
        (|v| v[0]["points"]["93"]["coordinates"] = json!([0, "x", 1]), &["coordinates", "invalid type"]),
        (|v| v[0]["cameras"]["v2 dji 24 16 brown 0.85"]["focal_y"] = Value::Null, &["focal_y of camera", "is missing"]),
        (
            |v| v[0]["cameras"]["v2 dji 24 16 brown 0.85"]["projection_type"] = json!("dual"),
            &["projection_type", "dual"],
        ),
        (|v| v[0]["cameras"]["v2 dji 24 16 brown 0.85"]["width"] = json!(-4), &["width"]),
        (|v| drop(v[0].as_object_mut().map(|o| o.remove("shots"))), &["shots at line", "missing field"]),
    ];
    for (change, words) in parts {
        let root = opensfm(&folder, "reconstruction.json");
        let mut value = reconstruction(&folder);
        change(&mut value);
        write_json(&root.path().join("reconstruction.json"), &value);
        complains(root.path(), &[&["reconstruction.json", "at line"], words].concat());
    }
    let root = opensfm(&folder, "reconstruction.json");
    write_json(&root.path().join("reconstruction.json"), &json!([]));
    assert!(matches!(load(root.path()), Err(Error::NoImages { .. })));
}

#[test]
fn truncated_and_foreign_files_are_named() {
    let folder = turned_ring([0.0; 3]);
    let roots = [
        (nerfstudio(&folder, true), "transforms.json"),
        (nerfstudio(&folder, true), "sparse_pc.ply"),
        (nerfstudio(&folder, false), "sparse_pc.ply"),
        (opensfm(&folder, "reconstruction.json"), "reconstruction.json"),
    ];
    for (root, name) in &roots {
        let file = root.path().join(name);
        let whole = fs::read(&file).expect("file");
        load(root.path()).expect("whole");
        // A text file is readable with one digit of its last number.
        for length in (0..whole.len() - 4).step_by(1 + whole.len() / 150) {
            fs::write(&file, &whole[..length]).expect("written");
            complains(root.path(), &[name]);
        }
        for foreign in [&b"\x89PNG\r\n\x1a\n"[..], b"{}", b"[1, 2]", b"\xff\xfe\0\0", b"ply\n", b"null"] {
            fs::write(&file, foreign).expect("written");
            if !(*name == "reconstruction.json" && foreign == b"{}") {
                complains(root.path(), &[name]);
            }
        }
    }
    let root = nerfstudio(&folder, true);
    fs::remove_file(root.path().join("sparse_pc.ply")).expect("removed");
    complains(root.path(), &["sparse_pc.ply", "ply_file_path", "is not there"]);
    fs::remove_file(root.path().join("images/b.png")).expect("removed");
    fs::write(root.path().join("sparse_pc.ply"), cloud(&folder, true)).expect("points");
    complains(root.path(), &["1 of 3 photographs is missing", "b.png"]);
}

#[track_caller]
fn complains(root: &Path, words: &[&str]) {
    let strict = LoadOptions { strict: true, ..LoadOptions::default() };
    let error = Dataset::load(root, &strict).map(|d| d.views.len()).expect_err(words[0]).to_string();
    for word in words {
        assert!(error.contains(word), "does not say {word}: {error}");
    }
}

#[test]
fn masks_that_frames_name_are_used() {
    let folder = turned_ring([0.0; 3]);
    let root = nerfstudio(&folder, true);
    let mut value = transforms(&folder);
    value["frames"][1]["mask_path"] = json!("hidden/b_mask.png");
    write_json(&root.path().join("transforms.json"), &value);
    complains(root.path(), &["b_mask.png", "mask_path of frame", "is not there"]);
    fs::create_dir_all(root.path().join("hidden")).expect("folder");
    image::GrayImage::new(24, 16).save(root.path().join("hidden/b_mask.png")).expect("mask");
    let dataset = load(root.path()).expect("loads");
    let masks = dataset.masks.as_ref().expect("masks");
    assert_eq!((masks.matched, masks.of), (1, 3));
    assert!(dataset.views[1].photograph().expect("decodes").rgba8().chunks_exact(4).all(|p| p[3] == 0));
    assert!(dataset.views[0].photograph().expect("decodes").rgba8().chunks_exact(4).all(|p| p[3] == 255));
}

/// NeRF's layout: a file for each part, an angle in place of focal lengths, names without extensions.
#[test]
fn scenes_in_parts_hold_out_what_they_keep_for_it() {
    let names: Vec<String> = (0..20).map(|i| format!("r_{i:02}.png")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let folder = Folder::ring(&names, [0.0; 3]);
    let whole = transforms(&folder);
    let write = |root: &Path, part: &str, frames: std::ops::Range<usize>| {
        let named = |i: usize| {
            let mut frame = whole["frames"][i].clone();
            frame["file_path"] = json!(format!("./{part}/r_{i:02}"));
            frame
        };
        let frames: Vec<Value> = frames.map(named).collect();
        let file = json!({ "camera_angle_x": 0.9, "frames": frames });
        write_json(&root.join(format!("transforms_{part}.json")), &file);
        folder.write_photographs(&root.join(part));
    };
    let root = tempfile::tempdir().expect("temporary folder");
    let roles = |split: Split| {
        let options = LoadOptions { split, ..LoadOptions::default() };
        let dataset = Dataset::load(root.path(), &options).expect("loads");
        assert_eq!(dataset.format, Format::Nerfstudio);
        let of = |role| dataset.views_of(role).map(|(_, view)| view.name.clone()).collect::<Vec<_>>();
        assert!(dataset.views.iter().all(|view| (view.camera.fx - 12.0 / (0.45_f64).tan()).abs() < 1e-12));
        (of(Role::Train), of(Role::HeldOut))
    };
    let of_part = |part: &str, numbers: &[usize]| -> Vec<String> {
        numbers.iter().map(|i| format!("{part}/r_{i:02}.png")).collect()
    };
    let all: Vec<usize> = (0..10).collect();
    write(root.path(), "train", 0..10);
    // A single part is split like other datasets.
    assert_eq!(roles(Split::Test).1, of_part("train", &[0, 8]));
    write(root.path(), "test", 10..14);
    assert_eq!(roles(Split::Test), (of_part("train", &all), of_part("test", &[10, 11, 12, 13])));
    // Without a validation part, validation photographs are taken from the training part.
    assert_eq!(roles(Split::Val), (of_part("train", &[1, 2, 3, 5, 6, 7, 9]), of_part("train", &[4])));
    assert_eq!(roles(Split::None), (of_part("train", &all), Vec::new()));
    assert_eq!(roles(Split::Every { every: 5, first: 1 }).1, of_part("train", &[1, 6]));
    write(root.path(), "val", 14..16);
    assert_eq!(roles(Split::Val), (of_part("train", &all), of_part("val", &[14, 15])));
    assert_eq!(roles(Split::Test).1, of_part("test", &[10, 11, 12, 13]));
    // A file of the whole dataset wins over files of parts.
    write_json(&root.path().join("transforms.json"), &json!({ "camera_angle_x": 0.9, "frames": [] }));
    complains(root.path(), &["transforms.json"]);
    fs::remove_file(root.path().join("transforms.json")).expect("removed");
    fs::remove_file(root.path().join("transforms_train.json")).expect("removed");
    complains(root.path(), &["no dataset here", "transforms_train.json"]);
}

#[test]
fn random_points_lie_where_cameras_look() {
    let names: Vec<String> = (0..12).map(|i| format!("{i:02}.png")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    for offset in [[0.0; 3], UTM] {
        let mut folder = Folder::ring(&names, offset);
        folder.points.clear();
        let root = folder.dataset(false);
        let dataset = load(root.path()).expect("loads");
        let points = dataset.random_points(3);
        assert!(points.len() > 10_000, "{} points", points.len());
        assert_eq!(points, dataset.random_points(3), "equal seeds");
        assert_ne!(points, dataset.random_points(4));
        for (point, _) in points.iter().step_by(97) {
            let seen = dataset.views.iter().filter(|view| {
                let (c, center) = (&view.camera, view.camera.center());
                let at = c.rotation.map(|row| (0..3).map(|k| row[k] * (point[k] - center[k])).sum::<f64>());
                let (u, v) = (c.fx * at[0] / at[2] + c.cx, c.fy * at[1] / at[2] + c.cy);
                at[2] > 0.0 && u > 0.0 && v > 0.0 && u < f64::from(c.width) && v < f64::from(c.height)
            });
            assert!(seen.count() >= 3, "{point:?}");
        }
    }
    let one = load(Folder::ring(&["a.png"], [0.0; 3]).dataset(false).path()).expect("loads");
    assert!(one.random_points(0).is_empty(), "one photograph says nothing of depth");
}

#[test]
fn orientation_tags_are_not_applied() {
    let root = Folder::ring(&["a.jpg", "b.jpg"], [0.0; 3]).dataset(false);
    let plain = fs::read(root.path().join("images/a.jpg")).expect("photograph");
    // An EXIF segment with one entry: orientation (0x0112) 6, turned by 90 degrees.
    let tiff = [&b"MM\0*\0\0\0\x08\0\x01"[..], b"\x01\x12\0\x03\0\0\0\x01\0\x06\0\0", b"\0\0\0\0"].concat();
    let body = [&b"Exif\0\0"[..], &tiff].concat();
    let segment = [&[0xff, 0xe1][..], &(body.len() as u16 + 2).to_be_bytes(), &body].concat();
    let tagged = [&plain[..2], &segment, &plain[2..]].concat();
    fs::write(root.path().join("images/b.jpg"), tagged).expect("written");
    let dataset = load(root.path()).expect("loads");
    let [a, b] = [0, 1].map(|i| dataset.views[i].photograph().expect("decodes"));
    assert_eq!((dataset.views[1].size_on_disk, a == b), ((24, 16), true), "the stored pixels are COLMAP's");
}
