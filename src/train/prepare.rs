//! Makes the input of a training from a dataset and settings, with depths and normals from stereo or a cloud.

mod colour_gains;
mod colours;
mod exposures;
mod setup;
mod shapes;
mod spacing;
mod stereo;
mod stereo_cost;

pub use super::input::Coloured;
pub use colour_gains::{ColourGains, Gain};
pub use colours::Uncoloured;
pub use exposures::{ExposureEvidence, decide_exposures};
pub use setup::{Setup, SetupEvent, SetupRequest};
pub(crate) use stereo::finer;
pub use stereo::{CloudReport, StereoReport, compute_stereo_priors, longer_side, splats_on_surfaces};
pub use stereo_cost::stereo_settings;

use std::collections::HashMap;
use std::path::Path;

use super::Error;
use super::input::{Input, OptionalInput, Outline, View};
use super::memory::HostMemory;
use super::settings::{self, Settings, Transparent};
use crate::dataset::{
    Colourless, Dataset, Decoding, HostShare, LoadOptions, MaskUse, NoColours, Role, Supply, Tone, Undecoded, Warning,
};
use crate::format::ply::{Cloud, Content};
use crate::format::splats;
use crate::format::{At, Error as FileError, LeftOut};
use crate::scene::{Frame, Gaussians, init};

/// How a dataset is loaded for these settings. `background` is the colour behind the splats (red, green, blue from 0 to
/// 1); transparent pixels show it if the settings say so.
pub fn load_options(photographs: &settings::Photographs, background: [f32; 3]) -> LoadOptions {
    LoadOptions {
        max_side: Some(photographs.max_side),
        images_folder: photographs.images.as_ref().map(Into::into),
        split: photographs.split,
        format: photographs.format,
        mask_ignores: photographs.mask_ignores,
        behind: (photographs.transparent == Transparent::Background).then_some(background),
        tone: Tone { white_level: photographs.white_level, transfer: photographs.transfer },
        strict: photographs.strict,
        ..LoadOptions::default()
    }
}

/// As [`load_options`] for all settings of a training, with the limit of host memory.
pub fn load_options_of(settings: &Settings) -> LoadOptions {
    let host_memory = settings.host.host_memory.map(|bytes| bytes.0);
    LoadOptions { host_memory, ..load_options(&settings.photographs, settings.model.background.evaluated()) }
}

/// The views of a role with photographs, and cameras in scene coordinates. Every photograph is decoded once and kept as
/// `share` allows; bytes kept are subtracted from `share`. Pixels less than half opaque are masked. A photograph with
/// no other pixel is left out ([`left_out`]), as are a few that cannot be decoded; [`Dataset::leave_out`] removes the
/// latter from the dataset too.
pub fn views(dataset: &Dataset, role: Role, share: &mut HostShare) -> Result<(Vec<View>, Undecoded), Error> {
    let mut decoding = Decoding::of(dataset);
    let photographs = decoding.take_in(dataset, role, share)?;
    Ok((with_photographs(dataset, role, photographs), decoding.end()?))
}

fn with_photographs(dataset: &Dataset, role: Role, photographs: Vec<Option<Supply>>) -> Vec<View> {
    let views = dataset.views_of(role).zip(photographs);
    let view = |((index, view), photograph): ((usize, &crate::dataset::View), _)| {
        Some(View { name: view.name.clone(), camera: dataset.scene_camera(index)?, photograph: photograph? })
    };
    views.filter_map(view).collect()
}

/// Warnings about the views of a role: views that [`views`] has left out, masks without effect or given by
/// transparency, photographs brighter than white, and photographs with transparent pixels.
pub fn left_out(dataset: &Dataset, role: Role, views: &[View]) -> Vec<Warning> {
    left_out_besides(dataset, role, views, &[])
}

/// As [`left_out`], without the photographs of `told` that were left out because of wrong poses.
pub fn left_out_besides(dataset: &Dataset, role: Role, views: &[View], told: &[Warning]) -> Vec<Warning> {
    let wrong = |name: &str| {
        told.iter().any(|warning| matches!(warning, Warning::PoseWrong { name: wrong, .. } if wrong == name))
    };
    let kept: HashMap<&str, &Supply> = views.iter().map(|view| (view.name.as_str(), &view.photograph)).collect();
    let of_role = dataset.views_of(role).map(|(_, view)| view.name.as_str()).filter(|name| !wrong(name));
    let of_role = of_role.map(|name| (name, kept.get(name).copied()));
    told_of(&of_role.collect::<Vec<_>>())
}

/// As [`left_out`], for names of views with photographs; `None` for a photograph whose pixels are all masked.
pub fn told_of(views: &[(&str, Option<&Supply>)]) -> Vec<Warning> {
    let named = |wanted: &dyn Fn(Option<&Supply>) -> bool| {
        let mut names = views.iter().filter(|(_, photograph)| wanted(*photograph)).map(|(name, _)| (*name).to_owned());
        names.next().map(|first| (1 + names.count(), first))
    };
    let masked = named(&|photograph| photograph.is_none());
    let masked = masked.map(|(photographs, first)| Warning::AllMasked { photographs, first });
    let of = views.iter().filter(|(_, photograph)| photograph.is_some_and(|p| p.mask().is_some())).count();
    let with_mask = |wanted: fn(MaskUse) -> bool| named(&move |p| p.and_then(Supply::mask).is_some_and(wanted));
    let nothing = with_mask(|mask| mask.left_out == 0);
    let nothing = nothing.map(|(masks, first)| Warning::MasksLeaveOutNothing { masks, of, first });
    let by_alpha = with_mask(|mask| mask.by_alpha);
    let by_alpha = by_alpha.map(|(masks, first)| Warning::MasksByTransparency { masks, of, first });
    let pixels = |count: fn(&Supply) -> u64| {
        let found: Vec<u64> = views.iter().filter_map(|(_, p)| p.map(count)).filter(|n| *n > 0).collect();
        (!found.is_empty()).then(|| (found.len(), found.iter().sum()))
    };
    let clipped = pixels(Supply::clipped);
    let clipped = clipped.map(|(photographs, pixels)| Warning::BrighterThanWhite { photographs, pixels });
    let transparent = pixels(Supply::transparent);
    let transparent = transparent.map(|(photographs, pixels)| Warning::TransparentLeftOut { photographs, pixels });
    [masked, nothing, by_alpha, clipped, transparent].into_iter().flatten().collect()
}

/// What the photographs of a role may take of the host's memory if nothing is trained.
pub fn host_share(dataset: &Dataset, role: Role, host: &settings::HostChoice) -> HostShare {
    let decoding = dataset.views_of(role).map(|(_, view)| view.decoding_bytes()).max();
    HostMemory::new(host.host_memory.map(|bytes| bytes.0)).share(decoding.unwrap_or(0))
}

/// Sizes and depths of the photographs, before any is decoded.
pub fn outline(dataset: &Dataset) -> Outline {
    let of = |role| {
        let views = dataset.views_of(role);
        views.filter_map(|(i, view)| Some((dataset.scene_camera(i)?, view.samples.depth()))).collect()
    };
    Outline { train: of(Role::Train), held_out: of(Role::HeldOut), extent: Frame::EXTENT as f32 }
}

/// The first model of a training.
#[derive(Clone, Debug)]
pub struct FirstModel {
    /// Splats of the model.
    pub splats: Gaussians,
    /// The points of the model, if they have no colours: [`Uncoloured::take_colours`] takes colours from photographs.
    pub uncoloured: Option<Uncoloured>,
    /// What was left out of the file that the model was read from.
    pub left_out: Option<LeftOut>,
}

/// The splats of [`first`].
pub fn initial(dataset: &Dataset, settings: &Settings) -> Result<Gaussians, Error> {
    Ok(first(dataset, settings)?.splats)
}

/// The first model: from the model or point cloud of `init`, else from the reconstructed points, else from random
/// points. Takes at most `max-splats` points; a model stays whole.
pub fn first(dataset: &Dataset, settings: &Settings) -> Result<FirstModel, Error> {
    let mut left_out = None;
    let (points, colourless): (Vec<_>, Option<Colourless>) = match settings.run.init.as_deref() {
        Some(file) => {
            let (content, without) = splats::read_content(file, settings.photographs.strict)?;
            left_out = without;
            match content {
                Content::Model(model) if model.gaussians.is_empty() => return Err(empty(file, "splats")),
                Content::Cloud(cloud) if cloud.positions.is_empty() => return Err(empty(file, "points")),
                Content::Model(model) => {
                    return Ok(FirstModel { splats: model.in_scene(&dataset.frame), uncoloured: None, left_out });
                }
                Content::Cloud(cloud) => of_cloud(file, cloud),
            }
        }
        None => {
            let points = dataset.usable_points().iter().map(|p| (p.position, p.colour));
            match dataset.begins_at_random() {
                true => (points.chain(dataset.random_points(settings.run.seed)).collect(), None),
                false => (points.collect(), dataset.colourless.clone()),
            }
        }
    };
    let most = settings.density.max_splats.map_or(usize::MAX, |most| most as usize);
    let kept: Vec<_> = spread(&points, most).into_iter().copied().collect();
    let mut splats = init::from_points(&kept, &dataset.frame)?;
    init::make_opaque(&mut splats, 0, settings.geometry.first_opacity);
    init::widen(&mut splats, 0..kept.len(), settings.geometry.first_width);
    let of_dataset = settings.run.init.is_none();
    let positions = || points.iter().map(|(position, _)| *position).collect();
    let uncoloured = colourless.map(|colourless| Uncoloured::new(colourless, positions(), of_dataset));
    Ok(FirstModel { splats, uncoloured, left_out })
}

/// A position in dataset coordinates and an 8-bit colour.
type ColouredPoint = ([f64; 3], [u8; 3]);

/// The points of a cloud with their colours, grey if the cloud has none, and the reason why it has none.
fn of_cloud(file: &Path, cloud: Cloud) -> (Vec<ColouredPoint>, Option<Colourless>) {
    let why = match cloud.colours.is_empty() {
        true => Some(NoColours::with_properties(&cloud.unknown)),
        false => NoColours::of_colours(cloud.colours.iter().copied()),
    };
    let colours = cloud.colours.into_iter().chain(std::iter::repeat([128; 3]));
    let points = cloud.positions.into_iter().zip(colours).collect();
    (points, why.map(|why| Colourless { file: file.to_owned(), why }))
}

/// `count` elements evenly spread from first to last, or all if there are fewer.
fn spread<T>(of: &[T], count: usize) -> Vec<&T> {
    let count = count.min(of.len());
    (0..count).map(|i| &of[(i as u128 * of.len() as u128 / count as u128) as usize]).collect()
}

fn empty(file: &Path, what: &str) -> Error {
    let problem = format!("it holds no {what} to begin with; give another file, or leave `init` unset");
    FileError::malformed(file, "element vertex", At::Byte(0), problem).into()
}

/// Decodes all photographs into memory and makes the first model. Held-out photographs are decoded too, for evaluation
/// only.
pub fn input(dataset: &Dataset, settings: &Settings) -> Result<Input, Error> {
    let FirstModel { splats, uncoloured, .. } = first(dataset, settings)?;
    let mut input = input_within(dataset, splats, HostShare::unlimited())?;
    if let Some(points) = uncoloured {
        points.take_colours(dataset, &mut input)?;
    }
    Ok(input)
}

/// The input with the first model `initial`. Photographs are kept as `share` allows, training photographs first.
pub fn input_within(dataset: &Dataset, initial: Gaussians, mut share: HostShare) -> Result<Input, Error> {
    // Training and held-out photographs are counted together, because one photograph may be a tenth of the held-out
    // ones.
    let mut decoding = Decoding::of(dataset);
    let mut photographs = decoding.take_in(dataset, Role::Train, &mut share)?;
    let mut left_out = Vec::new();
    for (at, fault) in dataset.poses_against_photographs(Role::Train, &photographs)? {
        if let (Some(photograph), Some((_, view))) = (photographs.get_mut(at), dataset.views_of(Role::Train).nth(at)) {
            *photograph = None;
            left_out.push(Warning::PoseWrong { name: view.name.clone(), fault, left_out: true });
        }
    }
    let held_out = decoding.take_in(dataset, Role::HeldOut, &mut share)?;
    let undecoded = decoding.end()?;
    left_out.extend(undecoded.warning.clone());
    Ok(Input {
        train: with_photographs(dataset, Role::Train, photographs),
        held_out: with_photographs(dataset, Role::HeldOut, held_out),
        initial,
        extent: Frame::EXTENT as f32,
        optional: OptionalInput { left_out, undecoded, ..OptionalInput::default() },
    })
}

/// Pixels of training photographs for which one splat is allowed however few the first splats are.
const PIXELS_PER_SPLAT: f64 = 512.0;

/// Limits the splats to `growth-room` times the first ones if there is no other limit, and returns the limit. Few first
/// splats, as where stereo finds nothing, may grow to one for every `PIXELS_PER_SPLAT` in any case. The limit is
/// written into the settings, so a resumed run has it too.
pub fn limit_growth(input: &Input, settings: &mut Settings) -> Option<u32> {
    let density = &mut settings.density;
    if density.no_densify || density.growth_room == 0.0 || density.max_splats.is_some() {
        return None;
    }
    let pixels: f64 = input.train.iter().map(|v| f64::from(v.camera.width) * f64::from(v.camera.height)).sum();
    // A background does not grow.
    let still = input.optional.part.as_ref().map_or(0, |part| part.background.len());
    let growing = input.initial.len().saturating_sub(still);
    let most = still as f64 + (density.growth_room * growing as f64).max(pixels / PIXELS_PER_SPLAT);
    let most = most.ceil().clamp(1.0, f64::from(u32::MAX)) as u32;
    density.max_splats = Some(most);
    Some(most)
}

#[cfg(test)]
mod tests {
    use super::spread;

    #[test]
    fn as_many_as_asked_for_are_spread_evenly() {
        let all: Vec<u32> = (0..10).collect();
        let some = |count| spread(&all, count).into_iter().copied().collect::<Vec<_>>();
        assert_eq!(some(4), [0, 2, 5, 7]);
        assert_eq!(some(7), [0, 1, 2, 4, 5, 7, 8]);
        assert_eq!((some(10), some(11), some(0)), (all.clone(), all.clone(), vec![]));
        assert_eq!(spread::<u32>(&[], 5), Vec::<&u32>::new());
    }
}
