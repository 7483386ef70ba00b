//! Inputs that are known to break rasterizers and trainers, one test per cause. The table in `docs/ACCURACY.md` has all
//! causes, also those that other tests cover.

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
