//! Memory of the host: what a training may take of it, and how the photographs share what is left.

use std::fmt;

use super::MemoryPlan;
use crate::byte_size::readable;
use crate::dataset::{Dataset, HostShare, cores};
use crate::eval::REPORT_BYTES;
use crate::stereo::Room;
use crate::train::input::Outline;
use crate::train::pacing::Pacing;
use crate::train::photographs::{LANDINGS, Residency};
use crate::train::settings::{DepthPrior, LidarCloud, Settings};
use crate::vk::{DeviceKind, Gpu};

/// Where nothing can be found out.
const FREE_UNKNOWN: u64 = 4 << 30;
/// Set aside for what nobody counts: compiled passes, the driver, pictures of the report.
const SLACK: u64 = 128 << 20;
/// Photographs that are being decoded, and those decoded ahead, each take at most this share of what is left.
const PART: u64 = 4;
/// What a checkpoint holds of a splat, and what a picture with depth and normals takes beside a photograph's bytes.
const READ_BACK_PER_SPLAT: u64 = 736;
const READ_BACK_PER_BYTE: u64 = 12;
/// Held-out views in a report, beside a photograph's bytes: at most, where they are not reduced.
const REPORT_PER_BYTE: u64 = 4;
/// Photographs decoded ahead.
const AHEAD: (u64, u64) = (2, 8);
/// Threads that decode at one time.
const MOST_THREADS: u64 = 16;

/// What the process may take of the host's memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostMemory {
    /// Bytes that it may take.
    pub budget: u64,
    /// Bytes that it takes now.
    pub in_use: u64,
}

impl HostMemory {
    /// As asked for (`--host-memory`), else half of what is free.
    pub fn new(asked: Option<u64>) -> Self {
        let in_use = resident().unwrap_or(0);
        Self { budget: asked.unwrap_or_else(|| in_use + free().unwrap_or(FREE_UNKNOWN) / 2), in_use }
    }

    /// When so many bytes more are in use.
    pub fn after(self, bytes: u64) -> Self {
        Self { in_use: self.in_use.saturating_add(bytes), ..self }
    }

    /// Bytes that decoding takes beyond what may be used.
    pub fn short_by(self, share: &HostShare) -> u64 {
        self.in_use.saturating_add(SLACK).saturating_add(share.decoding).saturating_sub(self.budget)
    }

    /// What photographs may take where nothing is trained.
    pub fn share(self, largest_decoding: u64) -> HostShare {
        let left = self.budget.saturating_sub(self.in_use).saturating_sub(SLACK);
        let (decoding, threads) = decoders(left, largest_decoding);
        HostShare { keep: left.saturating_sub(decoding), decoding, threads }
    }
}

/// Bytes for decoding at one time, and on how many threads.
fn decoders(left: u64, each: u64) -> (u64, usize) {
    let threads = (left / PART / each.max(1)).clamp(1, MOST_THREADS.min(cores() as u64));
    (threads * each, threads as usize)
}

/// Whether the device works in the host's memory.
pub fn shares_memory(gpu: &Gpu) -> bool {
    matches!(gpu.caps().kind, DeviceKind::Cpu | DeviceKind::Integrated)
}

/// How a training shares the host's memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HostPlan {
    /// What may be taken.
    pub memory: HostMemory,
    /// Bytes of the training that are not photographs kept on the host: what is read back for a checkpoint, a picture, the report, its
    /// buffers where the device works in the host's memory, and what photographs are uploaded from. As at the start: more splats
    /// take more.
    pub training: u64,
    /// Bytes of all photographs, decoded.
    pub decoded: u64,
    /// What photographs are kept and decoded in.
    pub share: HostShare,
    /// Bytes of photographs decoded ahead.
    pub ahead: u64,
    /// Where photographs are, and how many are decoded ahead.
    pub pacing: Pacing,
    /// Bytes that are missing even so.
    pub short_by: u64,
}

impl HostPlan {
    /// For the training that `plan` tells the device memory of.
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
        let room = Room::of(&settings.geometry.stereo(), sizes);
        let stereo = match settings.geometry.depth_prior {
            DepthPrior::None if settings.density.lidar != Some(LidarCloud::Mvs) => Room::default(),
            // What views are matched with stays.
            DepthPrior::Propagation => Room { results: room.host, ..room },
            _ => room,
        };
        let at_once = u64::from(settings.texture.views_at_once());
        Self::of(memory, outline, plan, (decoding, stereo), (shares_memory(gpu), at_once))
    }

    fn of(
        memory: HostMemory,
        outline: &Outline,
        plan: &MemoryPlan,
        (each_decoding, stereo): (u64, Room),
        (shared, at_once): (bool, u64),
    ) -> Self {
        let mut pacing = Pacing::default();
        let largest = outline.largest();
        let decoded = Outline::bytes(&outline.train) + Outline::bytes(&outline.held_out);
        let on_device = if shared { plan.at_start.saturating_sub(plan.photographs.1) } else { 0 };
        let report = REPORT_BYTES.min(REPORT_PER_BYTE * Outline::bytes(&outline.held_out));
        let read_back = READ_BACK_PER_SPLAT * u64::from(plan.capacities.0) + READ_BACK_PER_BYTE * largest;
        // Depths are found before the training allocates; what is found stays until it has it.
        let before = stereo.host + if shared { stereo.device } else { 0 };
        let model = (on_device + read_back + report + stereo.results).max(before);
        let left = memory.budget.saturating_sub(memory.in_use).saturating_sub(SLACK).saturating_sub(model);
        let (decoding, threads) = decoders(left, each_decoding);
        let ring = largest * (pacing.events_in_flight() as u64 + at_once + if shared { LANDINGS as u64 } else { 0 });
        // Photographs that the host keeps decoded are there a second time while they are uploaded.
        let resident = if shared { plan.photographs.1 } else { 0 };
        let fits = decoded.saturating_add(resident).saturating_add(decoding) <= left;
        pacing.photographs = match plan.residency {
            Residency::Resident if shared && !fits => Residency::Streamed,
            residency => residency,
        };
        let uploads = if pacing.photographs == Residency::Streamed { ring } else { resident };
        let ahead = (left / PART / largest.max(1)).clamp(AHEAD.0, AHEAD.1);
        (pacing.decoded_ahead, pacing.decoders) = (ahead as usize, threads.min(ahead as usize));
        // Of the photographs to train on, and of those held out.
        let ahead = 2 * ahead * largest;
        let least = uploads + decoding;
        let room = left.saturating_sub(least);
        // What is kept decoded is not decoded ahead.
        let keep = if decoded <= room { room } else { room.saturating_sub(ahead) };
        Self {
            memory,
            training: model + uploads,
            decoded,
            share: HostShare { keep, decoding, threads },
            ahead: if decoded <= room { 0 } else { ahead },
            pacing,
            short_by: if decoded <= room { 0 } else { (least + ahead).saturating_sub(left) },
        }
    }
}

impl fmt::Display for HostPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "host memory: of the {} that may be used {} are in use and {} set aside for the training; photographs take {} decoded",
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
            ": up to {} of them are kept compressed, the others read again; {} decoded ahead on {} thread{}",
            readable(self.share.keep),
            self.pacing.decoded_ahead,
            self.pacing.decoders,
            if self.pacing.decoders == 1 { "" } else { "s" }
        )?;
        if self.short_by > 0 {
            write!(f, "; that is {} more than may be used, and the least that works", readable(self.short_by))?;
        }
        Ok(())
    }
}

/// Bytes of memory that this process holds (`VmRSS` of Linux).
fn resident() -> Option<u64> {
    kib(&std::fs::read_to_string("/proc/self/status").ok()?, "VmRSS:")
}

/// Bytes that can be allocated without swapping: the machine's, or the control group's if that has less.
fn free() -> Option<u64> {
    let machine = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| kib(&text, "MemAvailable:"));
    let number = |file| std::fs::read_to_string(file).ok()?.trim().parse::<u64>().ok();
    let group = number("/sys/fs/cgroup/memory.max")
        .zip(number("/sys/fs/cgroup/memory.current"))
        .map(|(most, now)| most.saturating_sub(now));
    machine.into_iter().chain(group).min()
}

fn kib(text: &str, key: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
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
        let memory = HostMemory { budget: budget * MIB, in_use: 50 * MIB };
        HostPlan::of(memory, &outline(views), &plan(views), (4 * MIB, Room::default()), (shared, 1))
    }

    #[test]
    fn everything_set_aside_stays_within_the_budget() {
        for shared in [true, false] {
            for views in [1, 10, 100, 1000, 10_000] {
                for budget in [400, 600, 1000, 3000] {
                    let plan = planned(budget, views, shared);
                    assert_eq!(plan.short_by, 0, "{plan:?}");
                    // Where all fit decoded, what is kept is at most what there is.
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
        // Another memory than the host's holds them.
        assert_eq!(place(400, false), Residency::Resident);
        assert_eq!(planned(600, 100, true).ahead, 0, "all of them decoded");
        let tight = planned(400, 1000, true);
        assert!(tight.ahead > 0 && tight.share.keep < 200 * MIB, "{tight}");
    }

    #[test]
    fn too_little_is_told_with_what_is_missing() {
        let plan = planned(150, 100, true);
        assert!(plan.short_by > 0 && plan.share.threads == 1 && plan.pacing.decoded_ahead == 2, "{plan:?}");
        assert!(plan.to_string().contains("the least that works"), "{plan}");
    }

    #[test]
    fn what_is_matched_before_the_training_is_part_of_the_plan() {
        let memory = HostMemory { budget: 1000 * MIB, in_use: 50 * MIB };
        let with = |host, device, results, shared| {
            let room = Room { host: host * MIB, device: device * MIB, results: results * MIB };
            HostPlan::of(memory, &outline(100), &plan(100), (4 * MIB, room), (shared, 1)).training
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
    fn figures_of_the_system_are_read() {
        assert_eq!(kib("MemTotal:  8 kB\nMemAvailable:    6 kB\n", "MemAvailable:"), Some(6144));
        assert_eq!(kib("MemAvailable: many kB\n", "MemAvailable:"), None);
        let now = HostMemory::new(Some(5));
        assert_eq!(now.budget, 5);
        if cfg!(target_os = "linux") {
            assert!(now.in_use > MIB && HostMemory::new(None).budget > now.in_use);
        }
    }
}
