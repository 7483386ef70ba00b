//! Memory of a training on the device and on the host, as planned before the training starts.

mod host;

pub use host::{HostMemory, HostPlan, shares_memory};

use std::fmt;

use super::Error;
use super::engine::{Needs, PAIRS_PER_SPLAT};
use super::input::{Input, Outline};
use super::pacing::{Pacing, Residency};
use super::settings::{Exposure, Settings};
use crate::byte_size::readable;
use crate::numbers::counted;
use crate::raster::{Variants, most_splats};
use crate::vk::{self, Gpu};

/// Device memory of a training, as planned before the training starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MemoryPlan {
    /// Bytes that may be used by this training and everything else on the device.
    pub limit: u64,
    /// Number of photographs to train on, and bytes of their buffers.
    pub photographs: (usize, u64),
    /// Whether all photographs are on the device, or only those of the next steps.
    pub residency: Residency,
    /// Bytes per splat of the capacity.
    pub per_splat: f64,
    /// Bytes per (splat, tile) pair of the capacity.
    pub per_pair: f64,
    /// Bytes per pixel of the largest photograph, without the photographs themselves.
    pub per_pixel: f64,
    /// Splats and pairs that there is room for at the start.
    pub capacities: (u32, u32),
    /// Bytes with `capacities`, renders and checkpoints during the training included.
    pub at_start: u64,
    /// Most splats, with 8 pairs each, and whether memory limits them (true) or the size of a buffer (false).
    pub most_splats: (u32, bool),
}

impl MemoryPlan {
    /// The plan of a training that begins with `splats` splats.
    pub fn new(
        gpu: &Gpu,
        input: &Input,
        settings: &Settings,
        variants: Variants,
        pacing: Pacing,
        splats: u32,
    ) -> Result<Self, Error> {
        Self::of(gpu, &input.outline(), settings, variants, pacing, splats)
    }

    /// As [`Self::new`], before any photograph is decoded.
    pub fn of(
        gpu: &Gpu,
        outline: &Outline,
        settings: &Settings,
        variants: Variants,
        pacing: Pacing,
        splats: u32,
    ) -> Result<Self, Error> {
        let mut settings = settings.clone();
        if settings.optimiser.exposure == Exposure::Auto {
            // What takes more of what it may become.
            settings.optimiser.exposure = Exposure::Affine;
        }
        let needs = Needs::new(gpu, outline, &settings, pacing)?;
        let capacities = needs.at_start(variants, splats, pacing)?;
        let photographs = (needs.views.len(), needs.of_photographs(needs.residency)?);
        // Numbers that differ much, because tables of the sorts grow in steps.
        let (n, more) = (1 << 19, 1 << 20);
        let bytes = |splats, pairs| needs.training(variants, splats, pairs).map(|b| b as f64);
        let base = bytes(n, n)?;
        let per = |with: f64| (with - base) / f64::from(more - n);
        let fewest = needs.of_small_views();
        let pixels = needs.views.iter().map(|(c, _)| f64::from(c.width) * f64::from(c.height)).fold(1.0, f64::max);
        let of_pixels = base - fewest.training(variants, n, n)? as f64;
        let most = needs.most_splats(variants);
        Ok(Self {
            limit: gpu.memory_use().limit,
            photographs,
            residency: needs.residency,
            per_splat: per(bytes(more, n)?),
            per_pair: per(bytes(n, more)?),
            per_pixel: of_pixels / pixels,
            capacities,
            at_start: needs.bytes(variants, capacities.0, capacities.1)?,
            most_splats: (most.unwrap_or(most_splats(gpu)), most.is_some()),
        })
    }
}

/// Whether an error says that there is not enough memory.
pub(super) fn is_lack_of_memory(error: &Error) -> bool {
    matches!(
        error,
        Error::MemoryLimit { .. }
            | Error::TooMany { .. }
            | Error::Device(vk::Error::OutOfDeviceMemory { .. } | vk::Error::BufferTooLarge { .. })
    )
}

impl fmt::Display for MemoryPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (splats, pairs) = self.capacities;
        let (most, by_memory) = self.most_splats;
        let most = counted(most, "splat");
        write!(
            f,
            "device memory: {} for {}{}, {:.0} B per splat, {:.0} B per (splat, tile) pair, {:.0} B per pixel; \
             {} at the start, with room for {} and {}; of the {} that may be used, {}",
            readable(self.photographs.1),
            counted(self.photographs.0, "photograph"),
            if self.residency == Residency::Streamed { ", uploaded in their steps" } else { "" },
            self.per_splat,
            self.per_pair,
            self.per_pixel,
            readable(self.at_start),
            counted(splats, "splat"),
            counted(pairs, "pair"),
            readable(self.limit),
            if by_memory {
                format!("{most} fit with {PAIRS_PER_SPLAT} pairs each: growth stops there")
            } else {
                format!("more than {most} would fit, which is the most that a buffer holds")
            }
        )
    }
}
