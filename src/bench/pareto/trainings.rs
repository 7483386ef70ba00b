//! Whole trainings: seconds against held-out quality.

use std::time::Instant;

use super::super::Error;
use super::{AGAIN, Setting, Table};
use crate::raster::{GradientSum, TileShape, Variants};
use crate::scene::Gaussians;
use crate::train::settings::Growth;
use crate::train::{Input, Message, Pacing, Settings, Trainer};
use crate::vk::{DeviceKind, Gpu};

/// Consecutive steps of one training before the next one takes its turn.
const TURN: u32 = 20;

/// A setting that trainings differ by.
#[derive(Clone, Debug)]
pub struct TrainingKnob {
    /// Name.
    pub name: &'static str,
    /// Options of `train` that choose the setting.
    pub options: &'static str,
    /// Applies the options.
    pub apply: fn(&mut Settings),
}

/// The default, and the settings that trade speed for error one by one.
pub fn training_knobs(gpu: &Gpu) -> Vec<TrainingKnob> {
    let knob = |name, options, apply| TrainingKnob { name, options, apply };
    let mut all = vec![
        knob("default", "", |_| ()),
        knob("deterministic", "--deterministic", |s| s.run.deterministic = true),
        knob("moments of 16 bits", "--moment-bits 16", |s| s.shortcuts.moment_bits = 16),
        knob("splats on the image alone", "--visible-adam", |s| s.shortcuts.visible_adam = true),
        knob("no reduced photographs", "--coarse-steps 0", |s| s.frequencies.coarse_steps = 0.0),
        knob("twice the steps on reduced photographs", "--coarse-steps 0.4", |s| s.frequencies.coarse_steps = 0.4),
        knob("spherical harmonics to degree 1", "--sh-degree 1", |s| s.model.sh_degree = 1),
        knob("sums by compare-and-swap", "--gradient-sum compare-and-swap", |s| {
            s.stepping.gradient_sum = Some(GradientSum::CompareAndSwap);
        }),
        knob("growth by the published threshold", "--growth threshold", |s| s.density.growth = Growth::Threshold),
    ];
    let chosen = Variants::choose(gpu, false);
    let atomic = Variants { gradients: GradientSum::Atomic, ..chosen };
    if chosen != atomic && Variants::possible(gpu).contains(&atomic) {
        all.push(knob("sums by float atomics", "--gradient-sum atomic", |s| {
            s.stepping.gradient_sum = Some(GradientSum::Atomic);
        }));
    }
    // On a CPU these tile shapes are many times slower and give the same images. The tables of pictures and gradients
    // have their times.
    if gpu.caps().kind != DeviceKind::Cpu {
        all.push(knob("tiles of 8x8", "--tile-shape column", |s| s.blending.tile_shape = Some(TileShape::Column)));
    }
    all
}

/// The result of a training.
#[derive(Clone, Debug)]
pub struct Scored {
    /// Seconds of the training steps, without evaluation.
    pub seconds: f64,
    /// Held-out PSNR in dB.
    pub psnr: f64,
    /// Held-out SSIM.
    pub ssim: f64,
    /// Splats at the end.
    pub splats: u32,
    /// The model.
    pub model: Gaussians,
    /// The variants of the passes that trained it.
    pub variants: Variants,
}

/// A training under way.
struct Running {
    knob: TrainingKnob,
    trainer: Trainer,
    /// Held-out PSNR before the first step. The loss would not do: reduced photographs come first.
    before: f64,
    seconds: f64,
    done: bool,
}

impl Running {
    fn new(gpu: &Gpu, knob: &TrainingKnob, input: Input, settings: &Settings) -> Result<Self, Error> {
        let mut trainer = Trainer::new(gpu, input, settings, Pacing::default(), None)?;
        let before = trainer.evaluate()?.psnr;
        Ok(Self { knob: knob.clone(), trainer, before, seconds: 0.0, done: false })
    }

    /// Takes one turn of steps and waits for their end on the device.
    fn go_on(&mut self) -> Result<(), Error> {
        let started = Instant::now();
        let mut steps = 0;
        while steps < TURN && !self.done {
            match self.trainer.next_message()? {
                Some(Message::Step { .. }) => steps += 1,
                Some(_) => {}
                None => self.done = true,
            }
        }
        if !self.done {
            self.trainer.drain_to_step()?;
        }
        self.seconds += started.elapsed().as_secs_f64();
        Ok(())
    }

    fn scored(mut self) -> Result<(TrainingKnob, Scored), Error> {
        let quality = self.trainer.evaluate()?;
        if quality.psnr.is_nan() || quality.psnr <= self.before {
            let (before, after) = (self.before, quality.psnr);
            return Err(Error::NotLive(format!("held-out PSNR went from {before:.2} to {after:.2} dB")));
        }
        let (splats, model) = (self.trainer.splats(), self.trainer.model()?);
        let variants = self.trainer.variants();
        let scored = Scored { seconds: self.seconds, psnr: quality.psnr, ssim: quality.ssim, splats, model, variants };
        Ok((self.knob, scored))
    }
}

/// Trains once with every knob, and once more with the default to measure the spread of two runs. All trainings are in
/// memory at once and take turns, so that other load on the machine falls on all of them alike. `input` makes the input
/// of a training from its settings. The results have the order of the table.
pub fn trainings(
    gpu: &Gpu,
    settings: &Settings,
    knobs: &[TrainingKnob],
    mut input: impl FnMut(&Settings) -> Result<Input, Error>,
    mut tell: impl FnMut(&str, &Scored),
) -> Result<(Table, Vec<Scored>), Error> {
    let again = knobs.first().map(|knob| TrainingKnob { name: AGAIN, ..knob.clone() });
    let mut running = Vec::new();
    for knob in knobs.iter().chain(&again) {
        let mut changed = settings.clone();
        (knob.apply)(&mut changed);
        // No evaluation between steps: its time would count.
        changed.run.eval_every = 0;
        running.push(Running::new(gpu, knob, input(&changed)?, &changed)?);
    }
    while running.iter().any(|one| !one.done) {
        running.iter_mut().filter(|one| !one.done).try_for_each(Running::go_on)?;
    }
    let mut all = Vec::new();
    for one in running {
        let (knob, scored) = one.scored()?;
        tell(knob.name, &scored);
        all.push((knob, scored));
    }
    let noise = match (all.first(), all.last()) {
        (Some((_, a)), Some((_, b))) => (a.psnr - b.psnr).abs(),
        _ => 0.0,
    };
    let mut table = Table {
        title: format!("Trainings: {} steps, method {}, one seed", settings.run.iterations, settings.run.method),
        time: "seconds of training".into(),
        error: "held-out error in dB (minus PSNR)".into(),
        same_error: (0.0, noise.max(0.1)),
        columns: vec!["PSNR, dB".into(), "SSIM".into(), "splats".into()],
        settings: Vec::new(),
    };
    for (knob, one) in &all {
        let default = knob.name == "default";
        let same = |of: &Scored| one.variants == of.variants && one.model == of.model;
        table.settings.push(Setting {
            name: knob.name.into(),
            options: knob.options.into(),
            default,
            repeats: !default && all.first().is_some_and(|(_, of)| same(of)),
            reproducible: one.variants.gradients == GradientSum::Slots,
            time: one.seconds,
            error: Some(-one.psnr),
            more: vec![one.psnr, one.ssim, f64::from(one.splats)],
            dominated: false,
        });
    }
    table.mark();
    Ok((table, all.into_iter().map(|(_, one)| one).collect()))
}
