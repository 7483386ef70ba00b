//! Chooses the splats that have spherical harmonics above degree 1, if not all splats have them.

use super::{Change, HostAction};
use crate::raster::{OPACITIES, SCALES, SH0};
use crate::scene::SH_GROUP_FLOATS;
use crate::train::Error;
use crate::train::engine::Engine;
use crate::train::message::Message;
use crate::train::schedule::{Event, Kind, Schedule};

/// Gives harmonics above degree 1, all zero, to the share of splats whose colour changes most with the direction by the
/// harmonics of degree 1. The chosen splats are moved before the others; both groups keep their order.
pub(super) struct SettleHarmonics;

impl HostAction for SettleHarmonics {
    fn due(&self, schedule: &Schedule, event: Event) -> bool {
        event.kind == Kind::Step && schedule.settles_sh(event.step)
    }

    fn catches_up(&self) -> bool {
        true
    }

    fn run(&mut self, engine: &mut Engine, _: &Schedule, step: u32) -> Result<Option<Change>, Error> {
        let splats = engine.splats()?;
        let mut full = 0;
        if splats > 0 {
            let needs = view_dependence(
                &engine.rows(SCALES, splats)?,
                &engine.rows(OPACITIES, splats)?,
                &engine.rows(SH0, splats)?,
            );
            full = engine.most_full_rows(splats);
            let chosen = most(&needs, full as usize);
            let (first, last): (Vec<u32>, Vec<u32>) = (0..splats).partition(|&row| chosen[row as usize]);
            engine.rearrange(&[first, last].concat(), Some(full))?;
        }
        Ok(Some(Change { message: Some(Message::HarmonicsSettled { step, full, splats }), ..Change::default() }))
    }
}

/// How much each splat makes renders depend on the direction: the energy of its harmonics of degree 1 times its opacity
/// times the area of its largest cross-section.
fn view_dependence(scales: &[f32], opacities: &[f32], head: &[f32]) -> Vec<f32> {
    let rows = scales.chunks_exact(3).zip(opacities).zip(head.chunks_exact(SH_GROUP_FLOATS));
    rows.map(|((scales, logit), head)| {
        let energy: f32 = head[3..].iter().map(|c| c * c).sum();
        let shortest = scales.iter().copied().fold(f32::INFINITY, f32::min);
        let area = (scales.iter().sum::<f32>() - shortest).exp();
        let need = energy * area / (1.0 + (-logit).exp());
        if need.is_finite() { need } else { 0.0 }
    })
    .collect()
}

/// Marks the `count` largest values; of equal values the first.
fn most(values: &[f32], count: usize) -> Vec<bool> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
    let mut chosen = vec![false; values.len()];
    order.into_iter().take(count).for_each(|row| chosen[row] = true);
    chosen
}

#[cfg(test)]
mod tests {
    use super::{most, view_dependence};
    use crate::scene::SH_GROUP_FLOATS;

    #[test]
    fn need_of_harmonics_follows_change_of_colour_and_visible_area() {
        let head = |constant: f32, linear: f32| {
            let mut row = vec![constant; 3];
            row.resize(SH_GROUP_FLOATS, linear);
            row
        };
        // The second colour changes twice as much, the third splat is four times as large in two directions, the fourth
        // is faint.
        let heads = [head(9.0, 0.1), head(0.0, 0.2), head(1.0, 0.1), head(0.0, 0.1), head(0.0, f32::NAN)].concat();
        let four = 4.0_f32.ln();
        let scales = [0.0, 0.0, -3.0, 0.0, -3.0, 0.0, four, four, -3.0, 0.0, 0.0, -3.0, 0.0, 0.0, 0.0];
        let needs = view_dependence(&scales, &[2.0, 2.0, 2.0, -5.0, 2.0], &heads);
        assert!((needs[1] / needs[0] - 4.0).abs() < 1e-4 && (needs[2] / needs[0] - 16.0).abs() < 1e-4, "{needs:?}");
        assert!(needs[3] < 0.02 * needs[0] && needs[4] == 0.0);
        assert_eq!(most(&needs, 2), [false, true, true, false, false]);
        assert_eq!(most(&[1.0, 2.0, 2.0, 2.0], 2), [false, true, true, false]);
        assert_eq!(most(&needs, 0), [false; 5]);
    }
}
