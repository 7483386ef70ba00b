//! The views of a dataset, from the model's shots and the headers of their photographs.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::model::{Model, Shot};
use super::picture_file::{self, Header};
use super::{DecodeLimit, Error, ImagesFolder, LoadOptions, Role, Samples, View, masks, numeric_limits, sizing};

/// Least pixels on the longer side of a reduced copy. Rounded sides of smaller copies fit cameras of any shape.
const SMALLEST_COPY: u32 = 8;

/// A view of each shot with its role and its mask, or the shot's error. `images` is the folder of photographs, if any.
pub(super) fn of_shots(
    model: &Model,
    images: Option<&ImagesFolder>,
    options: &LoadOptions,
    roles: Vec<Role>,
    masks: Vec<Option<PathBuf>>,
) -> Vec<Result<View, Error>> {
    let limit = DecodeLimit::new(options.host_memory);
    let shots = model.shots.par_iter().zip(roles).zip(masks);
    shots
        .map(|((shot, role), mask)| {
            let photograph = images.map(|folder| folder.path.join(&shot.file));
            let view = of_shot(shot, photograph, options, limit)?;
            if let Some(mask) = &mask {
                masks::check_size(mask, view.size_on_disk, limit)?;
            }
            let view = View { role, mask, ..view };
            numeric_limits::check_camera(&model.file, &view).map(|()| view)
        })
        .collect()
}

/// The view of a shot without a mask, for training.
fn of_shot(shot: &Shot, photograph: Option<PathBuf>, options: &LoadOptions, limit: DecodeLimit) -> Result<View, Error> {
    let header = match &photograph {
        Some(file) => picture_file::header_within(file, limit)?,
        None => Header { size: (shot.lens.size[0], shot.lens.size[1]), samples: Samples::Bits8, jpeg: false },
    };
    let Header { size: size_on_disk, samples, jpeg } = header;
    let path = photograph.unwrap_or_default();
    check_aspect(&path, shot, size_on_disk)?;
    let (lens, camera) = sizing::camera(&path, shot, size_on_disk, options.sizing(), options.rounding)?;
    Ok(View {
        name: shot.name.clone(),
        path,
        camera,
        lens,
        model: shot.model.clone(),
        mask: None,
        mask_ignores: options.mask_ignores,
        behind: options.behind,
        size_on_disk,
        jpeg,
        samples,
        tone: options.tone,
        limit,
        role: Role::Train,
        pose_checked: false,
    })
}

/// Compares aspect ratios. The file may be a reduced copy, whose sides are rounded up or down.
fn check_aspect(file: &Path, shot: &Shot, photograph: (u32, u32)) -> Result<(), Error> {
    let camera = (shot.lens.size[0], shot.lens.size[1]);
    let longer = |size: (u32, u32)| size.0.max(size.1);
    let tiny = longer(photograph) < SMALLEST_COPY.min(longer(camera));
    if sizing::same_shape(photograph, camera) && !tiny {
        return Ok(());
    }
    let turned = sizing::same_shape((photograph.1, photograph.0), camera);
    Err(Error::AspectRatio {
        file: file.to_owned(),
        photograph,
        camera: shot.camera.clone(),
        expected: camera,
        hint: if tiny {
            "; it is too small for a reduced copy"
        } else if turned {
            "; turned by 90 degrees it would fit: orientation tags of EXIF are not applied"
        } else {
            ""
        },
    })
}
