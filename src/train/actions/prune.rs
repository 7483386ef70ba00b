//! Splats that add next to nothing to any photograph are dropped (after RadSplat, Niemeyer et al. 2024).

use super::{Change, HostAction};
use crate::train::Error;
use crate::train::engine::Engine;
use crate::train::memory::is_lack_of_memory;
use crate::train::message::Message;
use crate::train::schedule::{Dropped, Event, Kind, Schedule};

/// Share of a limit from which on it counts as reached: density changes prune as they grow.
const NEARLY: f64 = 0.95;

pub(super) struct Prune;

impl HostAction for Prune {
    fn due(&self, schedule: &Schedule, event: Event) -> bool {
        event.kind == Kind::Step && schedule.drops(event.step).is_some()
    }

    fn run(&mut self, engine: &mut Engine, schedule: &Schedule, step: u32) -> Result<Option<Change>, Error> {
        let Some(due) = schedule.drops(step) else { return Ok(None) };
        let before = engine.splats()?;
        let held_up = engine.limit().is_some_and(|most| f64::from(before) >= NEARLY * f64::from(most));
        // For room only where it is short.
        if matches!(due, Dropped::Lightest(_)) && !held_up {
            return Ok(None);
        }
        let weights = match engine.weights(schedule.step(step).sh_degree) {
            Ok(weights) => weights,
            // The splats are what they were: a larger model is no reason to lose it.
            Err(error) if is_lack_of_memory(&error) => {
                let warning = format!(
                    "step {step}: splats of little weight are kept, because there is no room to weigh them: {error}"
                );
                return Ok(Some(Change { message: Some(Message::Warning(warning)), ..Change::default() }));
            }
            Err(error) => return Err(error),
        };
        let least = match due {
            Dropped::Below(least) => least,
            Dropped::Lightest(share) => quantile(&weights, share),
        };
        let dropped = engine.drop_below(least, &weights)?;
        let splats = before.saturating_sub(dropped);
        let message = Some(Message::Pruned { step, dropped, splats });
        Ok(Some(Change { splats: Some(splats), message, capacity: None }))
    }
}

/// The weight below which this share of the splats lies.
fn quantile(weights: &[f32], share: f64) -> f64 {
    let mut sorted = weights.to_vec();
    let rank = (share * weights.len() as f64) as usize;
    if rank >= sorted.len() {
        return 0.0;
    }
    let (_, weight, _) = sorted.select_nth_unstable_by(rank, f32::total_cmp);
    // What has no weight at all goes in any case.
    f64::from(weight.max(f32::MIN_POSITIVE))
}
