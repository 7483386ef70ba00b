//! Check points from files.

use std::path::Path;

use crate::dataset::georeference::ControlPoints;
use crate::format::{At, Error, read_text};
use crate::geodesy::ReferenceSystem;

/// Check points with their names: easting, northing and height on the map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CheckPoints {
    /// The names.
    pub names: Vec<String>,
    /// The places.
    pub places: Vec<[f64; 3]>,
}

impl CheckPoints {
    /// Reads `gcp_list.txt` in OpenDroneMap's format, whose places are taken to the map's system, or lines of name,
    /// easting, northing and height on the map, with commas, semicolons or spaces between them; the name may be absent,
    /// and the first line may be a heading.
    pub fn read(file: &Path, system: Option<&ReferenceSystem>) -> Result<Self, Error> {
        let text = read_text(file).map_err(Error::io(file, "read"))?;
        let text = text.trim_start_matches('\u{feff}');
        let first = text.lines().map(str::trim).find(|line| !line.is_empty() && !line.starts_with('#'));
        match first.filter(|line| ReferenceSystem::parse(line).is_ok()) {
            Some(_) => Self::of_control_points(&ControlPoints::read(file)?, system),
            None => Self::of_lines(file, text),
        }
    }

    fn of_control_points(points: &ControlPoints, system: Option<&ReferenceSystem>) -> Result<Self, Error> {
        let mut found = Self::default();
        for mark in &points.marks {
            let Some(height) = mark.height else { continue };
            let [x, y] = mark.place;
            let place = match system.filter(|system| !system.is_same_plane(&points.system)) {
                Some(system) => system.from_geodetic(points.system.to_geodetic([x, y, height])),
                None => [x, y, height],
            };
            // A point has a mark in each photograph.
            if !found.places.contains(&place) {
                let number = found.places.len() + 1;
                found.names.push(mark.name.clone().unwrap_or_else(|| format!("point {number}")));
                found.places.push(place);
            }
        }
        match found.places.is_empty() {
            true => Err(Error::malformed(&points.file, "points", At::Line(1), "none has a height")),
            false => Ok(found),
        }
    }

    fn of_lines(file: &Path, text: &str) -> Result<Self, Error> {
        let mut found = Self::default();
        let mut heading = true;
        for (number, line) in (1..).zip(text.lines().map(str::trim)) {
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let words: Vec<&str> = match line.contains([',', ';']) {
                true => line.split([',', ';']).map(str::trim).collect(),
                false => line.split_whitespace().collect(),
            };
            let from = words.len().saturating_sub(3).min(1);
            let numbers = words.iter().skip(from).take(3).filter_map(|word| word.parse::<f64>().ok());
            let numbers: Vec<f64> = numbers.filter(|v| v.is_finite()).collect();
            match (numbers.as_slice(), std::mem::take(&mut heading)) {
                (&[east, north, height], _) => {
                    let name = words.first().filter(|_| from == 1).map(|name| (*name).to_owned());
                    found.names.push(name.unwrap_or_else(|| format!("point {}", found.places.len() + 1)));
                    found.places.push([east, north, height]);
                }
                (_, true) => {}
                (_, false) => {
                    let problem =
                        "name, easting, northing and height are needed, such as: p1, 500000.0, 4600000.0, 90.0";
                    return Err(Error::malformed(file, "check point", At::Line(number), problem));
                }
            }
        }
        match found.places.is_empty() {
            true => Err(Error::malformed(file, "check points", At::Line(1), "there are none")),
            false => Ok(found),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, system: Option<&ReferenceSystem>) -> Result<CheckPoints, Error> {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("points.csv");
        std::fs::write(&file, text).expect("written");
        CheckPoints::read(&file, system)
    }

    #[test]
    fn check_points_are_read_with_and_without_names() {
        let want = [[500_000.5, 4_600_000.0, 90.25], [1.0, -2.0, 3.0]];
        for text in [
            "name,E,N,H\na,500000.5,4600000,90.25\nb, 1, -2, 3\n",
            "a;500000.5;4600000;90.25\r\nb;1;-2;3",
            "# of the surveyor\n500000.5 4600000 90.25\n\n1 -2 3\n",
        ] {
            let found = read(text, None).expect("points");
            assert_eq!(found.places, want, "{text}");
            assert_eq!(found.names.len(), 2);
        }
        assert_eq!(read("a,1,2,3,checked by hand\n", None).expect("points").names, ["a"]);
        for (text, problem) in
            [("a,1,2,3\nb,1,2\n", "line 2"), ("a,1,2,nan\nb,1,2,inf\n", "line 2"), ("", "none"), ("E,N,H\n", "none")]
        {
            let error = read(text, None).expect_err(text).to_string();
            assert!(error.contains(problem), "{text}: {error}");
        }
    }

    #[test]
    fn control_points_serve_once_each_in_the_system_of_the_map() {
        let text =
            "EPSG:32632\n657630.641 4984896.171 200 10 10 a.jpg one\n657630.641 4984896.171 200 20 9 b.jpg one\n";
        let same = ReferenceSystem::epsg(32_632).expect("a system");
        let found = read(text, Some(&same)).expect("points");
        assert_eq!((found.names, found.places), (vec!["one".to_owned()], vec![[657_630.641, 4_984_896.171, 200.0]]));
        // Seen from the next zone (pyproj).
        let other = ReferenceSystem::epsg(32_633).expect("a system");
        let [east, north, height] = read(text, Some(&other)).expect("points").places[0];
        assert!((east - 184_738.573).abs() < 2e-3 && (north - 4_990_738.261).abs() < 2e-3, "{east} {north}");
        assert_eq!(height, 200.0);
    }
}
