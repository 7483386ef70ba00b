//! What is told of a map's accuracy, and written as `accuracy.json`.

use serde::Serialize;

use super::{
    Accuracy, Cells, Completeness, Errors, Known, PointErrors, Surface, Terrain, assess, mask, on_common_cells,
};
use crate::numbers::{fraction, grouped, percent};

/// The file.
pub const FILE: &str = "accuracy.json";

/// How the figures are meant.
const DEFINITIONS: [(&str, &str); 7] = [
    ("mask", "ground and roofs of the reference, no cell within 2 gsd of a step of more than 2 gsd"),
    ("vertical", "map less reference at the middles of masked cells, no error left out, metres"),
    ("complete", "share of masked cells, seen by two photographs, with a height within 3 gsd of the reference"),
    ("planimetric", "shifts of patches of the orthophoto with texture in the reference, no shift left out, metres"),
    ("whole", "plane of least mean absolute vertical error, and the median shift of the patches"),
    ("terrain", "ground of the reference, open or covered: no cell masked"),
    ("stereo", "the fused cloud of stereo, the median height of its points in each cell"),
];

/// The accuracy of a map, and of stereo on the same cells.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// What the map is compared with.
    pub reference: String,
    /// Ground sample distance in metres.
    pub gsd: f64,
    /// Columns and rows.
    pub cells: [usize; 2],
    /// Share of the reference's cells that are compared.
    pub compared: f64,
    /// The map.
    pub map: Accuracy,
    /// The terrain model, where one was made.
    pub terrain: Option<Terrain>,
    /// The cloud of stereo.
    pub stereo: Option<Accuracy>,
    /// Vertical errors of map and stereo where both have a height.
    pub on_common_cells: Option<[Errors; 2]>,
    /// How the figures are meant.
    pub definitions: Vec<[&'static str; 2]>,
}

/// The accuracy of a map at check points.
#[derive(Clone, Debug, Serialize)]
pub struct PointReport {
    /// The file of the points.
    pub reference: String,
    /// Ground sample distance in metres.
    pub gsd: f64,
    /// Names of the points.
    pub names: Vec<String>,
    /// Their errors.
    pub points: PointErrors,
    /// Those of the terrain model, where one was made.
    pub terrain: Option<PointErrors>,
}

impl Report {
    /// Compares a map, and the heights of stereo's cloud, with what is known.
    pub fn of(reference: String, cells: Cells, known: &Known, map: &Surface<'_>, stereo: Option<&[f32]>) -> Self {
        let truth = known.reference();
        let mask = mask(cells, &truth);
        let of_stereo = |heights| assess(cells, &truth, &mask, &Surface { heights, picture: None, seen: map.seen });
        Self {
            reference,
            gsd: cells.gsd,
            cells: [cells.width, cells.height],
            compared: mask.share,
            map: assess(cells, &truth, &mask, map),
            terrain: None,
            stereo: stereo.map(of_stereo),
            on_common_cells: stereo.map(|stereo| on_common_cells(&truth, &mask, [map.heights, stereo])),
            definitions: DEFINITIONS.iter().map(|(name, text)| [*name, *text]).collect(),
        }
    }

    /// The same with the terrain model, of which `seen` tells how many photographs look at each cell.
    pub fn with_terrain(self, known: &Known, heights: &[f32], seen: Option<&[u16]>) -> Self {
        let terrain = Terrain::of(self.gsd, &known.ground(), heights, seen);
        Self { terrain: Some(terrain), ..self }
    }

    /// The figures in lines.
    pub fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!(
            "accuracy against {}, on {} of the cells: gsd {} m",
            self.reference,
            percent(self.compared, 1),
            self.gsd
        )];
        lines.extend(self.lines_of("map", &self.map));
        if let Some(terrain) = &self.terrain {
            let parts = [("all", &terrain.vertical), ("open", &terrain.open), ("covered", &terrain.covered)];
            lines.extend(parts.iter().filter_map(|(what, errors)| self.vertical("terrain", what, errors)));
            lines.push(complete("terrain", &terrain.completeness));
        }
        if let Some(stereo) = &self.stereo {
            lines.extend(self.lines_of("stereo", stereo));
        }
        if let Some([map, stereo]) = &self.on_common_cells {
            lines.push(format!(
                "on the {} cells where both have a height: vertical RMSE {} m of the map, {} m of stereo",
                grouped(map.count as u64),
                metres(map.rmse),
                metres(stereo.rmse)
            ));
        }
        lines
    }

    fn lines_of(&self, name: &str, of: &Accuracy) -> Vec<String> {
        let mut lines = Vec::new();
        if let Some(shifts) = &of.planimetric {
            lines.push(format!(
                "{name}: planimetric RMSE {} m ({} gsd), median {} m, of {} patches",
                metres(shifts.rmse),
                fraction(shifts.rmse / self.gsd, 2),
                metres(shifts.median_length),
                grouped(shifts.count as u64)
            ));
        }
        let parts = [("all", &of.vertical), ("ground", &of.ground), ("roofs", &of.roofs)];
        lines.extend(parts.iter().filter_map(|(what, errors)| self.vertical(name, what, errors)));
        lines.push(complete(name, &of.completeness));
        let whole = &of.whole;
        let shift = whole
            .shift
            .map_or_else(String::new, |[east, north]| format!("{} m east, {} m north, ", metres(east), metres(north)));
        lines.push(format!(
            "{name}: the whole lies off by {shift}{} m up, tilted by {} degrees; vertical RMSE without it {} m",
            metres(whole.up),
            fraction(whole.tilt_degrees, 4),
            metres(whole.rmse_without)
        ));
        lines
    }

    fn vertical(&self, name: &str, what: &str, errors: &Errors) -> Option<String> {
        let gsd = |v: f64| fraction(v / self.gsd, 2);
        (errors.count > 0).then(|| {
            format!(
                "{name}: vertical, {what}: RMSE {} m ({} gsd), median of absolute errors {} m ({} gsd), of {} cells",
                metres(errors.rmse),
                gsd(errors.rmse),
                metres(errors.median_absolute),
                gsd(errors.median_absolute),
                grouped(errors.count as u64)
            )
        })
    }

    /// What makes the figures doubtful.
    pub fn warnings(&self) -> Vec<String> {
        let mut lines = Vec::new();
        if self.compared < 0.4 {
            let share = percent(self.compared, 1);
            lines.push(format!("only {share} of the cells can be compared: the others lie by steps or on plants"));
        }
        if self.map.vertical.count == 0 {
            lines.push(format!("no cell of the map lies where {} has heights", self.reference));
        }
        if let Some(shifts) = self.map.planimetric.filter(|shifts| shifts.count < 100) {
            lines.push(format!("only {} patches tell the planimetric error, where 100 are needed", shifts.count));
        }
        lines
    }
}

impl PointReport {
    /// The figures in lines.
    pub fn lines(&self) -> Vec<String> {
        let line = |what: &str, errors: &Errors| {
            format!(
                "{what} at {} of {} check points of {}: vertical RMSE {} m ({} gsd), median {} m, mean {} m",
                errors.count,
                self.names.len(),
                self.reference,
                metres(errors.rmse),
                fraction(errors.rmse / self.gsd, 2),
                metres(errors.median),
                metres(errors.mean)
            )
        };
        let mut lines = vec![line("accuracy", &self.points.vertical)];
        lines.extend(self.terrain.as_ref().map(|terrain| line("terrain", &terrain.vertical)));
        lines
    }
}

fn metres(value: f64) -> String {
    fraction(value, 3)
}

fn complete(name: &str, of: &Completeness) -> String {
    format!(
        "{name}: complete {} of {} cells that two photographs see; a height in {}",
        percent(of.complete, 2),
        grouped(of.cells as u64),
        percent(of.with_height, 2)
    )
}
