//! Laser scans in LAS and compressed LAZ files (ASPRS LAS 1.0 to 1.4).

mod items;
mod write;

use std::fmt::Display;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use las::point::Classification;
use las::{Point, Reader};

use super::contain::contained;
use super::source::Source;
use super::{At, Error};

pub use write::{CloudPoint, Coordinates, Written, write};

/// The first bytes of a LAS file.
pub(crate) const MAGIC: [u8; 4] = *b"LASF";
/// Bytes of the shortest header (LAS 1.0 to 1.2).
const SHORTEST_HEADER: u64 = 227;
/// Bytes of the header of LAS 1.4.
const HEADER_OF_4: u64 = 375;
/// Bytes of a record of each point format without extra bytes.
const RECORD_BYTES: [u16; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];
/// Point formats from this number on are compressed in layers.
const LAYERED_FROM: u8 = 6;
/// Bytes of an extended record's header.
const EXTENDED_HEAD: u64 = 60;
/// Bits of the point format that mark compression.
const COMPRESSED: u8 = 0xc0;
/// Least bytes of a chunk, which has a whole first point and the sizes of its parts.
const LEAST_CHUNK: u64 = 24;
/// Most compressed points per byte. Scans have fewer than one, but the decoder finds thousands in bytes that repeat the
/// last point.
const MOST_PER_BYTE: u64 = 16;
/// Points decoded at a time.
const BATCH: u64 = 1 << 16;

/// The fields of the header that describe the rest of the file.
struct Header {
    points: u64,
    data: u64,
    format: u8,
    record: u16,
    compressed: bool,
}

/// Reads the positions of a LAS or LAZ file, with its scale and offset applied in double precision. Points marked as
/// withheld or as noise are left out. Sizes in the header are checked against the file's size before memory is
/// allocated.
pub fn read(file: &Path) -> Result<Vec<[f64; 3]>, Error> {
    let header = header(file)?;
    if header.compressed {
        compressed_sizes(file, &header)?;
    }
    contained(|| points(file, &header))
        .unwrap_or_else(|problem| Err(Error::malformed(file, "point data", At::Byte(header.data), problem)))
}

fn header(file: &Path) -> Result<Header, Error> {
    let mut source = Source::open(file)?;
    let len = source.remaining();
    if source.array::<4>("signature")? != MAGIC {
        return Err(source.error(0, "signature", "a LAS or LAZ file begins with 'LASF'"));
    }
    let head = source.bytes(SHORTEST_HEADER - 4, "header")?;
    let byte = |at: usize| head.get(at - 4).copied().unwrap_or(0);
    let word = |at: usize| u16::from_le_bytes([byte(at), byte(at + 1)]);
    let double = |at: usize| u32::from_le_bytes([byte(at), byte(at + 1), byte(at + 2), byte(at + 3)]);
    let float = |at: usize| f64::from_le_bytes(std::array::from_fn(|k| byte(at + k)));

    let (major, minor) = (byte(24), byte(25));
    if major != 1 || minor > 4 {
        return Err(source.error(24, "version", format_args!("is {major}.{minor}; 1.0 to 1.4 are known")));
    }
    let least = if minor == 4 { HEADER_OF_4 } else { SHORTEST_HEADER };
    let (size, data) = (u64::from(word(94)), u64::from(double(96)));
    if size < least || size > len {
        let problem = format_args!("is {size}; version 1.{minor} has at least {least}, the file has {len} bytes");
        return Err(source.error(94, "header size", problem));
    }
    if data < size || data > len {
        let problem = format_args!("is {data}; the header has {size} bytes, the file {len}");
        return Err(source.error(96, "offset to point data", problem));
    }
    let (format, record) = (byte(104) & !COMPRESSED, word(105));
    let Some(known) = RECORD_BYTES.get(usize::from(format)) else {
        return Err(source.error(104, "point format", format_args!("is {format}; 0 to 10 are known")));
    };
    if record < *known {
        let problem = format_args!("is {record}; points of format {format} have at least {known} bytes");
        return Err(source.error(105, "point record length", problem));
    }
    for (k, name) in ["x scale", "y scale", "z scale", "x offset", "y offset", "z offset"].into_iter().enumerate() {
        let value = float(131 + 8 * k);
        if !value.is_finite() || (k < 3 && value == 0.0) {
            return Err(source.error(131 + 8 * k as u64, name, format_args!("is {value}")));
        }
    }
    // Coordinates are 32-bit integers with a scale and an offset.
    for (k, axis) in ["x", "y", "z"].into_iter().enumerate() {
        let (scale, offset) = (float(131 + 8 * k), float(155 + 8 * k));
        if !(scale * 2_f64.powi(31) + offset.abs().copysign(scale)).is_finite() {
            let problem = format_args!("{scale:e} makes coordinates that are not finite");
            return Err(source.error(131 + 8 * k as u64, format_args!("{axis} scale"), problem));
        }
    }
    let mut count = (107, u64::from(double(107)));
    if minor == 4 {
        source.skip(8, "start of waveforms")?;
        let (first, extended) = (source.u64("start of extended records")?, source.u32("extended records")?);
        let all = source.u64("number of points")?;
        if count.1 == 0 {
            count = (247, all);
        }
        extended_records(file, first, extended)?;
    }
    let (at, points) = count;
    let compressed = byte(104) & COMPRESSED != 0;
    if compressed {
        items::check(file, size, double(100), record, *known)?;
    }
    if compressed && points / MOST_PER_BYTE > len - data {
        let problem = format_args!("is {points}, which cannot be in the {} bytes from byte {data} on", len - data);
        return Err(source.error(at, "number of points", problem));
    }
    let fits = points.checked_mul(u64::from(record)).is_some_and(|bytes| bytes <= len - data);
    if !compressed && !fits {
        let problem = format_args!(
            "is {points}, of {record} bytes each from byte {data} on; the file has {} bytes from there",
            len - data
        );
        return Err(source.error(at, "number of points", problem));
    }
    Ok(Header { points, data, format, record, compressed })
}

/// Checks that the records after the points lie within the file.
fn extended_records(file: &Path, first: u64, records: u32) -> Result<(), Error> {
    let mut source = Source::open(file)?;
    if records == 0 {
        return Ok(());
    }
    source.skip(first, "start of extended records")?;
    for record in 0..records {
        source.skip(20, format_args!("extended record {record}"))?;
        let bytes = source.u64(format_args!("length of extended record {record}"))?;
        source.skip(EXTENDED_HEAD - 28, format_args!("extended record {record}"))?;
        source.skip(bytes, format_args!("extended record {record}"))?;
    }
    Ok(())
}

/// Checks that the sizes for which the decoder allocates memory lie within the file.
fn compressed_sizes(file: &Path, header: &Header) -> Result<(), Error> {
    let mut source = Source::open(file)?;
    source.skip(header.data, "point data")?;
    let at = source.at();
    let mut table = i64::from_le_bytes(source.array("offset to chunk table")?);
    let data = source.at();
    let len = data + source.remaining();
    if table <= at as i64 {
        // Writers that cannot seek back put the offset at the end of the file.
        let mut end = Source::open(file)?;
        end.skip(len - 8, "offset to chunk table")?;
        table = i64::from_le_bytes(end.array("offset to chunk table")?);
    }
    let table = u64::try_from(table).unwrap_or(0).max(data);
    let mut chunks = Source::open(file)?;
    chunks.skip(table, "chunk table")?;
    chunks.skip(4, "version of the chunk table")?;
    let (place, count) = (chunks.at(), chunks.u32("number of chunks")?);
    if u64::from(count) * LEAST_CHUNK > len {
        return Err(chunks.error(place, "number of chunks", format_args!("is {count}; the file has {len} bytes")));
    }
    if header.format < LAYERED_FROM {
        return Ok(());
    }
    let extra = header.record - RECORD_BYTES[usize::from(header.format)];
    let of_format = match header.format {
        6 => 9,
        7 | 9 => 10,
        8 => 11,
        _ => 12,
    };
    let mut left = header.points;
    while left > 0 {
        source.skip(u64::from(header.record), "first point of a chunk")?;
        let place = source.at();
        let points = u64::from(source.u32("points of a chunk")?);
        if points == 0 {
            return Err(source.error(place, "points of a chunk", "is 0"));
        }
        let mut layers = 0;
        for _ in 0..of_format + extra {
            layers += u64::from(source.u32("size of a layer")?);
        }
        source.skip(layers, "layers of a chunk")?;
        left = left.saturating_sub(points);
    }
    Ok(())
}

fn points(file: &Path, header: &Header) -> Result<Vec<[f64; 3]>, Error> {
    let wrong = |problem: &dyn Display, done: u64| {
        let at = if header.compressed { header.data } else { header.data + done * u64::from(header.record) };
        Error::malformed(file, format_args!("point data from point {done} on"), At::Byte(at), problem)
    };
    let opened = File::open(file).map_err(Error::io(file, "open"))?;
    let mut reader = Reader::new(BufReader::with_capacity(1 << 16, opened))
        .map_err(|e| Error::malformed(file, "header", At::Byte(0), e))?;
    let mut positions = Vec::new();
    let (mut batch, mut done): (Vec<Point>, u64) = (Vec::new(), 0);
    while done < header.points {
        batch.clear();
        let got = reader.read_points_into(BATCH.min(header.points - done), &mut batch).map_err(|e| wrong(&e, done))?;
        if got == 0 {
            return Err(wrong(&"it ends too early", done));
        }
        done += got;
        let noise = |p: &&Point| {
            p.is_withheld || matches!(p.classification, Classification::LowPoint | Classification::HighNoise)
        };
        positions.extend(batch.iter().filter(|p| !noise(p)).map(|p| [p.x, p.y, p.z]));
    }
    Ok(positions)
}
