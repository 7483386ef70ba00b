//! `points3D.bin`, `points3D.txt` and `points3D.ply`.

use std::path::Path;

use super::{binary_records, text_records};
use crate::dataset::points_ply::GREY;
use crate::dataset::{NoColours, points_ply};
use crate::format::Error as FileError;
use crate::format::ply;

/// A reconstructed point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// COLMAP's number of the point.
    pub id: u64,
    /// Position in dataset coordinates.
    pub position: [f64; 3],
    /// 8-bit colour.
    pub color: [u8; 3],
    /// Mean reprojection error in pixels.
    pub error: f64,
    /// Number of observations.
    pub track: u64,
}

const VALUES: [&str; 3] = ["x", "y", "z"];

/// Points with the numbers of the images that observe each, and why they have no colours where the file has none.
type Points = (Vec<(Point, Vec<u32>)>, Option<NoColours>);

/// Reads points of the kind that the file's extension says; a cloud in PLY says nothing of who observes them.
pub(super) fn read(file: &Path) -> Result<Points, FileError> {
    match file.extension().and_then(|extension| extension.to_str()) {
        Some("ply") => {
            let (points, colourless) = points_ply::read(file)?;
            Ok((points.into_iter().map(|point| (point, Vec::new())).collect(), colourless))
        }
        Some("txt") => read_text(file),
        _ => Ok((read_binary(file)?, None)),
    }
}

/// Reads `points3D.bin`, points and the numbers of the images that observe each: per point u64 number, f64 position, u8 colour, f64 error, u64 track length and 8 bytes per
/// observation.
fn read_binary(file: &Path) -> Result<Vec<(Point, Vec<u32>)>, FileError> {
    binary_records(file, "points", 8 + 24 + 3 + 8 + 8, |source, i| {
        let id = source.u64(format_args!("number of point {i}"))?;
        let mut position = [0.0; 3];
        for (k, value) in position.iter_mut().enumerate() {
            *value = source.f64(format_args!("{} of point {id}", VALUES[k]))?;
        }
        let color = source.array(format_args!("colour of point {id}"))?;
        // Some exporters have no error to give and write NaN: it decides nothing here.
        let error = source.array(format_args!("error of point {id}")).map(f64::from_le_bytes)?;
        let track = source.count(8, format_args!("track length of point {id}"))? as u64;
        let bytes = source.bytes(8 * track, format_args!("track of point {id}"))?;
        let observers = bytes.chunks_exact(8).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        Ok((Point { id, position, color, error, track }, observers))
    })
}

/// Reads `points3D.txt`, likewise: per line number, position, colour, error and two numbers per observation. Colours may be written in
/// any of the usual ranges.
fn read_text(file: &Path) -> Result<Points, FileError> {
    let mut i = 0;
    let (mut written, mut no_byte) = (Vec::new(), None);
    let mut points = text_records(
        file,
        "points",
        |mut line| {
            let id = line.value(format_args!("number of point {i}"))?;
            i += 1;
            let mut position = [0.0; 3];
            for (k, value) in position.iter_mut().enumerate() {
                *value = line.f64(format_args!("{} of point {id}", VALUES[k]))?;
            }
            for _ in 0..3 {
                let value = line.f64(format_args!("colour of point {id}"))?;
                if !(0.0..=255.0).contains(&value) && no_byte.is_none() {
                    let problem = format_args!("'{value}' is not from 0 to 255, as others are");
                    no_byte = Some(line.error(format_args!("colour of point {id}"), problem));
                }
                written.push(value);
            }
            let error = line.value(format_args!("error of point {id}"))?;
            let left = line.left();
            if left % 2 != 0 {
                return Err(line.error(format_args!("track of point {id}"), "has an odd number of values"));
            }
            let track = left as u64 / 2;
            let mut observers = Vec::new();
            for _ in 0..track {
                // What is no number names no image.
                observers.extend(line.word(format_args!("track of point {id}"))?.parse::<u32>());
                line.word(format_args!("track of point {id}"))?;
            }
            Ok((Point { id, position, color: GREY, error, track }, observers))
        },
        None,
    )?;
    let Some((colours, largest)) = ply::colours_of_numbers(&written) else {
        return Ok((points, Some(NoColours::Unknown(["R", "G", "B"].map(str::to_owned).to_vec()))));
    };
    if let Some(error) = no_byte.filter(|_| largest <= 255.0) {
        return Err(error);
    }
    for ((point, _), colour) in points.iter_mut().zip(colours) {
        point.color = colour;
    }
    Ok((points, None))
}
