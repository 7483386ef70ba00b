//! `psrgs-vk bench --pareto`: time and error of settings.

use std::path::Path;

use anyhow::Context as _;
use psrgs_vk::bench::pareto::{self, Reference, Table};
use psrgs_vk::dataset::{Dataset, Role};
use psrgs_vk::format::atomic;
use psrgs_vk::numbers::counted;
use psrgs_vk::scene::{Camera, Gaussians};
use psrgs_vk::train::settings::{Method, Run};
use psrgs_vk::train::{Settings, prepare};
use psrgs_vk::vk::Gpu;
use psrgs_vk::world::{WorldParams, generate};

use super::{Args, failure};
use crate::cli::console::{self, Console};
use crate::cli::exit::Failure;

/// Most views whose renders are compared.
const VIEWS: usize = 4;
/// Pixels of each view that are compared with double precision.
const PIXELS: usize = 1500;
/// Timed rounds of every render and gradient.
const ROUNDS: u32 = 7;

/// Contents of the JSON file, besides how it was made.
#[derive(serde::Serialize)]
struct Report<'a> {
    device: &'a str,
    data: String,
    tables: &'a [Table],
}

pub(super) fn run(args: &Args, out: &Path, console: &Console) -> anyhow::Result<()> {
    std::fs::create_dir_all(out).with_context(|| Failure::Output(out.display().to_string()))?;
    let gpu = args.open(console)?;
    let mut settings = settings(args);
    let data = match &args.data {
        Some(data) => data.clone(),
        None => {
            let world = out.join("world");
            console.say(format_args!("no dataset is given: a small world is made in {}", world.display()));
            settings.photographs.max_side = settings.photographs.max_side.min(160);
            let params = WorldParams { images: 24, max_side: 160, offpath: 0, ..WorldParams::default() };
            if !world.join("world.toml").is_file() {
                generate(&params, &world, &mut |_| ())?;
            }
            world
        }
    };
    settings.check()?;
    let dataset = Dataset::load(&data, &prepare::load_options_of(&settings))?;
    let mut tables = Vec::new();
    let mut model = match &args.init {
        Some(file) => {
            let run = Run { init: Some(file.clone()), ..settings.run.clone() };
            Some(prepare::initial(&dataset, &Settings { run, ..settings.clone() })?)
        }
        None => None,
    };
    if args.train_steps > 0 {
        let (table, trained) = trainings(args, &gpu, &dataset, &settings, console)?;
        tables.push(table);
        model = model.or(trained);
    }
    let model =
        model.context(Failure::Usage("--pareto without --train-steps needs a model: --init FILE.ply".into()))?;
    let cameras = cameras(&dataset);
    console.say(format_args!("pictures and gradients of {} against double precision", counted(model.len(), "splat")));
    let reference = Reference::new(model, &cameras, settings.model.sh_degree, PIXELS).map_err(failure)?;
    tables.push(pareto::pictures(&gpu, &reference, ROUNDS).map_err(failure)?);
    tables.push(pareto::gradients(&gpu, &reference, ROUNDS).map_err(failure)?);
    write(args, out, &gpu, &data, &tables)?;
    console::print(&pareto::markdown(&tables))?;
    console.say(format_args!("tables, plots and JSON in {}", out.display()));
    Ok(())
}

/// The settings of the trainings: `lean` has every setting that is compared, and no priors to wait for.
fn settings(args: &Args) -> Settings {
    let mut settings = Settings { photographs: args.photographs.clone(), ..Settings::of_method(Method::Lean) };
    settings.device = args.device.clone();
    settings.host = args.host.clone();
    settings.blending = args.blending.clone();
    settings.stepping = args.stepping.clone();
    settings.run.iterations = args.train_steps.max(1);
    settings.run.scale_schedule = true;
    settings.run.seed = args.seed;
    settings.model.sh_degree = args.sh_degree;
    settings
}

fn trainings(
    args: &Args,
    gpu: &Gpu,
    dataset: &Dataset,
    settings: &Settings,
    console: &Console,
) -> anyhow::Result<(Table, Option<Gaussians>)> {
    let knobs = pareto::training_knobs(gpu);
    console.say(format_args!("{} of {} each", counted(knobs.len() + 1, "training"), counted(args.train_steps, "step")));
    let input = |settings: &Settings| Ok(prepare::input(dataset, settings)?);
    let (table, scored) = pareto::trainings(gpu, settings, &knobs, input, |name, one| {
        console.say(format_args!(
            "  {name}: {:.2} dB, {}, {:.1} s",
            one.psnr,
            counted(one.splats, "splat"),
            one.seconds
        ));
    })
    .map_err(failure)?;
    Ok((table, scored.into_iter().next().map(|one| one.model)))
}

/// Cameras of some photographs, held-out ones if there are any.
fn cameras(dataset: &Dataset) -> Vec<Camera> {
    let of =
        |role| -> Vec<Camera> { dataset.views_of(role).filter_map(|(index, _)| dataset.scene_camera(index)).collect() };
    let held_out = of(Role::HeldOut);
    let all = if held_out.is_empty() { of(Role::Train) } else { held_out };
    let step = all.len().div_ceil(VIEWS).max(1);
    all.into_iter().step_by(step).collect()
}

fn write(args: &Args, out: &Path, gpu: &Gpu, data: &Path, tables: &[Table]) -> anyhow::Result<()> {
    let device = &gpu.caps().device;
    let name = data.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let about = format!("{device}, {name}, seed {}", args.seed);
    super::write(&out.join("pareto.json"), &Report { device, data: name, tables }, false)?;
    let texts = [
        ("pareto.md", pareto::markdown(tables)),
        ("pareto.svg", pareto::svg(tables)),
        ("pareto.html", pareto::page(&about, tables)),
    ];
    for (name, text) in texts {
        atomic::write(&out.join(name), |out| out.write_all(text.as_bytes()))?;
    }
    Ok(())
}
