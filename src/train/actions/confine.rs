//! Keeps splats of a part of a scene from reaching far across the edges of its cell.

use std::sync::Arc;

use rayon::prelude::*;

use super::{Change, HostAction};
use crate::raster::{MEANS, SCALES};
use crate::train::Error;
use crate::train::engine::Engine;
use crate::train::part::Part;
use crate::train::schedule::{Event, Kind, Schedule};

/// Steps from one look at the widths of the splats to the next, and the least number of looks.
const EVERY: u32 = 100;
const LOOKS: u32 = 20;

/// Makes splats narrower that are too wide for their place. Where parts are put together, a wide splat would lie over
/// other cells, whose own parts have learned something in its place.
pub(super) struct Confine {
    part: Option<Arc<Part>>,
}

impl Confine {
    /// Without a part, splats may be as wide as they come.
    pub(super) fn new(part: Option<Arc<Part>>) -> Self {
        Self { part: part.filter(|part| part.cell.is_some()) }
    }
}

impl HostAction for Confine {
    fn due(&self, schedule: &Schedule, event: Event) -> bool {
        let every = EVERY.min(schedule.iterations / LOOKS).max(1);
        self.part.is_some() && event.kind == Kind::Step && event.step.saturating_sub(1).is_multiple_of(every)
    }

    fn catches_up(&self) -> bool {
        true
    }

    fn run(&mut self, engine: &mut Engine, _: &Schedule, _: u32) -> Result<Option<Change>, Error> {
        let Some(part) = &self.part else { return Ok(Some(Change::default())) };
        let splats = engine.splats()?;
        let (means, mut scales) = (engine.rows(MEANS, splats)?, engine.rows(SCALES, splats)?);
        narrow(part, &means, &mut scales);
        engine.set_rows(SCALES, &scales)?;
        Ok(Some(Change::default()))
    }
}

/// Lowers the logarithms of standard deviations that are too large at their means.
fn narrow(part: &Part, means: &[f32], scales: &mut [f32]) {
    scales.par_chunks_exact_mut(3).zip(means.par_chunks_exact(3)).for_each(|(scales, mean)| {
        let most = part.widest([mean[0], mean[1], mean[2]].map(f64::from)).ln() as f32;
        scales.iter_mut().filter(|scale| **scale > most).for_each(|scale| *scale = most);
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Region;
    use crate::train::Settings;

    #[test]
    fn splats_too_wide_for_their_place_become_narrower() {
        let cell = Region {
            origin: [0.0; 3],
            axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            low: [f64::NEG_INFINITY, f64::NEG_INFINITY],
            high: [0.0, f64::INFINITY],
        };
        let part = Part { cell: Some(cell), margin: 0.6, ..Part::default() };
        let means = [-0.9, 0.0, 0.0, 2.7, 5.0, 1.0];
        let mut scales = [0.5_f32, 0.3, 0.001, 0.9, 2.0, f32::NAN].map(f32::ln);
        narrow(&part, &means, &mut scales);
        for (scale, wanted) in scales.iter().zip([0.4, 0.3, 0.001, 0.9, 1.0]) {
            assert!((scale.exp() - wanted).abs() < 1e-5, "{scales:?}");
        }
    }

    #[test]
    fn widths_are_looked_at_from_the_first_step_on() {
        let mut settings = Settings::default();
        for (iterations, looks) in [(30_000, 300), (100, 20), (3, 3)] {
            settings.run.iterations = iterations;
            let schedule = Schedule::new(&settings, 3);
            let cell = Region { origin: [0.0; 3], axes: [[0.0; 3]; 2], low: [0.0; 2], high: [0.0; 2] };
            let part = Part { cell: Some(cell), ..Part::default() };
            let due = |confine: &Confine| {
                (1..=iterations).filter(|step| confine.due(&schedule, Event::of_step(*step))).collect::<Vec<_>>()
            };
            let steps = due(&Confine::new(Some(Arc::new(part))));
            assert_eq!((steps.len(), steps[0]), (looks, 1));
            assert_eq!(due(&Confine::new(Some(Arc::default()))), [0_u32; 0]);
        }
    }
}
