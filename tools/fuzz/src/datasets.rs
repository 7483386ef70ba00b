//! Whole datasets, with the input as one of their files.

use psrgs_vk::dataset::{Dataset, LoadOptions};

use crate::Scratch;
use crate::seeds::folders;

/// The files of a COLMAP model. The first byte of an input chooses one in this order.
pub struct Colmap {
    scratch: Scratch,
    files: [(&'static str, Vec<u8>); 3],
}

impl Colmap {
    /// A whole dataset without photographs.
    pub fn new(text: bool) -> Self {
        let folder = folders::ring();
        let this = Self { scratch: Scratch::new(), files: if text { folder.text() } else { folder.binary() } };
        this.files.iter().for_each(|(name, bytes)| this.put(name, bytes));
        this
    }

    fn put(&self, name: &str, bytes: &[u8]) {
        self.scratch.put(&format!("sparse/0/{name}"), bytes);
    }

    /// Loads the dataset with one of its files replaced.
    pub fn load_with(&self, file: usize, bytes: &[u8]) {
        let (name, whole) = &self.files[file % self.files.len()];
        self.put(name, bytes);
        load(&self.scratch, false);
        self.put(name, whole);
    }
}

/// Loads the dataset in a folder, and checks that it can be used.
pub fn load(scratch: &Scratch, photographs: bool) -> Option<Dataset> {
    let options = LoadOptions { photographs, max_side: Some(64), ..LoadOptions::default() };
    let dataset = match Dataset::load(scratch.path(), &options) {
        Ok(dataset) => dataset,
        Err(error) => {
            // Messages contain words from files.
            assert!(!error.to_string().is_empty());
            return None;
        }
    };
    let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
    assert!(!dataset.views.is_empty() && dataset.extent > 0.0 && dataset.extent.is_finite());
    assert!(dataset.frame.scale > 0.0 && finite(&dataset.frame.offset) && finite(&[dataset.frame.scale]));
    for i in 0..dataset.views.len() {
        let camera = dataset.scene_camera(i).expect("a camera for each view");
        assert!(camera.width > 0 && camera.height > 0 && camera.fx > 0.0 && camera.fy > 0.0, "{camera:?}");
        assert!(finite(&[camera.fx, camera.fy, camera.cx, camera.cy]) && finite(&camera.translation), "{camera:?}");
        assert!(camera.rotation.iter().all(|row| finite(row)), "{camera:?}");
    }
    if let Ok(first) = dataset.first_gaussians() {
        let planes = [&first.means, &first.scales, &first.quats, &first.opacities, &first.sh[0]];
        assert!(planes.iter().all(|plane| plane.iter().all(|v| v.is_finite())), "{first:?}");
    }
    let problems = dataset.problems(&dataset.sights());
    assert!(problems.iter().all(|problem| !problem.is_empty()));
    Some(dataset)
}
