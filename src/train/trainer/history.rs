//! The curves of a run, which checkpoints keep.

use serde::{Deserialize, Serialize};

use crate::train::message::Message;

/// Loss of the steps, and quality and number of splats at some of them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct History {
    /// Loss of every step, from the first.
    pub loss: Vec<f32>,
    /// (step, splats) after every density change and propagation, and at the beginning.
    pub splats: Vec<(u32, u32)>,
    /// (step, PSNR in dB, SSIM, seconds) of every evaluation.
    pub quality: Vec<(u32, f64, f64, f64)>,
    /// (step, view, sigma, loss) of every update of the saliency filter's width.
    #[serde(default)]
    pub sigmas: Vec<(u32, usize, f64, f64)>,
}

impl History {
    /// Adds the numbers of a message.
    pub fn add(&mut self, message: &Message) {
        match message {
            Message::Step { step, loss, splats, .. } => {
                self.loss.truncate(step.saturating_sub(1) as usize);
                self.loss.push(*loss);
                if self.splats.is_empty() {
                    self.splats.push((*step, *splats));
                }
            }
            Message::Density { step, splats, .. }
            | Message::Propagated { step, splats, .. }
            | Message::Relocated { step, splats, .. }
            | Message::Skirted { step, splats, .. }
            | Message::SplitWide { step, splats, .. }
            | Message::Pruned { step, splats, .. } => {
                self.splats.push((*step, *splats));
            }
            Message::Evaluated { step, quality, seconds, .. } => {
                self.quality.retain(|(s, ..)| s < step);
                self.quality.push((*step, quality.psnr, quality.ssim, *seconds));
            }
            Message::Sigma { step, learned } => {
                self.sigmas.retain(|(s, ..)| s < step);
                self.sigmas.push((*step, learned.view, learned.sigma, learned.loss));
            }
            _ => {}
        }
    }

    /// Removes everything after a step.
    pub fn rewind(&mut self, step: u32) {
        self.loss.truncate(step as usize);
        self.splats.retain(|(s, _)| *s <= step);
        self.quality.retain(|(s, ..)| *s <= step);
        self.sigmas.retain(|(s, ..)| *s <= step);
    }
}
