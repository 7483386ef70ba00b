//! Time against error of settings, measured in turn on the same work, and which settings are worth having.

mod chart;
mod gradients;
mod page;
mod pictures;
mod reference;
mod table;
mod trainings;

pub use chart::svg;
pub use gradients::gradients;
pub use page::page;
pub use pictures::pictures;
pub use reference::Reference;
pub use table::markdown;
pub use trainings::{Scored, TrainingKnob, training_knobs, trainings};

use serde::Serialize;

/// Times that differ by less than this share count as equal. So do times that differ by less than those of the default
/// and its repetitions.
const SAME_TIME: f64 = 0.05;
/// Name of the default's repetition.
const AGAIN: &str = "default, again";

/// One way to do a piece of work.
#[derive(Clone, Debug, Serialize)]
pub struct Setting {
    /// Name.
    pub name: String,
    /// Options that choose the setting; empty for none.
    pub options: String,
    /// Whether this is the default.
    pub default: bool,
    /// Whether the setting gives the default's bits with the default's variants, and so repeats its measurement.
    pub repeats: bool,
    /// Whether every run gives the same bits. A setting that does not cannot dominate one that does.
    pub reproducible: bool,
    /// Time, in the unit of the table.
    pub time: f64,
    /// Error in the unit of the table; smaller is better. `None` where the setting has no error.
    pub error: Option<f64>,
    /// Further numbers, one per column of the table.
    pub more: Vec<f64>,
    /// Whether another setting is better in time or error, as good in the other, and as reproducible.
    pub dominated: bool,
}

/// Settings compared on the same work.
#[derive(Clone, Debug, Serialize)]
pub struct Table {
    /// The work.
    pub title: String,
    /// Name of the time, with its unit.
    pub time: String,
    /// Name of the error, with its unit.
    pub error: String,
    /// Errors count as equal below the larger of two differences: a share of the smaller error, and an absolute one.
    pub same_error: (f64, f64),
    /// Names of the further numbers.
    pub columns: Vec<String>,
    /// The settings in the order of measurement.
    pub settings: Vec<Setting>,
}

impl Table {
    /// Marks dominated settings. Times count as equal within 5 % or within the spread of the default and its
    /// repetitions, and errors within [`Self::same_error`].
    pub fn mark(&mut self) {
        let (share, least) = self.same_error;
        let noise = 1.0 + self.noise().max(SAME_TIME);
        let as_fast = |a: &Setting, b: &Setting| a.time <= b.time * noise;
        let faster = |a: &Setting, b: &Setting| a.time * noise < b.time;
        let slack = |a: f64, b: f64| (share * a.abs().min(b.abs())).max(least);
        let as_right =
            |a: &Setting, b: &Setting| matches!((a.error, b.error), (Some(a), Some(b)) if a <= b + slack(a, b));
        let more_right =
            |a: &Setting, b: &Setting| matches!((a.error, b.error), (Some(a), Some(b)) if a + slack(a, b) < b);
        let as_steady = |a: &Setting, b: &Setting| a.reproducible || !b.reproducible;
        let better = |a: &Setting, b: &Setting| {
            as_fast(a, b) && as_right(a, b) && as_steady(a, b) && (faster(a, b) || more_right(a, b))
        };
        let dominated: Vec<bool> = self.settings.iter().map(|b| self.settings.iter().any(|a| better(a, b))).collect();
        self.settings.iter_mut().zip(dominated).for_each(|(setting, d)| setting.dominated = d);
    }

    /// Relative spread of the times of the default and its repetitions.
    fn noise(&self) -> f64 {
        let times = || self.settings.iter().filter(|s| s.default || s.repeats).map(|s| s.time);
        let (least, most) = (times().fold(f64::INFINITY, f64::min), times().fold(0.0, f64::max));
        if most > least { most / least - 1.0 } else { 0.0 }
    }

    /// The default if it is dominated.
    pub fn default_off_the_front(&self) -> Option<&Setting> {
        self.settings.iter().find(|s| s.default && s.dominated)
    }
}

/// The smallest time: that of the work without other load on the machine.
fn least(times: Vec<f64>) -> f64 {
    times.into_iter().fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::{Setting, Table};

    fn table(points: &[(f64, f64)]) -> Table {
        let setting = |(time, error): &(f64, f64)| Setting {
            name: String::new(),
            options: String::new(),
            default: false,
            repeats: false,
            reproducible: true,
            time: *time,
            error: Some(*error),
            more: Vec::new(),
            dominated: false,
        };
        let mut table = Table {
            title: String::new(),
            time: String::new(),
            error: String::new(),
            same_error: (0.1, 0.0),
            columns: Vec::new(),
            settings: points.iter().map(setting).collect(),
        };
        table.mark();
        table
    }

    fn dominated(points: &[(f64, f64)]) -> Vec<bool> {
        table(points).settings.iter().map(|s| s.dominated).collect()
    }

    #[test]
    fn what_is_slower_and_no_better_is_dominated() {
        assert_eq!(dominated(&[(1.0, 1.0), (2.0, 0.5), (3.0, 0.5), (1.0, 2.0)]), [false, false, true, true]);
    }

    #[test]
    fn what_is_the_same_within_noise_dominates_nothing() {
        assert_eq!(dominated(&[(1.0, 1.0), (1.02, 1.05), (0.98, 1.09)]), [false; 3]);
    }

    #[test]
    fn differences_within_the_noise_of_the_default_dominate_nothing() {
        let mut table = table(&[(1.0, 1.0), (1.2, 1.0), (0.85, 1.0), (0.7, 1.0)]);
        table.settings[0].default = true;
        table.settings[1].repeats = true;
        table.mark();
        let dominated: Vec<bool> = table.settings.iter().map(|s| s.dominated).collect();
        assert_eq!(
            dominated,
            [true, true, true, false],
            "a fifth is noise: 0.7 is faster than all, 0.85 is not faster than 1"
        );
    }

    #[test]
    fn another_measurement_of_the_default_does_not_dominate_it() {
        // As where a mode that the default has anyway is asked for: the same work to the last bit,
        // 8 % faster by chance.
        let mut table = table(&[(1.0, 1.0), (0.92, 1.0), (1.02, 1.0)]);
        assert!(table.settings[0].dominated);
        table.settings[0].default = true;
        table.settings.iter_mut().skip(1).for_each(|setting| setting.repeats = true);
        table.mark();
        assert!(table.default_off_the_front().is_none());
    }

    #[test]
    fn what_differs_from_run_to_run_does_not_dominate_what_does_not() {
        let mut table = table(&[(1.0, 1.0), (0.5, 1.0), (2.0, 1.0)]);
        table.settings[1].reproducible = false;
        table.mark();
        let dominated: Vec<bool> = table.settings.iter().map(|s| s.dominated).collect();
        assert_eq!(dominated, [false, false, true]);
        table.settings[0].reproducible = false;
        table.mark();
        assert!(table.settings[0].dominated);
    }

    #[test]
    fn a_setting_without_an_error_is_on_no_front_and_hides_nothing() {
        let mut table = table(&[(1.0, 1.0), (0.5, 0.1)]);
        table.settings[1].error = None;
        table.mark();
        assert!(!table.settings[0].dominated && !table.settings[1].dominated);
        table.settings[0].default = true;
        assert!(table.default_off_the_front().is_none());
    }
}
