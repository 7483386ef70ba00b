//! Training as a library: trains a model on a dataset and prints the training's messages.
//!
//! ```text
//! cargo run --example train -- DATA MODEL.ply [STEPS]
//! ```

use std::error::Error;
use std::path::Path;

use psrgs_vk::dataset::Dataset;
use psrgs_vk::format::ply;
use psrgs_vk::train::{Message, Pacing, Settings, Trainer, prepare};
use psrgs_vk::vk::{Gpu, OpenOptions};

/// Results of a training.
pub struct Outcome {
    /// Number of splats of the model.
    pub splats: usize,
    /// Mean PSNR over the held-out photographs in decibels, if there are any.
    pub psnr: Option<f64>,
    /// Number of reported steps.
    pub steps: u32,
}

/// Trains on a COLMAP folder and writes the model, in the dataset's units and axes.
pub fn train(gpu: &Gpu, data: &Path, model: &Path, settings: &Settings) -> Result<Outcome, Box<dyn Error>> {
    let dataset = Dataset::load(data, &prepare::load_options_of(settings))?;
    let input = prepare::input(&dataset, settings)?;
    let mut trainer = Trainer::new(gpu, input, settings, Pacing::default(), None)?;
    let (mut psnr, mut steps) = (None, 0);
    while let Some(message) = trainer.next_message()? {
        match message {
            Message::Step { step, loss, splats, .. } => {
                steps = step;
                if step % 50 == 0 {
                    println!("step {step}: loss {loss:.4}, {splats} splats");
                }
            }
            Message::Density { step, cloned, split, pruned, .. } => {
                println!("step {step}: {cloned} cloned, {split} split, {pruned} pruned");
            }
            Message::Evaluated { step, quality, .. } => {
                println!("step {step}: PSNR {:.2} dB, SSIM {:.4}", quality.psnr, quality.ssim);
                psnr = Some(quality.psnr);
            }
            Message::Checkpoint { path, .. } => println!("saved {}", path.display()),
            Message::Warning(text) => println!("warning: {text}"),
            _ => {}
        }
    }
    let trained = trainer.model()?;
    ply::save(model, &trained, &dataset.frame, settings.model.antialias)?;
    Ok(Outcome { splats: trained.len(), psnr, steps })
}

#[allow(dead_code)]
fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let (Some(data), Some(model)) = (args.next(), args.next()) else {
        return Err("usage: train DATA MODEL.ply [STEPS]".into());
    };
    let mut settings = Settings::default();
    settings.run.iterations = args.next().map_or(Ok(2000), |steps| steps.parse())?;
    settings.run.scale_schedule = true;
    settings.check()?;
    let gpu = Gpu::open(&OpenOptions::from_env()?)?;
    let outcome = train(&gpu, data.as_ref(), model.as_ref(), &settings)?;
    println!("{model}: {} splats after {} steps", outcome.splats, outcome.steps);
    Ok(())
}
