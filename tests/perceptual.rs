//! The perceptual distance: readers of weights, values against published numbers and an independent reference,
//! gradients against finite differences.

// Nothing of a test binary is reachable from outside.
#![allow(unreachable_pub)]

mod common;
#[path = "perceptual/files.rs"]
mod files;
#[path = "perceptual/filter_bank.rs"]
mod filter_bank;
#[path = "perceptual/gradient.rs"]
mod gradient;
#[path = "perceptual/reference.rs"]
mod reference;
#[path = "perceptual/values.rs"]
mod values;
#[path = "perceptual/weights.rs"]
mod weights;
#[path = "perceptual/written.rs"]
mod written;
