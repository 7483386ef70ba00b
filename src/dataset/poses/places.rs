//! Detects photographs that fit the poses of others: names and poses that changed places.

use rayon::prelude::*;

use super::super::colmap::Point;
use super::super::{Dataset, Error};
use super::{Judged, TELLING};

/// Number of nearest poses that a photograph is compared with, besides the poses before and after it.
const NEAREST: usize = 8;
/// A pose is wrong where another photograph's pose fits better by this, ...
const GAIN: f64 = 0.15;
/// ... and at least this share of the median fit.
const FITS_WELL: f64 = 0.85;
/// Two photographs that fit each other's poses better than their own: each by at least this ...
const GAIN_OF_EITHER: f64 = 0.03;
/// ... and both together by this. Then both poses are wrong, ...
const GAIN_OF_BOTH: f64 = 0.1;
/// ... if both fits are at least this share of the median.
const BOTH_FIT: f64 = 0.75;

/// The fit of a photograph from another one's pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct Elsewhere {
    /// Position of the other photograph among the judged ones.
    other: usize,
    fit: f64,
    /// Fit of the other photograph from this one's pose.
    back: f64,
}

/// For each photograph the best fitting pose among its neighbours; `None` where none can be compared.
pub(super) fn elsewhere(judged: &[Judged], points: &[&Point]) -> Vec<Option<Elsewhere>> {
    let centers: Vec<[f64; 3]> = judged.iter().map(|of| of.camera.center()).collect();
    let fit = |of: usize, from: usize| judged[of].coarse.fit(&judged[from].camera, points);
    let best = |of: usize| {
        let fits = neighbours(&centers, of).into_iter().filter_map(|other| Some((other, fit(of, other)?)));
        let (other, best) = fits.max_by(|a, b| a.1.total_cmp(&b.1))?;
        let back = if best > judged[of].own { fit(other, of) } else { None };
        Some(Elsewhere { other, fit: best, back: back.unwrap_or(f64::NEG_INFINITY) })
    };
    (0..judged.len()).into_par_iter().map(best).collect()
}

/// The nearest cameras, and those before and after.
fn neighbours(centers: &[[f64; 3]], of: usize) -> Vec<usize> {
    let far = |other: &usize| (0..3).map(|k| (centers[*other][k] - centers[of][k]).powi(2)).sum::<f64>();
    let beside = |other: &usize| other.abs_diff(of) == 1;
    let (mut out, mut others): (Vec<usize>, Vec<usize>) =
        (0..centers.len()).filter(|other| *other != of).partition(beside);
    others.sort_by(|a, b| far(a).total_cmp(&far(b)));
    out.extend(others.into_iter().take(NEAREST));
    out
}

/// Fails where most photographs fit only from the poses of others.
pub(super) fn refuse(dataset: &Dataset, judged: &[Judged], elsewhere: &[Option<Elsewhere>]) -> Result<(), Error> {
    let better = |(of, found): &(&Judged, &Option<Elsewhere>)| {
        found.is_some_and(|found| found.fit - of.own >= GAIN && found.fit >= TELLING)
    };
    let changed = judged.iter().zip(elsewhere).filter(better).count();
    match 2 * changed > judged.len() {
        true => Err(Error::PosesOfOthers { file: dataset.path.clone(), changed, of: judged.len() }),
        false => Ok(()),
    }
}

/// For each photograph with a wrong pose, its fit from the pose of another one. `usual` is the median fit.
pub(super) fn changed(judged: &[Judged], elsewhere: &[Option<Elsewhere>], usual: f64) -> Vec<Option<f64>> {
    let mut out = vec![None; judged.len()];
    for (of, found) in elsewhere.iter().enumerate() {
        let Some(Elsewhere { other, fit, back }) = *found else { continue };
        let gains = [fit - judged[of].own, back - judged[other].own];
        if gains[0] >= GAIN && fit >= FITS_WELL * usual {
            out[of] = Some(fit);
        }
        let both = gains.iter().all(|gain| *gain >= GAIN_OF_EITHER) && gains[0] + gains[1] >= GAIN_OF_BOTH;
        if both && fit.min(back) >= BOTH_FIT * usual {
            out[of] = Some(fit);
            out[other].get_or_insert(back);
        }
    }
    out
}
