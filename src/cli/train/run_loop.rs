//! Runs a training: prints its messages, and stops it on request.

use psrgs_vk::train::{Message, Trainer};
use psrgs_vk::vk::Gpu;

use super::RunPlan;
use super::watched::{Watched, Wish};
use crate::cli::console::Console;
use crate::cli::exit::Failure;
use crate::cli::interrupt::Interrupt;
use crate::cli::progress::Progress;
use psrgs_vk::numbers::{counted, grouped, percent};

/// Takes messages until the end and returns the seconds of training. `done` is the last step of an earlier stretch.
pub(super) fn follow(
    trainer: &mut Trainer,
    plan: &RunPlan,
    gpu: &Gpu,
    (console, interrupt): (&Console, &Interrupt),
    done: u32,
    mut page: Option<&mut Watched>,
) -> anyhow::Result<f64> {
    let iterations = trainer.schedule().iterations;
    let mut progress = Progress::new(console, done, iterations).with_stages(trainer.schedule().low_until);
    let mut seconds = 0.0;
    // A page may ask with any message; the training ends after a step.
    let mut stopped_on_page = false;
    while let Some(message) = trainer.next_message()? {
        tell(&message, &mut progress);
        if let Some(page) = &mut page {
            stopped_on_page |= page.hear(&message, trainer, gpu, interrupt)? == Wish::Stop;
        }
        match message {
            Message::Step { step, seconds: now, .. } => {
                seconds = now;
                if plan.lose_device_at == Some(step) {
                    gpu.simulate_device_loss();
                }
                if progress.wants_estimate(step) {
                    progress.estimate(step, now, gpu.memory_use().current, !plan.settings.density.no_densify);
                }
                if (interrupt.asked() || stopped_on_page) && step < iterations {
                    progress.finish();
                    return Err(stopped(trainer, plan)?.into());
                }
            }
            Message::ScoringGivenUp { .. } => {
                progress.finish();
                return Err(stopped(trainer, plan)?.into());
            }
            Message::Finished { seconds: now, .. } => seconds = now,
            _ => {}
        }
    }
    progress.finish();
    Ok(seconds)
}

/// Saves the training. Returns the failure that says how to resume.
fn stopped(trainer: &mut Trainer, plan: &RunPlan) -> anyhow::Result<Failure> {
    let (step, file) = trainer.save_checkpoint()?;
    Ok(Failure::Interrupted(format!(
        "stopped after step {step}, saved {}; go on with: {}",
        file.display(),
        plan.again()
    )))
}

/// Prints a message of the training.
fn tell(message: &Message, progress: &mut Progress) {
    match message {
        Message::Step { step, loss, splats, seconds, .. } => progress.step(*step, *loss, *splats, *seconds),
        Message::Density { step, cloned, split, pruned, splats } => progress.detail(format_args!(
            "step {step}: {cloned} cloned, {split} split, {pruned} pruned: {}",
            counted(*splats, "splat")
        )),
        Message::Sigma { step, learned } => progress.detail(format_args!(
            "step {step}: sigma {:.2} for photograph {} (loss {:.4})",
            learned.sigma, learned.view, learned.loss
        )),
        Message::Propagated { step, added, share, splats } => progress.detail(format_args!(
            "step {step}: depths of {} of a photograph propagated, {} added: {}",
            percent(*share, 1),
            counted(*added, "splat"),
            counted(*splats, "splat")
        )),
        Message::Skirted { step, added, splats } => progress.detail(format_args!(
            "step {step}: {} added where no photograph looks: {}",
            counted(*added, "splat"),
            counted(*splats, "splat")
        )),
        Message::SplitWide { step, split, splats } => progress.detail(format_args!(
            "step {step}: split {} wider than the local wavelength: {}",
            counted(*split, "splat"),
            counted(*splats, "splat")
        )),
        Message::Relocated { step, relocated, added, splats } => progress.detail(format_args!(
            "step {step}: relocated {}, grew by {}: {}",
            grouped(*relocated),
            grouped(*added),
            counted(*splats, "splat")
        )),
        Message::Pruned { step, dropped, splats } => progress.detail(format_args!(
            "step {step}: {} dropped for weight or size: {}",
            counted(*dropped, "splat"),
            counted(*splats, "splat")
        )),
        Message::HarmonicsSettled { step, full, splats } => progress.detail(format_args!(
            "step {step}: {} of {} with spherical harmonics above degree 1",
            grouped(*full),
            counted(*splats, "splat")
        )),
        Message::OpacityReset { step } => progress.detail(format_args!("step {step}: opacities reset")),
        Message::Grown { what, capacity, replay_from } => {
            progress.detail(format_args!("room for {} {what}; going on from step {replay_from}", grouped(*capacity)));
        }
        Message::Evaluated { step, quality, splats, .. } => {
            progress.evaluated(*step, quality.psnr, quality.ssim, *splats);
        }
        Message::Checkpoint { step, path } => {
            progress.detail(format_args!("step {step}: saved {}", path.display()));
        }
        Message::Warning(text) => progress.warn(text),
        Message::ScoringGivenUp { .. } | Message::Finished { .. } => {}
    }
}
