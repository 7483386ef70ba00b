//! `points3D.bin`, `points3D.txt` and `points3D.ply`.

use std::path::Path;

use super::{binary_records, text_records, wrong};
use crate::dataset::points_ply::{self, GREY};
use crate::dataset::{NoColours, Warning};
use crate::format::source::{Line, whole};
use crate::format::{At, Error as FileError, Tally, ply};

/// A reconstructed point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// COLMAP's number of the point.
    pub id: u64,
    /// Position in dataset coordinates.
    pub position: [f64; 3],
    /// 8-bit colour.
    pub colour: [u8; 3],
    /// Mean reprojection error in pixels.
    pub error: f64,
    /// Number of observations.
    pub track: u64,
}

const VALUES: [&str; 3] = ["x", "y", "z"];

/// A point, and the numbers of the images that observe it.
type Observed = (Point, Vec<u32>);

/// The content of a points file.
#[derive(Default)]
pub(super) struct Points {
    pub(super) list: Vec<Observed>,
    /// Why the points have no colours, where the file has none.
    pub(super) colourless: Option<NoColours>,
    pub(super) warnings: Vec<Warning>,
}

/// Reads points in the format of the file's extension. A PLY file does not say which images observe a point.
pub(super) fn read(file: &Path, strict: bool) -> Result<Points, FileError> {
    match file.extension().and_then(|extension| extension.to_str()) {
        Some("ply") => {
            let points_ply::Points { list, colourless, left_out } = points_ply::read(file, strict)?;
            let list = list.into_iter().map(|point| (point, Vec::new())).collect();
            Ok(Points { list, colourless, warnings: left_out.map(Warning::LeftOut).into_iter().collect() })
        }
        Some("txt") => read_text(file, strict),
        _ => read_binary(file, strict),
    }
}

/// Reads `points3D.bin`: per point u64 number, f64 position, u8 colour, f64 error,
/// u64 track length and 8 bytes per observation.
fn read_binary(file: &Path, strict: bool) -> Result<Points, FileError> {
    let mut tally = Tally::new(strict);
    let records = binary_records(file, "points", 8 + 24 + 3 + 8 + 8, |source, i| {
        let id = source.u64(format_args!("number of point {i}"))?;
        let at = source.at();
        let mut position = [0.0; 3];
        for (k, value) in position.iter_mut().enumerate() {
            *value = source.f64(format_args!("{} of point {id}", VALUES[k]))?;
        }
        let colour = source.array(format_args!("colour of point {id}"))?;
        // Some exporters write NaN for a missing error. The error has no effect here.
        let error = source.f64(format_args!("error of point {id}"))?;
        let track = source.count(8, format_args!("track length of point {id}"))? as u64;
        let bytes = source.bytes(8 * track, format_args!("track of point {id}"))?;
        if let Some(k) = position.iter().position(|v| !v.is_finite()) {
            let (at, field) = (At::Byte(at + 8 * k as u64), format!("{} of point {id}", VALUES[k]));
            tally.bad(format_args!("point {id}"), wrong(file, at, field, format_args!("is {}", position[k])))?;
            return Ok(None);
        }
        let observers = bytes.chunks_exact(8).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        Ok(Some((Point { id, position, colour, error, track }, observers)))
    })?;
    let list: Vec<Observed> = records.into_iter().flatten().collect();
    let left_out = tally.end(file, "points", list.len())?.map(Warning::LeftOut);
    Ok(Points { list, colourless: None, warnings: left_out.into_iter().collect() })
}

/// A point of a text file with its colour as written, and its position in the file.
struct Written {
    point: Observed,
    colour: [f64; 3],
    at: At,
}

/// Reads `points3D.txt`: per line number, position, colour, error and two numbers per observation. Colours may have any
/// usual range.
fn read_text(file: &Path, strict: bool) -> Result<Points, FileError> {
    let mut tally = Tally::new(strict);
    let mut written = Vec::new();
    let counts = text_records(file, |line| {
        let name = line.text.split_whitespace().next().unwrap_or_default();
        let ended = line.ended;
        match text_point(line) {
            Err(error) if !ended => return Err(error),
            point => written.extend(tally.take(format_args!("point {name}"), point)?),
        }
        Ok(())
    })?;
    let counted = counts.check(file, "points", written.len() + tally.count(), strict)?;
    let (list, colourless) = coloured(file, written, &mut tally)?;
    let left_out = tally.end(file, "points", list.len())?.map(Warning::LeftOut);
    Ok(Points { list, colourless, warnings: counted.into_iter().chain(left_out).collect() })
}

/// The points with colours in bytes. Where the range of the colours is that of bytes, points with values outside of it
/// cannot be used.
fn coloured(
    file: &Path,
    written: Vec<Written>,
    tally: &mut Tally<FileError>,
) -> Result<(Vec<Observed>, Option<NoColours>), FileError> {
    let numbers: Vec<f64> = written.iter().flat_map(|line| line.colour).collect();
    let Some((colours, largest)) = ply::colours_of_numbers(&numbers) else {
        let points = written.into_iter().map(|line| line.point).collect();
        return Ok((points, Some(NoColours::Unknown(["R", "G", "B"].map(str::to_owned).to_vec()))));
    };
    let mut points = Vec::with_capacity(written.len());
    for (Written { point: (mut point, observers), colour, at }, read) in written.into_iter().zip(colours) {
        point.colour = read;
        match colour.iter().find(|value| largest <= 255.0 && !(0.0..=255.0).contains(*value)) {
            None => points.push((point, observers)),
            Some(value) => {
                let problem = format_args!("'{value}' is not from 0 to 255, as others are");
                let error = wrong(file, at, format_args!("colour of point {}", point.id), problem);
                tally.bad(format_args!("point {}", point.id), error)?;
            }
        }
    }
    Ok((points, None))
}

fn text_point(mut line: Line<'_>) -> Result<Written, FileError> {
    let at = line.at();
    let id = line.whole("number of a point")?;
    let mut position = [0.0; 3];
    for (k, value) in position.iter_mut().enumerate() {
        *value = line.finite(format_args!("{} of point {id}", VALUES[k]))?;
    }
    let mut colour = [0.0; 3];
    for value in &mut colour {
        *value = line.finite(format_args!("colour of point {id}"))?;
    }
    let error = line.f64(format_args!("error of point {id}"))?;
    let left = line.left();
    if !left.is_multiple_of(2) {
        return Err(line.error(format_args!("track of point {id}"), "has an odd number of values"));
    }
    let track = left as u64 / 2;
    let mut observers = Vec::new();
    for _ in 0..track {
        // A word that is no number names no image.
        observers.extend(whole::<u32>(line.word(format_args!("track of point {id}"))?));
        line.word(format_args!("track of point {id}"))?;
    }
    Ok(Written { point: (Point { id, position, colour: GREY, error, track }, observers), colour, at })
}
