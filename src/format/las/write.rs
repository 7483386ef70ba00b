//! Point clouds as LAS 1.4, and compressed as LAZ.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use las::point::Format;
use las::{Builder, Color, Point, Transform, Vector, Vlr, Writer};

use crate::format::{Error, atomic};

/// Point format with time and colour.
const FORMAT: u8 = 7;
/// Bytes of an entry in the record that describes extra bytes.
const ENTRY: usize = 192;
/// The number of 4-byte floats among the types of extra bytes.
const FLOAT: u8 = 9;
/// The extra values of a point: name and description.
const EXTRA: [(&str, &str); 4] = [
    ("NormalX", "unit normal, east"),
    ("NormalY", "unit normal, north"),
    ("NormalZ", "unit normal, up"),
    ("Error", "standard deviation"),
];

/// A point of a cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudPoint {
    /// Easting, northing and height.
    pub position: [f64; 3],
    /// Colour.
    pub colour: [u8; 3],
    /// Unit normal; zero where none is known.
    pub normal: [f32; 3],
    /// Expected error along the normal, in units of the position; 0 where none is known.
    pub error: f32,
}

/// How coordinates are written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coordinates<'a> {
    /// The reference system in WKT; nothing for a local one.
    pub wkt: Option<&'a str>,
    /// The step of coordinates.
    pub step: f64,
    /// What is taken off before coordinates become whole numbers of steps.
    pub offset: [f64; 3],
}

/// What was written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// Points in the file.
    pub points: u64,
    /// Points without finite coordinates, or more than 2^31 steps from the offset, which are not in the file.
    pub left_out: u64,
}

/// Writes points one after the other, as LAZ where the file's name ends so. The file has LAS 1.4's point format 7, with
/// normals and errors as extra bytes.
pub fn write(
    file: &Path,
    coordinates: &Coordinates<'_>,
    points: impl IntoIterator<Item = CloudPoint>,
) -> Result<Written, Error> {
    let mut written = Written::default();
    let compressed = file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("laz"));
    atomic::write_file(file, |out| {
        let out = Patient::new(out.try_clone()?);
        let failed = out.failed.clone();
        // Problems of the disk are kept aside: the writer would panic over them when it is dropped.
        let result = put(out, coordinates, compressed, points, &mut written);
        match failed.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(error) => Err(error),
            None => result.map_err(io::Error::other),
        }
    })?;
    Ok(written)
}

fn put(
    out: Patient,
    coordinates: &Coordinates<'_>,
    compressed: bool,
    points: impl IntoIterator<Item = CloudPoint>,
    written: &mut Written,
) -> Result<(), las::Error> {
    let failed = out.failed.clone();
    let mut writer = Writer::new(out, header(coordinates, compressed)?.into_header()?)?;
    for point in points {
        match placed(&point, coordinates) {
            Some(at) => writer.write_point(record(&point, at))?,
            None => {
                written.left_out += 1;
                continue;
            }
        }
        written.points += 1;
        let broken =
            written.points.is_multiple_of(1 << 16) && failed.lock().unwrap_or_else(PoisonError::into_inner).is_some();
        if broken {
            break;
        }
    }
    writer.close()?;
    writer.into_inner()?.flush().map_err(las::Error::from)
}

fn header(coordinates: &Coordinates<'_>, compressed: bool) -> Result<Builder, las::Error> {
    let mut builder = Builder::from((1, 4));
    builder.point_format = Format::new(FORMAT)?;
    builder.point_format.extra_bytes = 4 * EXTRA.len() as u16;
    builder.point_format.is_compressed = compressed;
    builder.generating_software = "psrgs-vk".to_owned();
    // With the date, equal points would give different files.
    builder.date = None;
    // Points of this format have their reference system in WKT, if they have any.
    builder.has_wkt_crs = true;
    let axis = |k: usize| Transform { scale: coordinates.step, offset: coordinates.offset[k] };
    builder.transforms = Vector { x: axis(0), y: axis(1), z: axis(2) };
    builder.vlrs.push(Vlr {
        user_id: "LASF_Spec".to_owned(),
        record_id: 4,
        description: "extra bytes".to_owned(),
        data: EXTRA.iter().flat_map(|(name, description)| entry(name, description)).collect(),
    });
    if let Some(wkt) = coordinates.wkt {
        builder.vlrs.push(Vlr {
            user_id: "LASF_Projection".to_owned(),
            record_id: 2112,
            description: "WKT".to_owned(),
            data: wkt.bytes().chain([0]).collect(),
        });
    }
    Ok(builder)
}

/// The description of an extra value.
fn entry(name: &str, description: &str) -> [u8; ENTRY] {
    let mut entry = [0; ENTRY];
    entry[2] = FLOAT;
    entry[4..4 + name.len()].copy_from_slice(name.as_bytes());
    entry[160..160 + description.len()].copy_from_slice(description.as_bytes());
    entry
}

/// The position on whole steps; nothing where the format cannot hold it.
fn placed(point: &CloudPoint, coordinates: &Coordinates<'_>) -> Option<[f64; 3]> {
    let mut at = [0.0; 3];
    for (k, to) in at.iter_mut().enumerate() {
        let steps = ((point.position[k] - coordinates.offset[k]) / coordinates.step).round();
        // A comparison with NaN is false too.
        let held = steps >= f64::from(i32::MIN) && steps <= f64::from(i32::MAX);
        if !held {
            return None;
        }
        *to = steps * coordinates.step + coordinates.offset[k];
    }
    Some(at)
}

fn record(point: &CloudPoint, [x, y, z]: [f64; 3]) -> Point {
    // Colours have 16 bits in the format.
    let [red, green, blue] = point.colour.map(|c| u16::from(c) * 257);
    let extra = point.normal.iter().chain([&point.error]);
    Point {
        x,
        y,
        z,
        color: Some(Color::new(red, green, blue)),
        gps_time: Some(0.0),
        return_number: 1,
        number_of_returns: 1,
        extra_bytes: extra.flat_map(|v| v.to_le_bytes()).collect(),
        ..Point::default()
    }
}

/// A file that keeps its first error and swallows what comes after.
struct Patient {
    out: BufWriter<File>,
    /// Where the file would be without the error.
    at: u64,
    failed: Arc<Mutex<Option<io::Error>>>,
}

impl Patient {
    fn new(file: File) -> Self {
        Self { out: BufWriter::with_capacity(1 << 18, file), at: 0, failed: Arc::default() }
    }

    /// Works, unless there was an error; `None` where there was or is one.
    fn kept<T>(&mut self, work: impl FnOnce(&mut BufWriter<File>) -> io::Result<T>) -> io::Result<Option<T>> {
        let mut failed = self.failed.lock().unwrap_or_else(PoisonError::into_inner);
        if failed.is_some() {
            return Ok(None);
        }
        match work(&mut self.out) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Err(error),
            Err(error) => {
                *failed = Some(error);
                Ok(None)
            }
            Ok(value) => Ok(Some(value)),
        }
    }
}

impl Write for Patient {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.kept(|out| out.write(bytes))?.unwrap_or(bytes.len());
        self.at += count as u64;
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.kept(Write::flush).map(drop)
    }
}

impl Seek for Patient {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let at = self.at;
        self.at = self.kept(|out| out.seek(to))?.unwrap_or(match to {
            SeekFrom::Start(at) => at,
            SeekFrom::Current(by) => at.saturating_add_signed(by),
            SeekFrom::End(_) => at,
        });
        Ok(self.at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(count: u32) -> impl Iterator<Item = CloudPoint> {
        // Points in no order, as splats are.
        (0..count).map(|k| (k, f64::from(k.wrapping_mul(2_654_435_761) >> 8) * 1e-3)).map(|(k, far)| CloudPoint {
            position: [500_000.000_4 + far, 4_600_000.0 - far, 100.0 + 0.001 * f64::from(k)],
            colour: [255, k as u8, 0],
            normal: [0.0, 0.6, 0.8],
            error: 0.02,
        })
    }

    const HERE: Coordinates<'_> = Coordinates { wkt: None, step: 0.001, offset: [500_000.0, 4_600_000.0, 0.0] };

    #[test]
    fn points_come_back_to_the_millimetre() {
        let folder = tempfile::tempdir().expect("a folder");
        for name in ["a.las", "b.laz", "c.LAZ"] {
            let file = folder.path().join(name);
            // More than one chunk of the compressed format.
            let written = write(&file, &HERE, points(60_000)).expect("written");
            assert_eq!(written, Written { points: 60_000, left_out: 0 });
            let back = crate::format::las::read(&file).expect("read");
            assert_eq!(back.len(), 60_000);
            let far = points(60_000).zip(&back).flat_map(|(p, q)| (0..3).map(move |k| (p.position[k] - q[k]).abs()));
            assert!(far.fold(0.0, f64::max) < 0.000_501, "{name}");
        }
        let size = |name: &str| std::fs::metadata(folder.path().join(name)).expect("a file").len();
        assert!(2 * size("b.laz") < size("a.las"));
    }

    #[test]
    fn points_beyond_the_format_are_counted_and_none_is_no_error() {
        let folder = tempfile::tempdir().expect("a folder");
        for name in ["a.las", "b.laz"] {
            let file = folder.path().join(name);
            let far = [[f64::NAN, 0.0, 0.0], [500_000.0, 4_600_000.0, f64::INFINITY], [3e6, 4_600_000.0, 0.0]];
            let far = far.map(|position| CloudPoint { position, colour: [0; 3], normal: [0.0; 3], error: 0.0 });
            assert_eq!(write(&file, &HERE, far).expect("written"), Written { points: 0, left_out: 3 });
            assert_eq!(crate::format::las::read(&file).expect("read"), [[0.0; 3]; 0]);
        }
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_full_disk_is_an_error_and_no_panic() {
        for compressed in [false, true] {
            let full = std::fs::OpenOptions::new().write(true).open("/dev/full").expect("the full device");
            let out = Patient::new(full);
            let failed = out.failed.clone();
            let mut written = Written::default();
            let _ = put(out, &HERE, compressed, points(200_000), &mut written);
            let failed = failed.lock().expect("no panic").take().expect("an error");
            assert_eq!(failed.kind(), io::ErrorKind::StorageFull);
            assert!(written.points < 200_000, "it went on");
        }
    }
}
