//! Which splats have spherical harmonics above degree 1, where not all have them.

use super::Engine;
use crate::pass::counters;
use crate::raster::{OPACITIES, PLANES, Planes, SCALES, SH0, UPPER};
use crate::scene::{SH_GROUP_FLOATS, rows_of};
use crate::train::Error;

impl Engine {
    /// Whether only some splats have harmonics above degree 1.
    pub(super) fn has_plain_splats(&self) -> bool {
        self.settings.model.sh_share < 1.0
    }

    /// Gives harmonics above degree 1, zero to begin with, to the share of the splats whose colour changes most with the direction, by
    /// what degree 1 has learned; gives how many. These come first from here on, in the order that they had. To be called when
    /// everything submitted is done and no density change is to come. Waits.
    pub fn settle_harmonics(&mut self) -> Result<u32, Error> {
        let n = self.splats()? as usize;
        if n == 0 {
            return Ok(0);
        }
        let [scales, opacities, head] = [(SCALES, 3), (OPACITIES, 1), (SH0, SH_GROUP_FLOATS)]
            .map(|(plane, width)| self.gpu.read_at::<f32>(&self.model.buffers()[plane], 0, width * n));
        let needs = view_dependence(&scales?, &opacities?, &head?);
        let full = (self.settings.model.sh_share * n as f64) as usize;
        let full = full.min(self.model.full_rows() as usize);
        let chosen = most(&needs, full);
        let (first, last): (Vec<u32>, Vec<u32>) = (0..n as u32).partition(|&row| chosen[row as usize]);
        self.rearrange(&[first, last].concat(), Some(full as u32))?;
        Ok(full as u32)
    }

    /// Drops the rows that are not `kept`, moments and all; the others keep their order. Waits.
    pub(super) fn keep_rows(&mut self, kept: &[bool]) -> Result<(), Error> {
        let words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        let full = counters::full_rows(&words);
        let rows: Vec<u32> = (0..kept.len() as u32).filter(|&row| kept[row as usize]).collect();
        let settled = words[counters::PLAIN] != u32::MAX;
        let full = settled.then(|| rows.iter().filter(|&&row| (row as usize) < full).count() as u32);
        self.rearrange(&rows, full)
    }

    /// Puts the row `rows[k]` in place of row k, for every k; there are no others then. The first `full` have harmonics above degree 1,
    /// where that is settled. Statistics of growth begin anew.
    fn rearrange(&mut self, rows: &[u32], full: Option<u32>) -> Result<(), Error> {
        let mut words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        let (before, full_before) = (words[counters::SPLATS] as usize, counters::full_rows(&words));
        let moments = [self.optimiser.first()].into_iter().chain(self.optimiser.second());
        for planes in [&self.model].into_iter().chain(moments) {
            for (k, (_, width)) in PLANES.into_iter().enumerate() {
                if k < UPPER {
                    self.move_rows(planes, k, before, width as usize, |old| rows_of(old, width as usize, rows))?;
                } else if let Some(full) = full {
                    let width = width as usize;
                    self.move_rows(planes, k, full_before, width, |old| {
                        let mut new = vec![0.0; width * (full as usize).max(full_before)];
                        for (row, &from) in new.chunks_exact_mut(width).zip(&rows[..full as usize]) {
                            if let Some(old) = old.get(width * from as usize..width * (from as usize + 1)) {
                                row.copy_from_slice(old);
                            }
                        }
                        new
                    })?;
                }
            }
        }
        let ids: Vec<u32> = self.gpu.read_at(&self.ids, 0, before)?;
        if !rows.is_empty() {
            self.gpu.write(&self.ids, &rows_of(&ids, 1, rows))?;
        }
        words[counters::SPLATS] = rows.len() as u32;
        words[counters::PLAIN] = full.map_or(u32::MAX, |full| rows.len() as u32 - full);
        let mut recorder = self.gpu.recorder("rearrange")?;
        self.statistics.clear(&mut recorder)?;
        recorder.upload(&self.renderer.counters, 0, bytemuck::cast_slice(&words))?;
        self.gpu.wait(recorder.submit()?)?;
        Ok(())
    }

    fn move_rows(
        &self,
        planes: &Planes,
        k: usize,
        before: usize,
        width: usize,
        moved: impl FnOnce(&[f32]) -> Vec<f32>,
    ) -> Result<(), Error> {
        let old: Vec<f32> =
            if before > 0 { self.gpu.read_at(&planes.buffers()[k], 0, width * before)? } else { Vec::new() };
        let new = moved(&old);
        if !new.is_empty() {
            self.gpu.write(&planes.buffers()[k], &new)?;
        }
        Ok(())
    }
}

/// How much of the pictures changes with the direction because of each splat: the energy of its harmonics of degree 1 times its opacity
/// and the area of its largest section.
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

/// Which `count` values are the largest; of equal ones the first.
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
    fn a_splat_needs_harmonics_by_what_changes_and_how_much_of_it_is_seen() {
        let head = |constant: f32, linear: f32| {
            let mut row = vec![constant; 3];
            row.resize(SH_GROUP_FLOATS, linear);
            row
        };
        // The second changes twice as much, the third is four times as large in two directions, the fourth is faint.
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
