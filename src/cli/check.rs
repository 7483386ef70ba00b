//! `psrgs-vk check`: what a dataset holds, and what is wrong with it, before anything is trained.

use std::collections::BTreeMap;
use std::path::PathBuf;

use psrgs_vk::dataset::{self, Dataset, Format, Reference, Role, Sight};
use psrgs_vk::scene::SH_GROUP_FLOATS;
use psrgs_vk::train::prepare;
use psrgs_vk::train::settings::Photographs;

use super::console;
use super::exit::Failure;

/// A view with fewer points than this hardly takes part in the reconstruction.
const FEW_POINTS: usize = 20;
/// Views are named up to this many.
const NAMED: usize = 5;

/// Look at a dataset: what was found, and what is wrong with it
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk check fox
  psrgs-vk check fox --max-side 640 --json

Points count as in view where they fall inside the picture, hidden by something or not. The overlap of a view is the share of its
points that another one has in view too, the one with the most of them. Exit code 0: nothing is wrong; 7: problems are listed,
and training would begin all the same; 3: it could not begin.")]
pub(crate) struct Args {
    /// Dataset
    pub(crate) data: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) photographs: Photographs,
}

/// What `--json` prints.
#[derive(serde::Serialize)]
struct Found {
    format: Format,
    photographs: usize,
    train: usize,
    held_out: usize,
    folder: Option<PathBuf>,
    cameras: Vec<CameraGroup>,
    points: usize,
    /// Of the training cameras, in the dataset's units.
    extent: f64,
    center: [f64; 3],
    reference: Option<Reference>,
    masks: Option<usize>,
    /// Medians over the views.
    points_in_view: Option<f64>,
    overlap: Option<f64>,
    /// Bytes of device memory: photographs, and the model at the beginning with gradients and moments.
    photograph_bytes: u64,
    model_bytes: u64,
    problems: Vec<String>,
}

/// Views of one lens at one size.
#[derive(serde::Serialize)]
struct CameraGroup {
    model: String,
    undistorted: bool,
    size_on_disk: (u32, u32),
    size: (u32, u32),
    views: usize,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let mut options = prepare::load_options(&args.photographs);
    let (dataset, missing) = match Dataset::load(&args.data, &options) {
        Ok(dataset) => (dataset, None),
        Err(error @ (dataset::Error::MissingPhotographs { .. } | dataset::Error::NoPhotographs { .. })) => {
            // The poses can be told of without them.
            options.photographs = false;
            (Dataset::load(&args.data, &options)?, Some(error))
        }
        Err(error) => return Err(error.into()),
    };
    let mut found = found(&dataset);
    if let Some(error) = &missing {
        found.problems.insert(0, error.to_string());
    }
    let text = if args.json { serde_json::to_string_pretty(&found)? + "\n" } else { told(&found) };
    console::print(&text)?;
    match (missing, found.problems.len()) {
        (Some(error), _) => Err(error.into()),
        (None, 0) => Ok(()),
        (None, 1) => Err(Failure::Check(format!("{}: 1 problem", args.data.display())).into()),
        (None, n) => Err(Failure::Check(format!("{}: {n} problems", args.data.display())).into()),
    }
}

/// What a group has in common: model, whether it is undistorted, size on disk and size.
type Key<'a> = (&'a str, bool, (u32, u32), (u32, u32));

fn found(dataset: &Dataset) -> Found {
    let sights = dataset.sights();
    let mut groups: BTreeMap<Key<'_>, usize> = BTreeMap::new();
    for view in &dataset.views {
        let size = (view.camera.width, view.camera.height);
        *groups.entry((&view.model, view.lens.is_some(), view.size_on_disk, size)).or_default() += 1;
    }
    let group = |((model, undistorted, size_on_disk, size), views): (Key<'_>, usize)| CameraGroup {
        model: model.to_owned(),
        undistorted,
        size_on_disk,
        size,
        views,
    };
    let pixels = |size: (u32, u32)| u64::from(size.0) * u64::from(size.1);
    let trained = dataset.views_of(Role::Train).map(|(_, v)| 4 * pixels((v.camera.width, v.camera.height)));
    // Means, rotations, scales, opacity and four planes of spherical harmonics; values, gradients and two moments of each.
    let floats = (3 + 4 + 3 + 1 + 4 * SH_GROUP_FLOATS) as u64;
    Found {
        format: dataset.format,
        photographs: dataset.views.len(),
        train: dataset.views_of(Role::Train).count(),
        held_out: dataset.views_of(Role::HeldOut).count(),
        folder: dataset.images.as_ref().map(|folder| folder.path.clone()),
        cameras: groups.into_iter().map(group).collect(),
        points: dataset.points.len(),
        extent: dataset.extent,
        center: dataset.frame.offset,
        reference: dataset.reference,
        masks: dataset.masks.as_ref().map(|masks| masks.matched),
        points_in_view: median(sights.iter().map(|s| s.points as f64).collect()),
        overlap: median(sights.iter().filter_map(|s| s.overlap).collect()),
        photograph_bytes: trained.sum(),
        model_bytes: 16 * floats * dataset.points.len() as u64,
        problems: problems(dataset, &sights),
    }
}

fn problems(dataset: &Dataset, sights: &[Sight]) -> Vec<String> {
    let mut problems: Vec<String> = dataset.warnings.iter().map(ToString::to_string).collect();
    if dataset.points.is_empty() {
        return problems;
    }
    let named = |wanted: &dyn Fn(usize) -> bool| -> Vec<&str> {
        dataset.views.iter().zip(sights).filter(|(_, s)| wanted(s.points)).map(|(v, _)| v.name.as_str()).collect()
    };
    for (names, what) in [
        (named(&|n| n == 0), "without any point in view: their poses are wrong, or nothing was reconstructed there"),
        (named(&|n| n > 0 && n < FEW_POINTS), "with fewer than 20 points in view"),
    ] {
        if !names.is_empty() {
            let more = if names.len() > NAMED { ", ..." } else { "" };
            problems.push(format!(
                "{} views {what}: {}{more}",
                names.len(),
                names[..names.len().min(NAMED)].join(", ")
            ));
        }
    }
    problems
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

fn told(found: &Found) -> String {
    let mut rows: Vec<(&str, String)> = vec![("format", found.format.to_string())];
    let folder = found.folder.as_ref().map(|f| format!(", in {}", f.display())).unwrap_or_default();
    let counts = (found.photographs, found.train, found.held_out);
    rows.push(("photographs", format!("{}: {} to train on, {} held out{folder}", counts.0, counts.1, counts.2)));
    for group in &found.cameras {
        let (disk, size) = (group.size_on_disk, group.size);
        let how = match (group.undistorted, disk == size) {
            (true, _) => format!(", undistorted to {}x{}", size.0, size.1),
            (false, false) => format!(", reduced to {}x{}", size.0, size.1),
            (false, true) => String::new(),
        };
        rows.push(("camera", format!("{}, {}x{}{how}: {} views", group.model, disk.0, disk.1, group.views)));
    }
    rows.push(("points", found.points.to_string()));
    if let (Some(points), Some(overlap)) = (found.points_in_view, found.overlap) {
        let text = format!("{points:.0} points, {:.0} % of them shared with another view (medians)", 100.0 * overlap);
        rows.push(("a view has", text));
    }
    let [x, y, z] = found.center;
    rows.push(("extent", format!("{:.6} of the dataset's units about ({x:.3}, {y:.3}, {z:.3})", found.extent)));
    if let Some(at) = &found.reference {
        rows.push(("origin", format!("{} N, {} E, {} m", at.latitude, at.longitude, at.altitude)));
    }
    if let Some(masks) = found.masks {
        rows.push(("masks", format!("{masks} of {}", found.photographs)));
    }
    let mebibytes = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    rows.push((
        "device memory",
        format!(
            "{:.1} MiB for the photographs, {:.1} MiB for the first splats with gradients and moments",
            mebibytes(found.photograph_bytes),
            mebibytes(found.model_bytes)
        ),
    ));
    let mut text: String = rows.iter().map(|(name, value)| format!("{name:<14}{value}\n")).collect();
    match found.problems.as_slice() {
        [] => text.push_str("no problems\n"),
        problems => problems.iter().for_each(|problem| text.push_str(&format!("problem: {problem}\n"))),
    }
    text
}
