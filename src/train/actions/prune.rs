//! Drops splats that add next to nothing to any photograph (after RadSplat, Niemeyer et al. 2024).

use super::{Change, HostAction};
use crate::train::Error;
use crate::train::engine::Engine;
use crate::train::memory::is_lack_of_memory;
use crate::train::message::Message;
use crate::train::schedule::{DroppedSplats, Event, Kind, Schedule};

/// Share of the limit of splats from which on the limit counts as reached, because density changes prune as they grow.
const NEARLY: f64 = 0.95;

pub(super) struct Prune;

impl HostAction for Prune {
    fn due(&self, schedule: &Schedule, event: Event) -> bool {
        event.kind == Kind::Step && schedule.drops(event.step).is_some()
    }

    fn catches_up(&self) -> bool {
        true
    }

    fn run(&mut self, engine: &mut Engine, schedule: &Schedule, step: u32) -> Result<Option<Change>, Error> {
        let Some(due) = schedule.drops(step) else { return Ok(None) };
        let before = engine.splats()?;
        let held_up = engine.limit().is_some_and(|most| f64::from(before) >= NEARLY * f64::from(most));
        // The lightest splats make room for growth, and go only if room is short.
        if matches!(due, DroppedSplats::Lightest(_)) && !held_up {
            return Ok(None);
        }
        let weights = match engine.weights(schedule.step(step).sh_degree) {
            Ok(weights) => weights,
            // The splats are unchanged, and the training can go on with more splats than planned.
            Err(error) if is_lack_of_memory(&error) => {
                let warning = format!(
                    "step {step}: splats of little weight are kept, because there is no room to weigh them: {error}"
                );
                return Ok(Some(Change { message: Some(Message::Warning(warning)), ..Change::default() }));
            }
            Err(error) => return Err(error),
        };
        let least = match due {
            DroppedSplats::Below(least) => least,
            DroppedSplats::Lightest(share) => quantile(&weights, share),
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
    // Splats without any weight go in any case.
    f64::from(weight.max(f32::MIN_POSITIVE))
}
