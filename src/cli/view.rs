//! `psrgs-vk view`: a model on a page in the browser.

mod levels;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use psrgs_vk::dataset::{Dataset, LoadOptions, Role, View};
use psrgs_vk::raster::{Look, Picture};
use psrgs_vk::scene::{Camera, Frame};
use psrgs_vk::view::{Address, Drawable, Pacer, SceneInfo, Shot, Source, State, answer};
use psrgs_vk::vk::{Buffer, Gpu, Memory};

use super::console::Console;
use super::interrupt::Interrupt;
use super::live_page;
use super::look_args::{LookArgs, StrictArgs};
use super::model_file::{Drawn, ModelFile};
use levels::Levels;

/// Pictures a second while somebody moves.
const RATE: f64 = 15.0;

/// Longest wait before the program looks whether it is to end.
const NAP: Duration = Duration::from_millis(100);

/// Look at a model on a page in the browser
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk view fox-model/point_cloud.ply --cameras fox
  psrgs-vk view fox-model/point_cloud.ply --address 9000
  psrgs-vk view town/point_cloud.ply --max-splats 500000     a model too large for the device or too slow

The program renders on its device and the browser shows the pictures, so the page works through a tunnel as well: \
`ssh -L 8765:localhost:8765 HOST`, then open the printed address. Ctrl-C ends the program.")]
pub(crate) struct Args {
    /// Model
    pub(crate) model: PathBuf,
    /// Dataset whose cameras and photographs are shown
    #[arg(long, value_name = "DATA")]
    pub(crate) cameras: Option<PathBuf>,
    /// Serve the page at this address: PORT, HOST or HOST:PORT. A host other than this machine's own opens the page to
    /// other machines
    #[arg(long, value_name = "ADDR", default_value = live_page::ADDRESS)]
    pub(crate) address: Address,
    /// Photographs are reduced until their longer side has at most this many pixels
    #[arg(long, value_name = "PX", default_value_t = 1600)]
    pub(crate) max_side: u32,
    /// Draw at most this many splats: what is far or out of sight is drawn from splats merged when the program starts.
    /// A smaller number makes pictures faster and coarser [default: all splats]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(100..))]
    pub(crate) max_splats: Option<u32>,
    #[command(flatten)]
    pub(crate) files: StrictArgs,
    #[command(flatten)]
    pub(crate) look: LookArgs,
}

pub(crate) fn run(args: &Args, interrupt: &Interrupt, console: &Console) -> anyhow::Result<()> {
    let model = args.look.read(&args.model, args.files.strict, console)?;
    let (frame, shots) = match &args.cameras {
        Some(data) => cameras(data, args, console)?,
        None => (model.frame_of_its_own(), Vec::new()),
    };
    let gpu = args.look.scene.open(console)?;
    let gaussians = model.in_scene(&frame);
    let mut scene = SceneInfo::new(&title(&args.model), frame).with_shots(shots).around(&gaussians.means);
    let mut easel = match args.max_splats.map(|most| most as usize).filter(|most| *most < model.splats()) {
        Some(most) => {
            let levels = Levels::new(&gaussians, most, &args.look.drawing, console);
            // Levels put splats on the device when it is known from where they are seen.
            let none = model.with_model(model.model().rows(&[]));
            Easel { drawn: args.look.upload(&gpu, &none, &frame)?, ids: None, levels: Some(levels) }
        }
        None => Easel { drawn: args.look.upload(&gpu, &model, &frame)?, ids: identities(&gpu, &model)?, levels: None },
    };
    drop(gaussians);
    scene.parts = easel.ids.is_some();
    let splats = model.splats() as u32;
    drop(model);

    let server = live_page::start(&args.address, scene, console)?;
    let board = server.board();
    board.tell(|status| (status.state, status.splats) = (State::Final, splats));
    console.say("Ctrl-C ends the page");
    interrupt.work_begins("the page is closed");
    let mut pacer = Pacer::new(1.0, RATE, Instant::now());
    while !interrupt.asked() {
        match board.take() {
            Some(wanted) => answer(wanted, server.scene(), &board, &mut pacer, &mut easel),
            None => board.wait(NAP),
        }
    }
    Ok(())
}

/// The frame of a dataset, and its cameras with the photographs that are there.
fn cameras(data: &Path, args: &Args, console: &Console) -> anyhow::Result<(Frame, Vec<Shot>)> {
    let options = LoadOptions { max_side: Some(args.max_side), strict: args.files.strict, ..LoadOptions::default() };
    let dataset = match Dataset::load(data, &options) {
        Ok(dataset) => dataset,
        // Cameras without photographs are worth a look.
        Err(_) => Dataset::load(data, &LoadOptions { photographs: false, ..options })?,
    };
    dataset.warnings.iter().filter(|warning| warning.is_of_files()).for_each(|warning| console.warn(warning));
    let shots = dataset.views.iter().enumerate().filter_map(|(i, view)| {
        Some(Shot {
            name: view.name.clone(),
            camera: dataset.scene_camera(i)?,
            held_out: view.role == Role::HeldOut,
            photograph: dataset.images.is_some().then(|| source(view)),
        })
    });
    Ok((dataset.frame, shots.collect()))
}

/// The pixels of a photograph, decoded whenever the page asks for them.
fn source(view: &View) -> Source {
    let view = view.clone();
    Source::new(move || Ok(view.photograph().map_err(|error| error.to_string())?.pixels.rgb8()))
}

/// The identities of the splats, and the number below which they belong to the low-frequency stage.
fn identities(gpu: &Gpu, model: &ModelFile) -> anyhow::Result<Option<(Buffer, u32)>> {
    let Some(below) = model.constrained() else { return Ok(None) };
    let ids: Vec<u32> = (0..model.splats() as u32).collect();
    let buffer = gpu.buffer("ids", 4 * ids.len().max(1) as u64, Memory::Device)?;
    if !ids.is_empty() {
        gpu.write(&buffer, &ids)?;
    }
    Ok(Some((buffer, below as u32)))
}

/// The name of a model: that of its run where the file has the name that every run gives.
fn title(file: &Path) -> String {
    let name = |path: Option<&Path>| Some(path?.file_name()?.to_string_lossy().into_owned());
    let own = name(Some(file)).unwrap_or_default();
    match name(file.parent()) {
        Some(folder) if own == super::run_folder::MODEL => folder,
        _ => own,
    }
}

/// A model with the identities of its splats.
struct Easel {
    drawn: Drawn,
    ids: Option<(Buffer, u32)>,
    levels: Option<Levels>,
}

impl Easel {
    /// Puts what a camera needs on the device.
    fn prepare(&mut self, camera: &Camera) -> Result<(), String> {
        let shown = self.levels.as_mut().map(|levels| levels.show(&mut self.drawn, camera));
        shown.transpose().map(|_| ()).map_err(|error| error.to_string())
    }
}

impl Drawable for Easel {
    fn settle(&mut self) -> Result<(), String> {
        Ok(())
    }

    fn draw(&mut self, camera: &Camera, look: Look) -> Result<Picture, String> {
        self.prepare(camera)?;
        let ids = self.ids.as_ref().map(|(buffer, below)| (buffer, *below));
        self.drawn.look(camera, look, ids).map_err(|error| error.to_string())
    }

    fn depths(&mut self, camera: &Camera) -> Result<Vec<f32>, String> {
        self.prepare(camera)?;
        Ok(self.drawn.probe(camera, None).map_err(|error| error.to_string())?.median)
    }
}
