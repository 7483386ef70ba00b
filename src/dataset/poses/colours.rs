//! Judges poses by how well the colours of the points fit the photographs, in datasets without observations.

use super::{Judged, TELLING};
use std::sync::Arc;

use rayon::prelude::*;

use super::super::colmap::Point;
use super::super::{Dataset, Error, Role, Supply, View};
use super::inverted::{Convention, WrongConvention};
use super::places::{self, Elsewhere};
use super::{Coarse, LEAST_POINTS, PoseFault, matches};
use crate::scene::Camera;

/// Most points that are compared, about.
const MOST_POINTS: usize = 20_000;
/// Least number of judged photographs.
const LEAST_PHOTOGRAPHS: usize = 8;
/// A pose is wrong below this share of the median ...
const SHARE: f64 = 0.35;
/// ... and below the lower quartile by more than this multiple of the distance from quartile to median.
const SPREADS: f64 = 5.0;
/// Poses in another convention correlate less than this.
const UNFIT: f64 = 0.2;

impl Dataset {
    /// Photographs of a role that do not fit their poses by the colours of the points, while nearly all others do.
    /// `photographs` has the order of [`Dataset::views_of`], and so have the returned positions. Photographs with
    /// checked poses ([`View::pose_checked`]) are skipped. Fails where most photographs would fit with their poses in
    /// another convention, or with the poses of others. Where neither colours nor tracks tell, the training photographs
    /// are matched with one another to find another convention.
    pub fn poses_against_photographs(
        &self,
        role: Role,
        photographs: &[Option<Supply>],
    ) -> Result<Vec<(usize, PoseFault)>, Error> {
        let found = self.by_colours(role, photographs)?;
        if found.is_none() && role == Role::Train && 2 * self.tracked(role) < photographs.len() {
            matches::refuse(self, photographs)?;
        }
        Ok(found.unwrap_or_default())
    }

    /// `None` where the colours of the points carry no information.
    fn by_colours(&self, role: Role, photographs: &[Option<Supply>]) -> Result<Option<Vec<(usize, PoseFault)>>, Error> {
        let of = |(at, ((_, view), photograph)): (usize, ((usize, &View), &Option<Supply>))| {
            let coarse = photograph.as_ref().filter(|_| !view.pose_checked)?.coarse()?;
            Some((at, view.camera, coarse.clone()))
        };
        let seen: Vec<(usize, Camera, Arc<Coarse>)> =
            self.views_of(role).zip(photographs).enumerate().filter_map(of).collect();
        if seen.len() < LEAST_PHOTOGRAPHS || self.colourless.is_some() {
            return Ok(None);
        }
        let step = self.points.len().div_ceil(MOST_POINTS).max(1);
        let points: Vec<&Point> = self.points.iter().step_by(step).collect();
        let fits = |read: &(dyn Fn(&Camera) -> Camera + Sync)| -> Vec<Judged> {
            let fit = |(at, camera, coarse): &(usize, Camera, Arc<Coarse>)| {
                let own = coarse.fit(&read(camera), &points)?;
                Some(Judged { at: *at, camera: *camera, coarse: coarse.clone(), own })
            };
            seen.par_iter().filter_map(fit).collect()
        };
        let judged = fits(&|camera| *camera);
        let quarters = quartiles(&judged);
        if judged.len() < LEAST_PHOTOGRAPHS || quarters[1] < UNFIT {
            for found in Convention::ALL {
                let otherwise = fits(&|camera| found.camera(self.format, camera));
                if 10 * otherwise.len() >= 8 * seen.len() && quartiles(&otherwise)[1] >= TELLING {
                    let what = WrongConvention { format: self.format, found };
                    return Err(Error::PosesInOtherConvention { file: self.path.clone(), what });
                }
            }
        }
        if judged.len() < LEAST_PHOTOGRAPHS {
            return Ok(None);
        }
        let elsewhere = places::elsewhere(&judged, &points);
        places::refuse(self, &judged, &elsewhere)?;
        Ok((quarters[1] >= TELLING).then(|| wrong(&judged, &elsewhere, quarters)))
    }

    /// Photographs of a role whose tracks have enough points to judge their poses.
    fn tracked(&self, role: Role) -> usize {
        let mut points = vec![0_usize; self.views.len()];
        for view in (0..self.points.len()).flat_map(|point| self.tracks.of(point)) {
            if let Some(count) = points.get_mut(*view as usize) {
                *count += 1;
            }
        }
        self.views_of(role).filter(|(view, _)| points[*view] >= LEAST_POINTS).count()
    }
}

/// The photographs that do not fit, or that fit better from another pose.
fn wrong(judged: &[Judged], elsewhere: &[Option<Elsewhere>], [lower, usual]: [f64; 2]) -> Vec<(usize, PoseFault)> {
    let bound = (SHARE * usual).min(lower - SPREADS * (usual - lower));
    let fault = |(of, changed): (&Judged, Option<f64>)| match changed {
        Some(other) => Some((of.at, PoseFault::OtherPose { fit: of.own, other })),
        None if of.own < bound => Some((of.at, PoseFault::Colours { fit: of.own, usual })),
        None => None,
    };
    judged.iter().zip(places::changed(judged, elsewhere, usual)).filter_map(fault).collect()
}

/// Lower quartile and median of the photographs' fits.
fn quartiles(judged: &[Judged]) -> [f64; 2] {
    let mut all: Vec<f64> = judged.iter().map(|of| of.own).collect();
    all.sort_by(f64::total_cmp);
    [all.len() / 4, all.len() / 2].map(|at| all.get(at).copied().unwrap_or(0.0))
}
