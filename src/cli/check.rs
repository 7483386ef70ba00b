//! `psrgs-vk check`: the contents and the problems of a dataset, before a training.

mod training;

use std::collections::BTreeMap;
use std::path::PathBuf;

use psrgs_vk::dataset::georeference::FitReport;
use psrgs_vk::dataset::{self, Dataset, Decoding, Format, HostShare, PoseFault, Role, Supply, Warning};
use psrgs_vk::geodesy::KnownFrom;
use psrgs_vk::numbers::{counted, fraction, grouped, percent};
use psrgs_vk::scene::{Coordinates, MapFrame};
use psrgs_vk::train::settings::{
    BlendingVariants, DeviceChoice, HostChoice, LidarCloud, Method, Photographs, Preset, SteppingVariants, StepsByNeed,
};
use psrgs_vk::train::{self, Settings, prepare};

use super::asked::{as_options, named};
use super::console::{self, Console};
use super::exit::Failure;
use super::geo_args::{self, GeoArgs};
use super::presets;
use super::train::METHOD;
use training::Training;

/// Look at a dataset: what was found, what training takes, and what is wrong
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk check fox
  psrgs-vk check fox --preset standard --host-memory 4GiB
  psrgs-vk check fox --max-side 640 --json
  psrgs-vk check flight --gcp gcp_list.txt --crs EPSG:25832      where on a map, and how well the points fit

Points count as in view where they fall inside the picture, hidden by something or not. The overlap of a view is the \
share of its points that another one has in view too, the one with the most of them. Memory and time are those of \
`train` with the same options; for the time a few steps are taken on two of the photographs, and \
the splats that stereo would add are taken to lie where points are. Exit code 0: nothing is wrong; 7: problems are \
listed, and training would begin all the same; 3: it could not begin; 5: nor for want of memory.")]
pub(crate) struct Args {
    /// Dataset
    pub(crate) data: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub(crate) json: bool,
    /// As that of `train`
    #[arg(long, value_name = "NAME")]
    pub(crate) preset: Option<Preset>,
    /// As that of `train`
    #[arg(long, value_name = "NAME", default_value_t = METHOD)]
    pub(crate) method: Method,
    /// Training steps
    #[arg(long, value_name = "N")]
    pub(crate) iterations: Option<u32>,
    /// As that of `train`
    #[arg(long, value_name = "N")]
    pub(crate) max_splats: Option<u32>,
    #[command(flatten)]
    pub(crate) photographs: Photographs,
    #[command(flatten)]
    pub(crate) device: DeviceChoice,
    #[command(flatten)]
    pub(crate) host: HostChoice,
    #[command(flatten)]
    pub(crate) blending: BlendingVariants,
    #[command(flatten)]
    pub(crate) stepping: SteppingVariants,
    #[command(flatten)]
    pub(crate) geo: GeoArgs,
}

/// What `--json` prints.
#[derive(serde::Serialize)]
struct Report {
    format: Format,
    photographs: usize,
    train: usize,
    held_out: usize,
    folder: Option<PathBuf>,
    cameras: Vec<CameraGroup>,
    /// How photographs of more than 8 bits per channel are treated.
    deep: Vec<String>,
    points: usize,
    /// Extent of the training cameras in the dataset's units.
    extent: f64,
    center: [f64; 3],
    /// Where on Earth the coordinates lie.
    coordinates: Option<Coordinates>,
    /// The way to a map, about the middle of the training cameras.
    map: Option<MapFrame>,
    /// What the fit to positions or control points left.
    fit: Option<FitReport>,
    #[serde(skip)]
    map_rows: Vec<(&'static str, String)>,
    masks: Option<usize>,
    /// Remarks on the masks that are no problems.
    mask_notes: Vec<String>,
    /// Median over the views.
    points_in_view: Option<f64>,
    overlap: Option<f64>,
    /// Bytes of the decoded training photographs.
    photograph_bytes: u64,
    preset: Option<Preset>,
    method: Method,
    iterations: u32,
    /// How the steps were chosen, where that is left to the photographs.
    #[serde(skip)]
    steps: Option<StepsByNeed>,
    /// Memory and time of the training, where a device can be opened.
    training: Option<Training>,
    problems: Vec<String>,
}

/// Views with one lens and one size.
#[derive(serde::Serialize)]
struct CameraGroup {
    model: String,
    undistorted: bool,
    size_on_disk: (u32, u32),
    size: (u32, u32),
    views: usize,
}

pub(crate) fn run(args: &Args, matches: &clap::ArgMatches, console: &Console) -> anyhow::Result<()> {
    let mut settings = args.settings();
    let preset = presets::apply(&mut settings, |key| named(matches, key))?;
    if args.method == Method::Rsgs {
        // Either cloud takes about the same memory and time.
        settings.density.lidar = Some(LidarCloud::Mvs);
    }
    settings.check()?;
    let mut options = prepare::load_options_of(&settings);
    let (mut dataset, missing) = match Dataset::load(&args.data, &options) {
        Ok(dataset) => (dataset, None),
        Err(error @ (dataset::Error::MissingPhotographs { .. } | dataset::Error::NoPhotographs { .. })) => {
            // The poses can be checked without photographs.
            options.photographs = false;
            (Dataset::load(&args.data, &options)?, Some(error))
        }
        Err(error) => return Err(error.into()),
    };
    let mut decoded = Decoded::default();
    let mut missing = match missing {
        Some(error) => Some(error.into()),
        None => decoded.look_at(&mut dataset, &settings),
    };
    let steps = settings.choose_steps(dataset.views_of(Role::Train).count(), presets::kind(&settings)?);
    let mut found = Report { steps, ..found(&dataset, &settings, decoded) };
    found.put_on_map(&args.geo, &dataset)?;
    if missing.is_none() {
        match training::plan(&dataset, &settings, &mut found.problems, console) {
            Ok(training) => found.training = training,
            Err(error) if error.is::<train::Error>() => missing = Some(error),
            Err(error) => return Err(error),
        }
    }
    if let Some(error) = &missing {
        found.problems.insert(0, error.to_string());
    }
    if let Some(preset) = preset {
        console.say(preset);
    }
    // The command's own error is printed last, so the text leaves it out.
    let said = usize::from(missing.is_some());
    let text = if args.json { serde_json::to_string_pretty(&found)? + "\n" } else { told(&found, said) };
    console::print(&text)?;
    match (missing, found.problems.len()) {
        (Some(error), _) => Err(error),
        (None, 0) => Ok(()),
        (None, 1) => Err(Failure::Check(format!("{}: 1 problem", args.data.display())).into()),
        (None, n) => Err(Failure::Check(format!("{}: {n} problems", args.data.display())).into()),
    }
}

/// Findings from decoding the photographs.
#[derive(Default)]
struct Decoded {
    problems: Vec<String>,
    mask_notes: Vec<String>,
}

impl Decoded {
    /// Decodes the photographs without keeping them, and leaves out a few that cannot be decoded. Returns the error
    /// that prevents a training: too many cannot be decoded, or all are masked.
    fn look_at(&mut self, dataset: &mut Dataset, settings: &Settings) -> Option<anyhow::Error> {
        self.taken_in(dataset, settings).err()
    }

    fn taken_in(&mut self, dataset: &mut Dataset, settings: &Settings) -> anyhow::Result<()> {
        let mut decoding = Decoding::of(dataset);
        let mut decoded = |role| {
            let mut share = HostShare { keep: 0, ..prepare::host_share(dataset, role, &settings.host) };
            decoding.take_in(dataset, role, &mut share)
        };
        let (train, held_out) = (decoded(Role::Train)?, decoded(Role::HeldOut)?);
        let undecoded = decoding.end()?;
        self.problems.extend(undecoded.warning.iter().map(ToString::to_string));
        let gone = |name: &str| undecoded.photographs.iter().any(|photograph| photograph.name == name);
        let mut views = Vec::new();
        for (role, photographs) in [(Role::Train, &train), (Role::HeldOut, &held_out)] {
            let of_role = dataset.views_of(role).zip(photographs).filter(|((_, view), _)| !gone(&view.name));
            views.extend(of_role.map(|((_, view), photograph)| (view.name.as_str(), photograph.as_ref())));
        }
        self.take_warnings(prepare::told_of(&views));
        for (role, photographs, left_out) in [(Role::Train, &train, true), (Role::HeldOut, &held_out, false)] {
            self.problems.extend(wrong_poses(dataset, role, photographs, left_out)?);
        }
        let nothing = !train.is_empty() && train.iter().all(Option::is_none);
        dataset.leave_out(&undecoded);
        match nothing {
            true => Err(train::Error::AllMasked { dataset: dataset.path.clone(), role: Role::Train }.into()),
            false => Ok(()),
        }
    }

    /// Sorts warnings into problems and remarks: some warnings about masks are no problems.
    fn take_warnings(&mut self, warnings: Vec<Warning>) {
        for warning in warnings {
            match &warning {
                Warning::MasksLeaveOutNothing { masks, of, .. } if masks < of => {
                    self.mask_notes.push(warning.to_string())
                }
                Warning::MasksByTransparency { .. } => self.mask_notes.push(warning.to_string()),
                Warning::AllMasked { .. } | Warning::MasksLeaveOutNothing { .. } => {
                    self.problems.push(warning.to_string())
                }
                _ => {}
            }
        }
    }
}

/// Problems of photographs that do not fit the colours of the points.
fn wrong_poses(
    dataset: &Dataset,
    role: Role,
    photographs: &[Option<Supply>],
    left_out: bool,
) -> Result<Vec<String>, dataset::Error> {
    let wrong = dataset.poses_against_photographs(role, photographs)?;
    let told = |(at, fault): (usize, PoseFault)| {
        let (_, view) = dataset.views_of(role).nth(at)?;
        Some(Warning::PoseWrong { name: view.name.clone(), fault, left_out }.to_string())
    };
    Ok(wrong.into_iter().filter_map(told).collect())
}

impl Report {
    /// Adds the place on a map. Wrong control points are problems; wrong positions do no harm.
    fn put_on_map(&mut self, args: &GeoArgs, dataset: &Dataset) -> Result<(), Failure> {
        let placed = args.placed(dataset)?;
        self.map = placed.georeference.record(dataset.frame.offset);
        self.map_rows = geo_args::told(&placed);
        let warnings = geo_args::warnings(&placed);
        match placed.georeference.known_from() {
            KnownFrom::ControlPoints => self.problems.extend(warnings),
            _ => self.map_rows.extend(warnings.into_iter().map(|line| ("placed by", line))),
        }
        self.fit = placed.fit;
        Ok(())
    }
}

impl Args {
    fn settings(&self) -> Settings {
        let (photographs, device) = (self.photographs.clone(), self.device.clone());
        let mut settings = Settings { photographs, device, ..Settings::default() };
        settings.host = self.host.clone();
        settings.blending = self.blending.clone();
        settings.stepping = self.stepping.clone();
        settings.run.preset = self.preset;
        settings.run.method = self.method;
        settings.run.iterations = self.iterations.unwrap_or(settings.run.iterations);
        settings.density.max_splats = self.max_splats;
        settings
    }
}

/// What the views of a group share: lens model, whether it is undistorted, size on disk and size in use.
type Key<'a> = (&'a str, bool, (u32, u32), (u32, u32));

fn found(dataset: &Dataset, settings: &Settings, decoded: Decoded) -> Report {
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
    Report {
        format: dataset.format,
        photographs: dataset.views.len(),
        train: dataset.views_of(Role::Train).count(),
        held_out: dataset.views_of(Role::HeldOut).count(),
        folder: dataset.images.as_ref().map(|folder| folder.path.clone()),
        cameras: groups.into_iter().map(group).collect(),
        deep: dataset.deep_photographs(),
        points: dataset.points.len(),
        extent: dataset.extent,
        center: dataset.frame.offset,
        coordinates: dataset.coordinates.clone(),
        map: None,
        fit: None,
        map_rows: Vec::new(),
        masks: dataset.masks.as_ref().map(|masks| masks.matched),
        mask_notes: decoded.mask_notes,
        points_in_view: median(sights.iter().map(|s| s.points as f64).collect()),
        overlap: median(sights.iter().filter_map(|s| s.overlap).collect()),
        photograph_bytes: dataset.views_of(Role::Train).map(|(_, view)| view.pixel_bytes()).sum(),
        preset: settings.run.preset,
        method: settings.run.method,
        iterations: settings.run.iterations,
        steps: None,
        training: None,
        problems: [dataset.problems(&sights), decoded.problems].concat(),
    }
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// The report as text, without the first `said` problems.
fn told(found: &Report, said: usize) -> String {
    let mut rows: Vec<(&str, String)> = vec![("format", found.format.to_string())];
    let folder = found.folder.as_ref().map(|f| format!(", in {}", f.display())).unwrap_or_default();
    let counts = [found.photographs, found.train, found.held_out].map(grouped);
    rows.push(("photographs", format!("{}: {} to train on, {} held out{folder}", counts[0], counts[1], counts[2])));
    for group in &found.cameras {
        let (disk, size) = (group.size_on_disk, group.size);
        let how = match (group.undistorted, disk == size) {
            (true, _) => format!(", undistorted to {}x{}", size.0, size.1),
            (false, false) => format!(", reduced to {}x{}", size.0, size.1),
            (false, true) => String::new(),
        };
        rows.push(("camera", format!("{}, {}x{}{how}: {}", group.model, disk.0, disk.1, counted(group.views, "view"))));
    }
    rows.extend(found.deep.iter().map(|line| ("depth", line.clone())));
    rows.push(("points", grouped(found.points)));
    if let (Some(points), Some(overlap)) = (found.points_in_view, found.overlap) {
        let text = format!(
            "{}, {} of them shared with another view (medians)",
            counted(points.round() as u64, "point"),
            percent(overlap, 0)
        );
        rows.push(("a view has", text));
    }
    let [x, y, z] = found.center.map(|at| fraction(at, 3));
    rows.push(("extent", format!("{:.6} of the dataset's units about ({x}, {y}, {z})", found.extent)));
    if let Some(coordinates) = &found.coordinates {
        rows.push(("coordinates", coordinates.to_string()));
    }
    rows.extend(found.map_rows.iter().cloned());
    if let Some(masks) = found.masks {
        rows.push(("masks", format!("{} of {}", grouped(masks), grouped(found.photographs))));
        rows.extend(found.mask_notes.iter().map(|note| ("masks", note.clone())));
    }
    rows.push(("method", found.method.name().to_owned()));
    if let Some(preset) = found.preset {
        rows.push(("preset", format!("{preset}, {}", counted(found.iterations, "step"))));
    }
    rows.extend(found.steps.map(|steps| ("steps", as_options(&steps.to_string()).into_owned())));
    rows.extend(found.training.iter().flat_map(Training::rows));
    let mut text: String = rows.iter().map(|(name, value)| format!("{name:<14}{value}\n")).collect();
    match found.problems.get(said..).unwrap_or_default() {
        [] if said > 0 => {}
        [] => text.push_str("no problems\n"),
        problems => problems.iter().for_each(|problem| text.push_str(&format!("problem: {problem}\n"))),
    }
    text
}
