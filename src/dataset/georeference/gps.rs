//! The fit to the positions that photographs note.

use std::path::PathBuf;

use rayon::prelude::*;

use super::super::{Dataset, Role, View};
use super::position::{Position, noted_position};
use crate::geodesy::Tangent;
use crate::geodesy::fit::{self, Fit, Pair};
use crate::scene::Geodetic;

/// Standard deviations of positions that note none, in metres.
const USUAL: [f64; 2] = [3.0, 5.0];
/// Residual, in deviations, below which no position is called wrong.
const LEAST: f64 = 0.1;

/// The plane amid the positions, the fit to it, and the names of the photographs; else why there is none.
pub(super) fn fitted(dataset: &Dataset) -> Result<(Tangent, Fit, Vec<String>), String> {
    let views: Vec<&View> = dataset.views.iter().filter(|view| view.role != Role::Unused).collect();
    let noted: Vec<Option<Position>> = views.par_iter().map(|view| noted_position(&file(dataset, view)?)).collect();
    let found: Vec<(&View, Position)> = views.iter().zip(noted).filter_map(|(view, at)| Some((*view, at?))).collect();
    if found.is_empty() {
        return Err("neither the dataset nor its photographs say where they are".to_owned());
    }
    let known: Vec<f64> = found.iter().filter_map(|(_, at)| at.altitude).collect();
    let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
    let place = |at: &Position| Geodetic {
        latitude: at.latitude,
        longitude: at.longitude,
        // East and north hardly depend on it.
        altitude: at.altitude.unwrap_or(mean),
    };
    let places: Vec<Geodetic> = found.iter().map(|(_, at)| place(at)).collect();
    let tangent = Tangent::amid(&places).ok_or("no position")?;
    let pair = |((view, at), place): (&(&View, Position), &Geodetic)| {
        let horizontal = at.horizontal.unwrap_or(USUAL[0]);
        // What is noted of the plane says something of the height as well.
        let usual = at.horizontal.map_or(USUAL[1], |metres| 2.0 * metres);
        let vertical = if at.altitude.is_some() { at.vertical.unwrap_or(usual) } else { f64::INFINITY };
        Pair {
            point: view.camera.center(),
            place: tangent.from_geodetic(*place),
            deviation: [horizontal, horizontal, vertical],
        }
    };
    let pairs: Vec<Pair> = found.iter().zip(&places).map(pair).collect();
    let fit = fit::fit(&pairs, LEAST)
        .map_err(|problem| format!("positions that photographs note do not suffice: {problem}"))?;
    Ok((tangent, fit, found.into_iter().map(|(view, _)| view.name.clone()).collect()))
}

/// The photograph's file, also where the dataset was loaded without photographs.
fn file(dataset: &Dataset, view: &View) -> Option<PathBuf> {
    if !view.path.as_os_str().is_empty() {
        return Some(view.path.clone());
    }
    let folders = [dataset.path.join("images"), dataset.path.clone()];
    folders.into_iter().map(|folder| folder.join(&view.name)).find(|file| file.is_file())
}
