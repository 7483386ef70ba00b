//! Host memory: how much a training may take, and how the photographs share the rest.

use std::fmt;

use super::{Error, MemoryPlan};
use crate::byte_size::readable;
use crate::dataset::{Dataset, HostShare, cores};
use crate::eval::REPORT_BYTES;
use crate::host_memory::{FREE_UNKNOWN, free, resident};
use crate::stereo::MemoryEstimate;
use crate::train::input::Outline;
use crate::train::learning::sigma::bytes_of_landings;
use crate::train::pacing::{Pacing, Residency};
use crate::train::photographs::LANDINGS;
use crate::train::settings::{DepthPrior, Settings};
use crate::vk::{DeviceKind, Gpu};

/// Set aside for what is not counted: compiled passes, the driver, renders of the report.
const SLACK: u64 = 128 << 20;
/// Photographs that are being decoded, and those decoded ahead, each take at most 1 / this of what is left.
const PART: u64 = 4;
/// Bytes of a splat in a checkpoint.
const READ_BACK_PER_SPLAT: u64 = 736;
/// Bytes of a render with depth and normals, per byte of its photograph.
const READ_BACK_PER_BYTE: u64 = 12;
/// Most bytes of a held-out view in a report, per byte of its photograph.
const REPORT_PER_BYTE: u64 = 4;
/// Fewest and most photographs decoded ahead.
const AHEAD: (u64, u64) = (2, 8);
/// Most threads that decode at one time.
const MOST_THREADS: u64 = 16;

/// What the process may take of the host's memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostMemory {
    /// Bytes that the process plans to take at most.
    pub budget: u64,
    /// Bytes that the process takes now.
    pub in_use: u64,
    /// Bytes beyond which no work begins: the bytes asked for, or all that the machine has free for the process.
    pub most: u64,
}

impl HostMemory {
    /// With a budget of `asked` bytes, else with the bytes in use and half of the free ones.
    pub fn new(asked: Option<u64>) -> Self {
        let (in_use, free) = (resident().unwrap_or(0), free().unwrap_or(FREE_UNKNOWN));
        let machine = in_use.saturating_add(free);
        Self { budget: asked.unwrap_or(in_use + free / 2), in_use, most: asked.unwrap_or(machine).min(machine) }
    }

    /// The same with `bytes` more in use.
    pub fn after(self, bytes: u64) -> Self {
        Self { in_use: self.in_use.saturating_add(bytes), ..self }
    }

    /// Bytes that decoding takes beyond the budget.
    pub fn short_by(self, share: &HostShare) -> u64 {
        self.in_use.saturating_add(SLACK).saturating_add(share.decoding).saturating_sub(self.budget)
    }

    /// Refuses work that takes `needed` bytes, those in use included, if these are more than the process may take.
    fn allows(self, needed: u64) -> Result<(), Error> {
        if needed <= self.most {
            return Ok(());
        }
        Err(Error::HostMemoryLimit { needed, most: self.most, in_use: self.in_use, asked: self.most == self.budget })
    }

    /// Refuses decoding that takes more than the process may take.
    pub fn check(self, share: &HostShare) -> Result<(), Error> {
        self.allows(self.in_use.saturating_add(SLACK).saturating_add(share.decoding))
    }

    /// What photographs may take if nothing is trained.
    pub fn share(self, largest_decoding: u64) -> HostShare {
        let left = self.budget.saturating_sub(self.in_use).saturating_sub(SLACK);
        let (decoding, threads) = decoders(left, largest_decoding);
        HostShare { keep: left.saturating_sub(decoding), decoding, threads }
    }
}

/// Bytes for decoding at one time, and the number of threads that decode.
fn decoders(left: u64, each: u64) -> (u64, usize) {
    let threads = (left / PART / each.max(1)).clamp(1, MOST_THREADS.min(cores() as u64));
    (threads * each, threads as usize)
}

/// Whether the device uses the host's memory as its own.
pub fn shares_memory(gpu: &Gpu) -> bool {
    matches!(gpu.caps().kind, DeviceKind::Cpu | DeviceKind::Integrated)
}

/// How a training shares the host's memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HostPlan {
    /// What the process may take.
    pub memory: HostMemory,
    /// Bytes of the training that are not photographs kept on the host: model and renders read back, the report,
    /// staging of photographs, and the device's buffers if the device uses the host's memory. For the number of splats
    /// at the start.
    pub training: u64,
    /// Bytes of all decoded photographs.
    pub decoded: u64,
    /// Bytes in which photographs are kept and decoded.
    pub share: HostShare,
    /// Bytes of photographs decoded ahead.
    pub ahead: u64,
    /// Where photographs are, and how many are decoded ahead.
    pub pacing: Pacing,
    /// Fewest bytes with which the training can go on, those in use included.
    pub needed: u64,
    /// Bytes of `needed` beyond the budget.
    pub short_by: u64,
}

impl HostPlan {
    /// Refuses a training that does not fit what the process may have at most.
    pub fn check(&self) -> Result<(), Error> {
        self.memory.allows(self.needed)
    }

    /// For the training whose device memory is `plan`.
    pub fn new(
        gpu: &Gpu,
        memory: HostMemory,
        dataset: &Dataset,
        outline: &Outline,
        plan: &MemoryPlan,
        settings: &Settings,
    ) -> Self {
        let decoding = dataset.views.iter().map(|view| view.decoding_bytes()).max().unwrap_or(0);
        let sizes = outline.train.iter().map(|(camera, _)| (camera.width, camera.height));
        let room = MemoryEstimate::of(&settings.geometry.stereo(), sizes);
        let stereo = match settings.geometry.depth_prior {
            DepthPrior::None if !settings.needs_stereo() => MemoryEstimate::default(),
            // Propagation matches during the training: what stereo takes on the host stays.
            DepthPrior::Propagation => MemoryEstimate { results: room.host, ..room },
            _ => room,
        };
        let at_once = u64::from(settings.texture.views_at_once());
        let how = settings.frequencies.sigma_learning;
        let renders = bytes_of_landings(outline.most_pixels(), how, Pacing::default().events_in_flight());
        Self::of(memory, outline, plan, (decoding, stereo, renders), (shares_memory(gpu), at_once))
    }

    fn of(
        memory: HostMemory,
        outline: &Outline,
        plan: &MemoryPlan,
        (each_decoding, stereo, renders): (u64, MemoryEstimate, u64),
        (shared, at_once): (bool, u64),
    ) -> Self {
        let mut pacing = Pacing::default();
        let largest = outline.largest();
        let decoded = Outline::bytes(&outline.train) + Outline::bytes(&outline.held_out);
        // Renders that sigma is learned from are in the host's memory on every device, and in the plan of a shared one.
        let on_device = if shared { plan.at_start.saturating_sub(plan.photographs.1) } else { renders };
        let report = REPORT_BYTES.min(REPORT_PER_BYTE * Outline::bytes(&outline.held_out));
        let read_back = READ_BACK_PER_SPLAT * u64::from(plan.capacities.0) + READ_BACK_PER_BYTE * largest;
        // Depths are found before the training allocates; the results stay until the training has taken them over.
        let before = stereo.host + if shared { stereo.device } else { 0 };
        let model = (on_device + read_back + report + stereo.results).max(before);
        let left = memory.budget.saturating_sub(memory.in_use).saturating_sub(SLACK).saturating_sub(model);
        let (decoding, threads) = decoders(left, each_decoding);
        let ring = largest * (pacing.events_in_flight() as u64 + at_once + if shared { LANDINGS as u64 } else { 0 });
        // While photographs are uploaded, the host holds a second copy of each that it keeps decoded.
        let resident = if shared { plan.photographs.1 } else { 0 };
        let fits = decoded.saturating_add(resident).saturating_add(decoding) <= left;
        pacing.photographs = match plan.residency {
            Residency::Resident if shared && !fits => Residency::Streamed,
            residency => residency,
        };
        let uploads = if pacing.photographs == Residency::Streamed { ring } else { resident };
        let ahead = (left / PART / largest.max(1)).clamp(AHEAD.0, AHEAD.1);
        (pacing.decoded_ahead, pacing.decoders) = (ahead as usize, threads.min(ahead as usize));
        // Training photographs and held-out photographs are each decoded ahead.
        let ahead = 2 * ahead * largest;
        let least = uploads + decoding;
        let room = left.saturating_sub(least);
        // If all photographs are kept decoded, none is decoded ahead.
        let keep = if decoded <= room { room } else { room.saturating_sub(ahead) };
        let fitting = decoded <= room;
        let least = if fitting { least } else { least + ahead };
        let needed = memory.in_use.saturating_add(SLACK).saturating_add(model).saturating_add(least);
        Self {
            memory,
            training: model + uploads,
            decoded,
            share: HostShare { keep, decoding, threads },
            ahead: if fitting { 0 } else { ahead },
            pacing,
            needed,
            short_by: needed.saturating_sub(memory.budget),
        }
    }
}

impl fmt::Display for HostPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "host memory: of the {} that may be used {} are in use and {} set aside for the training; \
             photographs take {} decoded",
            readable(self.memory.budget),
            readable(self.memory.in_use),
            readable(self.training),
            readable(self.decoded)
        )?;
        if self.ahead == 0 {
            return f.write_str(", which fits");
        }
        write!(
            f,
            ": up to {} are kept compressed, the others are read again; {} photographs decoded ahead on {} thread{}",
            readable(self.share.keep),
            self.pacing.decoded_ahead,
            self.pacing.decoders,
            if self.pacing.decoders == 1 { "" } else { "s" }
        )?;
        if self.short_by > 0 {
            write!(f, "; that is {} more than half of what is free", readable(self.short_by))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Depth;
    use crate::scene::Camera;

    const MIB: u64 = 1 << 20;

    fn outline(views: usize) -> Outline {
        let rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let camera =
            Camera { rotation, translation: [0.0; 3], fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0, width: 512, height: 512 };
        Outline { train: vec![(camera, Depth::Eight); views], held_out: Vec::new(), extent: 5.0 }
    }

    fn plan(views: usize) -> MemoryPlan {
        let photographs = views as u64 * MIB;
        MemoryPlan {
            limit: u64::MAX,
            photographs: (views, photographs),
            residency: Residency::Resident,
            per_splat: 800.0,
            per_pair: 16.0,
            per_pixel: 80.0,
            capacities: (1, 1),
            at_start: photographs + 100 * MIB,
            most_splats: (1, false),
        }
    }

    fn planned(budget: u64, views: usize, shared: bool) -> HostPlan {
        let memory = HostMemory { budget: budget * MIB, in_use: 50 * MIB, most: budget * MIB };
        HostPlan::of(memory, &outline(views), &plan(views), (4 * MIB, MemoryEstimate::default(), 0), (shared, 1))
    }

    #[test]
    fn everything_set_aside_stays_within_the_budget() {
        for shared in [true, false] {
            for views in [1, 10, 100, 1000, 10_000] {
                for budget in [400, 600, 1000, 3000] {
                    let plan = planned(budget, views, shared);
                    assert_eq!(plan.short_by, 0, "{plan:?}");
                    // If all decoded photographs fit, no more than those are kept.
                    let kept = if plan.ahead == 0 { plan.decoded } else { plan.share.keep };
                    let all = plan.memory.in_use + SLACK + plan.training + plan.share.decoding + plan.ahead + kept;
                    assert!(all <= plan.memory.budget, "{all} bytes: {plan:?}");
                }
            }
        }
    }

    #[test]
    fn photographs_are_streamed_where_a_second_copy_does_not_fit() {
        let place = |budget, shared| planned(budget, 100, shared).pacing.photographs;
        assert_eq!((place(1000, true), place(400, true)), (Residency::Resident, Residency::Streamed));
        // The device's own memory holds them.
        assert_eq!(place(400, false), Residency::Resident);
        assert_eq!(planned(600, 100, true).ahead, 0, "all of them decoded");
        let tight = planned(400, 1000, true);
        assert!(tight.ahead > 0 && tight.share.keep < 200 * MIB, "{tight}");
    }

    #[test]
    fn too_little_is_told_with_what_is_missing() {
        let plan = planned(150, 100, true);
        assert!(plan.short_by > 0 && plan.share.threads == 1 && plan.pacing.decoded_ahead == 2, "{plan:?}");
        let Err(Error::HostMemoryLimit { needed, most, asked: true, .. }) = plan.check() else { panic!("{plan}") };
        assert_eq!((needed, most), (plan.short_by + 150 * MIB, 150 * MIB));
        // More than half of the free memory, and less than all of it.
        let memory = HostMemory { most: needed, ..plan.memory };
        let plan =
            HostPlan::of(memory, &outline(100), &self::plan(100), (4 * MIB, MemoryEstimate::default(), 0), (true, 1));
        assert!(plan.check().is_ok() && plan.to_string().contains("more than half of what is free"), "{plan}");
        assert!(HostPlan { memory: HostMemory { most: needed - 1, ..memory }, ..plan }.check().is_err());
    }

    #[test]
    fn a_photograph_larger_than_the_memory_of_the_host_is_refused() {
        let decoding = 100 << 30;
        let memory = HostMemory { budget: 1000 * MIB, in_use: 50 * MIB, most: 2000 * MIB };
        let plan = HostPlan::of(memory, &outline(3), &plan(3), (decoding, MemoryEstimate::default(), 0), (true, 1));
        assert!(plan.check().is_err(), "{plan}");
        assert!(memory.check(&memory.share(decoding)).is_err() && memory.check(&memory.share(MIB)).is_ok());
    }

    #[test]
    fn renders_that_are_learned_from_count_once() {
        let memory = HostMemory { budget: 1000 * MIB, in_use: 50 * MIB, most: 1000 * MIB };
        let with = |renders, shared| {
            let room = MemoryEstimate::default();
            HostPlan::of(memory, &outline(9), &plan(9), (MIB, room, renders * MIB), (shared, 1)).training
        };
        assert_eq!(with(70, false), with(0, false) + 70 * MIB);
        assert_eq!(with(70, true), with(0, true), "the plan of a shared device has them");
    }

    #[test]
    fn what_is_matched_before_the_training_is_part_of_the_plan() {
        let memory = HostMemory { budget: 1000 * MIB, in_use: 50 * MIB, most: 1000 * MIB };
        let with = |host, device, results, shared| {
            let room = MemoryEstimate { host: host * MIB, device: device * MIB, results: results * MIB };
            HostPlan::of(memory, &outline(100), &plan(100), (4 * MIB, room, 0), (shared, 1)).training
        };
        let none = with(0, 0, 0, true);
        assert_eq!(with(90, 0, 30, true), none + 30 * MIB, "what is found is there while the training allocates");
        let most = |shared| with(300, 200, 150, shared);
        assert!(most(true) > none + 200 * MIB && most(false) < most(true), "{} and {}", most(true), most(false));
        let share = memory.after(200 * MIB).share(10 * MIB);
        assert!(share.keep + share.decoding + 378 * MIB <= 1000 * MIB, "{share:?}");
        assert_eq!(memory.after(200 * MIB).short_by(&share), 0);
        assert_eq!(memory.after(900 * MIB).short_by(&memory.after(900 * MIB).share(10 * MIB)), 88 * MIB);
    }

    #[test]
    fn what_is_asked_for_is_the_budget_and_the_machine_its_bound() {
        let now = HostMemory::new(Some(5));
        assert_eq!((now.budget, now.most), (5, 5));
        let vast = HostMemory::new(Some(u64::MAX));
        assert!(vast.most < u64::MAX, "no machine has so much");
        if cfg!(target_os = "linux") {
            let free = HostMemory::new(None);
            assert!(free.in_use > MIB && free.budget > free.in_use && free.most > free.budget);
        }
    }
}
