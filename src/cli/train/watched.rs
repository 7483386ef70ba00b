//! A training on a page in the browser.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use psrgs_vk::dataset::Dataset;
use psrgs_vk::raster::{Look, Picture};
use psrgs_vk::scene::Camera;
use psrgs_vk::train::{Input, Message, Trainer, View};
use psrgs_vk::view::{Address, Board, Command, Drawable, Pacer, SceneInfo, Server, Shot, Source, State, answer};
use psrgs_vk::vk::{DeviceKind, Gpu};

use super::RunPlan;
use crate::cli::console::Console;
use crate::cli::interrupt::Interrupt;
use crate::cli::live_page;

/// Share of time that viewing may take from the training: drawing, and where the device is a processor the work of the
/// server as well. The browser on the same processor takes its own time beside that.
const SHARE: f64 = 0.08;

/// Pictures a second while somebody moves: beside a training, and of a training that rests or is done.
const RATES: [f64; 2] = [5.0, 15.0];

/// Longest wait before the program looks whether it is to end.
const NAP: Duration = Duration::from_millis(100);

/// Somebody looks for this long after a picture was wanted.
const LOOKING: Duration = Duration::from_secs(1);

/// Seconds between two reports of a step.
const REPORT: f64 = 0.2;

/// Seconds over which the speed is measured.
const SPEED: f64 = 5.0;

/// What a viewer wants of the training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wish {
    GoOn,
    Stop,
}

/// A training that is shown.
pub(super) struct Watched {
    server: Server,
    board: Arc<Board>,
    /// Of pictures beside the training, and of pictures with the device to themselves.
    pacers: [Pacer; 2],
    /// Seconds of the device that a second of work of the server takes.
    serving: f64,
    /// When something was last wanted.
    looked: Option<Instant>,
    reported: f64,
    /// Step and seconds of the last reports.
    recent: VecDeque<(u32, f64)>,
    loss: (f64, u32),
}

/// The scene of a training.
pub(super) fn scene(plan: &RunPlan, dataset: &Dataset, input: &Input) -> SceneInfo {
    let shot = |view: &View, held_out: bool| {
        let photograph = view.photograph.clone();
        let pixels = move || Ok(photograph.pixels().map_err(|error| error.to_string())?.rgb8());
        Shot { name: view.name.clone(), camera: view.camera, held_out, photograph: Some(Source::new(pixels)) }
    };
    let train = input.train.iter().map(|view| shot(view, false));
    let mut shots: Vec<Shot> = train.chain(input.held_out.iter().map(|view| shot(view, true))).collect();
    shots.sort_by(|a, b| a.name.cmp(&b.name));
    let name = plan.out.file_name().unwrap_or(plan.out.as_os_str()).to_string_lossy();
    let mut scene = SceneInfo::new(&name, dataset.frame).with_shots(shots).around(&input.initial.means);
    scene.training = true;
    scene
}

impl Watched {
    /// Starts the page.
    pub(super) fn begin(
        address: &Address,
        mut scene: SceneInfo,
        (trainer, gpu): (&Trainer, &Gpu),
        console: &Console,
    ) -> anyhow::Result<Self> {
        let schedule = trainer.schedule();
        scene.parts = schedule.low_until > 0;
        let server = live_page::start(address, scene, console)?;
        let board = server.board();
        board.tell(|status| (status.steps, status.low_until) = (schedule.iterations, schedule.low_until));
        // Larger pictures would need memory that the plan of the training does not have.
        let pixels = server.scene().shots.iter().map(|shot| shot.camera.width * shot.camera.height).max().unwrap_or(1);
        let pacers = [(SHARE, RATES[0]), (1.0, RATES[1])]
            .map(|(share, rate)| Pacer::new(share, rate, Instant::now()).within(pixels));
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let serving = if gpu.caps().kind == DeviceKind::Cpu { 1.0 / threads as f64 } else { 0.0 };
        let recent = VecDeque::new();
        Ok(Self { server, board, pacers, serving, looked: None, reported: 0.0, recent, loss: (0.0, 0) })
    }

    /// How far the work is.
    pub(super) fn tell(&self, state: State) {
        self.board.tell(|status| status.state = state);
    }

    /// Takes in a message of the training, then does what viewers want, within their share of device time. Returns only
    /// when the training may go on, or is to stop.
    pub(super) fn hear(
        &mut self,
        message: &Message,
        trainer: &mut Trainer,
        gpu: &Gpu,
        interrupt: &Interrupt,
    ) -> anyhow::Result<Wish> {
        self.note(message);
        if self.board.is_wanted() {
            self.looked = Some(Instant::now());
        }
        let looks = self.looked.is_some_and(|at| at.elapsed() < LOOKING);
        trainer.run_ahead_at_most(looks.then_some(2));
        let mut rest: Option<Instant> = None;
        let wish = loop {
            if self.commanded(trainer)? == Wish::Stop {
                break Wish::Stop;
            }
            let paused = self.board.paused();
            self.draw(&mut Easel { trainer, gpu }, paused);
            if !paused || interrupt.asked() {
                break Wish::GoOn;
            }
            rest.get_or_insert_with(Instant::now);
            self.board.wait(NAP);
        };
        if let Some(since) = rest {
            trainer.leave_out(since.elapsed());
        }
        Ok(wish)
    }

    /// Shows the final model until the user ends the program.
    pub(super) fn stay(&mut self, trainer: &mut Trainer, gpu: &Gpu, (interrupt, console): (&Interrupt, &Console)) {
        self.tell(State::Final);
        console.say("the page goes on with the final model; Ctrl-C ends the program");
        interrupt.work_begins("the page is closed");
        self.pacers[1] = Pacer::new(1.0, RATES[1], Instant::now());
        while !interrupt.asked() {
            // The training is over: its commands have no meaning.
            while self.board.take_command().is_some() {}
            if !self.draw(&mut Easel { trainer, gpu }, true) {
                self.board.wait(NAP);
            }
        }
    }

    /// Does what viewers want of the training.
    fn commanded(&mut self, trainer: &mut Trainer) -> anyhow::Result<Wish> {
        while let Some(command) = self.board.take_command() {
            if command == Command::Stop {
                return Ok(Wish::Stop);
            }
            let (step, file) = trainer.save_checkpoint()?;
            self.board.tell(|status| status.note = saved(step, &file));
        }
        Ok(Wish::GoOn)
    }

    /// Draws one picture if one is wanted and may be drawn now. Returns whether it drew.
    fn draw(&mut self, easel: &mut Easel<'_>, alone: bool) -> bool {
        if !self.board.is_wanted() {
            return false;
        }
        let served = self.board.take_served().as_secs_f64() * self.serving;
        let pacer = &mut self.pacers[usize::from(alone)];
        if !alone {
            pacer.also_took(served);
        }
        if !pacer.wait(Instant::now()).is_zero() {
            return false;
        }
        let Some(wanted) = self.board.take() else { return false };
        answer(wanted, self.server.scene(), &self.board, pacer, easel);
        true
    }

    fn note(&mut self, message: &Message) {
        match message {
            Message::Step { step, loss, splats, seconds, .. } => {
                self.loss = (self.loss.0 + f64::from(*loss), self.loss.1 + 1);
                if seconds - self.reported >= REPORT || *step == 1 {
                    self.report(*step, *splats, *seconds);
                }
            }
            Message::Evaluated { step, quality, .. } if quality.psnr.is_finite() => {
                self.board.add("psnr", *step, quality.psnr);
            }
            Message::Checkpoint { step, path } => {
                self.board.tell(|status| status.note = saved(*step, path));
            }
            Message::Warning(text) => self.board.tell(|status| status.note.clone_from(text)),
            Message::Finished { step, splats, seconds } => self.report(*step, *splats, *seconds),
            _ => {}
        }
    }

    fn report(&mut self, step: u32, splats: u32, seconds: f64) {
        self.reported = seconds;
        self.recent.push_back((step, seconds));
        while self.recent.len() > 2 && self.recent.front().is_some_and(|first| seconds - first.1 > SPEED) {
            self.recent.pop_front();
        }
        let before = self.recent.front().copied().unwrap_or((step, seconds));
        let steps = f64::from(step.saturating_sub(before.0));
        if self.loss.1 > 0 {
            self.board.add("loss", step, self.loss.0 / f64::from(self.loss.1));
            self.loss = (0.0, 0);
        }
        self.board.add("splats", step, f64::from(splats));
        self.board.tell(|status| {
            (status.step, status.splats, status.seconds) = (step, splats, seconds);
            let to_go = f64::from(status.steps.saturating_sub(step));
            status.left = (steps > 0.0).then(|| to_go * (seconds - before.1) / steps);
        });
    }
}

/// Says that a checkpoint is written. The page need not know the folder.
fn saved(step: u32, file: &Path) -> String {
    format!("Saved step {step}: {}", file.file_name().unwrap_or(file.as_os_str()).to_string_lossy())
}

/// A model in training.
struct Easel<'a> {
    trainer: &'a mut Trainer,
    gpu: &'a Gpu,
}

impl Drawable for Easel<'_> {
    fn settle(&mut self) -> Result<(), String> {
        self.gpu.wait(self.gpu.last_ticket()).map_err(|error| error.to_string())
    }

    fn draw(&mut self, camera: &Camera, look: Look) -> Result<Picture, String> {
        self.trainer.draw(camera, look).map_err(|error| error.to_string())
    }

    fn depths(&mut self, camera: &Camera) -> Result<Vec<f32>, String> {
        self.trainer.depths(camera).map_err(|error| error.to_string())
    }
}
