//! `psrgs-vk saliency`: saliency maps and texture masks of photographs as images.

use std::path::PathBuf;

use psrgs_vk::dataset::{self, Dataset, Decoding, LoadOptions, Photograph, View};
use psrgs_vk::format::image_out;
use psrgs_vk::numbers::counted;
use psrgs_vk::saliency::{Gate, Plane, Settings, split};
use rayon::prelude::*;

use super::console::Console;
use super::pictures::Pictures;
use super::{output_guard, progress};

/// The quantile of a map that is white in its PNG.
const SHOWN: f64 = 0.995;

/// Write the saliency map and the mask of a photograph or of a dataset's photographs
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk saliency fox/images/0001.jpg --out maps
  psrgs-vk saliency fox --out maps --gate gradient
  psrgs-vk saliency fox --out maps --sigma 8 --split

For each photograph: NAME.map.exr (in units of its mean) and NAME.map.png (white at its 99.5 % quantile), \
NAME.mask.exr and NAME.mask.png (from 0 to 1), all at the size they are worked out at.")]
pub(crate) struct Args {
    /// A photograph, or a dataset (whose photographs are undistorted, and masks left out)
    pub(crate) input: PathBuf,
    /// Folder for the pictures
    #[arg(long, value_name = "DIR", default_value = "saliency")]
    pub(crate) out: PathBuf,
    /// What tells texture: spectral, phase, gradient, random or off
    #[arg(long, value_name = "GATE", default_value_t = Gate::Spectral)]
    pub(crate) gate: Gate,
    /// Width of the spectral filter, in bins of an image of 256 pixels; 0 leaves the phase alone
    #[arg(long, value_name = "VALUE", default_value_t = 3.0)]
    pub(crate) sigma: f64,
    /// Photographs are reduced until their shorter side has this many pixels
    #[arg(long, value_name = "PX", default_value_t = Settings::default().side)]
    pub(crate) side: u32,
    /// Share of a photograph that counts as texture: the mean of its mask
    #[arg(long, value_name = "SHARE", default_value_t = Settings::default().share)]
    pub(crate) share: f64,
    /// Seed of --gate random
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub(crate) seed: u64,
    /// Also write the photograph in two by its mask: NAME.low.png and NAME.high.png
    #[arg(long)]
    pub(crate) split: bool,
    /// Refuse a file with a record that cannot be used; otherwise up to a tenth of them are left out, with a warning
    #[arg(long)]
    pub(crate) strict: bool,
}

/// A photograph to work on.
enum PhotographSource {
    File(PathBuf),
    View(Box<View>),
}

impl PhotographSource {
    fn name(&self) -> String {
        match self {
            Self::File(file) => file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default(),
            Self::View(view) => view.name.clone(),
        }
    }

    fn photograph(&self) -> Result<Photograph, dataset::Error> {
        match self {
            Self::File(file) => Photograph::read(file),
            Self::View(view) => view.photograph(),
        }
    }
}

pub(crate) fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let settings = Settings { side: args.side, share: args.share, ..Settings::default() };
    settings.check()?;
    Settings::check_sigma(args.sigma)?;
    let (sources, decoding) = sources(args, console)?;
    let names: Vec<String> = sources.iter().map(PhotographSource::name).collect();
    let pictures = Pictures::new(&args.out, names.iter().map(String::as_str), 1.0)?;
    let bar = progress::counter(console, sources.len(), "photographs");
    let one = |(i, source): (usize, &PhotographSource)| -> anyhow::Result<Option<dataset::Error>> {
        let photograph = match source.photograph() {
            Err(problem) if !args.strict => return Ok(Some(problem)),
            photograph => photograph?,
        };
        let luma = Plane::luma(photograph.width, photograph.height, &photograph.pixels)?.reduced(settings.side);
        let found = args.gate.mask(&luma, args.sigma, args.seed.wrapping_add(i as u64), &settings)?;
        let white = quantile(found.map.values(), SHOWN);
        write(&found.map, white, |extension| pictures.file(i, "map", extension))?;
        write(&found.mask, 1.0, |extension| pictures.file(i, "mask", extension))?;
        if args.split {
            let (width, height) = (photograph.width, photograph.height);
            for (kind, part) in ["low", "high"].into_iter().zip(split(width, height, &photograph.pixels, &found.mask)?)
            {
                let rgb = image_out::to_rgb8(&part, 3);
                image_out::write_png(&pictures.file(i, kind, "png"), width, height, &rgb)?;
            }
        }
        console.detail(format_args!("{}: {}x{}", source.name(), luma.width(), luma.height()));
        bar.inc(1);
        Ok(None)
    };
    let problems = sources.par_iter().enumerate().map(one).collect::<anyhow::Result<Vec<_>>>()?;
    bar.finish_and_clear();
    let left_out = left_out(&sources, problems, decoding, console)?;
    let of = if args.gate == Gate::Spectral {
        format!(" ({}, sigma {})", args.gate, args.sigma)
    } else {
        format!(" ({})", args.gate)
    };
    console.say(format_args!(
        "maps and masks of {} in {}{of}",
        counted(sources.len() - left_out, "photograph"),
        args.out.display()
    ));
    Ok(())
}

/// Warns of a dataset's photographs that cannot be decoded, and returns their number. Fails for a single photograph, or
/// for too many of a dataset.
fn left_out(
    sources: &[PhotographSource],
    problems: Vec<Option<dataset::Error>>,
    decoding: Option<Decoding>,
    console: &Console,
) -> anyhow::Result<usize> {
    let problems = sources.iter().zip(problems).filter_map(|(source, problem)| Some((source, problem?)));
    let Some(mut decoding) = decoding else {
        return problems.map(|(_, problem)| problem).next().map_or(Ok(0), |problem| Err(problem.into()));
    };
    for (source, problem) in problems {
        match source {
            PhotographSource::View(view) => decoding.take::<()>(view, Err(problem))?,
            PhotographSource::File(_) => return Err(problem.into()),
        };
    }
    let undecoded = decoding.end()?;
    undecoded.warning.iter().for_each(|warning| console.warn(warning));
    Ok(undecoded.photographs.len())
}

fn sources(args: &Args, console: &Console) -> anyhow::Result<(Vec<PhotographSource>, Option<Decoding>)> {
    if !args.input.is_dir() {
        return Ok((vec![PhotographSource::File(args.input.clone())], None));
    }
    // Photographs are read at full size; only the map is reduced.
    let options = LoadOptions { max_side: None, strict: args.strict, ..LoadOptions::default() };
    let dataset = Dataset::load(&args.input, &options)?;
    output_guard::check(&args.out, &dataset)?;
    for warning in &dataset.warnings {
        match warning.is_of_files() {
            true => console.warn(warning),
            // Warnings about points and poses do not matter here.
            false => console.detail(warning),
        }
    }
    let decoding = Decoding::of(&dataset);
    Ok((dataset.views.into_iter().map(|view| PhotographSource::View(Box::new(view))).collect(), Some(decoding)))
}

/// The value that a share of the values does not exceed.
fn quantile(values: &[f32], share: f64) -> f32 {
    let mut sorted = values.to_vec();
    let rank = ((share * sorted.len() as f64) as usize).min(sorted.len().saturating_sub(1));
    if sorted.is_empty() { 0.0 } else { *sorted.select_nth_unstable_by(rank, f32::total_cmp).1 }
}

fn write(plane: &Plane, white: f32, file: impl Fn(&str) -> PathBuf) -> Result<(), psrgs_vk::format::Error> {
    let (width, height) = (plane.width(), plane.height());
    image_out::write_luminance(&file("exr"), width, height, plane.values())?;
    let white = if white > 0.0 { white } else { 1.0 };
    let rgb: Vec<u8> = plane.values().iter().flat_map(|v| [image_out::to_u8(v / white); 3]).collect();
    image_out::write_png(&file("png"), width, height, &rgb)
}
