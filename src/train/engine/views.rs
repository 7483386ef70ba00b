//! The views of a training: cameras, photographs and masks.

use std::time::Instant;

use crate::dataset::Depth;
use crate::loss::Photograph;
use crate::raster::MemoryFootprint;
use crate::saliency::Cache;
use crate::scene::Camera;
use crate::train::Error;
use crate::train::input::View;
use crate::train::pacing::Pacing;
use crate::train::photographs::{Coarse, Photographs, Saliencies, Visit};
use crate::train::schedule::StepPlan;
use crate::train::settings::Settings;
use crate::vk::{Gpu, Recorder};

/// The training views, in their order.
pub(super) struct Views {
    pub(super) cameras: Vec<Camera>,
    pub(super) photographs: Photographs,
    coarse: Option<Coarse>,
    pub(super) saliencies: Option<Saliencies>,
    /// Seconds that making the masks took.
    pub(super) saliency_seconds: f64,
}

impl Views {
    /// Buffers for masks and reduced photographs, if the settings need them; contents undefined.
    pub(super) fn allocate(
        gpu: &Gpu,
        views: &[(Camera, Depth)],
        photographs: Photographs,
        settings: &Settings,
    ) -> Result<Self, Error> {
        let cameras: Vec<Camera> = views.iter().map(|(camera, _)| *camera).collect();
        let deep = has_deep(views);
        let coarse = settings.frequencies.coarse_steps > 0.0;
        let coarse = coarse.then(|| Coarse::new(gpu, most_pixels(&cameras), deep)).transpose()?;
        let saliencies = settings.needs_masks().then(|| Saliencies::new(gpu, &cameras)).transpose()?;
        Ok(Self { cameras, photographs, coarse, saliencies, saliency_seconds: 0.0 })
    }

    /// Makes the saliency masks if they are needed, and returns the cache from which learning their width begins.
    pub(super) fn fill_masks(
        &mut self,
        gpu: &Gpu,
        views: &[View],
        settings: &Settings,
        pacing: Pacing,
    ) -> Result<Option<Cache>, Error> {
        let Some(saliencies) = &mut self.saliencies else { return Ok(None) };
        let started = Instant::now();
        let cache = saliencies.fill(gpu, views, &settings.frequencies, settings.run.seed, pacing.decoders())?;
        self.saliency_seconds = started.elapsed().as_secs_f64();
        Ok(Some(cache))
    }

    /// Records bringing a photograph or a band of it to the device, reduced where the plan says so. Returns the
    /// photograph, and the camera of the whole photograph at that size.
    pub(super) fn record<'a>(
        &'a self,
        gpu: &Gpu,
        recorder: &mut Recorder,
        visit: &Visit,
        plan: &StepPlan,
    ) -> Result<(Photograph<'a>, Camera), Error> {
        let whole = self.cameras.get(visit.view).ok_or(Error::NoViews)?;
        let mut photograph = self.photographs.record(gpu, recorder, visit)?;
        photograph.mask = self.saliencies.as_ref().and_then(|saliencies| saliencies.mask(visit.view));
        let Some(coarse) = self.coarse.as_ref().filter(|_| plan.factor > 1) else { return Ok((photograph, *whole)) };
        Ok((coarse.record(recorder, whole, &photograph, plan.factor)?, Coarse::camera(whole, plan.factor)))
    }

    /// A position where the view's mask is high, as shares of width and height; `seen` is how often the view has been
    /// looked at.
    pub(super) fn center(&self, view: usize, seen: u32) -> [f32; 2] {
        self.saliencies.as_ref().map_or([0.5; 2], |saliencies| saliencies.place(view, seen))
    }

    /// Bytes of the buffers, without photographs.
    pub(super) fn footprint(&self) -> MemoryFootprint {
        let [of_pixels, fixed] = self.saliencies.as_ref().map_or([0; 2], Saliencies::bytes);
        let of_coarse = self.coarse.as_ref().map_or(0, Coarse::bytes);
        MemoryFootprint { pixels: of_pixels + of_coarse, fixed, ..MemoryFootprint::default() }
    }
}

/// Pixels of the largest photograph.
pub(super) fn most_pixels(cameras: &[Camera]) -> u32 {
    cameras.iter().map(|c| c.width * c.height).max().unwrap_or(1)
}

/// Mean number of pixels of a photograph.
pub(super) fn mean_pixels(cameras: &[Camera]) -> f64 {
    let all: f64 = cameras.iter().map(|c| f64::from(c.width) * f64::from(c.height)).sum();
    (all / cameras.len().max(1) as f64).max(1.0)
}

/// Whether some photographs have 16 bits per channel.
pub(super) fn has_deep(views: &[(Camera, Depth)]) -> bool {
    views.iter().any(|(_, depth)| *depth == Depth::Sixteen)
}
