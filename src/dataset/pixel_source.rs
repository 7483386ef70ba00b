//! Photographs that are asked for again and again, kept within a share of the host's memory: decoded where all fit,
//! else compressed as far as they fit, else read again.

use std::borrow::Cow;
use std::io::Cursor;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ExtendedColorType, ImageEncoder, ImageReader};

use super::error::Error;
use super::masks::MaskUse;
use super::photograph::{self, Photograph};
use super::pixels::{Depth, Pixels};
use super::poses::Coarse;
use super::{Dataset, Role, Samples, View, jpeg_reduced, picture_file, picture_size};

/// Photographs whose file holds this many times the pixels that are wanted, or more, are kept compressed at the wanted
/// size rather than as their file: decoding them again would cost as much again.
const COSTLY: f64 = 1.5;
/// A photograph packed without loss takes about this share of its pixels' bytes or more: below, packing is not tried.
const PACKED_SHARE: f64 = 0.25;

/// The share of the host's memory that photographs may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostShare {
    /// Bytes for those that are kept, decoded or compressed. What is kept is taken off.
    pub keep: u64,
    /// Bytes for those that are being decoded at one time; one always is.
    pub decoding: u64,
    /// Threads that decode.
    pub threads: usize,
}

impl HostShare {
    /// No limit, on every core.
    pub fn unlimited() -> Self {
        Self { keep: u64::MAX, decoding: u64::MAX, threads: cores() }
    }
}

/// Threads that this machine runs at a time.
pub(crate) fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Where the pixels of a photograph come from when they are asked for. Cloning gives another handle.
/// Alpha is 0 (masked) or full.
#[derive(Clone, Debug)]
pub struct Supply {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    place: Place,
    depth: Depth,
    masked: u32,
    clipped: u64,
    transparent: u64,
    mask: Option<MaskUse>,
    checksum: u32,
    /// Its colours in few cells, where its size is known.
    coarse: Option<Arc<Coarse>>,
}

#[derive(Debug)]
enum Place {
    Decoded(Arc<Pixels>),
    /// As a PNG file.
    Packed(Vec<u8>),
    /// Its own file, in memory.
    Held(Box<View>, Vec<u8>),
    /// Read again each time.
    File(Box<View>),
}

impl Supply {
    /// Of pixels that stay in memory. Alpha is masked or full from here on.
    pub fn of(mut pixels: Pixels) -> Self {
        pixels.harden_alpha();
        let (depth, masked) = (pixels.depth(), pixels.masked());
        let checksum = crc32fast::hash(pixels.bytes());
        Self {
            inner: Arc::new(Inner {
                place: Place::Decoded(Arc::new(pixels)),
                depth,
                masked,
                clipped: 0,
                transparent: 0,
                mask: None,
                checksum,
                coarse: None,
            }),
        }
    }

    /// The pixels: at once where they are kept decoded, else decoded now.
    pub fn pixels(&self) -> Result<Arc<Pixels>, Error> {
        let hardened = |photograph: Photograph| {
            let mut pixels = photograph.pixels;
            pixels.harden_alpha();
            Arc::new(pixels)
        };
        match &self.inner.place {
            Place::Decoded(pixels) => Ok(pixels.clone()),
            Place::Packed(bytes) => unpack(bytes, self.inner.depth).map(Arc::new),
            Place::Held(view, bytes) => photograph::decode_bytes(view, bytes).map(hardened),
            Place::File(view) => {
                let file = picture_file::read(&view.path)?;
                // What is no picture any more is told as that.
                let decoded = photograph::decode_bytes(view, &file)?;
                match checksum(&file, view)? == self.inner.checksum {
                    true => Ok(hardened(decoded)),
                    false => Err(Error::ChangedSince { file: view.path.clone() }),
                }
            }
        }
    }

    /// The file it comes from, for messages.
    pub fn file(&self) -> &Path {
        match &self.inner.place {
            Place::Held(view, _) | Place::File(view) => &view.path,
            Place::Decoded(_) | Place::Packed(_) => Path::new("(kept in memory)"),
        }
    }

    /// Bits per channel.
    pub fn depth(&self) -> Depth {
        self.inner.depth
    }

    /// Number of masked pixels.
    pub fn masked(&self) -> u32 {
        self.inner.masked
    }

    /// Pixels of the file that are brighter than the white level.
    pub fn clipped(&self) -> u64 {
        self.inner.clipped
    }

    /// Pixels of the file that are left out because they are less than half opaque.
    pub fn transparent(&self) -> u64 {
        self.inner.transparent
    }

    /// The use of its mask; `None` without a mask.
    pub fn mask(&self) -> Option<MaskUse> {
        self.inner.mask
    }

    /// CRC-32 of its file, or of the pixels where these were given: another one is another photograph.
    pub fn checksum(&self) -> u32 {
        self.inner.checksum
    }

    /// Its colours in few cells.
    pub(super) fn coarse(&self) -> Option<&Arc<Coarse>> {
        self.inner.coarse.as_ref()
    }

    /// Whether [`Self::pixels`] has nothing to do.
    pub fn is_decoded(&self) -> bool {
        matches!(self.inner.place, Place::Decoded(_))
    }

    /// Bytes that are kept for it.
    pub fn kept_bytes(&self) -> u64 {
        match &self.inner.place {
            Place::Decoded(pixels) => pixels.bytes().len() as u64,
            Place::Packed(bytes) | Place::Held(_, bytes) => bytes.len() as u64,
            Place::File(_) => 0,
        }
    }

    /// Bytes that decoding it takes, about; the pixels of what is kept packed come on top.
    pub fn decoding_bytes(&self) -> u64 {
        match &self.inner.place {
            Place::Decoded(_) => 0,
            Place::Packed(bytes) => bytes.len() as u64,
            Place::Held(view, _) | Place::File(view) => view.decoding_bytes(),
        }
    }
}

impl View {
    /// Bytes of the decoded photograph at the camera's size.
    pub fn pixel_bytes(&self) -> u64 {
        u64::from(self.camera.width) * u64::from(self.camera.height) * self.samples.depth().bytes_per_pixel()
    }

    /// Bytes that decoding it takes at its peak, the result included, about: the file, its pixels in two forms, and the
    /// rows that are reduced along columns already.
    pub fn decoding_bytes(&self) -> u64 {
        let divisor = jpeg_reduced::divisor(self);
        let (width, height) = (u64::from(self.size_on_disk.0 / divisor), u64::from(self.size_on_disk.1 / divisor));
        let per_pixel = picture_size::decoding_bytes_per_pixel(self.samples);
        let file = u64::from(self.size_on_disk.0) * u64::from(self.size_on_disk.1);
        let pixels = file + per_pixel * width * height;
        let same = (width, height) == (u64::from(self.camera.width), u64::from(self.camera.height));
        match &self.lens {
            None if same => pixels,
            None => pixels + 16 * width * u64::from(self.camera.height) + self.pixel_bytes(),
            Some(_) => pixels + self.pixel_bytes(),
        }
    }

    fn is_costly(&self) -> bool {
        let pixels = |(w, h): (u32, u32)| f64::from(w) * f64::from(h);
        let larger = pixels(self.size_on_disk) > COSTLY * pixels((self.camera.width, self.camera.height));
        larger || self.lens.is_some() || self.mask.is_some() || self.samples == Samples::Float
    }
}

impl Dataset {
    /// Decodes every photograph of a role once, several at a time, and keeps them as `share` allows; what is kept is
    /// taken off it. In the order of [`Dataset::views_of`]; `None` where every pixel is masked.
    /// No photograph of another role is read.
    pub fn take_in(&self, role: Role, share: &mut HostShare) -> Result<Vec<Option<Supply>>, Error> {
        // In the order of the names, so that the message about several problems does not depend on chance.
        self.decoded(role, share).into_iter().collect()
    }

    /// [`Self::take_in`] with the problem of each.
    pub(super) fn decoded(&self, role: Role, share: &mut HostShare) -> Vec<Result<Option<Supply>, Error>> {
        let views: Vec<&View> = self.views_of(role).map(|(_, view)| view).collect();
        let all: u64 = views.iter().map(|view| view.pixel_bytes()).sum();
        let intake = Intake { decoded: all <= share.keep, left: Mutex::new(share.keep) };
        let costs: Vec<u64> = views.iter().map(|view| view.decoding_bytes()).collect();
        let found = share.in_turns(&costs, |at| views.get(at).map_or(Ok(None), |view| intake.one(view)));
        share.keep = *lock(&intake.left);
        found
    }
}

struct Intake {
    decoded: bool,
    left: Mutex<u64>,
}

impl Intake {
    fn one(&self, view: &View) -> Result<Option<Supply>, Error> {
        let stored = picture_file::read(&view.path)?;
        let checksum = checksum(&stored, view)?;
        // Once: what is kept of it is decoded again and again.
        let file = match picture_file::whole(&view.path, &stored, view.limit)? {
            Cow::Borrowed(_) => stored,
            Cow::Owned(mended) => mended,
        };
        let Photograph { mut pixels, clipped, transparent, mask, .. } = photograph::decode_bytes(view, &file)?;
        pixels.harden_alpha();
        let (depth, masked) = (pixels.depth(), pixels.masked());
        if masked as usize == pixels.len() {
            return Ok(None);
        }
        let coarse = Coarse::of(&pixels, &view.camera).map(Arc::new);
        let place = self.place(view, file, pixels);
        Ok(Some(Supply {
            inner: Arc::new(Inner { place, depth, masked, clipped, transparent, mask, checksum, coarse }),
        }))
    }

    fn place(&self, view: &View, mut file: Vec<u8>, pixels: Pixels) -> Place {
        let raw = pixels.bytes().len() as u64;
        if self.decoded && self.reserve(raw) {
            return Place::Decoded(Arc::new(pixels));
        }
        if view.is_costly() {
            if (PACKED_SHARE * raw as f64) as u64 <= *lock(&self.left)
                && let Some(packed) = pack(&pixels, view)
                && self.reserve(packed.len() as u64)
            {
                return Place::Packed(packed);
            }
        } else if self.reserve(file.len() as u64) {
            file.shrink_to_fit();
            return Place::Held(Box::new(view.clone()), file);
        }
        Place::File(Box::new(view.clone()))
    }

    fn reserve(&self, bytes: u64) -> bool {
        let mut left = lock(&self.left);
        match left.checked_sub(bytes) {
            Some(rest) => {
                *left = rest;
                true
            }
            None => false,
        }
    }
}

/// Of the file and its mask: what the pixels are made of.
fn checksum(file: &[u8], view: &View) -> Result<u32, Error> {
    let mut all = crc32fast::Hasher::new();
    all.update(file);
    if let Some(mask) = &view.mask {
        all.update(&picture_file::read(mask)?);
    }
    Ok(all.finalize())
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Without loss.
fn pack(pixels: &Pixels, view: &View) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let kind = match pixels.depth() {
        Depth::Eight => ExtendedColorType::Rgba8,
        Depth::Sixteen => ExtendedColorType::Rgba16,
    };
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Paeth)
        .write_image(pixels.bytes(), view.camera.width, view.camera.height, kind)
        .ok()?;
    bytes.shrink_to_fit();
    Some(bytes)
}

fn unpack(bytes: &[u8], depth: Depth) -> Result<Pixels, Error> {
    let failed =
        |problem: &dyn std::fmt::Display| Error::undecodable("(kept in memory)".as_ref(), "pixels", 0, problem);
    let reader = ImageReader::with_format(Cursor::new(bytes), image::ImageFormat::Png);
    let decoder = reader.into_decoder().map_err(|e| failed(&e))?;
    match (depth, DynamicImage::from_decoder(decoder).map_err(|e| failed(&e))?) {
        (Depth::Eight, image) => Ok(Pixels::Rgba8(image.into_rgba8().into_raw())),
        (Depth::Sixteen, image) => Ok(Pixels::Rgba16(image.into_rgba16().into_raw())),
    }
}
