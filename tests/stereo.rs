//! Multi-view stereo: on planes of known depth, with degenerate input, and as a command.

#![allow(unreachable_pub)]

#[path = "common/mod.rs"]
mod common;

#[path = "colmap_folder/mod.rs"]
mod colmap_folder;

#[path = "stereo/alone.rs"]
mod alone;
#[path = "stereo/command.rs"]
mod command;
#[path = "stereo/cost.rs"]
mod cost;
#[path = "stereo/degenerate.rs"]
mod degenerate;
#[path = "stereo/first_splats.rs"]
mod first_splats;
#[path = "stereo/memory.rs"]
mod memory;
#[path = "stereo/planes.rs"]
mod planes;
#[path = "stereo/site.rs"]
mod site;
#[path = "stereo/sources.rs"]
mod sources;
