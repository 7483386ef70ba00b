//! PLY files, as models, as clouds and as meshes.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use psrgs_vk::format::ply;
use psrgs_vk_fuzz::{Scratch, begin, seeds, within};

static FOLDER: LazyLock<Scratch> = LazyLock::new(Scratch::new);

fuzz_target!(init: begin(seeds::clouds::ply), |data: &[u8]| {
    let file = FOLDER.put("input.ply", data);
    within(data.len(), 512, || {
        match ply::read_content(&file) {
            Ok(ply::Content::Model(model)) => {
                let copy = FOLDER.path().join("copy.ply");
                ply::write(&copy, &model).expect("a model that was read can be written");
                let again = ply::read(&copy).expect("and read again");
                assert_eq!((&again.gaussians, again.shift), (&model.gaussians, model.shift));
            }
            Ok(ply::Content::Cloud(cloud)) => {
                assert!(cloud.positions.iter().flatten().all(|v| v.is_finite()));
                assert!(cloud.colours.is_empty() || cloud.positions.len() == cloud.colours.len());
            }
            Err(error) => assert!(!error.to_string().is_empty()),
        }
        if let Ok(mesh) = ply::Mesh::read(&file) {
            assert!(mesh.triangles.iter().flatten().all(|v| (*v as usize) < mesh.vertices.len()));
        }
    });
});
