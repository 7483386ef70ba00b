//! The photographs of a training on the device, all of them or those of the next steps: how they come there, and what is made of them.

mod coarse;
mod prefetch;
mod saliencies;
mod upload_lru;

pub(super) use coarse::Coarse;
pub(super) use prefetch::Feed;
pub use prefetch::FeedCounts;
pub(super) use saliencies::Saliencies;

use upload_lru::Places;

use std::sync::{Mutex, MutexGuard, PoisonError};

use super::Error;
use super::input::View;
use super::pacing::{Pacing, Residency};
use super::schedule::Band;
use crate::dataset::Depth;
use crate::eval::PhotographWait;
use crate::loss::Photograph;
use crate::pass::loss;
use crate::scene::Camera;
use crate::vk::{self, Buffer, Gpu, Memory, Recorder};

/// Photographs that are uploaded to in turn, so that an upload need not wait for the step before.
pub(super) const LANDINGS: usize = 2;

/// Buffers of the photographs, and what is known of each.
pub(super) struct Photographs {
    views: Vec<Known>,
    place: Place,
}

struct Known {
    name: String,
    size: (u32, u32),
    depth: Depth,
    /// What the means of the loss are taken over.
    values: f32,
}

enum Place {
    /// One buffer each, and one for the band of a step, where steps look at bands.
    Resident(Vec<Buffer>, Option<Buffer>),
    Streamed(Stream),
}

/// Memory that is mapped all the time, and where its content lands. What events in flight look at lies there, and one photograph more: where
/// an event looks at those of the steps before it too, there is room for these. What steps that have
/// to be taken again look at still lies there.
struct Stream {
    staging: Vec<Buffer>,
    places: Mutex<Places>,
    landings: Vec<Buffer>,
    feed: Feed,
    waits: Mutex<Vec<PhotographWait>>,
    /// Of feeds that are gone.
    before: FeedCounts,
}

/// A look at a photograph in a recording.
pub(super) struct Visit {
    pub(super) view: usize,
    pub(super) step: u32,
    /// The part of the photograph, where that is not all of it.
    pub(super) band: Option<Band>,
    /// Counts recordings, so that none lands where the one before has.
    pub(super) recording: u64,
}

impl Photographs {
    /// Buffers for photographs of these cameras; contents undefined. Streamed ones lie in `places` until no event in
    /// flight looks at them; steps look at `bands` of one in turn.
    pub(super) fn allocate(
        gpu: &Gpu,
        views: &[(Camera, Depth)],
        residency: Residency,
        places: usize,
        bands: u32,
    ) -> Result<Self, Error> {
        let known: Vec<Known> = views
            .iter()
            .map(|(c, depth)| Known { name: String::new(), size: (c.width, c.height), depth: *depth, values: 0.0 })
            .collect();
        let place = if residency == Residency::Streamed {
            let largest = known.iter().map(Known::bytes).max().unwrap_or(0);
            let buffers = |name: &str, count: usize, memory| {
                (0..count)
                    .map(|i| gpu.buffer(&format!("{name} {i}"), largest, memory))
                    .collect::<Result<_, vk::Error>>()
            };
            Place::Streamed(Stream {
                staging: buffers("photographs on their way", places, Memory::Upload)?,
                places: Mutex::new(Places::new(places)),
                landings: buffers("photograph", LANDINGS, Memory::Device)?,
                feed: Feed::new(Vec::new(), 0, 0),
                waits: Mutex::default(),
                before: FeedCounts::default(),
            })
        } else {
            let buffer = |(i, k): (usize, &Known)| gpu.buffer(&format!("photograph {i}"), k.bytes(), Memory::Device);
            let band = known.iter().map(|k| k.bytes_of_band(bands)).max().filter(|_| bands > 1);
            let band = band.map(|bytes| gpu.buffer("band", bytes, Memory::Device)).transpose()?;
            Place::Resident(known.iter().enumerate().map(buffer).collect::<Result<_, vk::Error>>()?, band)
        };
        Ok(Self { views: known, place })
    }

    /// What decodes the photographs, which begins with those that are looked at first.
    pub(super) fn feed(views: &[View], pacing: Pacing, first: &[usize]) -> Feed {
        let supplies = views.iter().map(|view| view.photograph.clone()).collect();
        let feed = Feed::new(supplies, pacing.decoded_ahead, pacing.decoders());
        feed.look_ahead(first);
        feed
    }

    /// Uploads the photographs, or keeps what decodes them for their steps.
    pub(super) fn fill(&mut self, gpu: &Gpu, views: &[View], feed: Feed) -> Result<(), Error> {
        for (known, view) in self.views.iter_mut().zip(views) {
            known.name.clone_from(&view.name);
            known.values = loss::values(view.camera.width, view.camera.height, view.masked());
        }
        match &mut self.place {
            Place::Streamed(stream) => stream.feed = feed,
            Place::Resident(buffers, _) => {
                for (i, (known, buffer)) in self.views.iter().zip(buffers).enumerate() {
                    feed.look_ahead(&(i..views.len().min(i + feed.ahead())).collect::<Vec<_>>());
                    let pixels = feed.get(i)?;
                    known.check(pixels.bytes().len())?;
                    gpu.write(buffer, pixels.bytes())?;
                    // So that only one is held twice.
                    gpu.wait(gpu.last_ticket())?;
                }
            }
        }
        Ok(())
    }

    /// How many views [`Self::look_ahead`] has a use for: those of all steps that may have to be taken again lie there still, and as
    /// many as fit are decoded beside them.
    pub(super) fn ahead(&self) -> usize {
        match &self.place {
            Place::Streamed(stream) if stream.feed.ahead() > 0 => stream.feed.ahead() + lock(&stream.places).count(),
            _ => 0,
        }
    }

    /// The views of the next steps.
    pub(super) fn look_ahead(&self, views: &[usize]) {
        if let Place::Streamed(stream) = &self.place {
            let missing = lock(&stream.places).missing(views);
            stream.feed.look_ahead(&missing);
        }
    }

    /// A photograph for a recording, or a band of it: as it lies on the device, or with its upload at this place of the recording. Its mask is
    /// for the caller to add.
    pub(super) fn record(&self, gpu: &Gpu, recorder: &mut Recorder, visit: &Visit) -> Result<Photograph<'_>, Error> {
        let Visit { view, step, band, recording } = *visit;
        let known = self.views.get(view).ok_or(Error::NoViews)?;
        let (first, bytes) = known.part(band);
        let buffer = match &self.place {
            Place::Resident(buffers, landing) => {
                let whole = buffers.get(view).ok_or(Error::NoViews)?;
                match landing.as_ref().filter(|_| band.is_some()) {
                    Some(landing) => {
                        recorder.copy(whole, first, landing, 0, bytes)?;
                        landing
                    }
                    None => whole,
                }
            }
            Place::Streamed(stream) => {
                let staging = stream.staged(gpu, known, view, step)?;
                let landing = &stream.landings[(recording % stream.landings.len().max(1) as u64) as usize];
                recorder.copy(staging, first, landing, 0, bytes)?;
                landing
            }
        };
        // The share of masked pixels is taken to be that of the whole photograph.
        let part_values = (f64::from(known.values) * bytes as f64 / known.bytes().max(1) as f64) as f32;
        let rows = band.map_or(known.size.1, |band| band.rows(known.size.1).1);
        let (bits, size) = (known.depth.bits(), (known.size.0, rows));
        Ok(Photograph { buffer, bits, size, values: known.values, part_values, mask: None })
    }

    /// How the photographs of the steps so far came; `None` when all are on the device.
    pub(super) fn counts(&self) -> Option<FeedCounts> {
        if let Place::Streamed(stream) = &self.place { Some(stream.before + stream.feed.counts()) } else { None }
    }

    /// The steps so far that had to wait for their photographs.
    pub(super) fn waits(&self) -> Vec<PhotographWait> {
        if let Place::Streamed(stream) = &self.place { lock(&stream.waits).clone() } else { Vec::new() }
    }

    /// Gives back what the host keeps of photographs: no step is to come.
    pub(super) fn release(&mut self) {
        if let Place::Streamed(stream) = &mut self.place {
            stream.before = stream.before + stream.feed.counts();
            stream.feed = Feed::new(Vec::new(), 0, 0);
        }
    }

    /// Bytes of the buffers that count as device memory.
    pub(super) fn bytes(&self, gpu: &Gpu) -> u64 {
        let bytes = |buffer: &Buffer| gpu.counted_bytes(buffer);
        match &self.place {
            Place::Resident(buffers, band) => buffers.iter().chain(band).map(bytes).sum(),
            Place::Streamed(stream) => stream.staging.iter().chain(&stream.landings).map(bytes).sum(),
        }
    }
}

impl Stream {
    /// The mapped buffer that a photograph lies in from now on.
    fn staged(&self, gpu: &Gpu, known: &Known, view: usize, step: u32) -> Result<&Buffer, Error> {
        let mut places = lock(&self.places);
        if let Some(place) = places.find(view) {
            self.feed.reused();
            return self.staging.get(place).ok_or(Error::NoViews);
        }
        let (pixels, waited) = self.feed.get_timed(view)?;
        if let Some(seconds) = waited {
            let device_idle = gpu.is_done(gpu.last_ticket())?;
            lock(&self.waits).push(PhotographWait { step, seconds, device_idle });
        }
        known.check(pixels.bytes().len())?;
        let place = places.clear_oldest().ok_or(Error::NoViews)?;
        let staging = self.staging.get(place).ok_or(Error::NoViews)?;
        gpu.store(staging, pixels.bytes())?;
        places.fill(place, view);
        Ok(staging)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Known {
    /// Of its pixels.
    fn bytes(&self) -> u64 {
        self.row_bytes() * u64::from(self.size.1)
    }

    fn row_bytes(&self) -> u64 {
        u64::from(self.size.0) * self.depth.bytes_per_pixel()
    }

    /// Of the largest of so many bands.
    fn bytes_of_band(&self, of: u32) -> u64 {
        let rows = |index| Band { index, of }.rows(self.size.1).1;
        self.row_bytes() * u64::from((0..of).map(rows).max().unwrap_or(0))
    }

    /// Where a band of it begins, and how many bytes it has; without one, all.
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
