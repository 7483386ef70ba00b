//! What a benchmark tells; the field names are the keys of its JSON.

use super::roofline::PerPixel;
use serde::Serialize;

use super::Quartiles;
use super::rates::Rates;
use super::roofline::Floors;
use crate::raster::Variants;
use crate::train::MemoryCost;

/// A benchmark. Times in milliseconds.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Where it ran.
    pub device: DeviceName,
    /// Forms of the passes.
    pub variants: Variants,
    /// How fast the device moves bytes and calculates.
    pub rates: Rates,
    /// Steps before timing began.
    pub warm_up: u32,
    /// Steps timed as a whole, and as many pass by pass.
    pub steps: u32,
    /// What a step worked on.
    pub workload: Workload,
    /// That it was live.
    pub loss: Loss,
    /// A step on the device: sum of its passes.
    pub device_ms: Quartiles,
    /// From the end of one step to the end of the next as the host sees it, steps in flight as in training,
    /// no timestamps.
    pub wall_ms: Quartiles,
    /// What the host did per step.
    pub per_step: PerStep,
    /// Every pass, by time.
    pub passes: Vec<PassRow>,
    /// Passes by what they are for, by time.
    pub stages: Vec<StageRow>,
    /// Most device memory in use at a time, without the counting of pixel-splats.
    pub peak_device_bytes: u64,
    /// What the buffers cost by splats, pairs and pixels.
    pub memory: MemoryCost,
    /// Most device memory in use during a density change, and growth where the change needs some.
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

/// What a step worked on; means over the timed steps where it varies.
#[derive(Clone, Debug, Serialize)]
pub struct Workload {
    /// Views that were looked at in turn.
    pub views: usize,
    /// Width and height of the first of them.
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
    /// When each was looked at for the first time.
    pub first_pass: f64,
    /// For the last time.
    pub last_pass: f64,
}

/// What the host handed over and waited for, per step without timestamps.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PerStep {
    /// Dispatches.
    pub dispatches: f64,
    /// Fills and copies.
    pub transfers: f64,
    /// Pipeline barriers.
    pub barriers: f64,
    /// Buffer ranges in them.
    pub buffer_barriers: f64,
    /// Queue submits.
    pub submits: f64,
    /// Waits that left the device without work.
    pub host_waits: f64,
    /// Waits for an earlier step, to bound the queue.
    pub pacing_waits: f64,
}

/// All dispatches of one pass in a step.
#[derive(Clone, Debug, Serialize)]
pub struct PassRow {
    /// Name of the kernel, or `clear`, `copy`.
    pub pass: String,
    /// What it is for.
    pub stage: &'static str,
    /// Dispatches (or transfers) in a step.
    pub calls: f64,
    /// Their time together.
    pub ms: Quartiles,
    /// Of the device time of all steps.
    pub share: f64,
    /// Bytes moved by design; none for passes of a fixed few bytes.
    pub bytes: Option<f64>,
    /// These over the median time, 10^9 bytes per second.
    pub gb_per_s: Option<f64>,
    /// What the pass takes at least.
    pub floors: Floors,
    /// The median time over the larger floor.
    pub over_floor: Option<f64>,
}

/// All passes of one purpose in a step.
#[derive(Clone, Debug, Serialize)]
pub struct StageRow {
    /// What they are for.
    pub stage: &'static str,
    /// Their time together.
    pub ms: Quartiles,
    /// Of the device time of all steps.
    pub share: f64,
}
