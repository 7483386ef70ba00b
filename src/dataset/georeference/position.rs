//! The position that a photograph notes: in EXIF, and in the XMP of DJI and of Pix4D's and senseFly's cameras.

use std::io::{BufReader, Read, Seek};
use std::path::Path;

use crate::format::contain::contained;
use crate::format::source;

/// XMP is looked for in this many bytes from the beginning of a JPEG file.
const LOOKED_AT: u64 = 1 << 20;
/// The beginning of a JPEG segment with XMP.
const XMP: &[u8] = b"http://ns.adobe.com/xap/1.0/\0";
/// Altitudes in metres that are none.
const ALTITUDES: std::ops::Range<f64> = -12_000.0..100_000.0;
/// Largest deviation in metres that is taken for one.
const MOST_DEVIATION: f64 = 10_000.0;

/// A noted position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    /// Degrees north.
    pub latitude: f64,
    /// Degrees east.
    pub longitude: f64,
    /// Metres, if noted.
    pub altitude: Option<f64>,
    /// Standard deviation towards east and north in metres, if noted.
    pub horizontal: Option<f64>,
    /// Standard deviation of the altitude in metres, if noted.
    pub vertical: Option<f64>,
}

/// The position that a photograph notes. `None` where the file cannot be read, or notes none.
pub fn noted_position(file: &Path) -> Option<Position> {
    let mut reader = BufReader::new(source::open(file).ok()?.0);
    let exif = contained(|| exif::Reader::new().read_from_container(&mut reader).ok()).ok().flatten();
    let exif = exif.and_then(|noted| of_exif(&noted));
    let mut head = Vec::new();
    reader.rewind().ok()?;
    reader.take(LOOKED_AT).read_to_end(&mut head).ok()?;
    let noted = xmp(&head).map(|packet| String::from_utf8_lossy(packet).into_owned());
    noted.and_then(|packet| of_xmp(&packet, exif)).or(exif).filter(is_place)
}

/// Whether a position is one. Cameras without a fix write zeros.
fn is_place(at: &Position) -> bool {
    at.latitude.abs() <= 90.0 && at.longitude.abs() <= 180.0 && (at.latitude, at.longitude) != (0.0, 0.0)
}

fn of_exif(noted: &exif::Exif) -> Option<Position> {
    use exif::{In, Tag, Value};
    let numbers = |tag| match &noted.get_field(tag, In::PRIMARY)?.value {
        Value::Rational(values) => Some(values.iter().map(|value| value.to_f64()).collect::<Vec<f64>>()),
        _ => None,
    };
    let says = |tag, letter: u8| match noted.get_field(tag, In::PRIMARY).map(|field| &field.value) {
        Some(Value::Ascii(text)) => {
            text.first().and_then(|t| t.first()).is_some_and(|t| t.eq_ignore_ascii_case(&letter))
        }
        _ => false,
    };
    let degrees = |tag, side, negative| {
        let parts = numbers(tag)?;
        let sum: f64 = parts.iter().take(3).zip([1.0, 60.0, 3600.0]).map(|(part, by)| part / by).sum();
        (!parts.is_empty() && sum.is_finite()).then_some(if says(side, negative) { -sum } else { sum })
    };
    let one = |tag| numbers(tag)?.first().copied().filter(|value| value.is_finite());
    // 1 is below sea level, 3 below the ellipsoid.
    let below = noted.get_field(Tag::GPSAltitudeRef, In::PRIMARY).and_then(|field| field.value.get_uint(0));
    let sign = if matches!(below, Some(1 | 3)) { -1.0 } else { 1.0 };
    Some(Position {
        latitude: degrees(Tag::GPSLatitude, Tag::GPSLatitudeRef, b'S')?,
        longitude: degrees(Tag::GPSLongitude, Tag::GPSLongitudeRef, b'W')?,
        altitude: one(Tag::GPSAltitude).map(|metres| sign * metres).filter(|metres| ALTITUDES.contains(metres)),
        horizontal: one(Tag::GPSHPositioningError).filter(is_deviation),
        vertical: None,
    })
}

/// The XMP packet of a JPEG file.
fn xmp(jpeg: &[u8]) -> Option<&[u8]> {
    let mut rest = jpeg.strip_prefix(&[0xff, 0xd8])?;
    loop {
        let [0xff, marker, high, low, after @ ..] = rest else { return None };
        // The picture begins.
        if matches!(marker, 0xda | 0xd9) {
            return None;
        }
        let length = usize::from(u16::from_be_bytes([*high, *low])).checked_sub(2)?;
        let (segment, next) = after.split_at_checked(length)?;
        if let (0xe1, Some(packet)) = (marker, segment.strip_prefix(XMP)) {
            return Some(packet);
        }
        rest = next;
    }
}

/// The value of an attribute or element, such as `drone-dji:RtkFlag`.
fn text_of<'a>(packet: &'a str, name: &str) -> Option<&'a str> {
    packet.match_indices(name).find_map(|(at, _)| {
        let rest = packet.get(at + name.len()..)?.trim_start();
        if let Some(element) = rest.strip_prefix('>') {
            return element.split('<').next();
        }
        let quoted = rest.strip_prefix('=')?.trim_start();
        let quote = quoted.chars().next().filter(|c| ['"', '\''].contains(c))?;
        quoted.get(1..)?.split(quote).next()
    })
}

fn is_deviation(metres: &f64) -> bool {
    *metres > 0.0 && *metres < MOST_DEVIATION
}

/// The position in an XMP packet; what is not there is that of EXIF.
fn of_xmp(packet: &str, exif: Option<Position>) -> Option<Position> {
    let number = |name: &str| text_of(packet, name)?.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    let dji = |name: &str| number(&format!("drone-dji:{name}"));
    // Older cameras misspell the longitude.
    let longitude = dji("GpsLongitude").or_else(|| dji("GpsLongtitude"));
    let (latitude, longitude) = match (dji("GpsLatitude"), longitude) {
        (Some(latitude), Some(longitude)) => (latitude, longitude),
        _ => exif.map(|at| (at.latitude, at.longitude))?,
    };
    let altitude = dji("AbsoluteAltitude").filter(|metres| ALTITUDES.contains(metres));
    // 50 is a fixed solution, 34 a floating one.
    let usual = match dji("RtkFlag").map(|flag| flag as i64) {
        Some(50) => Some(0.03),
        Some(34) => Some(0.5),
        _ => None,
    };
    let pair = |a: Option<f64>, b: Option<f64>| Some((0.5 * (a?.powi(2) + b?.powi(2))).sqrt()).filter(is_deviation);
    let horizontal = pair(dji("RtkStdLat"), dji("RtkStdLon"));
    let vertical = dji("RtkStdHgt").filter(is_deviation);
    let named = |name: &str| number(&format!("Camera:{name}")).filter(is_deviation);
    Some(Position {
        latitude,
        longitude,
        altitude: altitude.or(exif.and_then(|at| at.altitude)),
        horizontal: horizontal.or(named("GPSXYAccuracy")).or(usual).or(exif.and_then(|at| at.horizontal)),
        vertical: vertical.or(named("GPSZAccuracy")).or(usual.map(|metres| 1.5 * metres)),
    })
}
