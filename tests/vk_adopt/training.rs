//! Training on a host's device, step by step and watched.

use psrgs_vk::train::{Input, Message, Pacing, Settings, Trainer};
use psrgs_vk::vk::{Gpu, HostDevice, SubmitSync};

use super::common::{self, plane_scene};
use super::{adopt, host, view_while_training};

/// Steps of a training here.
pub(crate) const STEPS: u32 = 24;

fn input() -> Input {
    plane_scene::input(5, 64, 48, 300)
}

/// A training with everything in it: density changes, resets, evaluations.
fn settings() -> Settings {
    let mut s = Settings::default();
    s.run.iterations = STEPS;
    s.run.eval_every = 10;
    s.run.deterministic = true;
    s.model.sh_interval = 6;
    s.density.densify_from = 3;
    s.density.densify_until = STEPS;
    s.density.densify_interval = 5;
    s.density.opacity_reset_interval = 15;
    s.density.grad_threshold = 1e-6;
    s
}

/// The example on this training.
pub(crate) fn watch(
    host: &view_while_training::host::Host,
    description: HostDevice<'_>,
    pacing: Pacing,
) -> view_while_training::Outcome {
    let (input, settings) = (input(), settings());
    let camera = input.held_out[0].camera;
    let outcome = view_while_training::run(host, description, input, &settings, pacing, camera).unwrap();
    assert_eq!(outcome.steps, STEPS);
    outcome
}

/// The training by messages on an own device: steps with losses and splats, evaluations, and the trainer.
fn pulled(gpu: &Gpu) -> (Vec<(u32, f32, u32)>, Vec<u32>, Trainer) {
    let mut trainer = Trainer::new(gpu, input(), &settings(), Pacing::default(), None).unwrap();
    let (mut steps, mut scored) = (Vec::new(), Vec::new());
    while let Some(message) = trainer.next_message().unwrap() {
        note(message, &mut steps, &mut scored);
    }
    (steps, scored, trainer)
}

fn note(message: Message, steps: &mut Vec<(u32, f32, u32)>, scored: &mut Vec<u32>) {
    match message {
        Message::Step { step, loss, splats, .. } => steps.push((step, loss, splats)),
        Message::Evaluated { step, .. } => scored.push(step),
        _ => {}
    }
}

#[test]
fn steps_between_points_of_the_host_are_those_of_the_stream() {
    let (Some(host), Some(own)) = (host(), common::gpu()) else { return };
    let (expected, expected_scores, mut pulled) = pulled(&own);
    let gpu = adopt(&host);
    // Too small at first, so that events are lost and replayed.
    let pacing = Pacing { splat_capacity: 1, pair_capacity: 64, ..Pacing::default() };
    let mut trainer = Trainer::new(&gpu, input(), &settings(), pacing, None).unwrap();
    let timeline = host.timeline().unwrap();
    let (mut steps, mut scored, mut calls, mut grown) = (Vec::new(), Vec::new(), 0, 0);
    loop {
        let (wait, signal) = ([timeline.at(calls)], [timeline.at(calls + 1)]);
        let Some(ticket) = trainer.step(SubmitSync::new(&wait, &signal)).unwrap() else { break };
        calls += 1;
        assert_eq!(ticket, gpu.last_ticket());
        while let Some(message) = trainer.poll().unwrap() {
            grown += u32::from(matches!(message, Message::Grown { .. }));
            note(message, &mut steps, &mut scored);
        }
    }
    while let Some(message) = trainer.poll().unwrap() {
        note(message, &mut steps, &mut scored);
    }
    assert!(timeline.wait(calls, u64::MAX).unwrap());
    assert!(grown > 0 && calls > u64::from(STEPS), "{grown} growths in {calls} calls");
    assert_eq!(steps, expected);
    assert_eq!(scored, expected_scores);
    assert_eq!(trainer.model().unwrap(), pulled.model().unwrap());
}

#[test]
fn a_step_waits_for_the_host() {
    let Some(host) = host() else { return };
    let gpu = adopt(&host);
    let mut trainer = Trainer::new(&gpu, input(), &settings(), Pacing::default(), None).unwrap();
    let timeline = host.timeline().unwrap();
    let (wait, signal) = ([timeline.at(1)], [timeline.at(2)]);
    let ticket = trainer.step(SubmitSync::new(&wait, &signal)).unwrap().unwrap();
    assert!(trainer.poll().unwrap().is_none(), "polling does not wait");
    assert!(!timeline.wait(2, 200_000_000).unwrap(), "it did not wait for the host");
    assert!(!gpu.is_done(ticket).unwrap());
    timeline.signal(1).unwrap();
    assert!(timeline.wait(2, u64::MAX).unwrap());
    gpu.wait(ticket).unwrap();
    assert!(matches!(trainer.poll().unwrap(), Some(Message::Step { step: 1, .. })));
}

#[test]
fn watching_a_training_changes_nothing() {
    let Some(gpu) = common::gpu() else { return };
    let host = view_while_training::host::Host::new().unwrap().unwrap();
    let (_, _, mut trainer) = pulled(&gpu);
    // Planes that grow while the training is watched.
    let pacing = Pacing { splat_capacity: 1, pair_capacity: 64, ..Pacing::default() };
    let outcome = watch(&host, host.describe(None), pacing);
    assert!(outcome.grown > 0 && outcome.frames.1 > outcome.frames.0);
    assert_eq!(outcome.model, trainer.model().unwrap());
    // The last frame is the trained model.
    let picture = trainer.picture(&input().held_out[0].camera).unwrap();
    for (a, b) in outcome.picture.rgbt.iter().zip(&picture.rgbt) {
        assert!((a - b).abs() <= 1e-5, "{a} and {b}");
    }
}
