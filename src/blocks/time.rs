//! How long the training of a block takes, as timed before any training.

use super::photographs::Chosen;
use super::surface::Piece;
use crate::dataset::{Dataset, Role};
use crate::scene::random::Random;
use crate::scene::{Gaussians, init};
use crate::train::{Error, Estimate, Input, OptionalInput, Settings, View, chosen_variants};
use crate::vk::Gpu;

/// Splats of a training in the mean over its steps, as a share of those at the end.
const MEAN: f64 = 0.6;
/// Most splats that are timed. More take a longer time in proportion.
const TIMED: f64 = 262_144.0;

/// Seconds of a step of a block with so many splats at the end. Two of its photographs are rendered with splats on its
/// surface. `None` where the device does not tell times.
pub(super) fn seconds_per_step(
    gpu: &Gpu,
    dataset: &Dataset,
    settings: &Settings,
    pieces: &[Piece],
    photographs: &[Chosen],
    splats: f64,
) -> Result<Option<f64>, Error> {
    let mut best: Vec<&Chosen> = photographs.iter().collect();
    best.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let looked_at = [best.first(), best.get(best.len() / 2)].into_iter().flatten();
    let mut train: Vec<View> = Vec::new();
    for (at, _) in looked_at.copied() {
        let at = *at as usize;
        let (Some(view), Some(camera)) = (dataset.views.get(at), dataset.scene_camera(at)) else { continue };
        if view.role == Role::Train && train.iter().all(|of| of.name != view.name) {
            train.push(View::new(&view.name, camera, view.photograph()?.pixels));
        }
    }
    let wanted = (MEAN * splats).max(1.0);
    let initial = spread(dataset, pieces, wanted.min(TIMED) as usize, settings.run.seed)?;
    let timed = initial.len() as f64;
    if initial.is_empty() {
        return Ok(None);
    }
    let input = Input { train, held_out: Vec::new(), initial, extent: 5.0, optional: OptionalInput::default() };
    let variants = chosen_variants(gpu, settings)?;
    let found = Estimate::measure(gpu, &input, settings, variants)?;
    Ok(found.map(|found| found.seconds_per_step * (wanted / timed).max(1.0)))
}

/// About so many splats on the pieces of a surface, as dense as the splats that each piece needs.
fn spread(dataset: &Dataset, pieces: &[Piece], count: usize, seed: u64) -> Result<Gaussians, Error> {
    let all: f64 = pieces.iter().map(|piece| piece.splats).sum();
    let mut random = Random::new(seed);
    let (mut due, mut points) = (0.0, Vec::with_capacity(count));
    for piece in pieces.iter().filter(|piece| piece.splats > 0.0) {
        due += piece.splats * count as f64 / all;
        while due >= 1.0 {
            due -= 1.0;
            points.push((piece.position.map(|v| v + 0.5 * piece.radius * random.symmetric()), [128; 3]));
        }
    }
    if points.is_empty() {
        return Ok(Gaussians::default());
    }
    Ok(init::from_points(&points, &dataset.frame)?)
}
