//! From a dataset and settings to the input of a training.

use std::collections::HashSet;
use std::path::Path;

use super::Error;
use super::input::{Input, View};
use super::settings::{self, Settings};
use crate::dataset::{Dataset, LoadOptions, Role, Warning};
use crate::format::ply;
use crate::scene::{Frame, Gaussians, init};

/// How a dataset is loaded for these settings.
pub fn load_options(photographs: &settings::Photographs) -> LoadOptions {
    LoadOptions {
        max_side: Some(photographs.max_side),
        images_folder: photographs.images.as_ref().map(Into::into),
        split: photographs.split,
        format: photographs.format,
        mask_ignores: photographs.mask_ignores,
        ..LoadOptions::default()
    }
}

/// The views of a role with their photographs decoded, cameras in scene coordinates. Pixels less than half opaque are masked;
/// a photograph without any other is left out: see [`left_out`].
pub fn views(dataset: &Dataset, role: Role) -> Result<Vec<View>, Error> {
    let photographs = dataset.photographs(role)?;
    let views = dataset.views_of(role).zip(photographs);
    Ok(views
        .filter_map(|((index, view), photograph)| {
            let camera = dataset.scene_camera(index)?;
            let mut rgba = photograph.rgba;
            rgba.chunks_exact_mut(4).for_each(|p| p[3] = if p[3] < 128 { 0 } else { 255 });
            Some(View { name: view.name.clone(), camera, rgba })
        })
        .filter(|view| view.rgba.chunks_exact(4).any(|p| p[3] != 0))
        .collect())
}

/// What to tell of the views of a role that [`views`] has left out.
pub fn left_out(dataset: &Dataset, role: Role, views: &[View]) -> Vec<Warning> {
    let kept: HashSet<&str> = views.iter().map(|view| view.name.as_str()).collect();
    let gone = dataset.views_of(role).filter(|(_, view)| !kept.contains(view.name.as_str()));
    gone.map(|(_, view)| Warning::AllMasked { name: view.name.clone() }).collect()
}

/// The first model: from `--init`, or from the reconstructed points, or where there are none from random ones.
pub fn initial(dataset: &Dataset, init_file: Option<&Path>, seed: u64) -> Result<Gaussians, Error> {
    match init_file {
        Some(file) => Ok(ply::read(file)?.in_scene(&dataset.frame)),
        None => {
            let points: Vec<_> = match dataset.points.as_slice() {
                [] => dataset.random_points(seed),
                points => points.iter().map(|p| (p.position, p.color)).collect(),
            };
            Ok(init::from_points(&points, &dataset.frame)?)
        }
    }
}

/// Decodes the photographs and makes the first model. Held-out photographs are decoded too, for evaluation only.
pub fn input(dataset: &Dataset, settings: &Settings) -> Result<Input, Error> {
    Ok(Input {
        train: views(dataset, Role::Train)?,
        held_out: views(dataset, Role::HeldOut)?,
        initial: initial(dataset, settings.run.init.as_deref(), settings.run.seed)?,
        extent: Frame::EXTENT as f32,
    })
}
