//! From a dataset's photographs and points to views that can be matched.

use rayon::prelude::*;

use super::{Error, Observations, Settings, Start, View, choose_sources, depth_range};
use crate::dataset::{self, Dataset, Photograph, Pixels, Role};
use crate::saliency::Plane;
use crate::scene::Camera;

/// Points drawn where nothing was reconstructed, of which the dataset's rule makes more.
const DRAWN: usize = 4000;
/// A view with fewer observed points than this begins at random.
const FEW_POINTS: usize = 8;

/// A view that is left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Skipped {
    /// Its position among the views.
    pub view: usize,
    /// Its name.
    pub name: String,
}

impl std::fmt::Display for Skipped {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "'{}': no other view sees enough of the same from another place", self.name)
    }
}

/// The views of a scene, ready to be matched.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// In the coordinates of the scene, at the size that is matched.
    pub views: Vec<View>,
    /// Their names.
    pub names: Vec<String>,
    /// Views without sources: nothing will be known of them.
    pub skipped: Vec<Skipped>,
}

impl Scene {
    /// The training photographs of a dataset, decoded by `photograph` in parallel. No other is read.
    pub fn of(
        dataset: &Dataset,
        settings: &Settings,
        photograph: impl Fn(&dataset::View) -> Result<Photograph, dataset::Error> + Sync,
    ) -> Result<Self, Error> {
        settings.check()?;
        let chosen: Vec<usize> = dataset.views_of(Role::Train).map(|(i, _)| i).collect();
        let seen = Observations::of(dataset, &chosen, settings.seed.into());
        let pictures: Vec<Result<(String, Camera, Photograph), dataset::Error>> = chosen
            .par_iter()
            .filter_map(|&i| Some((dataset.views.get(i)?, dataset.scene_camera(i)?)))
            .map(|(view, camera)| Ok((view.name.clone(), camera, photograph(view)?)))
            .collect();
        let pictures = pictures.into_iter().collect::<Result<Vec<_>, _>>()?;
        Ok(Self::new(pictures.iter().map(|(n, c, p)| (n.as_str(), c, &p.pixels)), &seen, settings))
    }

    /// Photographs with their names and cameras (in scene coordinates, at the size of the photograph), and what they see. Pixels
    /// without alpha are not matched. Sources, depths and first hypotheses come from the points.
    pub fn new<'a>(
        pictures: impl IntoIterator<Item = (&'a str, &'a Camera, &'a Pixels)>,
        seen: &Observations,
        settings: &Settings,
    ) -> Self {
        let pictures: Vec<(&str, &Camera, &Pixels)> = pictures.into_iter().collect();
        let cameras: Vec<Camera> = pictures
            .iter()
            .map(|(_, camera, _)| {
                let (width, height) = settings.size(camera.width, camera.height);
                camera.resized(width, height)
            })
            .collect();
        let sources = choose_sources(&cameras, seen, settings.checks as usize);
        let own = seen.by_view(pictures.len());
        let views: Vec<View> = pictures
            .par_iter()
            .zip(&cameras)
            .zip(sources.into_par_iter().zip(own))
            .map(|(((_, full, pixels), camera), (sources, own))| view(full, pixels, camera, sources, &own, seen))
            .collect();
        let names: Vec<String> = pictures.iter().map(|(name, ..)| (*name).to_owned()).collect();
        let alone = views.iter().enumerate().filter(|(_, view)| view.sources.is_empty());
        let skipped = alone.map(|(view, _)| Skipped { view, name: names[view].clone() }).collect();
        Self { views, names, skipped }
    }
}

impl Observations {
    /// The points of a dataset in scene coordinates, with the positions in `chosen` of the views (positions in the dataset) that see
    /// them. Where the dataset does not say which do, all are taken for it that have the point in their picture; where it has no points,
    /// random ones stand in for them, which are good for choosing sources and depths but not to begin with.
    pub fn of(dataset: &Dataset, chosen: &[usize], seed: u64) -> Self {
        let mut place = vec![None; dataset.views.len()];
        for (k, &view) in chosen.iter().enumerate() {
            if let Some(place) = place.get_mut(view) {
                *place = Some(k as u32);
            }
        }
        let (points, real): (Vec<[f64; 3]>, bool) = match dataset.points.as_slice() {
            [] => {
                let all = dataset.random_points(seed);
                let step = all.len().div_ceil(DRAWN).max(1);
                (all.into_iter().step_by(step).map(|(p, _)| p).collect(), false)
            }
            points => (points.iter().map(|p| p.position).collect(), true),
        };
        let in_view = |point: &[f64; 3]| -> Vec<u32> {
            let has = |i: &usize| dataset.views.get(*i).is_some_and(|v| dataset::in_view(&v.camera, *point));
            chosen.iter().enumerate().filter(|(_, i)| has(i)).map(|(k, _)| k as u32).collect()
        };
        let views = match real && !dataset.tracks.is_empty() {
            true => (0..points.len())
                .map(|p| {
                    let of = dataset.tracks.of(p).iter();
                    let mut views: Vec<u32> = of.filter_map(|v| *place.get(*v as usize)?).collect();
                    views.sort_unstable();
                    views
                })
                .collect(),
            false => points.par_iter().map(in_view).collect(),
        };
        let points = points.into_iter().map(|p| dataset.frame.to_scene(p)).collect();
        Self { points, views, drawn: !real }
    }

    /// For each view the places in its picture and the depths of the points that it sees, of those that at least `least` views see.
    pub fn observed_by(&self, views: &[View], least: usize) -> Vec<Vec<[f64; 3]>> {
        let trusted = |p: &u32| self.views.get(*p as usize).is_some_and(|v| v.len() >= least);
        let place = |view: &View, p: u32| placed(&view.camera, *self.points.get(p as usize)?);
        let own = self.by_view(views.len());
        let of =
            |(view, own): (&View, Vec<u32>)| own.into_iter().filter(trusted).filter_map(|p| place(view, p)).collect();
        views.iter().zip(own).map(of).collect()
    }

    /// The points that each of so many views sees.
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

fn view(
    full: &Camera,
    pixels: &Pixels,
    camera: &Camera,
    sources: Vec<usize>,
    own: &[u32],
    seen: &Observations,
) -> View {
    let placed: Vec<[f64; 3]> = own.iter().filter_map(|p| placed(camera, *seen.points.get(*p as usize)?)).collect();
    let depths = depth_range(placed.iter().map(|p| p[2]));
    let start = match seen.drawn || placed.len() < FEW_POINTS {
        true => Start::Random,
        false => Start::from_points(camera, &placed),
    };
    let (width, height) = (camera.width, camera.height);
    let rgba = channels(pixels, (full.width, full.height), (width, height));
    let luma = rgba.iter().map(|p| 0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2]).collect();
    let opaque: Vec<bool> = rgba.iter().map(|p| p[3] >= 0.5).collect();
    let colours = rgba.iter().map(|p| [p[0], p[1], p[2]].map(|v| (v * 255.0).round().clamp(0.0, 255.0) as u8));
    View {
        camera: *camera,
        luma,
        colours: colours.collect(),
        // Without any point there is no range of depths to look in.
        sources: if depths.is_some() { sources } else { Vec::new() },
        depths: depths.unwrap_or([0.5, 2.0]),
        start,
        wanted: opaque.contains(&false).then_some(opaque),
    }
}

/// Place of a point in the picture, and its depth.
fn placed(camera: &Camera, point: [f64; 3]) -> Option<[f64; 3]> {
    let c = camera.center();
    let [x, y, z] = camera.rotation.map(|row| (0..3).map(|k| row[k] * (point[k] - c[k])).sum::<f64>());
    let (u, v) = (camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy);
    let inside = z > 0.0 && (0.0..f64::from(camera.width)).contains(&u) && (0.0..f64::from(camera.height)).contains(&v);
    inside.then_some([u, v, z])
}

/// Red, green, blue and alpha from 0 to 1, at another size; what is not as many as the pixels counts as black and missing.
fn channels(pixels: &Pixels, from: (u32, u32), to: (u32, u32)) -> Vec<[f32; 4]> {
    let full: Vec<[f32; 4]> = match pixels {
        Pixels::Rgba8(v) => v.chunks_exact(4).map(|p| [0, 1, 2, 3].map(|k| f32::from(p[k]) / 255.0)).collect(),
        Pixels::Rgba16(v) => v.chunks_exact(4).map(|p| [0, 1, 2, 3].map(|k| f32::from(p[k]) / 65535.0)).collect(),
    };
    if from == to && full.len() == to.0 as usize * to.1 as usize {
        return full;
    }
    let plane = |k: usize| {
        let made = Plane::new(from.0, from.1, full.iter().map(|p| p[k]).collect());
        made.map(|plane| plane.resized(to.0, to.1).values().to_vec()).unwrap_or_default()
    };
    let planes = [plane(0), plane(1), plane(2), plane(3)];
    let at = |k: usize, i: usize| planes[k].get(i).copied().unwrap_or(0.0);
    (0..to.0 as usize * to.1 as usize).map(|i| [at(0, i), at(1, i), at(2, i), at(3, i)]).collect()
}
