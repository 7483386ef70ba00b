//! Models in the formats of viewers.

use psrgs_vk::format::Error;
use psrgs_vk::format::ply::Model;
use psrgs_vk::format::splats::spz::Version;
use psrgs_vk::format::splats::{gltf, sog, splat, spz};
use psrgs_vk::scene::Gaussians;

use crate::chosen;

/// A model of a few splats.
pub fn model(splats: usize, sh_degree: u32) -> Model {
    let mut gaussians = Gaussians::zeros(splats);
    gaussians.means.iter_mut().enumerate().for_each(|(k, v)| *v = k as f32 * 0.25 - 1.0);
    gaussians.quats.iter_mut().enumerate().for_each(|(k, v)| *v = (k % 5) as f32 - 2.0);
    gaussians.sh.iter_mut().flatten().enumerate().for_each(|(k, v)| *v = (k % 7) as f32 * 0.1);
    Model { gaussians, sh_degree, antialias: Some(true), ..Model::default() }
}

/// What holds of every result: the values are finite, the planes as long as each other, and errors name the file.
pub fn check(result: Result<Model, Error>) {
    match result {
        Ok(model) => {
            assert!(model.gaussians.finite_rows().is_none() && model.sh_degree <= 3);
            assert!(model.gaussians.means.len() == 3 * model.gaussians.len());
        }
        Err(error) => assert!(error.to_string().contains("input.")),
    }
}

/// Files of every version.
pub fn spz() -> Vec<Vec<u8>> {
    let of = |n, degree, version| spz::encode(&model(n, degree), 3, version).expect("a model");
    vec![of(3, 3, Version::Two), of(3, 1, Version::Three), of(3, 2, Version::Four), of(0, 0, Version::Four)]
}

/// Files with and without a palette.
pub fn sog() -> Vec<Vec<u8>> {
    [(0, 0), (3, 0), (5, 1), (5, 3)].map(|(n, degree)| sog::encode(&model(n, degree), 3).expect("a model")).to_vec()
}

/// GLB and `.splat` files.
pub fn glb() -> Vec<Vec<u8>> {
    let of = |n, degree| chosen(0, gltf::encode(&model(n, degree), 3).expect("a model"));
    vec![of(0, 0), of(3, 0), of(3, 3), chosen(1, splat::encode(&model(3, 0)).expect("a model"))]
}
