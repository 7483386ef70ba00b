//! Reading, dropping, moving and adding rows of the model between steps, with their moments and identities.

use super::Engine;
use crate::pass::counters;
use crate::raster::{OPACITIES, PLANES, Planes, SCALES, SH_HIGHER, most_splats, planes_of};
use crate::scene::{Gaussians, rows_of};
use crate::train::Error;
use crate::train::actions::Relocation;
use crate::train::density::DensityRules;
use crate::vk::Memory;

/// Logit of the opacity of a splat to drop: below that of every kept splat, but finite, else the splat would count as a
/// bad one.
const DOOMED_LOGIT: f32 = -1e30;
/// Opacity threshold between dropped and kept splats.
const PRUNE_OPACITY: f64 = 1e-30;
/// Column of the statistics that counts views. Mean gradients are sums divided by this count, or zero without views.
const VIEWS: usize = 2;

/// The result of adding splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::train) struct Appended {
    /// Splats that were added.
    pub(in crate::train) added: u32,
    /// Splats after adding.
    pub(in crate::train) splats: u32,
    /// New capacity of splats, if it has grown.
    pub(in crate::train) capacity: Option<u32>,
}

/// Call these methods when everything submitted is done. They wait for the device.
impl Engine {
    /// The first `splats` rows of a plane; `plane` is below [`SH_HIGHER`].
    pub(in crate::train) fn rows(&self, plane: usize, splats: u32) -> Result<Vec<f32>, Error> {
        if splats == 0 {
            return Ok(Vec::new());
        }
        let (_, width) = PLANES[plane];
        Ok(self.gpu.read_at(&self.model.buffers()[plane], 0, width as usize * splats as usize)?)
    }

    /// Writes the first rows of a plane; `plane` is below [`SH_HIGHER`].
    pub(in crate::train) fn set_rows(&self, plane: usize, rows: &[f32]) -> Result<(), Error> {
        if rows.is_empty() {
            return Ok(());
        }
        Ok(self.gpu.write(&self.model.buffers()[plane], rows)?)
    }

    /// Sets the count of views to zero in the statistics of all splats but the `growing` ones, so that only these grow
    /// in the next density change. A second call changes nothing.
    pub(in crate::train) fn limit_growth_to(&self, growing: &[bool]) -> Result<(), Error> {
        if growing.is_empty() {
            return Ok(());
        }
        let mut stats: Vec<f32> = self.gpu.read_at(self.statistics.stats(), 0, 4 * growing.len())?;
        for (row, _) in stats.chunks_exact_mut(4).zip(growing).filter(|(_, growing)| !**growing) {
            row[VIEWS] = 0.0;
        }
        Ok(self.gpu.write(self.statistics.stats(), &stats)?)
    }

    /// The largest weight (alpha times transmittance) of every splat in any pixel of any training photograph.
    pub(in crate::train) fn weights(&mut self, sh_degree: u32) -> Result<Vec<f32>, Error> {
        let splats = self.splats()?;
        if splats == 0 {
            return Ok(Vec::new());
        }
        let weights = self.gpu.buffer("weights", 4 * u64::from(splats), Memory::Device)?;
        let mut recorder = self.gpu.recorder("no weights")?;
        recorder.fill(&weights, 0)?;
        recorder.submit()?;
        for camera in self.views.cameras.clone() {
            let shot = self.view_shot(&camera, sh_degree, [0.0; 3]);
            self.viewer.weigh(&self.model, splats, &shot, &weights)?;
        }
        Ok(self.gpu.read(&weights)?)
    }

    /// Drops the splats whose weight is below `least`, with their moments, and returns how many. Clears the statistics.
    pub(in crate::train) fn drop_below(&mut self, least: f64, weights: &[f32]) -> Result<u32, Error> {
        if weights.is_empty() {
            return Ok(0);
        }
        if self.has_plain_splats() {
            let kept: Vec<bool> = weights.iter().map(|weight| f64::from(*weight) >= least).collect();
            self.keep_rows(&kept)?;
            return Ok(kept.iter().filter(|kept| !**kept).count() as u32);
        }
        let opacities = &self.model.buffers()[OPACITIES];
        let mut logits: Vec<f32> = self.gpu.read_at(opacities, 0, weights.len())?;
        for (logit, weight) in logits.iter_mut().zip(weights) {
            if f64::from(*weight) < least {
                *logit = DOOMED_LOGIT;
            }
        }
        self.gpu.write(opacities, &logits)?;
        let rules = DensityRules {
            clone_threshold: f32::INFINITY,
            split_threshold: f32::INFINITY,
            prune_opacity: PRUNE_OPACITY,
            ..DensityRules::reference(self.needs.extent, 0)
        };
        let mut recorder = self.gpu.recorder("prune")?;
        self.density.record(&mut recorder, &self.density_model(), &rules, 0)?;
        self.gpu.wait(recorder.submit()?)?;
        Ok((weights.len() as u32).saturating_sub(self.splats()?))
    }

    /// How many of `splats` splats may have harmonics above degree 1, if not all have them.
    pub(in crate::train) fn most_full_rows(&self, splats: u32) -> u32 {
        let share = (self.settings.model.sh_share * f64::from(splats)) as u32;
        share.min(self.model.full_rows())
    }

    /// Drops the rows that are not `kept`, with their moments; the others keep their order.
    fn keep_rows(&mut self, kept: &[bool]) -> Result<(), Error> {
        let words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        let full = counters::full_rows(&words);
        let rows: Vec<u32> = (0..kept.len() as u32).filter(|&row| kept[row as usize]).collect();
        let settled = words[counters::PLAIN] != u32::MAX;
        let full = settled.then(|| rows.iter().filter(|&&row| (row as usize) < full).count() as u32);
        self.rearrange(&rows, full)
    }

    /// Replaces the rows by `rows[0]`, `rows[1]` and so on. The first `full` of them have harmonics above degree 1;
    /// `None` if those splats are not chosen yet. Clears the statistics.
    pub(in crate::train) fn rearrange(&mut self, rows: &[u32], full: Option<u32>) -> Result<(), Error> {
        let mut words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        let (before, full_before) = (words[counters::SPLATS] as usize, counters::full_rows(&words));
        let moments = [self.optimiser.first()].into_iter().chain(self.optimiser.second());
        for planes in [&self.model].into_iter().chain(moments) {
            for (k, (_, width)) in PLANES.into_iter().enumerate() {
                if k < SH_HIGHER {
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

    /// How many of `more` splats [`Self::append`] would add. Grows the buffers for them.
    pub(in crate::train) fn room(&mut self, more: u32) -> Result<Appended, Error> {
        let before = self.size.splats;
        let words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        let splats = words[counters::SPLATS];
        let limits = self.most_splats.into_iter().chain(self.settings.density.max_splats);
        let most = limits.chain([most_splats(&self.gpu)]).min().unwrap_or(0);
        let wanted = splats.saturating_add(more).min(most.max(splats));
        let added = self.room_for(wanted, &words)?.min(wanted) - splats;
        let capacity = (self.size.splats > before).then_some(self.size.splats);
        Ok(Appended { added, splats: splats + added, capacity })
    }

    /// Gives rows of the model other splats, with moments of zero. Statistics and identities stay.
    pub(in crate::train) fn replace(&self, rows: &[u32], by: &Gaussians) -> Result<(), Error> {
        if rows.is_empty() {
            return Ok(());
        }
        let splats = self.splats()? as usize;
        let change = |planes: &Planes, k: usize, new: Option<&[f32]>| -> Result<(), Error> {
            let width = PLANES[k].1 as usize;
            self.move_rows(planes, k, splats, width, |old| {
                let mut changed = old.to_vec();
                for (i, &row) in rows.iter().enumerate() {
                    let there = changed.get_mut(width * row as usize..width * (row as usize + 1));
                    let values = new.map(|new| new.get(width * i..width * (i + 1)).unwrap_or_default());
                    match (there, values) {
                        (Some(there), Some(values)) if there.len() == values.len() => there.copy_from_slice(values),
                        (Some(there), None) => there.fill(0.0),
                        _ => {}
                    }
                }
                changed
            })
        };
        for (k, new) in planes_of(by).into_iter().enumerate() {
            change(&self.model, k, Some(new))?;
            for moments in [self.optimiser.first()].into_iter().chain(self.optimiser.second()) {
                change(moments, k, None)?;
            }
        }
        Ok(())
    }

    /// Replaces the set of splats by that after a relocation, for which there is room. Moments of splats that share a
    /// place become zero, and splats in the places of others get new identities. Clears the statistics.
    pub(in crate::train) fn relocate(&mut self, to: &Relocation) -> Result<(), Error> {
        let mut words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        let before = words[counters::SPLATS] as usize;
        for (k, (_, width)) in PLANES.into_iter().enumerate() {
            let width = width as usize;
            self.move_rows(&self.model, k, before, width, |old| rows_of(old, width, &to.rows))?;
            for planes in [self.optimiser.first()].into_iter().chain(self.optimiser.second()) {
                self.move_rows(planes, k, before, width, |old| {
                    let mut moments = rows_of(old, width, &to.rows);
                    let rows = moments.chunks_exact_mut(width).zip(&to.shares);
                    rows.filter(|(_, shares)| **shares).for_each(|(row, _)| row.fill(0.0));
                    moments
                })?;
            }
        }
        self.gpu.write(&self.model.buffers()[SCALES], &to.scales)?;
        self.gpu.write(&self.model.buffers()[OPACITIES], &to.opacities)?;
        let old: Vec<u32> = self.gpu.read_at(&self.ids, 0, before)?;
        let mut ids = rows_of(&old, 1, &to.rows);
        for (_, id) in (0_u32..).zip(&mut ids).zip(&to.rows).filter(|((row, _), from)| row != *from).map(|(new, _)| new)
        {
            *id = words[counters::NEXT_ID];
            words[counters::NEXT_ID] = words[counters::NEXT_ID].saturating_add(1);
        }
        self.gpu.write(&self.ids, &ids)?;
        words[counters::SPLATS] = to.rows.len() as u32;
        let mut recorder = self.gpu.recorder("relocate")?;
        self.statistics.clear(&mut recorder)?;
        recorder.upload(&self.renderer.counters, 0, bytemuck::cast_slice(&words))?;
        self.gpu.wait(recorder.submit()?)?;
        Ok(())
    }

    /// Adds splats after the others, with moments and statistics of zero, as many as the limits allow and as fit.
    pub(in crate::train) fn append(&mut self, new: &Gaussians) -> Result<Appended, Error> {
        let room = self.room(new.len() as u32)?;
        let more = room.added;
        if more == 0 {
            return Ok(Appended { capacity: None, ..room });
        }
        let mut words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        let (splats, next_id) = (words[counters::SPLATS], words[counters::NEXT_ID]);
        let rows =
            |width: u32| 4 * u64::from(width) * u64::from(splats)..4 * u64::from(width) * u64::from(splats + more);
        let mut recorder = self.gpu.recorder("append")?;
        let moments: Vec<&Planes> = [self.optimiser.first()].into_iter().chain(self.optimiser.second()).collect();
        for (k, (values, (_, width))) in planes_of(new).into_iter().zip(PLANES).enumerate() {
            let values = values.get(..(width * more) as usize).unwrap_or_default();
            recorder.upload(&self.model.buffers()[k], rows(width).start, bytemuck::cast_slice(values))?;
            for planes in &moments {
                recorder.fill(planes.buffers()[k].slice(rows(width)), 0)?;
            }
        }
        recorder.fill(self.statistics.stats().slice(rows(4)), 0)?;
        if let Some(scores) = self.statistics.scores() {
            recorder.fill(scores.slice(rows(2)), 0)?;
        }
        let ids: Vec<u32> = (next_id..next_id.saturating_add(more)).collect();
        recorder.upload(&self.ids, rows(1).start, bytemuck::cast_slice(&ids))?;
        (words[counters::SPLATS], words[counters::NEXT_ID]) = (splats + more, next_id.saturating_add(more));
        recorder.upload(&self.renderer.counters, 0, bytemuck::cast_slice(&words))?;
        self.gpu.wait(recorder.submit()?)?;
        Ok(room)
    }
}
