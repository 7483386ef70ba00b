//! Statistics of the pipelines of a training, as the driver tells them. Nothing is run on the device.

use super::Error;
use crate::dataset::Pixels;
use crate::scene::{Camera, Frame, Gaussians};
use crate::stereo::Prior;
use crate::train::settings::Method;
use crate::train::{self, Engine, Event, Input, OptionalInput, Pacing, Schedule, Settings, View};
use crate::vk::{Gpu, PipelineStatistics};

/// Steps of the schedule that is recorded: in so many, everything that a schedule has comes up.
const STEPS: u32 = 400;
/// Width and height of the photograph.
const SIDE: u32 = 64;

/// Statistics of every pipeline that trainings by `3dgs` and `psrgs` need, each with and without `--deterministic`. The
/// trainings are recorded and not submitted. The device has to be opened with [`crate::vk::OpenOptions::statistics`].
pub fn statistics(gpu: &Gpu) -> Result<Vec<PipelineStatistics>, Error> {
    for method in [Method::Reference3dgs, Method::Psrgs] {
        for deterministic in [false, true] {
            let mut settings = Settings::default();
            settings.run.deterministic = deterministic;
            settings.run.iterations = STEPS;
            settings.run.scale_schedule = true;
            method.apply(&mut settings, |key| ["iterations", "scale-schedule"].contains(&key));
            record(gpu, &settings)?;
        }
    }
    Ok(gpu.pipeline_statistics()?)
}

/// Records every event of a training, which creates the pipelines.
fn record(gpu: &Gpu, settings: &Settings) -> Result<(), Error> {
    let schedule = Schedule::new(settings, 1);
    let variants = train::chosen_variants(gpu, settings)?;
    let engine = Engine::new(gpu, &input(), settings, variants, Pacing::default(), None)?;
    let mut event = Event::of_step(1);
    while event.step <= schedule.iterations {
        let mut recorder = gpu.recorder("statistics")?;
        engine.record(&mut recorder, event, &schedule.step(event.step), 0)?;
        event = event.next(&schedule);
    }
    Ok(())
}

/// One splat before one grey photograph with a known depth.
fn input() -> Input {
    let (side, pixels) = (f64::from(SIDE), (SIDE * SIDE) as usize);
    let camera = Camera {
        rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        translation: [0.0, 0.0, 4.0],
        fx: side,
        fy: side,
        cx: side / 2.0,
        cy: side / 2.0,
        width: SIDE,
        height: SIDE,
    };
    let prior = Prior {
        width: SIDE,
        height: SIDE,
        depth: vec![4.0; pixels],
        normals: vec![[0.0, 0.0, -1.0]; pixels],
        confidence: vec![1.0; pixels],
    };
    let initial = Gaussians {
        means: vec![0.0; 3],
        quats: vec![1.0, 0.0, 0.0, 0.0],
        scales: vec![-2.0; 3],
        opacities: vec![0.0],
        sh: std::array::from_fn(|_| vec![0.0; 12]),
        ids: vec![0],
    };
    Input {
        train: vec![View::new("grey", camera, Pixels::Rgba8(vec![128; 4 * pixels]))],
        held_out: Vec::new(),
        initial,
        extent: Frame::EXTENT as f32,
        optional: OptionalInput { priors: vec![Some(prior)], ..OptionalInput::default() },
    }
}
