//! Clouds of points on surfaces, measured by a laser scanner or by stereo. A cloud limits where splats grow, and gives
//! depths and normals to train with. After RS-Gaussian (Li et al. 2024), whose LiDAR cloud limits where splats grow and
//! split; its code is not public, so the distance and the terms of the loss are this project's.

mod bounds;
mod maps;
mod normals;
mod proximity_index;

use std::fs::File;
use std::io::Read;
use std::path::Path;

pub use bounds::Bounds;
pub use maps::maps;
pub use proximity_index::ProximityIndex;

use super::Error;
use crate::dataset::Dataset;
use crate::format::{At, Error as FileError, LeftOut, foreign, las, ply};

/// The positions in a PLY, LAS or LAZ file, told apart by their first bytes. A few points that are not finite are left
/// out.
pub fn read(file: &Path) -> Result<Vec<[f64; 3]>, FileError> {
    read_with(file, false).map(|(positions, _)| positions)
}

/// The positions in a file, and what was left out. Points that are not finite are an error if `strict`, or if they are
/// more than one in ten.
pub fn read_with(file: &Path, strict: bool) -> Result<(Vec<[f64; 3]>, Option<LeftOut>), FileError> {
    let mut opened = File::open(file).map_err(FileError::io(file, "open"))?;
    let mut begins = Vec::new();
    opened.by_ref().take(foreign::LOOKED_AT as u64).read_to_end(&mut begins).map_err(FileError::io(file, "read"))?;
    match begins.as_slice() {
        begin if begin.starts_with(&las::MAGIC) => Ok((las::read(file)?, None)),
        [b'p', b'l', b'y', ..] | [0xef, 0xbb, 0xbf, b'p', ..] => {
            ply::Cloud::read_with(file, strict).map(|(cloud, left_out)| (cloud.positions, left_out))
        }
        _ => {
            let bytes = opened.metadata().map_err(FileError::io(file, "read"))?.len();
            let problem = foreign::described(file, bytes, &begins).unwrap_or_else(|| {
                "neither a PLY file, which begins with 'ply', nor a LAS or LAZ file, which begins with 'LASF'"
                    .to_owned()
            });
            Err(FileError::malformed(file, "signature", At::Byte(0), problem))
        }
    }
}

/// The positions in a file, in scene coordinates. An error if none lies where the dataset's cameras look.
pub fn placed(file: &Path, dataset: &Dataset) -> Result<Vec<[f64; 3]>, Error> {
    place(file, read(file)?, dataset)
}

/// Positions of a file turned into scene coordinates. An error if none lies where the dataset's cameras look.
pub(super) fn place(file: &Path, positions: Vec<[f64; 3]>, dataset: &Dataset) -> Result<Vec<[f64; 3]>, Error> {
    let scene = Bounds::of_dataset(dataset);
    if positions.iter().any(|p| scene.contains(*p)) {
        return Ok(positions.into_iter().map(|p| dataset.frame.to_scene(p)).collect());
    }
    Err(Error::CloudElsewhere {
        file: file.to_owned(),
        cloud: Bounds::of(positions.iter().copied()).map(Box::new),
        scene: Box::new(scene),
    })
}
