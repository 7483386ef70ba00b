//! OpenEXR, lossless f32: depth in the channel `Z` as compositing programs expect, normals in `N.X`, `N.Y`, `N.Z`.

use std::io::{Cursor, Read};
use std::path::Path;

use exr::meta::MetaData;
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes, LineOrder,
    ReadChannels, ReadLayers, WritableImage,
};

use super::check_size;
use crate::byte_size::readable;
use crate::format::contain::contained;
use crate::format::{At, Error, atomic, foreign, source};
use crate::host_memory::{DecodeLimit, NoMemory};

/// The first bytes of an OpenEXR file.
const MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// Depths in rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Depth along the camera's z axis, in the writer's units.
    pub values: Vec<f32>,
}

/// Writes one depth per pixel.
pub fn write_depth(file: &Path, width: u32, height: u32, depths: &[f32]) -> Result<(), Error> {
    check_size(file, width, height, depths.len(), true)?;
    write(file, width, height, vec![("Z", depths.to_vec())])
}

/// Writes one value per pixel as channel `Y`, which programs show as grey. [`read_depth`] can read the file.
pub fn write_luminance(file: &Path, width: u32, height: u32, values: &[f32]) -> Result<(), Error> {
    check_size(file, width, height, values.len(), true)?;
    write(file, width, height, vec![("Y", values.to_vec())])
}

/// Writes one normal per pixel.
pub fn write_normals(file: &Path, width: u32, height: u32, normals: &[[f32; 3]]) -> Result<(), Error> {
    check_size(file, width, height, normals.len(), true)?;
    let channel = |k: usize| normals.iter().map(|n| n[k]).collect();
    write(file, width, height, vec![("N.X", channel(0)), ("N.Y", channel(1)), ("N.Z", channel(2))])
}

fn write(file: &Path, width: u32, height: u32, channels: Vec<(&str, Vec<f32>)>) -> Result<(), Error> {
    let list = channels.into_iter().map(|(name, values)| AnyChannel::new(name, FlatSamples::F32(values))).collect();
    let encoding =
        Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let size = (width as usize, height as usize);
    let image = Image::from_layer(Layer::new(size, LayerAttributes::default(), encoding, AnyChannels::sort(list)));
    let mut bytes = Cursor::new(Vec::new());
    image.write().non_parallel().to_buffered(&mut bytes).map_err(|e| Error::Unwritable {
        file: file.to_owned(),
        what: "the EXR",
        problem: e.to_string(),
    })?;
    atomic::write(file, |out| out.write_all(bytes.get_ref()))
}

/// Normals in rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct NormalMap {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Unit normals in the writer's frame.
    pub values: Vec<[f32; 3]>,
}

/// Reads the channel `Z`, or the only channel of a file, within half of the free memory.
pub fn read_depth(file: &Path) -> Result<DepthMap, Error> {
    read_depth_within(file, DecodeLimit::new(None))
}

/// [`read_depth`] within a memory limit.
pub fn read_depth_within(file: &Path, limit: DecodeLimit) -> Result<DepthMap, Error> {
    let (width, height, mut channels) = read(file, &["Z"], limit)?;
    Ok(DepthMap { width, height, values: channels.remove(0) })
}

/// Reads the channels `N.X`, `N.Y` and `N.Z` within half of the free memory.
pub fn read_normals(file: &Path) -> Result<NormalMap, Error> {
    read_normals_within(file, DecodeLimit::new(None))
}

/// [`read_normals`] within a memory limit.
pub fn read_normals_within(file: &Path, limit: DecodeLimit) -> Result<NormalMap, Error> {
    let (width, height, channels) = read(file, &["N.X", "N.Y", "N.Z"], limit)?;
    let values = (0..channels[0].len()).map(|i| [0, 1, 2].map(|k| channels[k][i])).collect();
    Ok(NormalMap { width, height, values })
}

/// Width, height, and the values of the named channels. A single name also matches a file's only channel.
fn read(file: &Path, names: &[&str], limit: DecodeLimit) -> Result<(u32, u32, Vec<Vec<f32>>), Error> {
    let (mut opened, length) = source::open(file)?;
    let mut bytes = Vec::new();
    opened.read_to_end(&mut bytes).map_err(Error::io(file, "read"))?;
    let begin = &bytes[..bytes.len().min(foreign::LOOKED_AT)];
    if !begin.starts_with(&MAGIC)
        && let Some(problem) = foreign::described(file, length, begin)
    {
        return Err(Error::malformed(file, "header", At::Byte(0), problem));
    }
    let mut cursor = Cursor::new(bytes.as_slice());
    let header = contained(|| MetaData::read_from_buffered(&mut cursor, false).map_err(|e| e.to_string()));
    let fail = |field: &str, at: u64, problem: String| Error::malformed(file, field, At::Byte(at), problem);
    let header = header.flatten().map_err(|problem| fail("header", cursor.position(), problem))?;
    let mut samples = 0_u64;
    for layer in &header.headers {
        let (size, channels) = (layer.layer_size, layer.channels.list.len());
        check_memory(file, size.0, size.1, channels, bytes.len())?;
        samples = samples.saturating_add((size.0 * size.1 * channels.max(1)) as u64);
    }
    check_limit(file, samples, limit)?;
    cursor.set_position(0);
    let image = contained(|| {
        let reader = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels();
        let reader = reader.first_valid_layer().all_attributes().non_parallel();
        reader.from_buffered(&mut cursor).map_err(|e| e.to_string())
    });
    let layer = image.flatten().map_err(|problem| fail("pixels", cursor.position(), problem))?.layer_data;
    let side = |v: usize| u32::try_from(v).map_err(|_| fail("size", 0, format!("a side of {v} is too long")));
    let (width, height) = (side(layer.size.0)?, side(layer.size.1)?);
    let channels = &layer.channel_data.list;
    let values = |name: &&str| {
        let channel = match (channels.as_slice(), names) {
            ([only], [_]) => Some(only),
            (several, _) => several.iter().find(|c| c.name.eq(name)),
        };
        let channel = channel.ok_or_else(|| {
            let names: Vec<String> = channels.iter().map(|c| c.name.to_string()).collect();
            fail("channels", 0, format!("there is no channel '{name}' among {}", names.join(", ")))
        })?;
        let values: Vec<f32> = channel.sample_data.values_as_f32().collect();
        if values.len() as u64 != u64::from(width) * u64::from(height) {
            return Err(fail("channel", 0, format!("{} values are not {width}x{height}", values.len())));
        }
        Ok(values)
    };
    let planes = names.iter().map(values).collect::<Result<Vec<_>, Error>>()?;
    Ok((width, height, planes))
}

/// Compression gains little more than a factor of 1000 (deflate reaches 1032). A larger factor means a damaged size.
fn check_memory(file: &Path, width: usize, height: usize, channels: usize, bytes: usize) -> Result<(), Error> {
    let wanted = width.checked_mul(height).and_then(|n| n.checked_mul(channels.max(1)));
    if wanted.is_some_and(|n| n / 1100 <= bytes) {
        return Ok(());
    }
    let problem = format!("{width}x{height} pixels of {channels} channels cannot be in {bytes} bytes");
    Err(Error::malformed(file, "size", At::Byte(0), problem))
}

/// Bytes per sample during decoding: as stored, unpacked, in its channel, and in the resulting map.
const SAMPLE_BYTES: u64 = 16;

/// Refuses a map whose decoding exceeds the limit or the free memory.
fn check_limit(file: &Path, samples: u64, limit: DecodeLimit) -> Result<(), Error> {
    let needed = samples.saturating_mul(SAMPLE_BYTES);
    let problem = match limit.has_room_for(needed) {
        Ok(()) => return Ok(()),
        Err(NoMemory::OverLimit) => format!(
            "decoding it takes {} of memory, of which {} may be used; store a smaller picture, or {}",
            readable(needed),
            readable(limit.most),
            if limit.asked { "allow more host memory" } else { "use a machine with more memory" }
        ),
        Err(NoMemory::Refused) => {
            format!("decoding it takes {} of memory, which the system does not give; free memory", readable(needed))
        }
    };
    Err(Error::malformed(file, "size", At::Byte(0), problem))
}
