//! COLMAP folders as COLMAP writes them, for the tests to read.
#![allow(dead_code, reason = "each test crate uses its own part")]

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use image::{Rgb, RgbImage};

#[derive(Clone)]
pub(crate) struct CameraRow {
    pub(crate) id: u32,
    pub(crate) model: (&'static str, i32),
    pub(crate) size: [u64; 2],
    pub(crate) params: Vec<f64>,
}

#[derive(Clone)]
pub(crate) struct ImageRow {
    pub(crate) id: u32,
    pub(crate) quaternion: [f64; 4],
    pub(crate) translation: [f64; 3],
    pub(crate) camera: u32,
    pub(crate) name: String,
    pub(crate) keypoints: Vec<(f64, f64, i64)>,
}

#[derive(Clone)]
pub(crate) struct PointRow {
    pub(crate) id: u64,
    pub(crate) position: [f64; 3],
    pub(crate) colour: [u8; 3],
    pub(crate) error: f64,
    pub(crate) track: Vec<(u32, u32)>,
}

#[derive(Clone)]
pub(crate) struct Folder {
    pub(crate) cameras: Vec<CameraRow>,
    pub(crate) images: Vec<ImageRow>,
    pub(crate) points: Vec<PointRow>,
}

pub(crate) const PINHOLE: (&str, i32) = ("PINHOLE", 1);
pub(crate) const SIMPLE_PINHOLE: (&str, i32) = ("SIMPLE_PINHOLE", 0);
pub(crate) const THIN_PRISM_FISHEYE: (&str, i32) = ("THIN_PRISM_FISHEYE", 10);

impl Folder {
    /// Cameras on a ring of radius 2 about `offset`, 10 above it and looking down at points around `offset`.
    pub(crate) fn ring(names: &[&str], offset: [f64; 3]) -> Self {
        let images = names.iter().enumerate().map(|(i, name)| {
            let angle = std::f64::consts::TAU * i as f64 / names.len() as f64;
            let center = [offset[0] + 2.0 * angle.cos(), offset[1] + 2.0 * angle.sin(), offset[2] + 10.0];
            // Half a turn about x: the camera looks along -z of the dataset. R = diag(1, -1, -1), t = -R c.
            ImageRow {
                id: i as u32 + 1,
                quaternion: [0.0, 1.0, 0.0, 0.0],
                translation: [-center[0], center[1], center[2]],
                camera: 1,
                name: (*name).to_owned(),
                keypoints: (0..i % 3).map(|k| (1.5 + k as f64, 2.25, if k == 0 { -1 } else { 7 })).collect(),
            }
        });
        let points = (0..12).map(|i| {
            let (u, v) = (f64::from(i % 4) * 0.7 - 1.0, f64::from(i / 4) * 0.9 - 1.0);
            PointRow {
                id: 100 - i as u64,
                position: [offset[0] + u, offset[1] + v, offset[2] + 0.1 * u * v],
                colour: [(i * 20) as u8, 255 - (i * 20) as u8, 128],
                error: 0.25 + f64::from(i) / 7.0,
                track: (0..2 + i as u32 % 3).filter(|k| *k < names.len() as u32).map(|k| (k + 1, k)).collect(),
            }
        });
        Self {
            images: images.collect(),
            points: points.collect(),
            cameras: vec![CameraRow { id: 1, model: PINHOLE, size: [24, 16], params: vec![20.5, 21.25, 11.125, 8.75] }],
        }
    }

    pub(crate) fn binary(&self) -> [(&'static str, Vec<u8>); 3] {
        let mut cameras = (self.cameras.len() as u64).to_le_bytes().to_vec();
        for c in &self.cameras {
            cameras.extend(c.id.to_le_bytes());
            cameras.extend(c.model.1.to_le_bytes());
            c.size.iter().for_each(|v| cameras.extend(v.to_le_bytes()));
            c.params.iter().for_each(|v| cameras.extend(v.to_le_bytes()));
        }
        let mut images = (self.images.len() as u64).to_le_bytes().to_vec();
        for i in &self.images {
            images.extend(i.id.to_le_bytes());
            i.quaternion.iter().chain(&i.translation).for_each(|v| images.extend(v.to_le_bytes()));
            images.extend(i.camera.to_le_bytes());
            images.extend(i.name.as_bytes());
            images.push(0);
            images.extend((i.keypoints.len() as u64).to_le_bytes());
            for (x, y, point) in &i.keypoints {
                images.extend(x.to_le_bytes());
                images.extend(y.to_le_bytes());
                images.extend(point.to_le_bytes());
            }
        }
        let mut points = (self.points.len() as u64).to_le_bytes().to_vec();
        for p in &self.points {
            points.extend(p.id.to_le_bytes());
            p.position.iter().for_each(|v| points.extend(v.to_le_bytes()));
            points.extend(p.colour);
            points.extend(p.error.to_le_bytes());
            points.extend((p.track.len() as u64).to_le_bytes());
            for (image, keypoint) in &p.track {
                points.extend(image.to_le_bytes());
                points.extend(keypoint.to_le_bytes());
            }
        }
        [("cameras.bin", cameras), ("images.bin", images), ("points3D.bin", points)]
    }

    pub(crate) fn text(&self) -> [(&'static str, Vec<u8>); 3] {
        let mut cameras = format!(
            "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number \
             of cameras: {}\n",
            self.cameras.len()
        );
        for c in &self.cameras {
            let _ = write!(cameras, "{} {} {} {}", c.id, c.model.0, c.size[0], c.size[1]);
            c.params.iter().for_each(|v| write!(cameras, " {v}").expect("to memory"));
            cameras.push('\n');
        }
        let mut images = format!(
            "# Image list with two lines of data per image:\n# Number of images: {}, mean observations per image: \
             1.5\n",
            self.images.len()
        );
        for i in &self.images {
            let _ = write!(images, "{}", i.id);
            i.quaternion.iter().chain(&i.translation).for_each(|v| write!(images, " {v}").expect("to memory"));
            let _ = writeln!(images, " {} {}", i.camera, i.name);
            let keypoints: Vec<String> = i.keypoints.iter().map(|(x, y, p)| format!("{x} {y} {p}")).collect();
            let _ = writeln!(images, "{}", keypoints.join(" "));
        }
        let mut points =
            format!("# 3D point list\n# Number of points: {}, mean track length: 2.5\n", self.points.len());
        for p in &self.points {
            let [x, y, z] = p.position;
            let [r, g, b] = p.colour;
            let _ = write!(points, "{} {x} {y} {z} {r} {g} {b} {}", p.id, p.error);
            p.track.iter().for_each(|(i, k)| write!(points, " {i} {k}").expect("to memory"));
            points.push('\n');
        }
        [
            ("cameras.txt", cameras.into_bytes()),
            ("images.txt", images.into_bytes()),
            ("points3D.txt", points.into_bytes()),
        ]
    }

    pub(crate) fn write(&self, root: &Path, files: &[(&'static str, Vec<u8>)]) {
        let sparse = root.join("sparse").join("0");
        fs::create_dir_all(&sparse).expect("folder");
        for (name, bytes) in files {
            fs::write(sparse.join(name), bytes).expect("file");
        }
    }

    /// One photograph per image, in the size of its camera and in a colour of its own.
    pub(crate) fn write_photographs(&self, folder: &Path) {
        for (i, image) in self.images.iter().enumerate() {
            let camera = self.cameras.iter().find(|c| c.id == image.camera).expect("camera");
            write_photograph(&folder.join(&image.name), camera.size[0] as u32, camera.size[1] as u32, i as u8);
        }
    }

    /// A whole dataset in a fresh temporary folder.
    pub(crate) fn dataset(&self, text: bool) -> tempfile::TempDir {
        let root = tempfile::tempdir().expect("temporary folder");
        self.write(root.path(), &if text { self.text() } else { self.binary() });
        self.write_photographs(&root.path().join("images"));
        root
    }
}

pub(crate) fn write_photograph(file: &Path, width: u32, height: u32, tint: u8) {
    fs::create_dir_all(file.parent().expect("parent")).expect("folder");
    RgbImage::from_fn(width, height, |x, y| Rgb([tint, (x * 9) as u8, (y * 13) as u8])).save(file).expect("photograph");
}
