//! Reads SPZ files.

use std::f32::consts::FRAC_1_SQRT_2;
use std::io::Read;
use std::path::Path;

use super::super::decoding::{damaged, finished, set_coefficient, splat_count};
use super::super::encoding::{logit_of_alpha, rest};
use super::super::flip::flipped;
use super::{ANTIALIASED, COLOUR, EXTENSIONS, HEADER, MAGIC, OLD_HEADER, parts};
use crate::format::ply::Model;
use crate::format::{At, Error};
use crate::scene::Gaussians;

/// Identifier of the record that names other axes (SPZ_ADOBE_coordinate_system), and the number of the usual axes.
const AXES: u32 = 0xadbe_0003;
const RIGHT_UP_BACK: u32 = 4;

/// Most bytes of other programs' data after the splats that are looked at.
const MOST_EXTENSIONS: u64 = 1 << 24;

/// The fields of a header.
struct Header {
    version: u32,
    splats: usize,
    degree: u32,
    bits: u32,
    flags: u8,
}

/// A model from the bytes of an SPZ file. `file` is its name, for messages. A few splats that are not finite are left
/// out; where `strict` is set they are an error.
pub fn decode(file: &Path, bytes: &[u8], strict: bool) -> Result<Model, Error> {
    let (header, parts) = if bytes.starts_with(&MAGIC) { of_streams(file, bytes)? } else { of_gzip(file, bytes)? };
    let antialias = Some(header.flags & ANTIALIASED != 0);
    let gaussians = flipped(&unpacked(&header, &parts));
    finished(file, Model { gaussians, sh_degree: header.degree, antialias, ..Model::default() }, strict)
}

impl Header {
    /// The fields from the first 16 bytes, in a file of `bytes` bytes.
    fn read(file: &Path, head: &[u8], bytes: usize) -> Result<Self, Error> {
        let wrong = |field: &str, at: u64, problem: String| Error::malformed(file, field, At::Byte(at), problem);
        let Some(&[m0, m1, m2, m3, v0, v1, v2, v3, n0, n1, n2, n3, degree, bits, flags, _]) = head.get(..OLD_HEADER)
        else {
            return Err(damaged(file, "header", At::Byte(head.len() as u64), "the file ends here"));
        };
        if [m0, m1, m2, m3] != MAGIC {
            return Err(wrong("magic", 0, "an SPZ file begins with 'NGSP', packed by gzip or not".to_owned()));
        }
        let version = u32::from_le_bytes([v0, v1, v2, v3]);
        if !(1..=4).contains(&version) {
            return Err(wrong(
                "version",
                4,
                format!("is {version}; 1 to 4 are known: convert the file to one of them"),
            ));
        }
        let splats = splat_count(file, u64::from(u32::from_le_bytes([n0, n1, n2, n3])), bytes, At::Byte(8))?;
        if degree > 3 {
            let problem = format!("is {degree}; 0 to 3 are known: convert the file to one of them");
            return Err(wrong("degree of the spherical harmonics", 12, problem));
        }
        if bits > 24 {
            return Err(damaged(file, "fractional bits", At::Byte(13), format_args!("are {bits}, of 24")));
        }
        Ok(Self { version, splats, degree: u32::from(degree), bits: u32::from(bits), flags })
    }

    /// Bytes of each part of the file.
    fn sizes(&self) -> [usize; 6] {
        parts(self.version, self.degree).map(|bytes| bytes * self.splats)
    }
}

/// The parts of a file of version 4.
fn of_streams(file: &Path, bytes: &[u8]) -> Result<(Header, [Vec<u8>; 6]), Error> {
    let header = Header::read(file, bytes, bytes.len())?;
    let short = |at: usize| damaged(file, "table of streams", At::Byte(at as u64), "the file ends here");
    if header.version != 4 {
        let problem = format!("is {}, and such a file is packed by gzip", header.version);
        return Err(damaged(file, "version", At::Byte(4), problem));
    }
    let head = bytes.get(..HEADER).ok_or_else(|| short(bytes.len()))?;
    let table = u32::from_le_bytes([head[16], head[17], head[18], head[19]]) as usize;
    if header.flags & EXTENSIONS != 0 {
        check_axes(file, bytes.get(HEADER..table).ok_or_else(|| short(16))?)?;
    }
    let sizes = header.sizes();
    let used = sizes.iter().filter(|size| **size > 0).count();
    if usize::from(head[15]) != used || table < HEADER {
        let problem = format!("{} streams from byte {table} on, where {used} are needed", head[15]);
        return Err(damaged(file, "table of streams", At::Byte(15), problem));
    }
    let rows = bytes.get(table..).and_then(|rest| rest.get(..16 * used)).ok_or_else(|| short(table))?;
    let mut rest = &bytes[table + 16 * used..];
    let mut rows = rows.chunks_exact(8).map(|word| u64::from_le_bytes(word.try_into().unwrap_or_default()));
    let mut parts: [Vec<u8>; 6] = Default::default();
    for (part, size) in parts.iter_mut().zip(sizes).filter(|(_, size)| *size > 0) {
        let (packed, claimed) = (rows.next().unwrap_or(0), rows.next().unwrap_or(0));
        let at = bytes.len() - rest.len();
        let wrong = |problem: String| damaged(file, "stream", At::Byte(at as u64), problem);
        if claimed != size as u64 {
            return Err(wrong(format!("{claimed} bytes are told, {size} belong to the number of splats")));
        }
        let stream = usize::try_from(packed).ok().and_then(|packed| rest.split_at_checked(packed));
        let (stream, next) = stream.ok_or_else(|| wrong(format!("{packed} bytes do not fit the file")))?;
        rest = next;
        let decoder = zstd::stream::read::Decoder::with_buffer(stream).map_err(|e| wrong(e.to_string()))?;
        *part = exactly(decoder, size).map_err(wrong)?;
    }
    Ok((header, parts))
}

/// The parts of a file of an earlier version.
fn of_gzip(file: &Path, bytes: &[u8]) -> Result<(Header, [Vec<u8>; 6]), Error> {
    let wrong = |problem: String| damaged(file, "gzip stream", At::Byte(0), problem);
    let mut decoder = flate2::read::GzDecoder::new(bytes);
    let head = exactly(&mut decoder, OLD_HEADER).map_err(wrong)?;
    let header = Header::read(file, &head, bytes.len())?;
    if header.version == 4 {
        return Err(damaged(file, "version", At::Byte(4), "is 4, and such a file is not packed by gzip"));
    }
    let mut parts: [Vec<u8>; 6] = Default::default();
    for (part, size) in parts.iter_mut().zip(header.sizes()) {
        *part = exactly(&mut decoder, size).map_err(wrong)?;
    }
    // Data of other programs may follow. The end of the stream has a checksum of all of it.
    let rest = std::io::copy(&mut decoder.take(MOST_EXTENSIONS), &mut std::io::sink());
    rest.map_err(|e| damaged(file, "gzip stream", At::Byte(0), e))?;
    Ok((header, parts))
}

/// The next `size` bytes. Memory grows with what is there.
fn exactly(from: impl Read, size: usize) -> Result<Vec<u8>, String> {
    let mut out = Vec::new();
    from.take(size as u64).read_to_end(&mut out).map_err(|e| e.to_string())?;
    if out.len() == size { Ok(out) } else { Err(format!("{} bytes are there, {size} are needed", out.len())) }
}

/// Refuses axes that are not the usual ones, among the records of other programs.
fn check_axes(file: &Path, mut records: &[u8]) -> Result<(), Error> {
    let word = |at: usize, from: &[u8]| Some(u32::from_le_bytes(from.get(at..at + 4)?.try_into().ok()?));
    while let (Some(kind), Some(bytes)) = (word(0, records), word(4, records)) {
        if kind == AXES && word(8, records).is_some_and(|axes| axes != RIGHT_UP_BACK) {
            let problem = "axes other than right, up, back are not supported: convert the file to these axes";
            return Err(Error::malformed(file, "extension record", At::Byte(HEADER as u64), problem));
        }
        records = records.get(8_usize.saturating_add(bytes as usize)..).unwrap_or_default();
    }
    Ok(())
}

/// The splats in the axes of the file.
fn unpacked(header: &Header, [positions, alphas, colours, scales, rotations, harmonics]: &[Vec<u8>; 6]) -> Gaussians {
    let mut g = Gaussians::zeros(header.splats);
    if header.version == 1 {
        let halves = positions.chunks_exact(2).map(|b| half::f16::from_le_bytes([b[0], b[1]]).to_f32());
        g.means.iter_mut().zip(halves).for_each(|(v, half)| *v = half);
    } else {
        let step = 1.0 / f64::from(1_u32 << header.bits);
        // The sign is extended from 24 to 32 bits.
        let fixed = positions.chunks_exact(3).map(|b| i32::from_le_bytes([0, b[0], b[1], b[2]]) >> 8);
        g.means.iter_mut().zip(fixed).for_each(|(v, fixed)| *v = (f64::from(fixed) * step) as f32);
    }
    g.opacities.iter_mut().zip(alphas).for_each(|(v, alpha)| *v = logit_of_alpha(*alpha));
    g.scales.iter_mut().zip(scales).for_each(|(v, b)| *v = f32::from(*b) / 16.0 - 10.0);
    let rest = rest(header.degree);
    for i in 0..header.splats {
        for c in 0..3 {
            let colour = (f64::from(colours[3 * i + c]) - 127.5) / COLOUR;
            set_coefficient(&mut g, i, 0, c, colour as f32);
            for k in 0..rest {
                let value = (f32::from(harmonics[3 * (rest * i + k) + c]) - 128.0) / 128.0;
                set_coefficient(&mut g, i, k + 1, c, value);
            }
        }
        let [x, y, z, w] = match header.version {
            1 | 2 => first_three([0, 1, 2].map(|k| rotations[3 * i + k])),
            _ => smallest_three(u32::from_le_bytes([0, 1, 2, 3].map(|k| rotations[4 * i + k]))),
        };
        g.quats[4 * i..4 * i + 4].copy_from_slice(&[w, x, y, z]);
    }
    g
}

fn first_three(bytes: [u8; 3]) -> [f32; 4] {
    let [x, y, z] = bytes.map(|b| f32::from(b) / 127.5 - 1.0);
    let squares = x * x + y * y + z * z;
    // Rounding can make the three a little longer than one.
    let length = squares.max(1.0).sqrt();
    [x / length, y / length, z / length, (1.0 - squares).max(0.0).sqrt()]
}

fn smallest_three(packed: u32) -> [f32; 4] {
    let largest = (packed >> 30) as usize;
    let mut smaller = [0.0; 3];
    // The last component is in the lowest bits.
    for (at, value) in smaller.iter_mut().rev().enumerate() {
        let bits = packed >> (10 * at);
        let magnitude = (bits & 511) as f32 / 511.0 * FRAC_1_SQRT_2;
        *value = if bits >> 9 & 1 == 1 { -magnitude } else { magnitude };
    }
    super::super::decoding::with_largest(largest, smaller)
}
