//! Decides before the first step whether exposures are learned, if the settings leave that to the photographs: by the
//! colours of points in several photographs, or without points by the exposures that the cameras noted.

use std::collections::HashMap;
use std::fmt;

use rayon::prelude::*;

use super::colour_gains::{ColourGains, Seen, fitted};
use crate::dataset::{Dataset, Pixels, Role};
use crate::numbers::{counted, percent};
use crate::scene::Camera;
use crate::train::settings::{Exposure, Settings};
use crate::train::{Error, Input, View};

/// Exposures are learned if gains of the photographs explain more than this share, by two standard errors, of the
/// colour differences that viewing directions leave. With gains painted on photographs this is where maps begin to pay.
const SHARE: f64 = 0.3;
/// The gains also have to change colours by at least this share.
const SPREAD: f64 = 0.01;
/// Fewer points say nothing.
const FEWEST_POINTS: usize = 100;
/// Photographs that show a point, at least: of two that differ neither is known to.
const FEWEST_VIEWS: usize = 3;
/// Points and observations that are looked at, at most.
const MOST_POINTS: usize = 10_000;
const MOST_SEEN: usize = 100_000;
/// Half of the side of the square that a colour is the mean of, as a share of the longer side: keypoints are where
/// colours change most.
const BLUR: f64 = 0.0125;
/// Values of 255 that are neither near black nor cut at white.
const KNOWN: std::ops::Range<f64> = 10.0..245.0;
/// Points in a cell of a picture, in the mean, and how much farther than the nearest of them a point may be that is not
/// hidden.
const POINTS_PER_CELL: usize = 8;
const DEEPER: f64 = 1.05;
/// Spread of the exposures that cameras noted, as a root mean square of logarithms, from which on exposures are
/// learned.
const NOTED: f64 = 0.05;

/// What a decision about exposures is by.
#[derive(Clone, Debug, PartialEq)]
pub enum ExposureEvidence {
    /// Colours of points that several photographs show.
    Colours(ColourGains),
    /// Exposure times, apertures and sensitivities in the files: the root mean square of their logarithms about the
    /// mean.
    Noted(f64),
    /// Neither: exposures are taken as equal.
    Nothing,
}

impl ExposureEvidence {
    /// Whether exposures vary.
    pub fn varies(&self) -> bool {
        match self {
            Self::Colours(found) => found.share - 2.0 * found.share_error > SHARE && found.spread >= SPREAD,
            Self::Noted(spread) => *spread >= NOTED,
            Self::Nothing => false,
        }
    }
}

impl fmt::Display for ExposureEvidence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let outcome = if self.varies() { "exposures vary and are learned" } else { "no exposures are learned" };
        match self {
            Self::Colours(found) => write!(
                f,
                "{outcome}: one gain for each photograph explains {} (+-{}) of the colour differences of {} between \
                 photographs that viewing directions leave, and changes colours by {}",
                percent(found.share.max(0.0), 0),
                percent(found.share_error, 0),
                counted(found.points, "point"),
                percent(found.spread, 1)
            ),
            Self::Noted(spread) => {
                write!(
                    f,
                    "{outcome}: no points show it, and the exposures in the files differ by {}",
                    percent(*spread, 1)
                )
            }
            Self::Nothing => {
                write!(f, "{outcome}: neither points nor the files of the photographs say whether they vary")
            }
        }
    }
}

/// Where `exposure` is `auto`: decides by the photographs to train on and puts the outcome into the settings, where a
/// resumed run and a repeated one find it. Gives what the decision is by.
pub fn decide_exposures(
    dataset: &Dataset,
    input: &Input,
    settings: &mut Settings,
) -> Result<Option<ExposureEvidence>, Error> {
    if settings.optimiser.exposure != Exposure::Auto {
        return Ok(None);
    }
    let by_colours = fitted(&seen_points(dataset, &input.train)?, input.train.len());
    let evidence = match by_colours.filter(|found| found.points >= FEWEST_POINTS) {
        Some(found) => ExposureEvidence::Colours(found),
        None => noted(dataset, &input.train).map_or(ExposureEvidence::Nothing, ExposureEvidence::Noted),
    };
    settings.optimiser.exposure = if evidence.varies() { Exposure::Affine } else { Exposure::Off };
    Ok(Some(evidence))
}

/// The spread of the exposures that the files note, where most of them do.
fn noted(dataset: &Dataset, views: &[View]) -> Option<f64> {
    let files: HashMap<&str, _> = dataset.views.iter().map(|view| (view.name.as_str(), view)).collect();
    let noted: Vec<f64> =
        views.iter().filter_map(|view| Some(files.get(view.name.as_str())?.noted_exposure()?.ln())).collect();
    let mean = noted.iter().sum::<f64>() / noted.len().max(1) as f64;
    let variance = noted.iter().map(|log| (log - mean).powi(2)).sum::<f64>() / noted.len().max(1) as f64;
    (noted.len() >= FEWEST_VIEWS && 4 * noted.len() >= 3 * views.len()).then(|| variance.sqrt())
}

/// A point that is looked for, in scene coordinates, with the photographs that observe it where the dataset says that.
struct Wanted {
    place: [f64; 3],
    observers: Option<Vec<u32>>,
}

/// What the photographs show of points: of the reconstructed ones that enough of them observe, or, where nothing says
/// who observes them, of those that lie in front in enough pictures.
fn seen_points(dataset: &Dataset, views: &[View]) -> Result<Vec<Seen>, Error> {
    let wanted = wanted(dataset, views);
    let mut seen = Vec::new();
    for (number, view) in (0..).zip(views) {
        let observed = |point: &Wanted| point.observers.as_ref().is_none_or(|of| of.binary_search(&number).is_ok());
        let placed: Vec<(u32, Placed)> = (0..)
            .zip(&wanted)
            .filter(|(_, point)| observed(point))
            .filter_map(|(k, point)| Some((k, Placed::of(&view.camera, point.place)?)))
            .collect();
        let front = Front::of(&view.camera, &placed);
        let pixels = view.photograph.pixels()?;
        let shown = |(point, placed): &(u32, Placed)| {
            let in_front = wanted[*point as usize].observers.is_some() || front.has(placed);
            let colour = in_front.then(|| colour(&view.camera, &pixels, placed)).flatten()?;
            Some(Seen { point: *point, view: number, colour, direction: placed.direction })
        };
        seen.extend(placed.par_iter().filter_map(shown).collect::<Vec<_>>());
    }
    let mut counts = vec![0; wanted.len()];
    seen.iter().for_each(|seen| counts[seen.point as usize] += 1);
    seen.retain(|seen| counts[seen.point as usize] >= FEWEST_VIEWS);
    Ok(seen)
}

/// The points that are looked for: evenly as many of those that serve as are worth their time.
fn wanted(dataset: &Dataset, views: &[View]) -> Vec<Wanted> {
    if dataset.begins_at_random() {
        return Vec::new();
    }
    let numbers: HashMap<&str, u32> = views.iter().map(|view| view.name.as_str()).zip(0..).collect();
    let of_view = |(_, view): (usize, &crate::dataset::View)| numbers.get(view.name.as_str()).copied();
    let number: HashMap<u32, u32> =
        dataset.views_of(Role::Train).filter_map(|view| Some((view.0 as u32, of_view(view)?))).collect();
    let place = |position: [f64; 3]| dataset.frame.to_scene(position);
    let mut all: Vec<Wanted> = Vec::new();
    for (k, point) in dataset.points.iter().enumerate() {
        let mut observers: Vec<u32> = dataset.tracks.of(k).iter().filter_map(|v| number.get(v).copied()).collect();
        observers.sort_unstable();
        if observers.len() >= FEWEST_VIEWS {
            all.push(Wanted { place: place(point.position), observers: Some(observers) });
        }
    }
    if all.len() < FEWEST_POINTS {
        let of_points = dataset.usable_points().iter().map(|point| point.position);
        all = of_points.map(|position| Wanted { place: place(position), observers: None }).collect();
    }
    let observations: usize = all.iter().map(|point| point.observers.as_ref().map_or(views.len(), Vec::len)).sum();
    let most = MOST_POINTS.min((MOST_SEEN as f64 * all.len() as f64 / observations.max(1) as f64) as usize);
    let step = all.len().div_ceil(most.max(1)).max(1);
    all.into_iter().step_by(step).collect()
}

/// Where a picture has a point.
struct Placed {
    at: [f64; 2],
    depth: f64,
    /// From the point to the camera.
    direction: [f64; 3],
}

impl Placed {
    fn of(camera: &Camera, point: [f64; 3]) -> Option<Self> {
        let centre = camera.center();
        let away: [f64; 3] = std::array::from_fn(|k| centre[k] - point[k]);
        let [x, y, z]: [f64; 3] = camera.rotation.map(|row| -(0..3).map(|k| row[k] * away[k]).sum::<f64>());
        let at = [camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy];
        let size = [camera.width, camera.height].map(f64::from);
        let inside = z > 0.0 && (0..2).all(|k| (0.0..size[k]).contains(&at[k]));
        let length = away.iter().map(|v| v * v).sum::<f64>().sqrt();
        inside.then(|| Self { at, depth: z, direction: away.map(|v| v / length) })
    }
}

/// The nearest points in the cells of a picture: what lies farther is likely to be hidden.
struct Front {
    cells: [usize; 2],
    size: [f64; 2],
    nearest: Vec<f64>,
}

impl Front {
    fn of(camera: &Camera, points: &[(u32, Placed)]) -> Self {
        let size = [camera.width, camera.height].map(f64::from);
        let side = (size[0] * size[1] * POINTS_PER_CELL as f64 / points.len().max(1) as f64).sqrt().max(1.0);
        let cells = size.map(|s| (s / side).ceil().max(1.0) as usize);
        let mut front = Self { cells, size, nearest: vec![f64::MAX; cells[0] * cells[1]] };
        for (_, placed) in points {
            let cell = front.cell(placed);
            front.nearest[cell] = front.nearest[cell].min(placed.depth);
        }
        front
    }

    fn cell(&self, placed: &Placed) -> usize {
        let [x, y]: [usize; 2] = std::array::from_fn(|k| {
            ((placed.at[k] / self.size[k] * self.cells[k] as f64) as usize).min(self.cells[k] - 1)
        });
        y * self.cells[0] + x
    }

    fn has(&self, placed: &Placed) -> bool {
        placed.depth <= DEEPER * self.nearest[self.cell(placed)]
    }
}

/// The logarithms of the mean colour about a place; nothing where that is not all in the picture, or masked, near black
/// or near white.
fn colour(camera: &Camera, pixels: &Pixels, placed: &Placed) -> Option<[f64; 3]> {
    let [width, height] = [camera.width as usize, camera.height as usize];
    let radius = (BLUR * width.max(height) as f64).round().max(1.0) as usize;
    let [x, y] = placed.at.map(|at| at as usize);
    if x < radius || y < radius || x + radius >= width || y + radius >= height {
        return None;
    }
    let mut sums = [0.0; 3];
    for row in y - radius..=y + radius {
        for column in x - radius..=x + radius {
            let at = 4 * (row * width + column);
            let [red, green, blue, alpha] = match pixels {
                Pixels::Rgba8(values) => <[u8; 4]>::try_from(values.get(at..at + 4)?).ok()?.map(f64::from),
                Pixels::Rgba16(values) => {
                    <[u16; 4]>::try_from(values.get(at..at + 4)?).ok()?.map(|v| f64::from(v) / 257.0)
                }
            };
            if alpha == 0.0 {
                return None;
            }
            sums = [sums[0] + red, sums[1] + green, sums[2] + blue];
        }
    }
    let count = ((2 * radius + 1) * (2 * radius + 1)) as f64;
    let mean = sums.map(|sum| sum / count);
    mean.iter().all(|value| KNOWN.contains(value)).then(|| mean.map(|value| (value / 255.0).ln()))
}
