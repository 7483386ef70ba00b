//! The world as a dataset: COLMAP's files read field by field, and by the project's own reader.

use std::fs;
use std::path::Path;

use glam::{DQuat, DVec3};
use psrgs_vk::world::{Progress, Stage, World, WorldParams, generate};

use crate::small;

/// A reader of the consecutive fields of the binary COLMAP format.
struct Fields(Vec<u8>, usize);

impl Fields {
    fn open(path: &Path) -> Self {
        Self(fs::read(path).unwrap(), 0)
    }

    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let out = self.0[self.1..self.1 + N].try_into().unwrap();
        self.1 += N;
        out
    }

    fn u64(&mut self) -> u64 {
        u64::from_le_bytes(self.bytes())
    }

    fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.bytes())
    }

    fn f64(&mut self) -> f64 {
        f64::from_le_bytes(self.bytes())
    }

    fn end(&self) {
        assert_eq!(self.0.len(), self.1, "bytes left over");
    }
}

struct Photo {
    name: String,
    rotation: DQuat,
    translation: DVec3,
    seen: Vec<(f64, f64, u64)>,
}

#[test]
fn dataset_is_consistent() {
    let dir = tempfile::tempdir().unwrap();
    let mut params = small();
    // With these two effects, residuals have more than the noise of observations: see the tests of sparse points.
    (params.effects.pose_noise, params.effects.outliers) = (0.0, 0.0);
    let mut stages = Vec::new();
    let summary = generate(&params, dir.path(), &mut |p: Progress| stages.push(p)).unwrap();
    assert_eq!(stages.first().map(|p| (p.stage, p.total)), Some((Stage::Photographs, 8)));
    assert_eq!(stages.last(), Some(&Progress { stage: Stage::Truth, done: 5, total: 5 }));
    assert_eq!((summary.images, summary.width, summary.height), (8, 96, 72));

    let sparse = dir.path().join("sparse/0");
    let mut f = Fields::open(&sparse.join("cameras.bin"));
    assert_eq!((f.u64(), f.u32(), f.u32(), f.u64(), f.u64()), (1, 1, 1, 96, 72));
    let [fx, fy, cx, cy] = [f.f64(), f.f64(), f.f64(), f.f64()];
    f.end();
    assert!((cx - 48.0).abs() > 0.5 && (cy - 36.0).abs() > 0.3, "the principal point is off centre");

    let mut f = Fields::open(&sparse.join("images.bin"));
    let photos: Vec<Photo> = (0..f.u64())
        .map(|k| {
            assert_eq!(u64::from(f.u32()), k + 1);
            let [w, x, y, z] = [f.f64(), f.f64(), f.f64(), f.f64()];
            let translation = DVec3::new(f.f64(), f.f64(), f.f64());
            assert_eq!(f.u32(), 1);
            let mut name = Vec::new();
            loop {
                match f.bytes::<1>() {
                    [0] => break,
                    [c] => name.push(c),
                }
            }
            let seen = (0..f.u64()).map(|_| (f.f64(), f.f64(), f.u64())).collect();
            let rotation = DQuat::from_xyzw(x, y, z, w);
            assert!((rotation.length() - 1.0).abs() < 1e-9);
            Photo { name: String::from_utf8(name).unwrap(), rotation, translation, seen }
        })
        .collect();
    f.end();
    assert_eq!(photos.len(), 8);

    let mut f = Fields::open(&sparse.join("points3D.bin"));
    let count = f.u64();
    assert_eq!(count as usize, summary.points);
    assert!(count > 60, "{count} points");
    let depths: Vec<Vec<f32>> = photos
        .iter()
        .map(|p| {
            let file = dir.path().join("depth").join(&p.name).with_extension("exr");
            let image = exr::prelude::read_first_flat_layer_from_file(file).unwrap();
            let channel = &image.layer_data.channel_data.list[0];
            assert_eq!(channel.name.to_string(), "Z");
            assert_eq!((image.layer_data.size.x(), image.layer_data.size.y()), (96, 72));
            channel.sample_data.values_as_f32().collect()
        })
        .collect();
    let (mut squares, mut observations, mut near) = (0.0, 0usize, 0usize);
    for number in 1..=count {
        assert_eq!(f.u64(), number);
        let p = DVec3::new(f.f64(), f.f64(), f.f64());
        let _colour: [u8; 3] = f.bytes();
        let error = f.f64();
        let length = f.u64();
        assert!(length >= 3);
        let mut mean = 0.0;
        for _ in 0..length {
            let photo_id = f.u32() as usize - 1;
            let photo = &photos[photo_id];
            let (x, y, id) = photo.seen[f.u32() as usize];
            assert_eq!(id, number, "the track and the photograph name each other");
            let q = photo.rotation * p + photo.translation;
            let (u, v) = (fx * q.x / q.z + cx, fy * q.y / q.z + cy);
            let distance = (u - x).hypot(v - y);
            assert!(distance < 2.5, "{distance} px off");
            mean += distance / length as f64;
            squares += (u - x).powi(2) + (v - y).powi(2);
            observations += 1;
            let truth = f64::from(depths[photo_id][y as usize * 96 + x as usize]);
            near += usize::from((truth - q.z).abs() < 0.02 * q.z);
        }
        assert!((mean - error).abs() < 1e-6);
    }
    f.end();
    assert_eq!(observations, summary.observations);
    // Three coordinates are fitted to 2 n values with noise of 0.3 px each: residuals keep 2 n - 3 degrees of freedom.
    let freedom = 2.0 * observations as f64 - 3.0 * count as f64;
    let sigma = (squares / freedom).sqrt();
    assert!((sigma - 0.3).abs() < 5.0 * 0.3 / (2.0 * freedom).sqrt(), "residuals of {sigma} px");
    // Not all: next to an edge, the pixel's centre may lie on another surface.
    assert!(near * 10 > observations * 8, "{near} of {observations} observations lie at the true depth");

    let written: WorldParams = toml::from_str(&fs::read_to_string(dir.path().join("world.toml")).unwrap()).unwrap();
    assert_eq!(written, params);
    // The project's own reader finds the same values.
    let options = psrgs_vk::dataset::LoadOptions::default();
    let dataset = psrgs_vk::dataset::Dataset::load(dir.path(), &options).unwrap();
    assert!(dataset.warnings.is_empty(), "{:?}", dataset.warnings);
    assert_eq!((dataset.views.len(), dataset.points.len()), (8, summary.points));
    let world = World::new(&params).unwrap();
    for (read, made) in dataset.views.iter().zip(world.views()) {
        assert_eq!(read.name, made.name);
        let (a, b) = (read.camera.center(), made.reconstructed.center());
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9), "{a:?} {b:?}");
    }
    for p in &photos {
        let image = image::open(dir.path().join("images").join(&p.name)).unwrap().to_rgb8();
        assert_eq!(image.dimensions(), (96, 72));
    }
}

/// A second world in the folder of a first removes the files of the first and no others.
#[test]
fn files_of_others_in_the_folder_of_a_world_stay() {
    let dir = tempfile::tempdir().unwrap();
    let params = |images| WorldParams { images, max_side: 48, supersample: 1, offpath: 1, ..small() };
    generate(&params(3), dir.path(), &mut |_| ()).unwrap();
    let others = [
        "images/mine.jpg",
        "images/view_a.jpg",
        "images/views/view_0000.jpg",
        "depth/notes.txt",
        "sparse/0/points3D.txt",
    ];
    for name in others {
        std::fs::create_dir_all(dir.path().join(name).parent().unwrap()).unwrap();
        std::fs::write(dir.path().join(name), "theirs").unwrap();
    }
    generate(&params(2), dir.path(), &mut |_| ()).unwrap();
    assert!(others.iter().all(|name| std::fs::read(dir.path().join(name)).unwrap() == b"theirs"));
    assert!(dir.path().join("images/view_0001.jpg").exists() && !dir.path().join("images/view_0002.jpg").exists());
    assert!(!dir.path().join("depth/view_0002.exr").exists());
}

#[test]
fn a_world_does_not_replace_what_no_world_has_left() {
    for name in ["world.toml", "lidar.las", "images/a.jpg", "sparse/0/cameras.bin"] {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join(name);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(&file, "port = 80").unwrap();
        let error = generate(&small(), dir.path(), &mut |_| ()).unwrap_err().to_string();
        assert!(error.contains("no world made this") && error.contains("another folder"), "{name}: {error}");
        assert_eq!(std::fs::read(&file).unwrap(), b"port = 80");
    }
}
