//! OpenSfM's `reconstruction.json`, which OpenDroneMap has in its folder `opensfm`; as its documentation describes it
//! ("Reconstruction file format", "Geometric models").
//!
//! Pixels are normalised by the longer side, about the middle of the photograph; rotations are vectors (axis times angle) from
//! the world to the camera, whose axes are x right, y down, z forwards.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::error::Error;
use super::json::Json;
use super::lens::{Distortion, Lens};
use super::model::{Format, Model, Reference, Shot};
use super::points_ply::GREY;
use super::{NoColours, Point, Tracks, Warning, rotation};
use crate::format::{Error as FileError, ply};

/// The file of a project, of OpenSfM or of OpenDroneMap.
pub(super) fn file(dataset: &Path) -> Option<PathBuf> {
    let places = [dataset.join("reconstruction.json"), dataset.join("opensfm").join("reconstruction.json")];
    places.into_iter().find(|file| file.is_file())
}

/// What OpenSfM writes where no photograph says where it was taken.
const NOWHERE: Reference = Reference { latitude: 0.0, longitude: 0.0, altitude: 0.0 };

#[derive(Deserialize)]
struct Reconstruction {
    cameras: BTreeMap<String, CameraEntry>,
    shots: BTreeMap<String, ShotEntry>,
    #[serde(default)]
    points: BTreeMap<String, PointEntry>,
    reference_lla: Option<Reference>,
}

#[derive(Deserialize)]
struct CameraEntry {
    projection_type: Option<String>,
    width: u32,
    height: u32,
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
    rotation: [f64; 3],
    translation: [f64; 3],
}

#[derive(Deserialize)]
struct PointEntry {
    coordinates: [f64; 3],
    color: Option<[f64; 3]>,
}

pub(super) fn read(dataset: &Path) -> Result<Model, Error> {
    let path = file(dataset).unwrap_or_else(|| dataset.join("reconstruction.json"));
    let json = Json::open(&path)?;
    let mut parts: Vec<Reconstruction> = json.parse()?;
    let sizes: Vec<usize> = parts.iter().map(|part| part.shots.len()).collect();
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
    let lenses: BTreeMap<&String, (String, Lens)> =
        part.cameras.iter().map(|(id, camera)| Ok((id, lens(&json, id, camera)?))).collect::<Result<_, FileError>>()?;
    let mut shots = Vec::with_capacity(part.shots.len());
    for (name, shot) in &part.shots {
        let (model, lens) = lenses.get(&shot.camera).ok_or_else(|| {
            let field = format!("camera of shot '{name}'");
            json.error(name, field, format_args!("there is no camera '{}'", shot.camera))
        })?;
        shots.push(Shot {
            name: name.clone(),
            camera: shot.camera.clone(),
            model: model.clone(),
            lens: *lens,
            rotation: rotation::of_vector(shot.rotation),
            translation: shot.translation,
            mask: None,
            part: None,
            observations: Vec::new(),
        });
    }
    let (points, colourless) = points(&part.points);
    Ok(Model {
        format: Format::Opensfm,
        file: path.clone(),
        shots,
        points,
        colourless,
        tracks: Tracks::default(),
        points_file: Some(path),
        images: None,
        reference: part.reference_lla.filter(|at| *at != NOWHERE),
        warnings,
    })
}

/// The points by their numbers, and why they have no colours where they have none.
fn points(entries: &BTreeMap<String, PointEntry>) -> (Vec<Point>, Option<NoColours>) {
    let all: Option<Vec<[f64; 3]>> = entries.values().map(|entry| entry.color).collect();
    let read = all.as_deref().and_then(|all| ply::colours_of_numbers(all.as_flattened()));
    let colours = read.map(|(colours, _)| colours);
    let point = |(i, (id, entry)): (usize, (&String, &PointEntry))| {
        let id = id.parse().unwrap_or(i as u64);
        let color = colours.as_ref().and_then(|colours| colours.get(i)).copied().unwrap_or(GREY);
        Point { id, position: entry.coordinates, color, error: 0.0, track: 0 }
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
    let kind = camera.projection_type.as_deref().unwrap_or("perspective");
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
            return Err(wrong("projection_type", format!("is {other}; known are {known}")));
        }
    };
    let sides = [camera.width, camera.height].map(f64::from);
    if sides.iter().any(|side| !(1.0..=1_048_576.0).contains(side)) {
        return Err(wrong("size", format!("is {}x{}", camera.width, camera.height)));
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
    Ok((kind.to_owned(), Lens::new(focal, center, [camera.width, camera.height], distortion)))
}
