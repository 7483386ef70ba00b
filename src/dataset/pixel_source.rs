//! Photographs that are needed repeatedly, kept within a share of the host's memory. They are kept decoded if all fit,
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

/// Photographs whose file has at least this many times the wanted pixels are kept compressed at the wanted size instead
/// of as their file: decoding the file repeatedly would cost that much more.
const COSTLY: f64 = 1.5;
/// A losslessly packed photograph takes at least about this share of its pixels' bytes. With less memory, packing is
/// not tried.
const PACKED_SHARE: f64 = 0.25;

/// The share of the host's memory that photographs may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostShare {
    /// Bytes for kept photographs, decoded or compressed. Each kept photograph reduces this number.
    pub keep: u64,
    /// Bytes for photographs that are being decoded at one time. One photograph is always decoded.
    pub decoding: u64,
    /// Threads that decode.
    pub threads: usize,
}

impl HostShare {
    /// No memory limit, and threads on every core.
    pub fn unlimited() -> Self {
        Self { keep: u64::MAX, decoding: u64::MAX, threads: cores() }
    }
}

/// Number of threads that this machine runs in parallel.
pub(crate) fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// The pixels of a photograph, kept or decoded on request. A clone is another handle. Alpha is 0 (masked) or opaque.
#[derive(Clone, Debug)]
pub struct Supply {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    place: PixelStore,
    depth: Depth,
    masked: u32,
    clipped: u64,
    transparent: u64,
    mask: Option<MaskUse>,
    checksum: u32,
    /// The photograph's colours in a few cells, where its size is known.
    coarse: Option<Arc<Coarse>>,
}

#[derive(Debug)]
enum PixelStore {
    Decoded(Arc<Pixels>),
    /// A PNG file in memory.
    Packed(Vec<u8>),
    /// The photograph's own file in memory.
    Held(Box<View>, Vec<u8>),
    /// The file on disk, read again on each request.
    File(Box<View>),
}

impl Supply {
    /// Pixels that stay in memory. Their alpha becomes 0 (masked) or opaque.
    pub fn of(mut pixels: Pixels) -> Self {
        pixels.harden_alpha();
        let (depth, masked) = (pixels.depth(), pixels.masked());
        let checksum = crc32fast::hash(pixels.bytes());
        Self {
            inner: Arc::new(Inner {
                place: PixelStore::Decoded(Arc::new(pixels)),
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

    /// The pixels: kept ones, else decoded now.
    pub fn pixels(&self) -> Result<Arc<Pixels>, Error> {
        let hardened = |photograph: Photograph| {
            let mut pixels = photograph.pixels;
            pixels.harden_alpha();
            Arc::new(pixels)
        };
        match &self.inner.place {
            PixelStore::Decoded(pixels) => Ok(pixels.clone()),
            PixelStore::Packed(bytes) => unpack(bytes, self.inner.depth).map(Arc::new),
            PixelStore::Held(view, bytes) => photograph::decode_bytes(view, bytes).map(hardened),
            PixelStore::File(view) => {
                let file = picture_file::read(&view.path)?;
                // A file that is no picture any more is reported as undecodable, not as changed.
                let decoded = photograph::decode_bytes(view, &file)?;
                match checksum(&file, view)? == self.inner.checksum {
                    true => Ok(hardened(decoded)),
                    false => Err(Error::ChangedSince { file: view.path.clone() }),
                }
            }
        }
    }

    /// The photograph's file, for messages.
    pub fn file(&self) -> &Path {
        match &self.inner.place {
            PixelStore::Held(view, _) | PixelStore::File(view) => &view.path,
            PixelStore::Decoded(_) | PixelStore::Packed(_) => Path::new("(kept in memory)"),
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

    /// How the mask is used; `None` without a mask.
    pub fn mask(&self) -> Option<MaskUse> {
        self.inner.mask
    }

    /// CRC-32 of the file and its mask, or of the pixels if they were given. Another number is another photograph.
    pub fn checksum(&self) -> u32 {
        self.inner.checksum
    }

    /// The photograph's colours in a few cells.
    pub(super) fn coarse(&self) -> Option<&Arc<Coarse>> {
        self.inner.coarse.as_ref()
    }

    /// Whether [`Self::pixels`] returns kept pixels.
    pub fn is_decoded(&self) -> bool {
        matches!(self.inner.place, PixelStore::Decoded(_))
    }

    /// Bytes kept in memory.
    pub fn kept_bytes(&self) -> u64 {
        match &self.inner.place {
            PixelStore::Decoded(pixels) => pixels.bytes().len() as u64,
            PixelStore::Packed(bytes) | PixelStore::Held(_, bytes) => bytes.len() as u64,
            PixelStore::File(_) => 0,
        }
    }

    /// Approximate bytes for decoding, without the pixels of a packed photograph.
    pub fn decoding_bytes(&self) -> u64 {
        match &self.inner.place {
            PixelStore::Decoded(_) => 0,
            PixelStore::Packed(bytes) => bytes.len() as u64,
            PixelStore::Held(view, _) | PixelStore::File(view) => view.decoding_bytes(),
        }
    }
}

impl View {
    /// Bytes of the photograph's pixels at the camera's size.
    pub fn pixel_bytes(&self) -> u64 {
        u64::from(self.camera.width) * u64::from(self.camera.height) * self.samples.depth().bytes_per_pixel()
    }

    /// Approximate peak bytes for decoding the photograph, its result included: the file, its pixels in two forms, and
    /// the rows already reduced along columns.
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
    /// Decodes every photograph of a role once, several at a time, and keeps them as `share` allows. Kept photographs
    /// reduce `share`. Returns the photographs in the order of [`Dataset::views_of`], `None` for a photograph with
    /// every pixel masked. Reads no photograph of another role.
    pub fn take_in(&self, role: Role, share: &mut HostShare) -> Result<Vec<Option<Supply>>, Error> {
        // The first problem in the order of the names is returned, so that the message does not depend on chance.
        self.decoded(role, share).into_iter().collect()
    }

    /// [`Self::take_in`] with one result per photograph.
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
        // Mended once: the kept file is decoded repeatedly.
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

    fn place(&self, view: &View, mut file: Vec<u8>, pixels: Pixels) -> PixelStore {
        let raw = pixels.bytes().len() as u64;
        if self.decoded && self.reserve(raw) {
            return PixelStore::Decoded(Arc::new(pixels));
        }
        if view.is_costly() {
            if (PACKED_SHARE * raw as f64) as u64 <= *lock(&self.left)
                && let Some(packed) = pack(&pixels, view)
                && self.reserve(packed.len() as u64)
            {
                return PixelStore::Packed(packed);
            }
        } else if self.reserve(file.len() as u64) {
            file.shrink_to_fit();
            return PixelStore::Held(Box::new(view.clone()), file);
        }
        PixelStore::File(Box::new(view.clone()))
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

/// CRC-32 of the file and its mask, from which the pixels are made.
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

/// Packs pixels losslessly.
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
