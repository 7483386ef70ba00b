//! The results of a benchmark. Field names are the keys of its JSON.

use super::roofline::PerPixel;
use serde::Serialize;

use super::Quartiles;
use super::rates::Rates;
use super::roofline::Floors;
use crate::raster::Variants;
use crate::train::MemoryCost;

/// The results of a benchmark. Times are in milliseconds.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The device that ran the steps.
    pub device: DeviceName,
    /// Variants of the passes.
    pub variants: Variants,
    /// Rates at which the device moves bytes and calculates.
    pub rates: Rates,
    /// Steps before timing.
    pub warm_up: u32,
    /// Steps timed as a whole. As many more were timed pass by pass.
    pub steps: u32,
    /// Work of a step.
    pub workload: Workload,
    /// Loss, which shows that the steps trained.
    pub loss: Loss,
    /// A step on the device: the sum of its passes.
    pub device_ms: Quartiles,
    /// From the end of one step to the end of the next on the host's clock, with steps in flight as in training and
    /// without timestamps.
    pub wall_ms: Quartiles,
    /// Work of the host per step.
    pub per_step: PerStep,
    /// Every pass, the longest first.
    pub passes: Vec<PassRow>,
    /// Stages of a step, the longest first.
    pub stages: Vec<StageRow>,
    /// Peak device memory, without the passes that count splats per pixel.
    pub peak_device_bytes: u64,
    /// Memory of the buffers per splat, pair and pixel.
    pub memory: MemoryCost,
    /// Peak device memory during a density change, with the growth of buffers where the change needs it.
    pub density_peak_bytes: u64,
}

/// The device.
#[derive(Clone, Debug, Serialize)]
pub struct DeviceName {
    /// Name.
    pub name: String,
    /// Discrete, integrated, CPU ...
    pub kind: String,
    /// Driver and its version.
    pub driver: String,
    /// Version of Vulkan.
    pub api: String,
}

/// Work of a step, as means over the timed steps where it varies.
#[derive(Clone, Debug, Serialize)]
pub struct Workload {
    /// Views that took turns.
    pub views: usize,
    /// Width and height of the first view in pixels.
    pub size: [u32; 2],
    /// Pixels of a view.
    pub pixels: f64,
    /// Tiles of a view.
    pub tiles: f64,
    /// Degree of the spherical harmonics in use.
    pub sh_degree: u32,
    /// Splats of the model.
    pub splats: u32,
    /// Splats on screen.
    pub visible: f64,
    /// (splat, tile) pairs.
    pub pairs: f64,
    /// Splats per pixel, over all views after the timed steps; none where the counts might not fit 32 bits.
    pub splats_per_pixel: Option<PerPixel>,
}

/// Mean losses over the same views.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Loss {
    /// Mean loss of the first pass over the views.
    pub first_pass: f64,
    /// Mean loss of the last pass over the views.
    pub last_pass: f64,
}

/// Commands and waits of the host per step without timestamps.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PerStep {
    /// Dispatches.
    pub dispatches: f64,
    /// Fills and copies.
    pub transfers: f64,
    /// Pipeline barriers.
    pub barriers: f64,
    /// Buffer ranges in the barriers.
    pub buffer_barriers: f64,
    /// Queue submissions.
    pub submits: f64,
    /// Waits that left the device without work.
    pub host_waits: f64,
    /// Waits for an earlier step that bound the length of the queue.
    pub pacing_waits: f64,
}

/// All dispatches of one pass in a step.
#[derive(Clone, Debug, Serialize)]
pub struct PassRow {
    /// Name of the kernel, or `clear`, `copy`.
    pub pass: String,
    /// Stage of the step.
    pub stage: &'static str,
    /// Dispatches (or transfers) in a step.
    pub calls: f64,
    /// Time of all dispatches.
    pub ms: Quartiles,
    /// Share of the device time of all steps.
    pub share: f64,
    /// Bytes moved by design; none for passes that move a fixed few bytes.
    pub bytes: Option<f64>,
    /// Bytes over the median time, 10^9 bytes per second.
    pub gb_per_s: Option<f64>,
    /// Least times of the pass.
    pub floors: Floors,
    /// The median time over the larger floor.
    pub over_floor: Option<f64>,
}

/// All passes of one stage in a step.
#[derive(Clone, Debug, Serialize)]
pub struct StageRow {
    /// Name of the stage.
    pub stage: &'static str,
    /// Time of all its passes.
    pub ms: Quartiles,
    /// Share of the device time of all steps.
    pub share: f64,
}
