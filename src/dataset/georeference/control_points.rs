//! Ground control points in OpenDroneMap's `gcp_list.txt`: a line with the reference system, then lines of easting,
//! northing, height, the point's place in a photograph in pixels, the photograph's name, and optionally the point's name.

use std::path::{Path, PathBuf};

use crate::format::{At, Error, read_text};
use crate::geodesy::ReferenceSystem;

/// A point's place in a photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// Easting and northing (or longitude and latitude), and the height, if it is known.
    pub place: [f64; 2],
    /// The height, if it is known.
    pub height: Option<f64>,
    /// Pixels from the middle of the first one, to the right and down, as OpenDroneMap counts them.
    pub pixel: [f64; 2],
    /// The photograph's name.
    pub photograph: String,
    /// The point's name; marks without one belong together where their places are the same.
    pub name: Option<String>,
    /// The line of the file.
    pub line: u64,
}

/// The content of a file of ground control points.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlPoints {
    /// The file.
    pub file: PathBuf,
    /// The reference system of the places.
    pub system: ReferenceSystem,
    /// All marks, in the order of the file.
    pub marks: Vec<Mark>,
}

impl ControlPoints {
    /// Reads a file.
    pub fn read(file: &Path) -> Result<Self, Error> {
        let text = read_text(file).map_err(Error::io(file, "read"))?;
        let fail = |field: &str, line: u64, problem: String| Error::malformed(file, field, At::Line(line), problem);
        let lines = (1..).zip(text.trim_start_matches('\u{feff}').lines().map(str::trim));
        let mut lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        let form = "the first line names the reference system, such as EPSG:32617 or WGS84 UTM 17N";
        let (number, header) =
            lines.next().ok_or_else(|| fail("reference system", 1, format!("is missing: {form}")))?;
        let system = ReferenceSystem::parse(header)
            .map_err(|problem| fail("reference system", number, format!("{problem}; {form}")))?;
        let mut marks = Vec::new();
        for (number, line) in lines {
            marks.push(mark(line, number).map_err(|(field, problem)| fail(field, number, problem))?);
        }
        if marks.is_empty() {
            return Err(fail("marks", number, "none follow the reference system".to_owned()));
        }
        Ok(Self { file: file.to_owned(), system, marks })
    }

    /// The marks of each point, with the point's name, in the order of the file.
    pub(super) fn by_point(&self) -> Vec<(String, Vec<&Mark>)> {
        let mut points: Vec<(String, Vec<&Mark>)> = Vec::new();
        for mark in &self.marks {
            let same = |first: &Mark| match (&first.name, &mark.name) {
                (Some(a), Some(b)) => a == b,
                (None, None) => first.place == mark.place && first.height == mark.height,
                _ => false,
            };
            match points.iter_mut().find(|(_, marks)| marks.first().is_some_and(|first| same(first))) {
                Some((_, marks)) => marks.push(mark),
                None => {
                    let name = mark.name.clone().unwrap_or_else(|| format!("point {}", points.len() + 1));
                    points.push((name, vec![mark]));
                }
            }
        }
        points
    }
}

/// A line, or the field that is amiss and the problem.
fn mark(line: &str, number: u64) -> Result<Mark, (&'static str, String)> {
    const FIELDS: [&str; 5] = ["x", "y", "z", "pixel x", "pixel y"];
    let mut words = line.split_whitespace();
    let mut values = [0.0; 5];
    for (field, value) in FIELDS.into_iter().zip(&mut values) {
        let word =
            words.next().ok_or_else(|| (field, "is missing: x y z pixel-x pixel-y photograph [name]".to_owned()))?;
        let unknown = field == "z" && ["nan", "-", "none"].contains(&word.to_ascii_lowercase().as_str());
        *value = match word.parse::<f64>() {
            _ if unknown => f64::NAN,
            Ok(read) if read.is_finite() => read,
            _ => return Err((field, format!("'{word}' is no number"))),
        };
    }
    let photograph = words.next().ok_or_else(|| ("photograph", "is missing".to_owned()))?.to_owned();
    let [x, y, z, u, v] = values;
    let height = (!z.is_nan()).then_some(z);
    let name = words.next().map(str::to_owned);
    Ok(Mark { place: [x, y], height, pixel: [u, v], photograph, name, line: number })
}
