//! What a fit left.

use serde::Serialize;

use crate::geodesy::fit::Fit;

/// What a position or a control point is off the fit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Off {
    /// The photograph's or the point's name.
    pub name: String,
    /// Metres towards east: measured less fitted.
    pub east: f64,
    /// Metres towards north.
    pub north: f64,
    /// Metres upwards; `None` where no height was measured.
    pub up: Option<f64>,
    /// Whether the fit goes by it: wrong ones are left out.
    pub used: bool,
}

impl Off {
    /// Metres in the plane.
    pub fn plane(&self) -> f64 {
        self.east.hypot(self.north)
    }

    /// Metres in space.
    pub fn distance(&self) -> f64 {
        self.plane().hypot(self.up.unwrap_or(0.0))
    }
}

/// Residuals of a fit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FitReport {
    /// Those of each position or point.
    pub residuals: Vec<Off>,
    /// Median, root of the mean square and largest distance in the plane, of those that were used, in metres.
    pub plane: [f64; 3],
    /// The same of heights, without sign. `None` where none was measured.
    pub height: Option<[f64; 3]>,
    /// Metres per unit of the dataset.
    pub scale: f64,
    /// Remarks on what was left out before the fit.
    pub notes: Vec<String>,
}

impl FitReport {
    pub(super) fn new(names: Vec<String>, fit: &Fit) -> Self {
        let off = |((name, [east, north, up]), used): ((String, &[f64; 3]), &bool)| {
            let up = Some(*up).filter(|up| !up.is_nan());
            Off { name, east: *east, north: *north, up, used: *used }
        };
        let residuals: Vec<Off> = names.into_iter().zip(&fit.residuals).zip(&fit.used).map(off).collect();
        let of = |value: &dyn Fn(&Off) -> Option<f64>| -> Vec<f64> {
            residuals.iter().filter(|off| off.used).filter_map(value).collect()
        };
        let plane = figures(of(&|off| Some(off.plane()))).unwrap_or_default();
        let height = figures(of(&|off| off.up.map(f64::abs)));
        Self { residuals, plane, height, scale: fit.similarity.scale, notes: Vec::new() }
    }

    pub(super) fn with_notes(self, notes: Vec<String>) -> Self {
        Self { notes, ..self }
    }

    /// Those that were left out as wrong, the worst first.
    pub fn wrong(&self) -> Vec<&Off> {
        let mut wrong: Vec<&Off> = self.residuals.iter().filter(|off| !off.used).collect();
        wrong.sort_by(|a, b| b.distance().total_cmp(&a.distance()));
        wrong
    }

    /// The one that was used and is furthest off.
    pub fn furthest(&self) -> Option<&Off> {
        self.residuals.iter().filter(|off| off.used).max_by(|a, b| a.distance().total_cmp(&b.distance()))
    }
}

/// Median, root of the mean square and largest.
fn figures(mut values: Vec<f64>) -> Option<[f64; 3]> {
    values.sort_by(f64::total_cmp);
    let (middle, largest) = (values.get(values.len() / 2)?, values.last()?);
    let square = values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64;
    Some([*middle, square.sqrt(), *largest])
}
