//! Small trainings for the other modules.

use std::collections::HashMap;

use psrgs_vk::dataset::Pixels;
use psrgs_vk::raster::PLANES;
use psrgs_vk::train::{Input, Message, Pacing, Settings, State, Trainer, View};
use psrgs_vk::vk::Gpu;

pub(crate) fn settings(iterations: u32) -> Settings {
    let mut s = Settings::default();
    s.run.iterations = iterations;
    s.run.deterministic = true;
    s.run.eval_every = 0;
    s.density.densify_from = 10;
    s.density.densify_until = iterations;
    s.density.densify_interval = 15;
    s.density.opacity_reset_interval = 0;
    s.model.sh_interval = 20;
    // A scene this small needs larger steps than the reference's.
    s.optimiser.lr_sh_base = 0.02;
    s.optimiser.lr_opacities = 0.1;
    s
}

/// The messages of a training.
#[derive(Default)]
pub(crate) struct Told {
    pub(crate) losses: Vec<f32>,
    /// Step, splats grown, splats pruned.
    pub(crate) changes: Vec<[u32; 3]>,
    pub(crate) warnings: Vec<String>,
}

impl Told {
    pub(crate) fn grown(&self) -> u32 {
        self.changes.iter().map(|c| c[1]).sum()
    }
}

/// Trains to the end, or until the message of step `until`.
pub(crate) fn run(trainer: &mut Trainer, until: u32) -> Told {
    let mut told = Told::default();
    while let Some(message) = trainer.next_message().expect("message") {
        match message {
            Message::Step { step, loss, .. } => {
                told.losses.push(loss);
                if step == until {
                    break;
                }
            }
            Message::Density { step, cloned, split, pruned, .. } => told.changes.push([step, cloned + split, pruned]),
            Message::Warning(text) => told.warnings.push(text),
            _ => {}
        }
    }
    told
}

pub(crate) fn trained(gpu: &Gpu, input: Input, settings: &Settings) -> (Trainer, Told) {
    let mut trainer = Trainer::new(gpu, input, settings, Pacing::default(), None).expect("trainer");
    let told = run(&mut trainer, u32::MAX);
    (trainer, told)
}

pub(crate) fn state(trainer: &mut Trainer) -> State {
    trainer.snapshot().expect("snapshot").state
}

/// Mean of the last `n` losses.
pub(crate) fn tail(losses: &[f32], n: usize) -> f32 {
    losses[losses.len() - n..].iter().sum::<f32>() / n as f32
}

/// The view with every pixel mapped.
pub(crate) fn mapped(view: &View, pixel: impl Fn([u8; 4]) -> [u8; 4]) -> View {
    let pixels = view.photograph.pixels().expect("pixels");
    let pixels = pixels.rgba8().chunks_exact(4).flat_map(|p| pixel([p[0], p[1], p[2], p[3]])).collect();
    View::new(&view.name, view.camera, Pixels::Rgba8(pixels))
}

/// The input with every pixel of every photograph mapped.
pub(crate) fn mapped_input(input: &Input, pixel: impl Fn([u8; 4]) -> [u8; 4] + Copy) -> Input {
    let all = |views: &[View]| views.iter().map(|view| mapped(view, pixel)).collect();
    Input { train: all(&input.train), held_out: all(&input.held_out), ..input.clone() }
}

/// Bits of every row of a splat's parameters, moments and statistics, by its identity.
pub(crate) fn by_identity(state: &State) -> HashMap<u32, Vec<u32>> {
    let rows = |i: usize| {
        let planes = [&state.params].into_iter().chain(&state.moments);
        let of_planes = planes.flat_map(move |planes| {
            planes.iter().zip(PLANES).flat_map(move |(plane, (_, row))| {
                let row = row as usize;
                plane[row * i..row * (i + 1)].iter().map(|v| v.to_bits())
            })
        });
        of_planes.chain(state.stats[4 * i..4 * i + 4].iter().map(|v| v.to_bits())).collect()
    };
    state.ids.iter().enumerate().map(|(i, id)| (*id, rows(i))).collect()
}
