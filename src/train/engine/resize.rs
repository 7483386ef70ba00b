//! Grows buffers that were too small for an event.

use super::{Engine, GrownCapacities, density_control};
use crate::pass::counters;
use crate::raster::{Renderer, Size, Variants, grown, most_pairs, most_splats};
use crate::train::Error;

impl Engine {
    /// Waits for everything submitted, grows the buffers that were too small, and clears the status. Returns the number
    /// of the last event done, and the new capacities. If more splats do not fit, their buffers do not grow and
    /// [`Self::most_splats`] is set. After an error the training can still be saved: call [`Self::clear_overflow`]
    /// first.
    pub fn grow(&mut self) -> Result<(u32, GrownCapacities), Error> {
        let mut words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        let status = words[counters::STATUS];
        let mut grown = Vec::new();
        let mut size = self.size;
        let mut variants = self.renderer.variants();
        if status & counters::PAIRS_BIT != 0 {
            let wanted = words[counters::WANT_PAIRS];
            if wanted > most_pairs(&self.gpu, variants) && !self.settings.run.deterministic {
                let without = variants.without_slots(&self.gpu);
                if without.runs_on(&self.gpu) {
                    variants = without;
                }
            }
            let limit = most_pairs(&self.gpu, variants);
            let planned = larger(wanted, size.pairs, limit, "(splat, tile) pairs", "`max-side`")?;
            size.pairs = self.needs.pairs(variants, size.splats, wanted, planned)?;
            grown.push(("pairs", u64::from(size.pairs)));
        }
        if status & counters::SPLATS_BIT != 0 {
            let limit = most_splats(&self.gpu);
            let wanted = words[counters::WANT_SPLATS];
            let planned = larger(wanted, size.splats, limit, "splats", "`max-splats`")?;
            let planned = planned.min(self.limit().unwrap_or(u32::MAX));
            match self.needs.splats(variants, size.pairs, wanted, planned) {
                Some(splats) => {
                    size.splats = splats;
                    grown.push(("splats", u64::from(splats)));
                }
                // Pairs take more memory than was set aside for them.
                None => self.most_splats = Some(size.splats),
            }
        }
        words[counters::STATUS] = 0;
        self.resize(variants, size, &words)?;
        Ok((words[counters::DONE], grown))
    }

    /// Makes room for `wanted` splats, or as many as fit, and writes the counters `words`. Returns the capacity. Waits.
    pub(super) fn room_for(&mut self, wanted: u32, words: &[u32]) -> Result<u32, Error> {
        if wanted > self.size.splats {
            let planned = larger(wanted, self.size.splats, most_splats(&self.gpu), "splats", "`max-splats`")?;
            let planned = planned.min(self.limit().unwrap_or(u32::MAX));
            let variants = self.renderer.variants();
            match self.needs.splats(variants, self.size.pairs, wanted, planned) {
                Some(splats) => self.resize(variants, Size { splats, ..self.size }, words)?,
                None => self.most_splats = Some(self.size.splats),
            }
        }
        Ok(self.size.splats)
    }

    fn resize(&mut self, variants: Variants, size: Size, words: &[u32]) -> Result<(), Error> {
        let splats = size.splats;
        if splats > self.size.splats {
            // Buffers whose contents outlive no step are freed before larger planes are allocated.
            self.density = density_control(&self.gpu, 1, &self.needs)?;
            self.terms.resize(&self.gpu, 1)?;
            self.rebuild(variants, Size { splats: 1, pairs: 1, tiles: 1, ..size }, words)?;
            self.grow_planes(splats)?;
            self.density = density_control(&self.gpu, splats, &self.needs)?;
            self.terms.resize(&self.gpu, splats)?;
        }
        self.rebuild(variants, size, words)
    }

    /// Clears the status after a failed [`Self::grow`], so that the state can be saved. Returns the number of the last
    /// event done.
    pub fn clear_overflow(&mut self) -> Result<u32, Error> {
        let mut words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        words[counters::STATUS] = 0;
        self.gpu.write(&self.renderer.counters, &words)?;
        Ok(words[counters::DONE])
    }

    fn rebuild(&mut self, variants: Variants, size: Size, counters: &[u32]) -> Result<(), Error> {
        // The old buffers are freed before the new ones are allocated, because their contents outlive no step. The
        // counters do, and are kept. If the planes stay, their counters stay in the same buffer, for a host that
        // renders the model.
        let kept = (size.splats == self.size.splats).then(|| self.renderer.counters.clone());
        self.renderer = Renderer::new(&self.gpu, variants, Size { splats: 1, pairs: 1, tiles: 1, ..size })?;
        self.gpu.write(&self.renderer.counters, counters)?;
        let mut renderer = Renderer::new(&self.gpu, variants, size)?;
        if let Some(kept) = kept {
            renderer.counters = kept;
        }
        self.gpu.write(&renderer.counters, counters)?;
        self.renderer = renderer;
        self.size = size;
        Ok(())
    }

    /// Makes later steps count evaluated and blended pixel-splats into [`Renderer::pair_counts`], which is slower.
    /// Waits.
    pub fn count_pixel_splats(&mut self) -> Result<(), Error> {
        let words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        self.rebuild(self.variants(), Size { count: true, ..self.size }, &words)
    }

    /// Grows plane by plane, so that only one plane is held twice at a time.
    fn grow_planes(&mut self, splats: u32) -> Result<(), Error> {
        self.ids = grown(&self.gpu, &self.ids, 4 * u64::from(splats))?;
        self.statistics.grow(&self.gpu, splats)?;
        self.model.grow(&self.gpu, splats)?;
        self.optimiser.grow(&self.gpu, splats)?;
        Ok(())
    }
}

/// A capacity for `wanted` elements with a quarter to spare, at most `most`.
fn larger(wanted: u32, now: u32, most: u32, what: &'static str, remedy: &'static str) -> Result<u32, Error> {
    if wanted > most {
        return Err(Error::TooMany { what, wanted: u64::from(wanted), limit: u64::from(most), remedy });
    }
    let next = (u64::from(wanted) + u64::from(wanted) / 4).max(u64::from(now) + 64);
    Ok(next.min(u64::from(most)) as u32)
}
