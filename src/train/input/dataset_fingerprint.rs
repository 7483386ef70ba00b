//! Which photographs a training looks at. Checkpoints keep this, because a resumed training has to look at the same.

use std::collections::HashSet;
use std::fmt;

use super::View;
use crate::numbers::{counted, grouped, of_count};
use crate::scene::Camera;
use crate::train::Error;

/// Relative tolerance of the numbers of a camera, which are computed anew, perhaps on another machine.
const TOLERANCE: f64 = 1e-6;

/// Names, cameras (in scene coordinates) and checksums of the photographs to train on.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct TrainedOn {
    pub(in crate::train) names: Vec<String>,
    cameras: Vec<Vec<f64>>,
    /// Empty in checkpoints of earlier versions.
    #[serde(default)]
    checksums: Vec<u32>,
    /// What the perceptual loss compares by. Absent without a perceptual loss, and in checkpoints of earlier versions.
    #[serde(default)]
    perceptual: Option<PerceptualBy>,
}

/// What a perceptual loss compares by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(in crate::train) enum PerceptualBy {
    /// Oriented filters.
    Filters,
    /// A network whose weights have this checksum.
    Network(u32),
}

impl fmt::Display for PerceptualBy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Filters => f.write_str("filters, for want of weights"),
            Self::Network(checksum) => write!(f, "a network whose weights have the checksum {checksum:08x}"),
        }
    }
}

impl TrainedOn {
    pub(in crate::train) fn of(views: &[View], perceptual: Option<PerceptualBy>) -> Self {
        Self {
            names: views.iter().map(|view| view.name.clone()).collect(),
            cameras: views.iter().map(|view| numbers(&view.camera)).collect(),
            checksums: views.iter().map(|view| view.photograph.checksum()).collect(),
            perceptual,
        }
    }

    /// Whether a training that looked at the photographs of `self` may go on with `views`.
    pub fn check_views(&self, views: &[View]) -> Result<(), Error> {
        self.check(&Self::of(views, None))
    }

    /// Whether a training that looked at the photographs of `self` may go on with those of `now`.
    pub(in crate::train) fn check(&self, now: &Self) -> Result<(), Error> {
        let other = |what: String| Err(Error::OtherPhotographs { what });
        let there: HashSet<&str> = now.names.iter().map(String::as_str).collect();
        let mut gone = self.names.iter().filter(|name| !there.contains(name.as_str()));
        if let Some(first) = gone.next() {
            let count = 1 + gone.count();
            return other(format!(
                "{}'{first}'{} not to be trained on any more, as {} missing, unusable or held out now",
                if count == 1 { String::new() } else { format!("{} photographs, the first of them ", grouped(count)) },
                of_count(count, " is", ", are"),
                of_count(count, "the photograph is", "they are"),
            ));
        }
        if self.names.len() != now.names.len() {
            let before: HashSet<&str> = self.names.iter().map(String::as_str).collect();
            let new = now.names.iter().find(|name| !before.contains(name.as_str()));
            return other(format!(
                "it has {} to train on, and the run had {}{}",
                counted(now.names.len(), "photograph"),
                grouped(self.names.len()),
                new.map_or(String::new(), |name| format!(", without '{name}'"))
            ));
        }
        for (k, (before, name)) in self.names.iter().zip(&now.names).enumerate() {
            if before != name {
                return other(format!("'{name}' is where the run had '{before}'"));
            }
            let same = |(a, b): (&f64, &f64)| (a - b).abs() <= TOLERANCE * a.abs().max(1.0);
            let (a, b) = (self.cameras.get(k), now.cameras.get(k));
            let equal = a.zip(b).is_some_and(|(a, b)| a.len() == b.len() && a.iter().zip(b).all(same));
            if !equal {
                return other(format!("the camera of '{name}' has changed"));
            }
            if self.checksums.get(k).zip(now.checksums.get(k)).is_some_and(|(a, b)| a != b) {
                return other(format!("the file of '{name}' or its mask has changed"));
            }
        }
        match self.perceptual.zip(now.perceptual) {
            Some((before, now)) if before != now => {
                Err(Error::OtherPerceptual { before: before.to_string(), now: now.to_string() })
            }
            _ => Ok(()),
        }
    }
}

fn numbers(camera: &Camera) -> Vec<f64> {
    let Camera { rotation, translation, fx, fy, cx, cy, width, height } = camera;
    let [a, b, c] = *rotation;
    [a, b, c, *translation]
        .concat()
        .into_iter()
        .chain([*fx, *fy, *cx, *cy, (*width).into(), (*height).into()])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Pixels;

    fn view(name: &str, at: f64) -> View {
        let rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let camera =
            Camera { rotation, translation: [at, 0.0, 0.0], fx: 9.0, fy: 9.0, cx: 1.0, cy: 1.0, width: 2, height: 2 };
        View::new(name, camera, Pixels::Rgba8(vec![255; 16]))
    }

    #[test]
    fn others_are_told_from_the_same() {
        let run = TrainedOn::of(&[view("a", 0.0), view("b", 1.0)], None);
        let complaint =
            |views: &[View]| run.check(&TrainedOn::of(views, None)).err().map(|e| e.to_string()).unwrap_or_default();
        assert_eq!(complaint(&[view("a", 0.0), view("b", 1.0 + 1e-9)]), "");
        for (views, words) in [
            (vec![view("a", 0.0)], "'b' is not to be trained on any more"),
            (vec![], "2 photographs, the first of them 'a', are not to be trained on any more"),
            (vec![view("a", 0.0), view("c", 1.0)], "'b' is not to be trained on any more"),
            (
                vec![view("a", 0.0), view("b", 1.0), view("c", 1.0)],
                "3 photographs to train on, and the run had 2, without 'c'",
            ),
            (vec![view("b", 1.0), view("a", 0.0)], "'b' is where the run had 'a'"),
            (vec![view("a", 0.0), view("b", 1.001)], "camera of 'b'"),
        ] {
            assert!(complaint(&views).contains(words), "{}", complaint(&views));
        }
        let mut retouched = view("b", 1.0);
        retouched.photograph = crate::dataset::Supply::of(Pixels::Rgba8([vec![255; 15], vec![254]].concat()));
        // Alpha is rounded to 0 or 255, so the photograph is the same.
        assert_eq!(complaint(&[view("a", 0.0), retouched.clone()]), "");
        retouched.photograph = crate::dataset::Supply::of(Pixels::Rgba8([vec![254], vec![255; 15]].concat()));
        let views = [view("a", 0.0), retouched];
        assert!(complaint(&views).contains("the file of 'b' or its mask has changed"), "{}", complaint(&views));
        let earlier = TrainedOn { checksums: Vec::new(), ..run };
        assert!(earlier.check(&TrainedOn::of(&views, None)).is_ok(), "a checkpoint without checksums");
    }

    #[test]
    fn a_perceptual_loss_goes_on_by_what_it_went_by() {
        let views = [view("a", 0.0)];
        let by = |perceptual| TrainedOn::of(&views, perceptual);
        let kept = |of: &TrainedOn| -> TrainedOn {
            serde_json::from_str(&serde_json::to_string(of).expect("text")).expect("the same")
        };
        let (filters, network) = (by(Some(PerceptualBy::Filters)), by(Some(PerceptualBy::Network(7))));
        for (before, now, fits) in [
            (&filters, &filters, true),
            (&network, &network, true),
            (&filters, &network, false),
            (&network, &filters, false),
            (&network, &by(Some(PerceptualBy::Network(8))), false),
            // What an earlier version kept.
            (&by(None), &network, true),
        ] {
            let checked = kept(before).check(&kept(now));
            assert_eq!(checked.is_ok(), fits, "{before:?}, {now:?}");
            if let Err(error) = checked {
                assert!(error.to_string().contains("`perceptual-weights`"), "{error}");
            }
        }
    }
}
