//! Rates at which the device moves bytes and calculates, for the floors of the passes.

use serde::Serialize;

use super::Error;
use crate::pass::probe::{self, CHAINS, COPY_GROUPS, CopyPush, RatePush, UNROLL};
use crate::raster::{TileShape, Variants};
use crate::twin::probe::chains;
use crate::vk::{Gpu, Groups, Memory, PassTime, Recorder};

/// Repetitions; the fastest counts.
const ROUNDS: usize = 5;
/// Iterations of each thread's loop.
const TURNS: u32 = 512;
/// Least nanoseconds of a timed dispatch, so that its start and end do not matter.
const LONG_ENOUGH: f64 = 2e7;
/// Most workgroups of a dispatch.
const MOST_GROUPS: u64 = 1 << 22;

/// Rates measured on the device right before the steps.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Rates {
    /// Bytes of each buffer of the copies.
    pub copied_bytes: u64,
    /// Copy by a kernel, 16 bytes at a time: bytes read plus bytes written, 10^9 per second.
    pub copy_kernel_gb_per_s: f64,
    /// Copy by the device's command: bytes read plus bytes written, 10^9 per second.
    pub copy_buffer_gb_per_s: f64,
    /// Additions and multiplications in dependent pairs on registers, 10^9 per second: twice the multiply-adds.
    pub gops_per_s: f64,
    /// Exponentials to the base of 2, 10^9 per second.
    pub gexp2_per_s: f64,
}

impl Rates {
    /// Measures the rates in about a second. `variants` decide the size of a workgroup. Copies `bytes`, or as many as a
    /// binding of the device holds.
    pub fn measure(gpu: &Gpu, variants: Variants, bytes: u64) -> Result<Rates, Error> {
        let copied_bytes = bytes.min(gpu.caps().limits.storage_range) / 16 * 16;
        let [copy_kernel_gb_per_s, copy_buffer_gb_per_s] = copies(gpu, copied_bytes)?;
        // The workgroups of the blending passes: a subgroup on a CPU, a tile on a GPU.
        let local_size = if variants.tile == TileShape::Column { 8 } else { 256 };
        let multiply_adds = calculations(gpu, (local_size, 0), |x| x * f64::from(A) + f64::from(B))?;
        Ok(Rates {
            copied_bytes,
            copy_kernel_gb_per_s,
            copy_buffer_gb_per_s,
            gops_per_s: 2.0 * multiply_adds,
            gexp2_per_s: calculations(gpu, (local_size, 1), |x| (-x).exp2())?,
        })
    }

    /// Bandwidth of the faster copy, bytes per second.
    pub fn bandwidth(&self) -> f64 {
        1e9 * self.copy_kernel_gb_per_s.max(self.copy_buffer_gb_per_s)
    }
}

/// Factor and summand of the probe's multiply-add. The results converge to 1.5.
const A: f32 = 0.5;
const B: f32 = 0.75;

/// Nanoseconds of the commands that `record` records.
fn time(gpu: &Gpu, record: impl FnOnce(&mut Recorder) -> Result<(), crate::vk::Error>) -> Result<f64, Error> {
    let mut recorder = gpu.recorder("probe")?;
    recorder.profile(true);
    record(&mut recorder)?;
    let ticket = recorder.submit()?;
    gpu.wait(ticket)?;
    let times: Vec<PassTime> = gpu.timings(ticket)?.unwrap_or_default();
    Ok(times.iter().map(|t| t.ns).sum())
}

/// The shortest time of several runs.
fn shortest(mut run: impl FnMut() -> Result<f64, Error>) -> Result<f64, Error> {
    let times = (0..ROUNDS).map(|_| run()).collect::<Result<Vec<f64>, Error>>()?;
    let least = times.into_iter().fold(f64::INFINITY, f64::min);
    if least > 0.0 { Ok(least) } else { Err(Error::NotLive("a probe of the device took no time at all".into())) }
}

/// Rates of the kernel's copy and of the device's copy command, 10^9 bytes per second.
fn copies(gpu: &Gpu, bytes: u64) -> Result<[f64; 2], Error> {
    let source = gpu.buffer("probe_source", bytes, Memory::Device)?;
    let target = gpu.buffer("probe_target", bytes, Memory::Device)?;
    let pipeline = gpu.pipeline(&probe::COPY.kernel, &[])?;
    let push = CopyPush { count: (bytes / 16) as u32 };
    let groups = Groups::Workgroups(u64::from(push.count.div_ceil(COPY_GROUPS)));
    let speed = |ns: f64| 2.0 * bytes as f64 / ns;
    // Memory is written first: pages never written may share one physical page.
    const WORD: u32 = 0x5eed_c0de;
    let mut recorder = gpu.recorder("probe")?;
    recorder.fill(&source, WORD)?;
    recorder.fill(&target, 0)?;
    recorder.submit()?;
    let kernel = shortest(|| time(gpu, |rec| rec.dispatch(&pipeline, &[&source, &target], &push, groups)))?;
    let last: Vec<u32> = gpu.read_at(&target, bytes - 4, 1)?;
    if last != [WORD] {
        return Err(Error::NotLive("the copy that measures the device's bandwidth did not arrive".into()));
    }
    let buffer = shortest(|| time(gpu, |rec| rec.copy(&source, 0, &target, 0, bytes)))?;
    Ok([speed(kernel), speed(buffer)])
}

/// Rate of the operations of a probe, 10^9 per second: exponentials where `exp2` is 1, multiply-adds where it is 0.
fn calculations(gpu: &Gpu, (local_size, exp2): (u32, u32), step: fn(f64) -> f64) -> Result<f64, Error> {
    let pipeline = gpu.pipeline(&probe::RATE.kernel, &[("LOCAL_SIZE", local_size), ("EXP2", exp2)])?;
    let sums = gpu.buffer("probe_sums", 4 * u64::from(local_size), Memory::Device)?;
    let push = RatePush { turns: TURNS, threads: local_size, a: A, b: B };
    let run = |groups: u64| time(gpu, |rec| rec.dispatch(&pipeline, &[&sums], &push, Groups::Workgroups(groups)));
    let mut groups = 16;
    while run(groups)? < LONG_ENOUGH && groups < MOST_GROUPS {
        groups *= 2;
    }
    let ns = shortest(|| run(groups))?;
    for (thread, sum) in gpu.read::<f32>(&sums)?.into_iter().enumerate() {
        let expected = chains(thread as u32, TURNS, step);
        if (f64::from(sum) - expected).abs() > 1e-4 * expected {
            let operation = ["multiply-adds", "exponentials"][exp2 as usize];
            return Err(Error::NotLive(format!("{operation} gave {sum} instead of {expected}")));
        }
    }
    let each = f64::from(TURNS) * f64::from(CHAINS) * f64::from(UNROLL);
    Ok(groups as f64 * f64::from(local_size) * each / ns)
}
