//! Saliency maps, masks, and learning the filter's width: against a slow transform, finite differences and grid search.

// Nothing of a test binary is reachable from outside.
#![allow(unreachable_pub)]

#[path = "saliency/command.rs"]
mod command;
#[path = "saliency/gradients.rs"]
mod gradients;
#[path = "saliency/images.rs"]
mod images;
#[path = "saliency/learning.rs"]
mod learning;
#[path = "saliency/maps.rs"]
mod maps;
#[path = "saliency/parts.rs"]
mod parts;
#[path = "saliency/reference.rs"]
mod reference;
