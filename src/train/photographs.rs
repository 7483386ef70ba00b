//! The photographs of a training on the device: uploading all of them or those of the next steps, reduced copies and
//! masks.

mod coarse;
mod prefetch;
mod saliencies;
mod upload_lru;

pub(super) use coarse::Coarse;
pub(super) use prefetch::Feed;
pub use prefetch::FeedCounts;
pub(super) use saliencies::Saliencies;

use upload_lru::StagingSlots;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::Error;
use super::input::View;
use super::pacing::{Pacing, Residency};
use super::schedule::Band;
use crate::dataset::{Depth, Pixels, Supply};
use crate::eval::{PhotographWait, TrainingScores};
use crate::loss::Photograph;
use crate::pass::loss;
use crate::scene::Camera;
use crate::vk::{self, Buffer, Gpu, Memory, Recorder};

/// Device buffers that uploads use in turn, so that an upload need not wait for the step before.
pub(super) const LANDINGS: usize = 2;

/// Buffers of the photographs, and size and depth of each photograph.
pub(super) struct Photographs {
    layouts: Vec<PhotographLayout>,
    storage: Storage,
}

struct PhotographLayout {
    name: String,
    size: (u32, u32),
    depth: Depth,
    /// Number of values that the means of the loss are taken over.
    values: f32,
}

enum Storage {
    Resident {
        /// One buffer for each photograph.
        whole: Vec<Buffer>,
        /// Copy of the band of a step, if steps look at bands.
        band: Option<Buffer>,
    },
    Streamed(Stream),
}

/// Mapped staging buffers, and the device buffers that photographs are copied to. There are staging buffers for all
/// photographs that events in flight look at, and one more, so the photographs of steps that have to be repeated are
/// still there.
struct Stream {
    staging: Vec<Buffer>,
    slots: Mutex<StagingSlots>,
    landings: Vec<Buffer>,
    feed: Feed,
    /// The photographs of [`TrainingScores::sample`].
    sample: Vec<(usize, Supply)>,
    waits: Mutex<Vec<PhotographWait>>,
    /// Counts of earlier feeds.
    before: FeedCounts,
}

/// A look at a photograph in a recording.
pub(super) struct Visit {
    pub(super) view: usize,
    pub(super) step: u32,
    /// The band of the photograph, if not the whole photograph is looked at.
    pub(super) band: Option<Band>,
    /// Number of the recording: consecutive recordings use different landings.
    pub(super) recording: u64,
}

impl Photographs {
    /// Buffers for photographs of these cameras; contents undefined. Streamed photographs have `slots` staging buffers.
    /// Steps look at the `bands` of a photograph in turn.
    pub(super) fn allocate(
        gpu: &Gpu,
        views: &[(Camera, Depth)],
        residency: Residency,
        slots: usize,
        bands: u32,
    ) -> Result<Self, Error> {
        let layout = |(c, depth): &(Camera, Depth)| {
            let size = (c.width, c.height);
            PhotographLayout { name: String::new(), size, depth: *depth, values: 0.0 }
        };
        let layouts: Vec<PhotographLayout> = views.iter().map(layout).collect();
        let storage = if residency == Residency::Streamed {
            let largest = layouts.iter().map(PhotographLayout::bytes).max().unwrap_or(0);
            let buffers = |name: &str, count: usize, memory| {
                (0..count)
                    .map(|i| gpu.buffer(&format!("{name} {i}"), largest, memory))
                    .collect::<Result<_, vk::Error>>()
            };
            Storage::Streamed(Stream {
                staging: buffers("photographs on their way", slots, Memory::Upload)?,
                slots: Mutex::new(StagingSlots::new(slots)),
                landings: buffers("photograph", LANDINGS, Memory::Device)?,
                feed: Feed::new(Vec::new(), 0, 0),
                sample: Vec::new(),
                waits: Mutex::default(),
                before: FeedCounts::default(),
            })
        } else {
            let buffer = |(i, layout): (usize, &PhotographLayout)| {
                gpu.buffer(&format!("photograph {i}"), layout.bytes(), Memory::Device)
            };
            let band = layouts.iter().map(|layout| layout.bytes_of_band(bands)).max().filter(|_| bands > 1);
            let band = band.map(|bytes| gpu.buffer("band", bytes, Memory::Device)).transpose()?;
            Storage::Resident { whole: layouts.iter().enumerate().map(buffer).collect::<Result<_, vk::Error>>()?, band }
        };
        Ok(Self { layouts, storage })
    }

    /// The feed that decodes the photographs, beginning with the views `first`.
    pub(super) fn feed(views: &[View], pacing: Pacing, first: &[usize]) -> Feed {
        let supplies = views.iter().map(|view| view.photograph.clone()).collect();
        let feed = Feed::new(supplies, pacing.decoded_ahead, pacing.decoders());
        feed.look_ahead(first);
        feed
    }

    /// Uploads the photographs, or keeps `feed` for the steps if photographs are streamed.
    pub(super) fn fill(&mut self, gpu: &Gpu, views: &[View], feed: Feed) -> Result<(), Error> {
        for (layout, view) in self.layouts.iter_mut().zip(views) {
            layout.name.clone_from(&view.name);
            layout.values = loss::values(view.camera.width, view.camera.height, view.masked());
        }
        match &mut self.storage {
            Storage::Streamed(stream) => {
                stream.feed = feed;
                let sampled = TrainingScores::sample(views.len()).into_iter();
                stream.sample = sampled.map(|view| (view, views[view].photograph.clone())).collect();
            }
            Storage::Resident { whole, .. } => {
                for (i, (layout, buffer)) in self.layouts.iter().zip(whole).enumerate() {
                    feed.look_ahead(&(i..views.len().min(i + feed.ahead())).collect::<Vec<_>>());
                    let pixels = feed.get(i)?;
                    layout.check(pixels.bytes().len())?;
                    gpu.write(buffer, pixels.bytes())?;
                    // Wait, so that only one photograph is held twice.
                    gpu.wait(gpu.last_ticket())?;
                }
            }
        }
        Ok(())
    }

    /// How many views [`Self::look_ahead`] can use: as many as are decoded ahead and as many as lie in staging buffers.
    pub(super) fn ahead(&self) -> usize {
        match &self.storage {
            Storage::Streamed(stream) if stream.feed.ahead() > 0 => stream.feed.ahead() + lock(&stream.slots).count(),
            _ => 0,
        }
    }

    /// Names the views of the next steps, so that their photographs are decoded ahead.
    pub(super) fn look_ahead(&self, views: &[usize]) {
        if let Storage::Streamed(stream) = &self.storage {
            let missing = lock(&stream.slots).missing(views);
            stream.feed.look_ahead(&missing);
        }
    }

    /// A photograph or a band of it for a recording. Records the copy of a streamed photograph or of a band. The caller
    /// adds the mask.
    pub(super) fn record(&self, gpu: &Gpu, recorder: &mut Recorder, visit: &Visit) -> Result<Photograph<'_>, Error> {
        let Visit { view, step, band, recording } = *visit;
        let layout = self.layouts.get(view).ok_or(Error::NoViews)?;
        let (first, bytes) = layout.part(band);
        let buffer = match &self.storage {
            Storage::Resident { whole, band: landing } => {
                let whole = whole.get(view).ok_or(Error::NoViews)?;
                match landing.as_ref().filter(|_| band.is_some()) {
                    Some(landing) => {
                        recorder.copy(whole, first, landing, 0, bytes)?;
                        landing
                    }
                    None => whole,
                }
            }
            Storage::Streamed(stream) => {
                let staging = stream.staged(gpu, layout, view, step)?;
                let landing = &stream.landings[(recording % stream.landings.len().max(1) as u64) as usize];
                recorder.copy(staging, first, landing, 0, bytes)?;
                landing
            }
        };
        // The share of masked pixels is taken from the whole photograph.
        let part_values = (f64::from(layout.values) * bytes as f64 / layout.bytes().max(1) as f64) as f32;
        let rows = band.map_or(layout.size.1, |band| band.rows(layout.size.1).1);
        let (bits, size) = (layout.depth.bits(), (layout.size.0, rows));
        Ok(Photograph { buffer, bits, size, values: layout.values, part_values, mask: None })
    }

    /// Counts of the photographs of the steps so far; `None` when all photographs are on the device.
    pub(super) fn counts(&self) -> Option<FeedCounts> {
        if let Storage::Streamed(stream) = &self.storage { Some(stream.before + stream.feed.counts()) } else { None }
    }

    /// The steps so far that had to wait for their photographs.
    pub(super) fn waits(&self) -> Vec<PhotographWait> {
        if let Storage::Streamed(stream) = &self.storage { lock(&stream.waits).clone() } else { Vec::new() }
    }

    /// A photograph of [`TrainingScores::sample`], also after [`Self::release`]: from the device, or decoded. Waits.
    pub(super) fn sampled(&self, gpu: &Gpu, view: usize) -> Result<Arc<Pixels>, Error> {
        match &self.storage {
            Storage::Resident { whole, .. } => {
                let (layout, buffer) = self.layouts.get(view).zip(whole.get(view)).ok_or(Error::NoViews)?;
                let bytes = layout.bytes() as usize;
                Ok(Arc::new(match layout.depth {
                    Depth::Eight => Pixels::Rgba8(gpu.read_at(buffer, 0, bytes)?),
                    Depth::Sixteen => Pixels::Rgba16(gpu.read_at(buffer, 0, bytes / 2)?),
                }))
            }
            Storage::Streamed(stream) => {
                let (_, supply) = stream.sample.iter().find(|(at, _)| *at == view).ok_or(Error::NoViews)?;
                Ok(supply.pixels()?)
            }
        }
    }

    /// Frees the photographs that the host keeps, but for those of [`Self::sampled`]. No step may follow.
    pub(super) fn release(&mut self) {
        if let Storage::Streamed(stream) = &mut self.storage {
            stream.before = stream.before + stream.feed.counts();
            stream.feed = Feed::new(Vec::new(), 0, 0);
        }
    }

    /// Bytes of the buffers that count as device memory.
    pub(super) fn bytes(&self, gpu: &Gpu) -> u64 {
        let bytes = |buffer: &Buffer| gpu.counted_bytes(buffer);
        match &self.storage {
            Storage::Resident { whole, band } => whole.iter().chain(band).map(bytes).sum(),
            Storage::Streamed(stream) => stream.staging.iter().chain(&stream.landings).map(bytes).sum(),
        }
    }
}

impl Stream {
    /// The staging buffer with the photograph of `view`, filled if necessary.
    fn staged(&self, gpu: &Gpu, layout: &PhotographLayout, view: usize, step: u32) -> Result<&Buffer, Error> {
        let mut slots = lock(&self.slots);
        if let Some(slot) = slots.find(view) {
            self.feed.reused();
            return self.staging.get(slot).ok_or(Error::NoViews);
        }
        let (pixels, waited) = self.feed.get_timed(view)?;
        if let Some(seconds) = waited {
            let device_idle = gpu.is_done(gpu.last_ticket())?;
            lock(&self.waits).push(PhotographWait { step, seconds, device_idle });
        }
        layout.check(pixels.bytes().len())?;
        let slot = slots.clear_oldest().ok_or(Error::NoViews)?;
        let staging = self.staging.get(slot).ok_or(Error::NoViews)?;
        gpu.store(staging, pixels.bytes())?;
        slots.fill(slot, view);
        Ok(staging)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl PhotographLayout {
    /// Bytes of the pixels.
    fn bytes(&self) -> u64 {
        self.row_bytes() * u64::from(self.size.1)
    }

    fn row_bytes(&self) -> u64 {
        u64::from(self.size.0) * self.depth.bytes_per_pixel()
    }

    /// Bytes of the largest of `of` bands.
    fn bytes_of_band(&self, of: u32) -> u64 {
        let rows = |index| Band { index, of }.rows(self.size.1).1;
        self.row_bytes() * u64::from((0..of).map(rows).max().unwrap_or(0))
    }

    /// First byte and number of bytes of a band, or of the whole photograph without a band.
    fn part(&self, band: Option<Band>) -> (u64, u64) {
        let (top, rows) = band.map_or((0, self.size.1), |band| band.rows(self.size.1));
        (self.row_bytes() * u64::from(top), self.row_bytes() * u64::from(rows))
    }

    fn check(&self, found: usize) -> Result<(), Error> {
        let expected = self.bytes() as usize;
        if found != expected || expected == 0 {
            return Err(Error::PhotographSize { name: self.name.clone(), found, expected });
        }
        Ok(())
    }
}
