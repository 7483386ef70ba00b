//! Attribute planes on the device: of a model, its gradients, or its moments.

use half::f16;
use serde::{Deserialize, Serialize};

use crate::scene::{Gaussians, SH_GROUP_FLOATS};
use crate::vk::{self, Buffer, Gpu, Memory, Recorder};

/// (name, floats per splat) of each plane, in the order that every pass uses.
pub const PLANES: [(&str, u32); 8] = [
    ("means", 3),
    ("quats", 4),
    ("scales", 3),
    ("opacities", 1),
    ("sh0", SH_GROUP_FLOATS as u32),
    ("sh1", SH_GROUP_FLOATS as u32),
    ("sh2", SH_GROUP_FLOATS as u32),
    ("sh3", SH_GROUP_FLOATS as u32),
];

/// Index of the means in [`PLANES`].
pub const MEANS: usize = 0;
/// Index of the quaternions in [`PLANES`].
pub const QUATS: usize = 1;
/// Index of the log scales in [`PLANES`].
pub const SCALES: usize = 2;
/// Index of the opacity logits in [`PLANES`].
pub const OPACITIES: usize = 3;
/// Index of the first spherical-harmonics group in [`PLANES`].
pub const SH0: usize = 4;

/// One attribute of a model on the device.
#[derive(Clone, Copy, Debug)]
pub struct Plane<'a> {
    /// Name, as in [`PLANES`].
    pub name: &'static str,
    /// Numbers per splat. The numbers of splat i start at index `i * floats`; rows are tightly packed.
    pub floats: u32,
    /// Bits per number: 32, or 16 for half floats.
    pub bits: u32,
    /// The buffer. [`Buffer::raw`] is the Vulkan handle, [`Buffer::address`] the device address.
    pub buffer: &'a Buffer,
}

/// Index in [`PLANES`] of the first spherical-harmonics group above degree 1.
pub const SH_HIGHER: usize = 5;

/// Eight buffers, one per entry of [`PLANES`]. Cloning gives another handle to the same memory.
///
/// The planes above degree 1 may have fewer rows than the others ([`Self::limited`]). Splats from some row on then have
/// no coefficients above degree 1; [`crate::pass::counters::PLAIN`] counts these splats for the passes. Unused rows of
/// limited planes hold zeros.
#[derive(Clone)]
pub struct Planes {
    capacity: u32,
    sh: ShStorage,
    /// Rows of the planes above degree 1, as a fraction of `capacity`.
    share: f64,
    buffers: [Buffer; 8],
}

/// Bytes of a row of plane `k`.
fn row_bytes(k: usize, sh: ShStorage) -> u64 {
    let (_, row) = PLANES[k];
    u64::from(row) * u64::from(if k < SH0 { 32 } else { sh.bits() }) / 8
}

impl Planes {
    /// Planes for `capacity` splats, with undefined contents. `prefix` begins the buffers' names.
    pub fn new(gpu: &Gpu, prefix: &str, capacity: u32) -> Result<Self, vk::Error> {
        Self::with_sh(gpu, prefix, capacity, ShStorage::Full)
    }

    /// Like [`Self::new`], with a storage format for spherical harmonics.
    pub fn with_sh(gpu: &Gpu, prefix: &str, capacity: u32, sh: ShStorage) -> Result<Self, vk::Error> {
        Self::allocated(gpu, prefix, capacity, sh, 1.0)
    }

    /// Like [`Self::new`], with coefficients above degree 1 for only a fraction `share` of the splats, rounded up. The
    /// caller sets the planes above degree 1 to zero before any read: [`Self::clear_upper`].
    pub fn limited(gpu: &Gpu, prefix: &str, capacity: u32, share: f64) -> Result<Self, vk::Error> {
        Self::allocated(gpu, prefix, capacity, ShStorage::Full, share)
    }

    fn allocated(gpu: &Gpu, prefix: &str, capacity: u32, sh: ShStorage, share: f64) -> Result<Self, vk::Error> {
        let capacity = capacity.max(1);
        let plane = |k: usize| {
            let bytes = row_bytes(k, sh) * u64::from(rows_at(k, capacity, share));
            gpu.buffer(&format!("{prefix}{}", PLANES[k].0), bytes, Memory::Device)
        };
        let buffers = [plane(0)?, plane(1)?, plane(2)?, plane(3)?, plane(4)?, plane(5)?, plane(6)?, plane(7)?];
        Ok(Self { capacity, sh, share, buffers })
    }

    /// Most splats that fit.
    pub fn capacity(&self) -> u32 {
        self.capacity
    }

    /// Most splats with coefficients above degree 1; fewer than [`Self::capacity`] only in [limited](Self::limited)
    /// planes.
    pub fn full_rows(&self) -> u32 {
        rows_at(SH_HIGHER, self.capacity, self.share)
    }

    /// Least value of [`crate::pass::counters::PLAIN`] for a model of `splats` splats in these planes.
    pub fn plain(&self, splats: u32) -> u32 {
        splats.saturating_sub(self.full_rows())
    }

    /// Storage format of spherical harmonics.
    pub fn sh(&self) -> ShStorage {
        self.sh
    }

    /// Total bytes of the buffers.
    pub fn bytes(&self) -> u64 {
        self.buffers.iter().map(Buffer::size).sum()
    }

    /// The buffers in the order of [`PLANES`].
    pub fn buffers(&self) -> &[Buffer; 8] {
        &self.buffers
    }

    /// Every plane with its layout. Units and order follow `docs/CONVENTIONS.md`: means in scene coordinates, quats (w,
    /// x, y, z) of any length, logarithms of scales, logits of opacities, sh coefficients with colour fastest.
    pub fn layout(&self) -> [Plane<'_>; 8] {
        std::array::from_fn(|k| {
            let bits = if k < SH0 { 32 } else { self.sh.bits() };
            Plane { name: PLANES[k].0, floats: PLANES[k].1, bits, buffer: &self.buffers[k] }
        })
    }

    /// Makes room for `capacity` splats and keeps the contents. Grows one plane after another, so that only one plane
    /// is in memory twice. Waits. After an error every plane keeps its contents; some planes may have grown.
    pub fn grow(&mut self, gpu: &Gpu, capacity: u32) -> Result<(), vk::Error> {
        let capacity = capacity.max(self.capacity);
        for (k, buffer) in self.buffers.iter_mut().enumerate() {
            let bytes = row_bytes(k, self.sh) * u64::from(rows_at(k, capacity, self.share));
            let beyond = if k >= SH_HIGHER && self.share < 1.0 { Padding::Zero } else { Padding::Undefined };
            *buffer = grown_with(gpu, buffer, bytes, beyond)?;
        }
        self.capacity = capacity;
        Ok(())
    }

    /// Sets every number to zero.
    pub fn clear(&self, recorder: &mut Recorder) -> Result<(), vk::Error> {
        for buffer in &self.buffers {
            recorder.fill(buffer, 0)?;
        }
        Ok(())
    }

    /// Sets the coefficients above degree 1 to zero.
    pub fn clear_upper(&self, recorder: &mut Recorder) -> Result<(), vk::Error> {
        for buffer in &self.buffers[SH_HIGHER..] {
            recorder.fill(buffer, 0)?;
        }
        Ok(())
    }

    /// Writes `gaussians` to the first rows.
    pub fn write(&self, gpu: &Gpu, gaussians: &Gaussians) -> Result<(), vk::Error> {
        self.write_rows(gpu, &planes_of(gaussians))
    }

    /// Writes the first rows of every plane. Rows that a limited plane lacks are dropped.
    pub fn write_rows<T: AsRef<[f32]>>(&self, gpu: &Gpu, values: &[T; 8]) -> Result<(), vk::Error> {
        for (k, values) in values.iter().map(AsRef::as_ref).enumerate().filter(|(_, values)| !values.is_empty()) {
            let values = if k < SH_HIGHER { values } else { &values[..values.len().min(self.upper_numbers())] };
            match self.halved(k) {
                false => gpu.write(&self.buffers[k], values)?,
                true => {
                    let halves: Vec<u16> = values.iter().map(|v| half_of(*v)).collect();
                    gpu.write(&self.buffers[k], &halves)?;
                }
            }
        }
        Ok(())
    }

    /// Numbers in a plane above degree 1.
    fn upper_numbers(&self) -> usize {
        self.full_rows() as usize * SH_GROUP_FLOATS
    }

    /// Reads the first `splats` rows. Rows that a limited plane lacks are zeros. Waits.
    pub fn read(&self, gpu: &Gpu, splats: u32) -> Result<[Vec<f32>; 8], vk::Error> {
        let mut out: [Vec<f32>; 8] = Default::default();
        if splats == 0 {
            return Ok(out);
        }
        for (k, plane) in out.iter_mut().enumerate() {
            let wanted = (PLANES[k].1 * splats) as usize;
            let numbers = if k < SH_HIGHER { wanted } else { wanted.min(self.upper_numbers()) };
            *plane = match self.halved(k) {
                false => gpu.read_at(&self.buffers[k], 0, numbers)?,
                true => {
                    let halves: Vec<u16> = gpu.read_at(&self.buffers[k], 0, numbers)?;
                    halves.into_iter().map(|h| f16::from_bits(h).to_f32()).collect()
                }
            };
            plane.resize(wanted, 0.0);
        }
        Ok(out)
    }

    fn halved(&self, k: usize) -> bool {
        k >= SH0 && self.sh == ShStorage::Half
    }
}

/// The nearest finite half float; NaN stays NaN.
fn half_of(value: f32) -> u16 {
    f16::from_f32(value.clamp(f16::MIN.to_f32(), f16::MAX.to_f32())).to_bits()
}

/// Rows of plane `k` for `capacity` splats.
fn rows_at(k: usize, capacity: u32, share: f64) -> u32 {
    if k < SH_HIGHER || share >= 1.0 { capacity } else { ((share * f64::from(capacity)).ceil() as u32).max(1) }
}

/// Content of a grown buffer after the copied content.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Padding {
    Undefined,
    Zero,
}

/// A new buffer of `bytes` bytes (at least `buffer`'s size) that begins with the contents of `buffer`. Waits.
pub fn grown(gpu: &Gpu, buffer: &Buffer, bytes: u64) -> Result<Buffer, vk::Error> {
    grown_with(gpu, buffer, bytes, Padding::Undefined)
}

fn grown_with(gpu: &Gpu, buffer: &Buffer, bytes: u64, beyond: Padding) -> Result<Buffer, vk::Error> {
    let larger = gpu.buffer(buffer.name(), bytes, Memory::Device)?;
    let mut recorder = gpu.recorder("grow")?;
    if beyond == Padding::Zero {
        recorder.fill(&larger, 0)?;
    }
    recorder.copy(buffer, 0, &larger, 0, buffer.size())?;
    gpu.wait(recorder.submit()?)?;
    Ok(larger)
}

/// The attributes of a model on the host, in the order of [`PLANES`].
pub fn planes_of(gaussians: &Gaussians) -> [&[f32]; 8] {
    let [a, b, c, d] = &gaussians.sh;
    [&gaussians.means, &gaussians.quats, &gaussians.scales, &gaussians.opacities, a, b, c, d]
}

/// A model made of attributes in the order of [`PLANES`].
pub fn gaussians_of(planes: [Vec<f32>; 8], ids: Vec<u32>) -> Gaussians {
    let [means, quats, scales, opacities, a, b, c, d] = planes;
    Gaussians { means, quats, scales, opacities, sh: [a, b, c, d], ids }
}

/// Storage format of spherical harmonics on the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShStorage {
    /// 32-bit floats.
    #[default]
    Full,
    /// Half floats: half the memory, for renders only. Training needs 32 bits.
    Half,
}

impl ShStorage {
    /// Bits per number.
    pub fn bits(self) -> u32 {
        match self {
            Self::Full => 32,
            Self::Half => 16,
        }
    }
}
