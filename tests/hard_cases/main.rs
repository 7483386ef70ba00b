//! Inputs that are known to break rasterizers and trainers, each a test named after its cause. `docs/ACCURACY.md` has
//! the table of them, with those that other tests cover.

mod blending;
mod budget;
#[path = "../colmap_folder/mod.rs"]
mod colmap_folder;
#[path = "../common/mod.rs"]
mod common;
mod device;
mod gradient_budget;
mod image;
mod optimiser;
mod poison;
mod projection;
mod scene;
mod sorting;
mod training;
