//! Where a dataset lies on a map, as commands are told and tell.

use std::path::{Path, PathBuf};

use psrgs_vk::dataset::georeference::{FitReport, PlaceOptions, Placed};
use psrgs_vk::dataset::{Dataset, LoadOptions};
use psrgs_vk::geodesy::{self, KnownFrom, ReferenceSystem, VerticalDatum};
use psrgs_vk::numbers::{counted, fraction};

use super::console::Console;
use super::exit::Failure;

/// Names of wrong positions that are printed.
const NAMED: usize = 5;

/// The options for the place on a map.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = "Map")]
pub(crate) struct GeoArgs {
    /// Reference system of the map: an EPSG code (EPSG:32632) or a PROJ string [default: that of the dataset or of the
    /// control points, else the UTM zone]
    #[arg(long, value_name = "EPSG:N|PROJ", value_parser = system)]
    pub(crate) crs: Option<ReferenceSystem>,
    /// Ground control points in OpenDroneMap's format (gcp_list.txt), which the dataset is fitted to [default: the
    /// dataset's own coordinates, else the positions that its photographs note in EXIF and XMP]
    #[arg(long, value_name = "FILE")]
    pub(crate) gcp: Option<PathBuf>,
    /// What the heights are measured from, as files shall say: a name, or an EPSG code such as EPSG:5773. No height is
    /// converted
    #[arg(long, value_name = "DATUM", value_parser = heights, default_value = "ellipsoid")]
    pub(crate) heights: VerticalDatum,
}

/// Refuses systems that no map is drawn in.
fn system(text: &str) -> Result<ReferenceSystem, geodesy::Error> {
    let system = ReferenceSystem::parse(text)?;
    system.check_map().map(|()| system)
}

fn heights(text: &str) -> Result<VerticalDatum, String> {
    Ok(VerticalDatum::parse(text))
}

impl GeoArgs {
    /// Where a dataset lies. Nothing is printed.
    pub(crate) fn placed(&self, dataset: &Dataset) -> Result<Placed, Failure> {
        let options =
            PlaceOptions { system: self.crs.clone(), heights: self.heights.clone(), control_points: self.gcp.clone() };
        dataset.georeference(&options).map_err(|problem| Failure::Input(problem.to_string()))
    }

    /// Where a dataset lies, with a line on the console for what was found.
    pub(crate) fn place(&self, dataset: &Dataset, console: &Console) -> Result<Placed, Failure> {
        let placed = self.placed(dataset)?;
        told(&placed).iter().for_each(|(name, line)| console.say(format_args!("{name}: {line}")));
        warnings(&placed).iter().for_each(|line| console.warn(format_args!("{line}")));
        Ok(placed)
    }
}

/// Reads a dataset for its cameras; the photographs, which may note positions and have masks, may be missing.
pub(crate) fn dataset(folder: &Path, options: LoadOptions, console: &Console) -> anyhow::Result<Dataset> {
    let dataset = match Dataset::load(folder, &options) {
        Ok(dataset) => dataset,
        Err(problem) if options.strict => return Err(problem.into()),
        Err(problem) => {
            let dataset = Dataset::load(folder, &LoadOptions { photographs: false, ..options })?;
            console.warn(format_args!("only the cameras are used, neither masks nor positions: {problem}"));
            dataset
        }
    };
    dataset.warnings.iter().filter(|warning| warning.is_of_files()).for_each(|warning| console.warn(warning));
    Ok(dataset)
}

/// The reference system, and what the fit left.
pub(crate) fn told(placed: &Placed) -> Vec<(&'static str, String)> {
    let found = &placed.georeference;
    let Some(system) = found.system() else {
        let why = placed.unplaced.clone().unwrap_or_default();
        return vec![("map", format!("a local system, in the dataset's units: {why}"))];
    };
    let shift = if system.is_shifted() { "; its datum is reached by a shift that is true to some metres" } else { "" };
    let mut lines = vec![("map", format!("{system}, heights above: {}{shift}", system.vertical()))];
    let fit = placed.fit.as_ref();
    let from = match (found.known_from(), fit) {
        (KnownFrom::Gps, Some(fit)) => format!("GPS of {}", counted(fit.residuals.len(), "photograph")),
        (KnownFrom::ControlPoints, Some(fit)) => counted(fit.residuals.len(), "ground control point"),
        _ => "the dataset's own coordinates".to_owned(),
    };
    lines.push(("placed by", format!("{from}{}", fit.map(figures).unwrap_or_default())));
    if let (KnownFrom::ControlPoints, Some(fit)) = (found.known_from(), fit) {
        lines.extend(fit.residuals.iter().map(|off| {
            let up = off.up.map_or_else(|| "unknown".to_owned(), |up| fraction(up, 3));
            let left_out = if off.used { "" } else { ", left out as wrong" };
            let text = format!("{} m east, {} m north, {up} m up", fraction(off.east, 3), fraction(off.north, 3));
            ("residual", format!("{}: {text}{left_out}", off.name))
        }));
    }
    lines
}

/// Residuals in a sentence.
fn figures(fit: &FitReport) -> String {
    let of = |[middle, square, largest]: [f64; 3]| {
        format!("median {} m, RMSE {} m, largest {} m", fraction(middle, 3), fraction(square, 3), fraction(largest, 3))
    };
    let height = fit.height.map_or_else(|| "unknown".to_owned(), of);
    let furthest = fit.furthest().map(|off| format!("; furthest off is {}", off.name)).unwrap_or_default();
    format!("; residuals in the plane: {}; of heights: {height}{furthest}", of(fit.plane))
}

/// What was left out.
pub(crate) fn warnings(placed: &Placed) -> Vec<String> {
    let Some(fit) = &placed.fit else { return Vec::new() };
    let mut lines = fit.notes.clone();
    let wrong = fit.wrong();
    let what = match placed.georeference.known_from() {
        KnownFrom::ControlPoints => "ground control point",
        _ => "position",
    };
    if !wrong.is_empty() {
        let named = wrong.iter().take(NAMED).map(|off| format!("{} ({} m off)", off.name, fraction(off.distance(), 2)));
        let more = if wrong.len() > NAMED { format!(" and {} more", wrong.len() - NAMED) } else { String::new() };
        let list = named.collect::<Vec<_>>().join(", ");
        lines.push(format!("{} left out as wrong: {list}{more}", counted(wrong.len(), what)));
    }
    lines
}
