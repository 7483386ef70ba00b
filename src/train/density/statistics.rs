//! Statistics of every splat for density control, accumulated step by step.

use crate::dataset::Depth;
use crate::loss::Photograph;
use crate::pass::camera::CameraPush;
use crate::pass::{densify_scores, densify_stats, densify_views};
use crate::raster::{MEANS, Planes, QUATS, RenderView, Renderer, SCALES, grown};
use crate::scene::Camera;
use crate::train::Error;
use crate::train::settings::{Growth, Settings};
use crate::vk::{self, Buffer, Gpu, Memory, Pipeline, Recorder, slices};

/// Gradient norms of every splat, and its scores if growth is sampled.
pub(in crate::train) struct Statistics {
    stats: Buffer,
    accumulate: Pipeline,
    /// For growth by the rule of 3DGS, which takes means over more views than those that show a splat.
    views: Option<Pipeline>,
    scores: Option<Scores>,
}

struct Scores {
    rows: Buffer,
    eight: Pipeline,
    sixteen: Option<Pipeline>,
    error: f32,
}

/// What the statistics of a step are computed from.
#[derive(Clone, Copy)]
pub(in crate::train) struct StatisticsInput<'a> {
    pub(in crate::train) model: &'a Planes,
    pub(in crate::train) shot: &'a RenderView,
    /// Height of the photograph, of which `shot` may be a band.
    pub(in crate::train) of_height: u32,
    pub(in crate::train) image: &'a Buffer,
    pub(in crate::train) photograph: &'a Photograph<'a>,
    /// Saliency, a value per pixel, if there are masks.
    pub(in crate::train) saliency: Option<&'a Buffer>,
}

impl Statistics {
    /// For `splats` splats, contents undefined; `deep` if some photographs have 16 bits per channel.
    pub(in crate::train) fn new(gpu: &Gpu, splats: u32, deep: bool, settings: &Settings) -> Result<Self, vk::Error> {
        let n = u64::from(splats);
        let pipeline = |depth: Depth| gpu.pipeline(&densify_scores::PASS.kernel, &[("PHOTOGRAPH_BITS", depth.bits())]);
        let scores = || -> Result<Scores, vk::Error> {
            Ok(Scores {
                rows: gpu.buffer("scores", 8 * n, Memory::Device)?,
                eight: pipeline(Depth::Eight)?,
                sixteen: deep.then(|| pipeline(Depth::Sixteen)).transpose()?,
                error: settings.density.sample_error as f32,
            })
        };
        let sampled = settings.density.growth == Growth::Sampled;
        Ok(Self {
            stats: gpu.buffer("stats", 16 * n, Memory::Device)?,
            accumulate: gpu.pipeline(&densify_stats::PASS.kernel, &[])?,
            views: (!sampled).then(|| gpu.pipeline(&densify_views::PASS.kernel, &[])).transpose()?,
            scores: sampled.then(scores).transpose()?,
        })
    }

    /// A vec4 per splat; see [`densify_stats`].
    pub(in crate::train) fn stats(&self) -> &Buffer {
        &self.stats
    }

    /// A vec2 per splat, if growth is sampled; see [`densify_scores`].
    pub(in crate::train) fn scores(&self) -> Option<&Buffer> {
        self.scores.as_ref().map(|scores| &scores.rows)
    }

    /// Records setting statistics and scores to zero.
    pub(in crate::train) fn clear(&self, recorder: &mut Recorder) -> Result<(), vk::Error> {
        recorder.fill(&self.stats, 0)?;
        self.scores().map_or(Ok(()), |rows| recorder.fill(rows, 0))
    }

    /// Records adding the statistics of a step, after its blend backward.
    pub(in crate::train) fn record(
        &self,
        recorder: &mut Recorder,
        renderer: &Renderer,
        step: StatisticsInput<'_>,
    ) -> Result<(), vk::Error> {
        let Some(grad2d) = renderer.grad2d() else { return Ok(()) };
        let Camera { width, height, .. } = step.shot.camera;
        let push = densify_stats::Push { half_width: 0.5 * width as f32, half_height: 0.5 * step.of_height as f32 };
        let [counts, tile_counts, splat2d, stats] =
            slices([&renderer.counters, &renderer.tile_counts, &renderer.splat2d, &self.stats]);
        let buffers = [counts, tile_counts, grad2d, stats];
        recorder.dispatch(&self.accumulate, &buffers, &push, renderer.per_splat())?;
        if let Some(views) = &self.views {
            let planes = step.model.buffers();
            let [means, quats, scales] = slices([&planes[MEANS], &planes[QUATS], &planes[SCALES]]);
            let push = CameraPush::new(&step.shot.camera, &step.shot.projection);
            recorder.dispatch(
                views,
                &[counts, tile_counts, means, quats, scales, stats],
                &push,
                renderer.per_splat(),
            )?;
        }
        let Some(scores) = &self.scores else { return Ok(()) };
        let pipeline = scores.sixteen.as_ref().filter(|_| step.photograph.bits == 16).unwrap_or(&scores.eight);
        let masked = u32::from(step.saliency.is_some());
        let push = densify_scores::Push { width, height, masked, error: scores.error };
        let [image, photograph, saliency, rows] =
            slices([step.image, step.photograph.buffer, step.saliency.unwrap_or(step.image), &scores.rows]);
        let buffers = [counts, tile_counts, splat2d, grad2d, image, photograph, saliency, rows];
        recorder.dispatch(pipeline, &buffers, &push, renderer.per_splat())
    }

    /// Makes room for `splats` splats; contents stay. Waits.
    pub(in crate::train) fn grow(&mut self, gpu: &Gpu, splats: u32) -> Result<(), vk::Error> {
        self.stats = grown(gpu, &self.stats, 16 * u64::from(splats))?;
        if let Some(scores) = &mut self.scores {
            scores.rows = grown(gpu, &scores.rows, 8 * u64::from(splats))?;
        }
        Ok(())
    }

    /// Statistics and scores of the first `splats` splats; no scores if growth is not sampled. Waits.
    pub(in crate::train) fn read(&self, gpu: &Gpu, splats: u32) -> Result<[Vec<f32>; 2], vk::Error> {
        let rows = |buffer: Option<&Buffer>, width: usize| match buffer {
            Some(buffer) if splats > 0 => gpu.read_at(buffer, 0, width * splats as usize),
            _ => Ok(Vec::new()),
        };
        Ok([rows(Some(&self.stats), 4)?, rows(self.scores(), 2)?])
    }

    /// Writes statistics and scores of an earlier run.
    pub(in crate::train) fn restore(&self, gpu: &Gpu, stats: &[f32], scores: &[f32]) -> Result<(), Error> {
        let expected = if self.scores.is_some() { stats.len() / 2 } else { 0 };
        if scores.len() != expected {
            return Err(Error::Checkpoint { section: "scores".to_owned(), found: scores.len(), expected });
        }
        if !stats.is_empty() {
            gpu.write(&self.stats, stats)?;
        }
        match self.scores() {
            Some(rows) if !scores.is_empty() => Ok(gpu.write(rows, scores)?),
            _ => Ok(()),
        }
    }

    /// Bytes of the buffers.
    pub(in crate::train) fn bytes(&self) -> u64 {
        self.stats.size() + self.scores().map_or(0, Buffer::size)
    }
}
