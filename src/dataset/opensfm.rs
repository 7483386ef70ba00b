//! OpenSfM's `reconstruction.json`, as its documentation describes it ("Reconstruction file format", "Geometric
//! models"). OpenDroneMap has it in its folder `opensfm`.
//!
//! Pixel coordinates are relative to the photograph's middle and divided by its longer side. Rotations are vectors
//! (axis times angle) from the world to the camera, with the camera's x right, y down and z forwards.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::error::Error;
use super::json::{Entries, Json};
use super::lens::{Distortion, Lens, names};
use super::model::{Format, Model, Shot};
use super::points_ply::GREY;
use super::{NoColours, Point, Tracks, Warning, opendronemap, rotation};
use crate::format::{Error as FileError, Tally, ply};
use crate::scene::Geodetic;

/// The reconstruction file of an OpenSfM or OpenDroneMap project.
pub(super) fn file(dataset: &Path) -> Option<PathBuf> {
    let places = [dataset.join("reconstruction.json"), dataset.join("opensfm").join("reconstruction.json")];
    places.into_iter().find(|file| file.is_file())
}

/// The reference that OpenSfM writes if no photograph has a position.
const NOWHERE: Geodetic = Geodetic { latitude: 0.0, longitude: 0.0, altitude: 0.0 };

#[derive(Deserialize)]
struct Reconstruction<'a> {
    #[serde(borrow)]
    cameras: Entries<'a>,
    #[serde(borrow)]
    shots: Entries<'a>,
    #[serde(borrow, default)]
    points: Entries<'a>,
    reference_lla: Option<Geodetic>,
}

#[derive(Deserialize)]
struct CameraEntry {
    projection_type: Option<String>,
    width: f64,
    height: f64,
    focal: Option<f64>,
    focal_x: Option<f64>,
    focal_y: Option<f64>,
    #[serde(default)]
    c_x: f64,
    #[serde(default)]
    c_y: f64,
    #[serde(default)]
    k1: f64,
    #[serde(default)]
    k2: f64,
    #[serde(default)]
    k3: f64,
    #[serde(default)]
    k4: f64,
    #[serde(default)]
    p1: f64,
    #[serde(default)]
    p2: f64,
}

#[derive(Deserialize)]
struct ShotEntry {
    camera: String,
    rotation: RotationEntry,
    translation: [f64; 3],
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "a rotation is a vector of 3 numbers, or a matrix of 3 rows with 3 numbers")]
enum RotationEntry {
    /// Axis times angle.
    Vector([f64; 3]),
    /// Matrix rows.
    Matrix([[f64; 3]; 3]),
}

#[derive(Deserialize)]
struct PointEntry {
    coordinates: [f64; 3],
    #[serde(rename = "color")]
    colour: Option<[f64; 3]>,
}

/// Camera model and lens by the camera's name, or the camera's error.
type Lenses = BTreeMap<String, Result<(String, Lens), FileError>>;

pub(super) fn read(dataset: &Path, strict: bool) -> Result<Model, Error> {
    let path = file(dataset).unwrap_or_else(|| dataset.join("reconstruction.json"));
    let json = Json::open(&path)?;
    let mut parts: Vec<Reconstruction<'_>> = json.parse()?;
    let sizes: Vec<usize> = parts.iter().map(|part| part.shots.0.len()).collect();
    let most = sizes.iter().copied().max().unwrap_or(0);
    let mut warnings = Vec::new();
    let Some(largest) = sizes.iter().position(|size| *size == most) else {
        return Err(Error::NoImages { file: path });
    };
    if parts.len() > 1 {
        let shots = sizes.iter().sum::<usize>() - most;
        warnings.push(Warning::OtherParts { used: most, parts: parts.len() - 1, shots });
    }
    let part = parts.swap_remove(largest);
    let lenses = lenses(&json, part.cameras, strict)?;
    let (mut shots, mut needed, mut tally) = (Vec::new(), BTreeSet::new(), Tally::new(strict));
    for (name, text) in part.shots.0 {
        let entry = json.parse_part::<ShotEntry>(text.get());
        needed.extend(entry.as_ref().ok().map(|entry| entry.camera.clone()));
        let shot = entry.and_then(|entry| shot(&json, &name, entry, &lenses));
        shots.extend(tally.take(format_args!("'{name}'"), shot)?);
    }
    warnings.extend(tally.end(&path, "shots", shots.len())?.map(Warning::LeftOut));
    warnings.extend(unneeded(&path, lenses, &needed, strict)?);
    let mut tally = Tally::new(strict);
    let mut texts = part.points.0;
    texts.sort_by(|a, b| a.0.cmp(&b.0));
    let mut entries = Vec::with_capacity(texts.len());
    for (id, text) in texts {
        let entry = tally.take(format_args!("point {id}"), json.parse_part(text.get()))?;
        entries.extend(entry.map(|entry| (id, entry)));
    }
    warnings.extend(tally.end(&path, "points", entries.len())?.map(Warning::LeftOut));
    let (points, colourless) = points(&entries);
    let origin = part.reference_lla.filter(|at| *at != NOWHERE);
    let coordinates = opendronemap::coordinates(dataset, &path, origin, &mut warnings);
    Ok(Model {
        format: Format::Opensfm,
        files: std::iter::once(path.clone()).chain(opendronemap::files(dataset)).collect(),
        file: path.clone(),
        shots,
        points,
        colourless,
        tracks: Tracks::default(),
        points_file: Some(path),
        images: None,
        coordinates,
        warnings,
    })
}

fn lenses(json: &Json, cameras: Entries<'_>, strict: bool) -> Result<Lenses, FileError> {
    let mut lenses = Lenses::new();
    for (id, text) in cameras.0 {
        let entry = json.parse_part::<CameraEntry>(text.get()).and_then(|camera| lens(json, &id, &camera));
        lenses.insert(id, if strict { Ok(entry?) } else { entry });
    }
    Ok(lenses)
}

/// The warning about unreadable cameras that no shot needs.
fn unneeded(
    file: &Path,
    lenses: Lenses,
    needed: &BTreeSet<String>,
    strict: bool,
) -> Result<Option<Warning>, FileError> {
    let (of, mut tally) = (lenses.len(), Tally::new(strict));
    for (id, lens) in lenses.into_iter().filter(|(id, _)| !needed.contains(id)) {
        tally.take(format_args!("camera '{id}'"), lens)?;
    }
    Ok(tally.told(file, "cameras", of).map(Warning::LeftOut))
}

fn shot(json: &Json, name: &str, entry: ShotEntry, lenses: &Lenses) -> Result<Shot, FileError> {
    let wrong = |key: &str, problem: String| json.error(name, format_args!("{key} of shot '{name}'"), problem);
    let (model, lens) = match lenses.get(&entry.camera) {
        Some(Ok(lens)) => lens,
        Some(Err(error)) => return Err(wrong("camera", format!("'{}' cannot be read: {error}", entry.camera))),
        None => return Err(wrong("camera", format!("there is no camera '{}'", entry.camera))),
    };
    let rotation = match entry.rotation {
        RotationEntry::Vector(vector) => rotation::of_vector(vector),
        RotationEntry::Matrix(matrix) => {
            rotation::nearest(&matrix).map_err(|is| wrong("rotation", format!("is {is}")))?
        }
    };
    if rotation.iter().flatten().any(|v| !v.is_finite()) {
        return Err(wrong("rotation", "is beyond all range".to_owned()));
    }
    Ok(Shot {
        name: name.to_owned(),
        file: name.to_owned(),
        camera: entry.camera,
        model: model.clone(),
        lens: *lens,
        rotation,
        translation: entry.translation,
        mask: None,
        part: None,
        observations: Vec::new(),
    })
}

/// The points by their ids, and why they have no colours if they have none.
fn points(entries: &[(String, PointEntry)]) -> (Vec<Point>, Option<NoColours>) {
    let all: Option<Vec<[f64; 3]>> = entries.iter().map(|(_, entry)| entry.colour).collect();
    let read = all.as_deref().and_then(|all| ply::colours_of_numbers(all.as_flattened()));
    let colours = read.map(|(colours, _)| colours);
    let point = |(i, (id, entry)): (usize, &(String, PointEntry))| {
        let id = id.parse().unwrap_or(i as u64);
        let colour = colours.as_ref().and_then(|colours| colours.get(i)).copied().unwrap_or(GREY);
        Point { id, position: entry.coordinates, colour, error: 0.0, track: 0 }
    };
    let mut points: Vec<Point> = entries.iter().enumerate().map(point).collect();
    points.sort_by_key(|p| p.id);
    let colourless = match (&colours, all) {
        (Some(_), _) => None,
        (None, Some(_)) => Some(NoColours::Unknown(vec!["color".to_owned()])),
        (None, None) => Some(NoColours::Absent),
    };
    (points, colourless)
}

fn lens(json: &Json, id: &str, camera: &CameraEntry) -> Result<(String, Lens), FileError> {
    let wrong = |key: &str, problem: String| json.error(id, format_args!("{key} of camera '{id}'"), problem);
    let given = camera.projection_type.as_deref().unwrap_or("perspective");
    let kind = kind(given);
    let (k1, k2, k3, k4, tangential) = (camera.k1, camera.k2, camera.k3, camera.k4, [camera.p1, camera.p2]);
    let one = matches!(kind, "perspective" | "fisheye");
    let distortion = match kind {
        "perspective" | "radial" => Distortion::brown([k1, k2, 0.0], [0.0; 2]),
        "simple_radial" => Distortion::brown([k1, 0.0, 0.0], [0.0; 2]),
        "brown" => Distortion::brown([k1, k2, k3], tangential),
        "fisheye" => Distortion::Fisheye { k: [k1, k2, 0.0, 0.0] },
        "fisheye_opencv" => Distortion::Fisheye { k: [k1, k2, k3, k4] },
        other => {
            let known = "perspective, simple_radial, radial, brown, fisheye and fisheye_opencv";
            let problem = match names::is_panorama(other) {
                true => format!("is {other}: {}", names::PANORAMA),
                false => format!("is {other}; known are {known}"),
            };
            return Err(wrong("projection_type", problem));
        }
    };
    let sides = [camera.width, camera.height];
    for (key, side) in ["width", "height"].into_iter().zip(sides) {
        if !(side.fract() == 0.0 && (1.0..=1_048_576.0).contains(&side)) {
            return Err(wrong(key, format!("is {side}")));
        }
    }
    let longer = sides[0].max(sides[1]);
    let positive = |key: &str, value: Option<f64>| match value {
        Some(f) if f > 0.0 => Ok(f * longer),
        Some(f) => Err(wrong(key, format!("is {f}"))),
        None => Err(wrong(key, "is missing".to_owned())),
    };
    let (focal, middle) = if one {
        let focal = positive("focal", camera.focal)?;
        ([focal, focal], [0.0; 2])
    } else {
        ([positive("focal_x", camera.focal_x)?, positive("focal_y", camera.focal_y)?], [camera.c_x, camera.c_y])
    };
    let center = [0.5 * sides[0] + middle[0] * longer, 0.5 * sides[1] + middle[1] * longer];
    Ok((kind.to_owned(), Lens::new(focal, center, sides.map(|side| side as u32), distortion)))
}

/// OpenSfM's name of a camera model in any usual spelling.
fn kind(name: &str) -> &str {
    let known = ["perspective", "simple_radial", "radial", "brown", "fisheye", "fisheye_opencv"];
    let wanted = names::key(name);
    known.into_iter().find(|kind| names::key(kind) == wanted).unwrap_or(name)
}
