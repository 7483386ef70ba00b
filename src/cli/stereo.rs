//! `psrgs-vk stereo`: depth and normals of photographs by multi-view stereo.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context as _;
use psrgs_vk::dataset::{Dataset, DecodeLimit, Decoding, Format, HostShare, LoadOptions, Role, Split, View};
use psrgs_vk::eval::peak_host_bytes;
use psrgs_vk::format::image_out::{
    read_depth_within, read_normals_within, write_depth, write_luminance, write_normals,
};
use psrgs_vk::format::names;
use psrgs_vk::format::ply::Cloud;
use psrgs_vk::numbers::{counted, percent};
use psrgs_vk::stereo::{
    self, Accuracy, FusedPoint, InitialPlanes, Matcher, MemoryEstimate, Observations, Prior, Scene, Settings,
    SkippedView, StereoView, ViewTruth, WithoutDepth, fuse,
};
use psrgs_vk::train::settings::{DeviceChoice, HostChoice};
use psrgs_vk::train::{HostMemory, shares_memory};
use psrgs_vk::vk::Gpu;

use super::console::Console;
use super::exit::Failure;
use super::{device, output_guard, progress};

/// Least number of observing views of the points that depths are compared with.
const TRUSTED_TRACK: usize = 3;

/// Find depth and normals of a dataset's photographs by multi-view stereo
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk stereo fox --out fox-stereo
  psrgs-vk stereo fox --out fox-stereo --max-side 640 --iterations 6
  psrgs-vk train fox --out fox-model --init fox-stereo/fused.ply

For each photograph that is trained on: depth/NAME.exr (along the camera's axis, in the dataset's units, 0 where \
unknown), normal/NAME.exr (camera frame, towards the camera) and confidence/NAME.exr (from 0 to 1); and fused.ply, a \
point cloud. Compared with the depth of DATA/depth where that is there, else with the reconstructed points.")]
pub(crate) struct Args {
    /// Dataset
    pub(crate) data: PathBuf,
    /// Folder for the results
    #[arg(long, value_name = "DIR", default_value = "stereo")]
    pub(crate) out: PathBuf,
    /// Photographs are reduced until their longer side has at most this many pixels
    #[arg(long, value_name = "PX", default_value_t = 320)]
    pub(crate) max_side: u32,
    /// Views that each is compared with, 1 to 4
    #[arg(long, value_name = "N", default_value_t = Settings::default().sources)]
    pub(crate) sources: u32,
    /// How many of them count at a pixel, the best ones
    #[arg(long, value_name = "N", default_value_t = Settings::default().best)]
    pub(crate) best: u32,
    /// Sweeps over all pixels; photographs that begin at random have three more
    #[arg(long, value_name = "N", default_value_t = Settings::default().iterations)]
    pub(crate) iterations: u32,
    /// Samples along a side of the windows that are compared: 3 to 6
    #[arg(long, value_name = "N", default_value_t = Settings::default().taps)]
    pub(crate) window: u32,
    /// Rounds in which what photographs agree on spreads to the rest, after the first
    #[arg(long, value_name = "N", default_value_t = Settings::default().rounds)]
    pub(crate) rounds: u32,
    /// Pixels from one sample of a window to the next
    #[arg(long, value_name = "PX", default_value_t = Settings::default().step)]
    pub(crate) step: u32,
    /// Least correlation of what is kept, -1 to 1
    #[arg(long, value_name = "NCC", default_value_t = Settings::default().least_ncc, allow_hyphen_values = true)]
    pub(crate) least_ncc: f32,
    /// Views that depths are checked against, at most 8
    #[arg(long, value_name = "N", default_value_t = Settings::default().checks)]
    pub(crate) checks: u32,
    /// How many of them must agree
    #[arg(long, value_name = "N", default_value_t = Settings::default().agree_sources)]
    pub(crate) agree: u32,
    /// Begin with random planes where the dataset's points could be begun with
    #[arg(long)]
    pub(crate) random_start: bool,
    /// Seed of random planes
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub(crate) seed: u32,
    /// Photographs that are left out: test, val, none, every:N or every:N:FIRST, as in `train`
    #[arg(long, value_name = "SPLIT", default_value_t = Split::Test)]
    pub(crate) split: Split,
    /// Format of the dataset: colmap, nerfstudio or opensfm [default: the first of them whose files are there]
    #[arg(long, value_name = "FORMAT")]
    pub(crate) format: Option<Format>,
    /// Folder of the photographs inside DATA [default: images, or the images_N that fits --max-side]
    #[arg(long, value_name = "FOLDER")]
    pub(crate) images: Option<PathBuf>,
    /// Refuse a file with a record that cannot be used; otherwise up to a tenth of them are left out, with a warning
    #[arg(long)]
    pub(crate) strict: bool,
    #[command(flatten)]
    pub(crate) device: DeviceChoice,
    #[command(flatten)]
    pub(crate) host: HostChoice,
}

impl Args {
    fn settings(&self) -> Settings {
        Settings {
            max_side: self.max_side,
            sources: self.sources,
            best: self.best,
            iterations: self.iterations,
            taps: self.window,
            step: self.step,
            least_ncc: self.least_ncc,
            checks: self.checks.max(self.sources),
            agree_sources: self.agree,
            rounds: self.rounds,
            seed: self.seed,
            ..Settings::default()
        }
    }
}

pub(crate) fn run(args: &Args, console: &Console, started: Instant) -> anyhow::Result<()> {
    let settings = args.settings();
    settings.check()?;
    let options = LoadOptions {
        max_side: Some(args.max_side),
        split: args.split,
        format: args.format,
        images_folder: args.images.clone(),
        host_memory: args.host.host_memory.map(|bytes| bytes.0),
        strict: args.strict,
        ..LoadOptions::default()
    };
    let mut dataset = Dataset::load(&args.data, &options)?;
    output_guard::check(&args.out, &dataset)?;
    dataset.warnings.iter().filter(|warning| !warning.is_of_training()).for_each(|warning| console.warn(warning));
    let gpu = device::open(&args.device, false, console)?;
    let share = host_share(&gpu, &dataset, &settings, &args.host, console)?;
    let mut scene = scene(&mut dataset, &settings, &share, console)?;
    if args.random_start {
        scene.views.iter_mut().for_each(|view| view.start = InitialPlanes::Random);
    }
    without_depth(&scene.skipped, console);
    let prepared = Instant::now();
    let priors = matched_views(&gpu, &scene, &settings, console)?;
    let matched = prepared.elapsed().as_secs_f64();
    let cloud = fuse(&scene.views, &priors, &settings);
    let per_pixel = u64::from(settings.sources) * settings.samples_per_pixel(1);
    console.detail(format_args!("{per_pixel} samples per pixel with all sources"));
    write(args, &dataset, &scene, &priors)?;
    let frame = &dataset.frame;
    let points = Cloud {
        positions: cloud.iter().map(|p| frame.to_dataset(p.position)).collect(),
        normals: cloud.iter().map(|p| p.normal).collect(),
        colours: cloud.iter().map(|p| p.colour).collect(),
        ..Cloud::default()
    };
    points.write(&args.out.join("fused.ply"))?;

    let views = scene.views.len() - scene.skipped.len();
    let valid = priors.iter().map(Prior::share).sum::<f64>() / views.max(1) as f64;
    console.say(format_args!(
        "{} matched in {} ({:.2} s each): {} of the pixels have a depth; {} in {}",
        counted(views, "photograph"),
        progress::duration(matched),
        matched / views.max(1) as f64,
        percent(valid, 1),
        counted(cloud.len(), "point"),
        args.out.join("fused.ply").display()
    ));
    if cloud.is_empty() && views > 0 {
        console.warn(format_args!(
            "no two photographs agree on any depth: fused.ply is empty. A lower --least-ncc or --agree keeps more; \
             poses that are wrong keep nothing"
        ));
    }
    compare(&dataset, &scene, &priors, DecodeLimit::new(options.host_memory), console)?;
    let peak = peak_host_bytes().map_or(String::new(), |bytes| format!(", {} of host memory at most", mib(bytes)));
    console.detail(format_args!("{} in all{peak}", progress::duration(started.elapsed().as_secs_f64())));
    Ok(())
}

/// The depths of all views.
fn matched_views(gpu: &Gpu, scene: &Scene, settings: &Settings, console: &Console) -> anyhow::Result<Vec<Prior>> {
    let matcher = Matcher::new(gpu, settings)?;
    let bar = progress::counter(console, scene.views.len(), "photographs");
    let priors = matcher.run(&scene.views, |done| bar.set_position((done * scene.views.len() as f64) as u64))?;
    bar.finish_and_clear();
    Ok(priors)
}

/// The cloud of a dataset, with the usual settings.
pub(crate) struct DatasetCloud {
    pub(crate) views: Vec<StereoView>,
    pub(crate) points: Vec<FusedPoint>,
}

/// Matches the photographs that a dataset trains on, at its size, and fuses their depths.
pub(crate) fn cloud(
    dataset: &mut Dataset,
    max_side: u32,
    gpu: &Gpu,
    host: &HostChoice,
    console: &Console,
) -> anyhow::Result<DatasetCloud> {
    let settings = Settings { max_side, ..Settings::default() };
    settings.check()?;
    let share = host_share(gpu, dataset, &settings, host, console)?;
    let scene = scene(dataset, &settings, &share, console)?;
    without_depth(&scene.skipped, console);
    let priors = matched_views(gpu, &scene, &settings, console)?;
    let points = fuse(&scene.views, &priors, &settings);
    Ok(DatasetCloud { views: scene.views, points })
}

/// The photographs and cameras of the scene. A few photographs that cannot be decoded are left out.
fn scene(dataset: &mut Dataset, settings: &Settings, share: &HostShare, console: &Console) -> anyhow::Result<Scene> {
    match Scene::of(dataset, settings, share, View::photograph) {
        Err(stereo::Error::Dataset(_)) => {}
        found => return Ok(found?),
    }
    // Every photograph is decoded again, which takes time only where one is damaged.
    let mut decoding = Decoding::of(dataset);
    decoding.take_in(dataset, Role::Train, &mut HostShare { keep: 0, ..*share })?;
    let undecoded = decoding.end()?;
    undecoded.warning.iter().for_each(|warning| console.warn(warning));
    dataset.leave_out(&undecoded);
    Ok(Scene::of(dataset, settings, share, View::photograph)?)
}

fn mib(bytes: u64) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}

/// The host memory that photographs may take while they are decoded.
fn host_share(
    gpu: &Gpu,
    dataset: &Dataset,
    settings: &Settings,
    host: &HostChoice,
    console: &Console,
) -> anyhow::Result<HostShare> {
    let views = || dataset.views_of(Role::Train).map(|(_, view)| view);
    let room = MemoryEstimate::of(settings, views().map(|view| (view.camera.width, view.camera.height)));
    let matching = room.host + if shares_memory(gpu) { room.device } else { 0 };
    let memory = HostMemory::new(host.host_memory.map(|bytes| bytes.0)).after(matching);
    let share = memory.share(views().map(View::decoding_bytes).max().unwrap_or(0));
    memory.check(&share)?;
    let short = memory.short_by(&share);
    let told = format!(
        "host memory: of the {} that may be used {} are in use or set aside for matching; {} for decoding, on {} \
         thread{}",
        mib(memory.budget),
        mib(memory.in_use),
        mib(share.decoding),
        share.threads,
        if share.threads == 1 { "" } else { "s" }
    );
    match short {
        0 => console.detail(told),
        _ => console.warn(format_args!("{told}; that is {} more than half of what is free", mib(short))),
    }
    Ok(share)
}

/// Path of a view's map. Creates its folder.
fn map_file(out: &Path, kind: &str, name: &Path) -> anyhow::Result<PathBuf> {
    let file = out.join(kind).join(format!("{}.exr", name.display()));
    if let Some(folder) = file.parent() {
        fs::create_dir_all(folder).with_context(|| Failure::Output(folder.display().to_string()))?;
    }
    Ok(file)
}

fn write(args: &Args, dataset: &Dataset, scene: &Scene, priors: &[Prior]) -> anyhow::Result<()> {
    fs::create_dir_all(&args.out).with_context(|| Failure::Output(args.out.display().to_string()))?;
    let views: Vec<&str> = scene.names.iter().map(String::as_str).collect();
    for ((name, view), prior) in names::nested(&views, ".exr".len()).iter().zip(&scene.views).zip(priors) {
        if view.sources.is_empty() {
            continue;
        }
        let (width, height) = (prior.width, prior.height);
        let depth: Vec<f32> = prior.depth.iter().map(|z| (f64::from(*z) / dataset.frame.scale) as f32).collect();
        write_depth(&map_file(&args.out, "depth", name)?, width, height, &depth)?;
        write_normals(&map_file(&args.out, "normal", name)?, width, height, &prior.normals)?;
        write_luminance(&map_file(&args.out, "confidence", name)?, width, height, &prior.confidence)?;
    }
    Ok(())
}

/// The true depth and normals of a view, if they lie beside the dataset.
fn known(dataset: &Dataset, name: &str, limit: DecodeLimit) -> anyhow::Result<Option<ViewTruth>> {
    let file = |kind: &str| dataset.path.join(kind).join(Path::new(name).with_extension("exr"));
    if !file("depth").is_file() {
        return Ok(None);
    }
    let depth = read_depth_within(&file("depth"), limit)?;
    let normals = match file("normal") {
        file if file.is_file() => read_normals_within(&file, limit)?.values,
        _ => Vec::new(),
    };
    Ok(Some(ViewTruth {
        width: depth.width,
        height: depth.height,
        depth: depth.values.iter().map(|z| f64::from(*z) * dataset.frame.scale).collect(),
        normals,
    }))
}

fn compare(
    dataset: &Dataset,
    scene: &Scene,
    priors: &[Prior],
    limit: DecodeLimit,
    console: &Console,
) -> anyhow::Result<()> {
    let truths = scene.names.iter().map(|name| known(dataset, name, limit)).collect::<anyhow::Result<Vec<_>>>()?;
    let percent = |v: Option<f64>| v.map_or("-".to_owned(), |v| percent(v, 2));
    if truths.iter().any(Option::is_some) {
        let found = Accuracy::of(&scene.views, priors, &truths);
        let normals = found.median_degrees().map_or("-".to_owned(), |v| format!("{v:.1}\u{b0}"));
        console.say(format_args!(
            "against the true depth: median error {}, {} of the depths within 0.5 %, {} of the pixels have one ({} of \
             those that two sources see); normals on planes: median error {normals}",
            percent(found.median_error()),
            percent(found.within(0.005)),
            percent(found.valid()),
            percent(found.valid_where_seen()),
        ));
        return Ok(());
    }
    let chosen: Vec<usize> = dataset.views_of(Role::Train).map(|(i, _)| i).collect();
    let seen = Observations::of(dataset, &chosen, 0);
    let found = Accuracy::of_points(priors, &seen.observed_by(&scene.views, TRUSTED_TRACK));
    if !seen.drawn && !dataset.tracks.is_empty() && !found.is_empty() {
        console.say(format_args!(
            "against points that 3 or more photographs observe: median error {}, {} of the depths within 0.5 %; {} \
             have a depth",
            percent(found.median_error()),
            percent(found.within(0.005)),
            percent(found.valid()),
        ));
    }
    Ok(())
}

/// Warns of photographs without a depth map, a line for each reason.
pub(crate) fn without_depth(skipped: &[SkippedView], console: &Console) {
    for why in WithoutDepth::ALL {
        let mut names = skipped.iter().filter(|skipped| skipped.why == why).map(|skipped| &skipped.name);
        let Some(first) = names.next() else { continue };
        let more = match names.count() {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        console.warn(format_args!("no depth is known of '{first}'{more}: {why}"));
    }
}
