//! Prepares a dataset's photographs and points as views for matching.

use std::sync::Arc;

use rayon::prelude::*;

use super::{Error, InitialPlanes, Observations, Settings, StereoView, choose_sources, depth_range};
use crate::dataset::{self, Dataset, HostShare, Photograph, Pixels, Role};
use crate::saliency::Plane;
use crate::scene::Camera;

/// Number of random points used where the dataset has no reconstructed points, out of the more that
/// [`Dataset::random_points`] draws.
const DRAWN: usize = 4000;
/// A view with fewer observed points than this starts at random. A view that shares fewer points than this with others
/// counts as a view without observations.
const FEW_POINTS: usize = 8;
/// Bytes per pixel that reducing a photograph takes: its pixels, one channel, and the rows being reduced.
const REDUCING: u64 = 16;

/// A view without depth.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SkippedView {
    /// Its position among the views.
    pub view: usize,
    /// Its name.
    pub name: String,
    /// The reason.
    pub why: WithoutDepth,
}

/// Why a view has no depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum WithoutDepth {
    /// No point lies in the photograph: there is no range of depths to search.
    NothingInView,
    /// No other view sees enough of the same surface from another position.
    NoOtherView,
    /// The view was compared with other views and agrees with none.
    NoAgreement,
}

impl WithoutDepth {
    /// All reasons.
    pub const ALL: [Self; 3] = [Self::NothingInView, Self::NoOtherView, Self::NoAgreement];
}

impl std::fmt::Display for WithoutDepth {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::NothingInView => {
                "no reconstructed point lies in the photograph: its pose is wrong, or nothing was reconstructed there"
            }
            Self::NoOtherView => "no other photograph sees enough of the same surface from another position",
            Self::NoAgreement => {
                "no surface fits both this and other photographs: its pose is wrong, or it has too little texture"
            }
        })
    }
}

/// The views of a scene, ready for matching.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The views in scene coordinates, at the size for matching.
    pub views: Vec<StereoView>,
    /// Names of the views.
    pub names: Vec<String>,
    /// Views without sources, which get no depth.
    pub skipped: Vec<SkippedView>,
}

/// A photograph that is not decoded yet.
#[derive(Clone, Copy, Debug)]
pub struct PendingPhotograph<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its camera in scene coordinates, at the decoded size.
    pub camera: Camera,
    /// Bytes that decoding the photograph takes.
    pub bytes: u64,
}

impl Scene {
    /// From the training photographs of a dataset, which `photograph` decodes as memory of `share` becomes free. Other
    /// photographs are not read.
    pub fn of(
        dataset: &Dataset,
        settings: &Settings,
        share: &HostShare,
        photograph: impl Fn(&dataset::View) -> Result<Photograph, dataset::Error> + Sync,
    ) -> Result<Self, Error> {
        let chosen: Vec<usize> = dataset.views_of(Role::Train).map(|(i, _)| i).collect();
        Self::of_views(dataset, &chosen, settings, share, |view| Ok(Arc::new(photograph(view)?.pixels)))
    }

    /// The same of other photographs: `chosen` are their positions in the dataset, and `pixels` decodes one.
    pub fn of_views(
        dataset: &Dataset,
        chosen: &[usize],
        settings: &Settings,
        share: &HostShare,
        pixels: impl Fn(&dataset::View) -> Result<Arc<Pixels>, dataset::Error> + Sync,
    ) -> Result<Self, Error> {
        settings.check()?;
        let seen = Observations::of(dataset, chosen, settings.seed.into());
        let views: Vec<(&dataset::View, Camera)> =
            chosen.iter().filter_map(|&i| Some((dataset.views.get(i)?, dataset.scene_camera(i)?))).collect();
        let pending: Vec<PendingPhotograph<'_>> = views
            .iter()
            .map(|(view, camera)| PendingPhotograph { name: &view.name, camera: *camera, bytes: view.decoding_bytes() })
            .collect();
        let of_view = |k: usize| match views.get(k) {
            Some((view, _)) => pixels(view),
            None => Ok(Arc::new(Pixels::Rgba8(Vec::new()))),
        };
        Ok(Self::new(&pending, &seen, settings, share, of_view)?)
    }

    /// From photographs and the points that they see. `pixels` decodes a photograph by its number, as memory of `share`
    /// becomes free; only the reduced photograph stays. Pixels with alpha below 0.5 are not matched. Sources, depths
    /// and initial hypotheses come from the points.
    pub fn new(
        pending: &[PendingPhotograph<'_>],
        seen: &Observations,
        settings: &Settings,
        share: &HostShare,
        pixels: impl Fn(usize) -> Result<Arc<Pixels>, dataset::Error> + Sync,
    ) -> Result<Self, dataset::Error> {
        let reduced = |camera: &Camera| {
            let (width, height) = settings.size(camera.width, camera.height);
            camera.resized(width, height)
        };
        let cameras: Vec<Camera> = pending.iter().map(|pending| reduced(&pending.camera)).collect();
        let sources = choose_sources(&cameras, seen, settings.checks as usize);
        let own = seen.by_view(pending.len());
        let of = |camera: &Camera| u64::from(camera.width) * u64::from(camera.height);
        let costs: Vec<u64> = pending.iter().map(|pending| pending.bytes + REDUCING * of(&pending.camera)).collect();
        let views = share.in_turns(&costs, |k| {
            let (full, decoded) = (&pending[k].camera, pixels(k)?);
            Ok(view(full, &decoded, &cameras[k], sources[k].clone(), &own[k], seen))
        });
        let views = views.into_iter().collect::<Result<Vec<StereoView>, dataset::Error>>()?;
        let names: Vec<String> = pending.iter().map(|pending| pending.name.to_owned()).collect();
        let alone = views.iter().enumerate().filter(|(_, view)| view.sources.is_empty());
        let in_view = |k: usize| {
            seen.drawn
                || seen.points.is_empty()
                || own[k].iter().any(|p| seen.points.get(*p as usize).is_some_and(|p| cameras[k].placed(*p).is_some()))
        };
        let why = |k| if in_view(k) { WithoutDepth::NoOtherView } else { WithoutDepth::NothingInView };
        let skipped = alone.map(|(view, _)| SkippedView { view, name: names[view].clone(), why: why(view) }).collect();
        Ok(Self { views, names, skipped })
    }
}

impl Observations {
    /// The points of a dataset in scene coordinates, with the views that see each point, as indices into `chosen`.
    /// `chosen` holds indices of the dataset's views. Where the dataset has no tracks, every view counts whose
    /// photograph contains the point, and likewise single views with next to no observations
    /// ([`Observations::assumed`]). Where the dataset has no usable points, random points replace them: they serve to
    /// choose sources and depths, but not initial hypotheses.
    pub fn of(dataset: &Dataset, chosen: &[usize], seed: u64) -> Self {
        let mut place = vec![None; dataset.views.len()];
        for (k, &view) in chosen.iter().enumerate() {
            if let Some(place) = place.get_mut(view) {
                *place = Some(k as u32);
            }
        }
        let real = !dataset.begins_at_random();
        let points: Vec<[f64; 3]> = match real {
            false => {
                let all = dataset.random_points(seed);
                let step = all.len().div_ceil(DRAWN).max(1);
                all.into_iter().step_by(step).map(|(p, _)| p).collect()
            }
            true => dataset.points.iter().map(|p| p.position).collect(),
        };
        let in_view = |point: &[f64; 3], of: &[bool]| -> Vec<u32> {
            let has = |i: &usize| dataset.views.get(*i).is_some_and(|v| dataset::in_view(&v.camera, *point));
            let asked = chosen.iter().enumerate().filter(|(k, _)| of[*k]);
            asked.filter(|(_, i)| has(i)).map(|(k, _)| k as u32).collect()
        };
        let mut views: Vec<Vec<u32>> = match real && !dataset.tracks.is_empty() {
            true => (0..points.len())
                .map(|p| {
                    let of = dataset.tracks.of(p).iter();
                    let mut views: Vec<u32> = of.filter_map(|v| *place.get(*v as usize)?).collect();
                    views.sort_unstable();
                    views
                })
                .collect(),
            false => vec![Vec::new(); points.len()],
        };
        let assumed = with_few_shared(&views, chosen.len());
        if !assumed.is_empty() {
            let without: Vec<bool> = (0..chosen.len() as u32).map(|k| assumed.binary_search(&k).is_ok()).collect();
            views.par_iter_mut().zip(&points).for_each(|(views, point)| {
                views.retain(|k| !without[*k as usize]);
                views.extend(in_view(point, &without));
                views.sort_unstable();
            });
        }
        let points = points.into_iter().map(|p| dataset.frame.to_scene(p)).collect();
        Self { points, views, drawn: !real, assumed }
    }

    /// For each view, position in pixels and depth of the points that the view sees, as (u, v, depth), among the points
    /// that at least `least` views see. Assumed observations count only where all observations are assumed.
    pub fn observed_by(&self, views: &[StereoView], least: usize) -> Vec<Vec<[f64; 3]>> {
        let nothing_else = self.assumed.len() == views.len();
        let counts = |k: &u32| nothing_else || self.assumed.binary_search(k).is_err();
        let trusted =
            |p: &u32| self.views.get(*p as usize).is_some_and(|v| v.iter().filter(|k| counts(k)).count() >= least);
        let place = |view: &StereoView, p: u32| view.camera.placed(*self.points.get(p as usize)?);
        let own = self.by_view(views.len());
        let of = |(k, (view, own)): (u32, (&StereoView, Vec<u32>))| match counts(&k) {
            true => own.into_iter().filter(trusted).filter_map(|p| place(view, p)).collect(),
            false => Vec::new(),
        };
        (0..).zip(views.iter().zip(own)).map(of).collect()
    }

    /// The points that each view sees.
    fn by_view(&self, views: usize) -> Vec<Vec<u32>> {
        let mut own = vec![Vec::new(); views];
        for (point, seen) in self.views.iter().enumerate() {
            for view in seen {
                if let Some(own) = own.get_mut(*view as usize) {
                    own.push(point as u32);
                }
            }
        }
        own
    }
}

/// The views that share next to no point with another view. `views` holds the views of each point, `count` the number
/// of views.
fn with_few_shared(views: &[Vec<u32>], count: usize) -> Vec<u32> {
    let mut shared = vec![0; count];
    for k in views.iter().filter(|views| views.len() > 1).flatten() {
        if let Some(shared) = shared.get_mut(*k as usize) {
            *shared += 1;
        }
    }
    (0..).zip(shared).filter(|(_, shared)| *shared < FEW_POINTS).map(|(k, _)| k).collect()
}

fn view(
    full: &Camera,
    pixels: &Pixels,
    camera: &Camera,
    sources: Vec<usize>,
    own: &[u32],
    seen: &Observations,
) -> StereoView {
    let placed: Vec<[f64; 3]> = own.iter().filter_map(|p| camera.placed(*seen.points.get(*p as usize)?)).collect();
    let depths = depth_range(placed.iter().map(|p| p[2]));
    let start = match seen.drawn || placed.len() < FEW_POINTS {
        true => InitialPlanes::Random,
        false => InitialPlanes::from_points(camera, &placed),
    };
    let (width, height) = (camera.width, camera.height);
    let rgba = channels(pixels, (full.width, full.height), (width, height));
    let luma = rgba.iter().map(|p| 0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2]).collect();
    let opaque: Vec<bool> = rgba.iter().map(|p| p[3] >= 0.5).collect();
    let colours = rgba.iter().map(|p| [p[0], p[1], p[2]].map(|v| (v * 255.0).round().clamp(0.0, 255.0) as u8));
    StereoView {
        camera: *camera,
        luma,
        colours: colours.collect(),
        // Without any point there is no range of depths to search.
        sources: if depths.is_some() { sources } else { Vec::new() },
        depths: depths.unwrap_or([0.5, 2.0]),
        start,
        wanted: opaque.contains(&false).then_some(opaque),
    }
}

/// Red, green, blue and alpha from 0 to 1, at another size; all zero where the number of pixels does not fit the size.
fn channels(pixels: &Pixels, from: (u32, u32), to: (u32, u32)) -> Vec<[f32; 4]> {
    // One channel at a time: all four channels as floats would take more memory than the photograph.
    let plane = |k: usize| -> Vec<f32> {
        let full: Vec<f32> = match pixels {
            Pixels::Rgba8(v) => v.chunks_exact(4).map(|p| f32::from(p[k]) / 255.0).collect(),
            Pixels::Rgba16(v) => v.chunks_exact(4).map(|p| f32::from(p[k]) / 65535.0).collect(),
        };
        if from == to && full.len() == to.0 as usize * to.1 as usize {
            return full;
        }
        let made = Plane::new(from.0, from.1, full);
        made.map(|plane| plane.resized(to.0, to.1).values().to_vec()).unwrap_or_default()
    };
    let planes = [plane(0), plane(1), plane(2), plane(3)];
    let at = |k: usize, i: usize| planes[k].get(i).copied().unwrap_or(0.0);
    (0..to.0 as usize * to.1 as usize).map(|i| [at(0, i), at(1, i), at(2, i), at(3, i)]).collect()
}
