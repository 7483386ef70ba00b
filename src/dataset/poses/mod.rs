//! Detects wrong poses by the reconstruction's own points.

mod coarse;
mod colours;
mod evidence;
mod inverted;
mod matches;
mod places;
mod sketch;

use std::fmt;
use std::sync::Arc;

use super::colmap::Point;
use super::extent::far_cameras;
use super::model::Model;
use super::random_points::in_view;
use super::{Error, Role, View, Warning};
use crate::numbers::{counted, fraction, grouped, of_count, percent};
use crate::scene::Camera;
pub(super) use coarse::Coarse;
use evidence::Evidence;
pub use inverted::{Convention, WrongConvention};

/// Least number of points for judging a pose.
const LEAST_POINTS: usize = 20;
/// A pose is wrong where more than this share of the points contradicts it.
const WRONG: f64 = 0.5;
/// A pose is doubtful where the points are off by more than this share of the longer side ...
const DOUBTFUL_OFF: f64 = 0.005;
/// ... and by more than this multiple of the usual distance.
const DOUBTFUL_TIMES: f64 = 10.0;

/// Why the pose of a photograph is wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PoseFault {
    /// The observed points do not project to their observed positions.
    Reprojection {
        /// Number of points used.
        points: usize,
        /// Median distance as a share of the image's longer side; infinite where most points lie behind the camera.
        off: f64,
        /// Median of `off` over all photographs.
        usual: f64,
    },
    /// The points that the photograph observes are outside its image.
    OutOfView {
        /// The number of points that the photograph is said to observe.
        points: usize,
        /// The number of these points inside the picture.
        inside: usize,
    },
    /// The camera is far from all others, and no point is in its image.
    FarAndBlind {
        /// Its distance from the middle of all cameras in multiples of the median distance.
        times: f64,
    },
    /// The colours of the points do not fit the photograph.
    Colours {
        /// Correlation of the colours of points and photograph.
        fit: f64,
        /// The median of this correlation over all photographs.
        usual: f64,
    },
    /// The colours of the points fit the photograph better from the pose of another one.
    OtherPose {
        /// Correlation from its own pose.
        fit: f64,
        /// Correlation from the other pose.
        other: f64,
    },
}

impl fmt::Display for PoseFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |share: f64| percent(share, if share < 0.01 { 2 } else { 0 });
        match self {
            Self::Reprojection { points, off, .. } if !off.is_finite() => {
                write!(f, "most of {} that it observes lie behind its camera", counted(*points, "point"))
            }
            Self::Reprojection { points, off, usual } => write!(
                f,
                "{} that it observes {} {} of the picture's longer side away from where it shows {} (usual: {})",
                counted(*points, "point"),
                of_count(*points, "lies", "lie"),
                percent(*off),
                of_count(*points, "it", "them"),
                percent(*usual)
            ),
            Self::OutOfView { points, inside } => {
                write!(
                    f,
                    "of {} that it is said to observe {} {} in its picture",
                    counted(*points, "point"),
                    grouped(*inside),
                    of_count(*inside, "is", "are")
                )
            }
            Self::Colours { fit, usual } => write!(
                f,
                "the colours of the points are not those of the photograph where they lie in its picture (correlation \
                 {}, usual: {})",
                fraction(*fit, 2),
                fraction(*usual, 2)
            ),
            Self::OtherPose { fit, other } => write!(
                f,
                "the colours of the points fit the photograph better from the pose of another one (correlation {}, \
                 from its own: {}): have photographs changed places?",
                fraction(*other, 2),
                fraction(*fit, 2)
            ),
            Self::FarAndBlind { times } => write!(
                f,
                "its camera is {times:.0} times as far from the others as they are from one another, and no point is \
                 in its picture"
            ),
        }
    }
}

/// The points' verdict on the poses.
#[derive(Default)]
pub(super) struct Judgement {
    /// For each photograph, whether the points confirm its pose.
    fits: Vec<bool>,
    /// Positions of photographs with a wrong pose.
    wrong: Vec<(usize, PoseFault)>,
    /// Positions of photographs with a doubtful pose.
    doubtful: Vec<(usize, PoseFault)>,
    /// For each photograph, whether its pose was judged by observed positions.
    by_places: Vec<bool>,
    warning: Option<Warning>,
}

impl Judgement {
    /// Judges the poses of a model. Fails where all poses have another convention.
    pub(super) fn of(model: &Model) -> Result<Self, Error> {
        let mut all = evidence::by_observations(model);
        if is_mostly_wrong(&all) {
            inverted::refuse(model, &all, evidence::EvidenceKind::Observations)?;
            // If images were reduced together with their cameras, the observations are at another size.
            all = evidence::by_tracks(model);
        }
        if is_mostly_wrong(&all) {
            inverted::refuse(model, &all, evidence::EvidenceKind::Tracks)?;
            let (wrong, of) = count(&all);
            let warning = Some(Warning::PosesAgainstPoints { file: model.file.clone(), wrong, of });
            return Ok(Self { warning, fits: vec![false; all.len()], ..Self::default() });
        }
        if all.iter().all(Option::is_none) {
            inverted::refuse_by_sight(model)?;
        }
        let usual = usual(&all);
        let mut out = Self { fits: vec![false; all.len()], ..Self::default() };
        out.by_places = all.iter().map(|evidence| evidence.is_some_and(|evidence| evidence.off.is_some())).collect();
        for (at, evidence) in all.iter().enumerate() {
            let Some(evidence) = evidence else { continue };
            let off = evidence.off.unwrap_or(0.0);
            if evidence.misfit > WRONG {
                out.wrong.push((at, evidence.fault(usual)));
            } else if off > DOUBTFUL_OFF && off > DOUBTFUL_TIMES * usual {
                out.doubtful.push((at, evidence.fault(usual)));
            } else {
                out.fits[at] = true;
            }
        }
        Ok(out)
    }

    /// Whether the points confirm the pose of a photograph.
    pub(super) fn fits(&self, at: usize) -> bool {
        self.fits.get(at).copied().unwrap_or(false)
    }

    /// Leaves photographs with wrong poses out of training, and warns of wrong and doubtful poses. `views` are those of
    /// the model.
    pub(super) fn apply(&mut self, views: &mut [View], warnings: &mut Vec<Warning>) {
        warnings.extend(self.warning.take());
        for (view, by_places) in views.iter_mut().zip(&self.by_places) {
            view.pose_checked = *by_places;
        }
        for (at, fault) in std::mem::take(&mut self.wrong) {
            if let Some(view) = views.get_mut(at) {
                leave_out(view, fault, warnings);
            }
        }
        for (at, fault) in std::mem::take(&mut self.doubtful) {
            if let Some(view) = views.get(at).filter(|view| view.role != Role::Unused) {
                warnings.push(Warning::PoseDoubtful { name: view.name.clone(), fault });
            }
        }
    }
}

/// Leaves a photograph with a wrong pose out of training, with a warning.
fn leave_out(view: &mut View, fault: PoseFault, warnings: &mut Vec<Warning>) {
    let left_out = view.role == Role::Train;
    if view.role != Role::Unused {
        warnings.push(Warning::PoseWrong { name: view.name.clone(), fault, left_out });
    }
    if left_out {
        view.role = Role::Unused;
    }
}

/// Warns of training cameras far from all others that no points confirm. Leaves such a photograph out if it sees no
/// point while the others see theirs. Returns the centres of the cameras that decide the scene's extent.
pub(super) fn without_far(
    judged: &Judgement,
    views: &mut [View],
    points: &[Point],
    warnings: &mut Vec<Warning>,
) -> Vec<[f64; 3]> {
    let on: Vec<usize> = (0..views.len()).filter(|at| views[*at].role == Role::Train).collect();
    let centers: Vec<[f64; 3]> = on.iter().map(|at| views[*at].camera.center()).collect();
    // A single wrong pose would make the scene as large as its error.
    let far = far_cameras(&centers, |k| judged.fits(on[k]));
    let is_far = |k: &usize| far.iter().any(|(other, _)| other == k);
    let rest: Vec<usize> = (0..on.len()).filter(|k| !is_far(k)).collect();
    let near: Vec<Camera> = rest.iter().map(|k| views[on[*k]].camera).collect();
    let most = !far.is_empty() && !points.is_empty() && most_see(&near, points);
    for (k, times) in &far {
        let view = &mut views[on[*k]];
        match most && !points.iter().any(|p| in_view(&view.camera, p.position)) {
            true => leave_out(view, PoseFault::FarAndBlind { times: *times }, warnings),
            false => warnings.push(Warning::CameraFarAway { name: view.name.clone(), times: *times }),
        }
    }
    rest.into_iter().map(|k| centers[k]).collect()
}

/// Numbers of wrong poses and of judged poses.
fn count(all: &[Option<Evidence>]) -> (usize, usize) {
    let judged = || all.iter().flatten();
    (judged().filter(|e| e.misfit > WRONG).count(), judged().count())
}

fn is_mostly_wrong(all: &[Option<Evidence>]) -> bool {
    let (wrong, of) = count(all);
    wrong > 0 && 2 * wrong >= of
}

/// The median distance between projections and observations.
fn usual(all: &[Option<Evidence>]) -> f64 {
    let mut off: Vec<f64> = all.iter().flatten().filter_map(|e| e.off).collect();
    off.sort_by(f64::total_cmp);
    off.get(off.len() / 2).copied().unwrap_or(0.0)
}

/// Whether nearly all cameras have many points in their images, so that one without any is odd.
fn most_see(cameras: &[Camera], points: &[Point]) -> bool {
    let sees = |camera: &&Camera| {
        points.iter().filter(|p| in_view(camera, p.position)).take(LEAST_POINTS).count() == LEAST_POINTS
    };
    10 * cameras.iter().filter(sees).count() >= 9 * cameras.len()
}

/// ... and at least half of the photographs must correlate this well. Below, the colours of the points carry no
/// information.
pub(super) const TELLING: f64 = 0.5;

/// A photograph compared with the colours of the points.
pub(super) struct Judged {
    /// Its position among the photographs of its role.
    pub(super) at: usize,
    pub(super) camera: Camera,
    pub(super) coarse: Arc<Coarse>,
    /// Correlation from its own pose.
    pub(super) own: f64,
}
