//! The commands end to end on a tiny made-up scene: train, stop, resume, repeat, render, eval; and unusable data.

// Nothing of a test binary is reachable from outside.
#![allow(unreachable_pub)]

#[path = "commands/aligned.rs"]
mod aligned;
#[path = "commands/bad_data.rs"]
mod bad_data;
#[path = "commands/blocks_run.rs"]
mod blocks_run;
mod colmap_folder;
mod common;
#[path = "commands/compare.rs"]
mod compare;
#[path = "commands/drivers.rs"]
mod drivers;
#[path = "commands/exporting.rs"]
mod exporting;
#[path = "commands/faults.rs"]
mod faults;
#[path = "commands/fronts.rs"]
mod fronts;
#[path = "commands/full_disk.rs"]
mod full_disk;
#[path = "commands/kills.rs"]
mod kills;
#[path = "commands/large_map.rs"]
mod large_map;
#[path = "commands/levels.rs"]
mod levels;
#[path = "commands/lidar.rs"]
mod lidar;
#[path = "commands/live_page.rs"]
mod live_page;
#[path = "commands/map_accuracy.rs"]
mod map_accuracy;
#[path = "commands/mapping.rs"]
mod mapping;
#[path = "commands/memory.rs"]
mod memory;
#[path = "commands/names.rs"]
mod names;
#[path = "commands/newcomer.rs"]
mod newcomer;
#[path = "commands/on_a_map.rs"]
mod on_a_map;
#[path = "commands/other_trainers.rs"]
mod other_trainers;
#[path = "commands/others_files.rs"]
mod others_files;
#[path = "commands/points.rs"]
mod points;
#[path = "commands/run.rs"]
mod run;
#[path = "commands/scoring.rs"]
mod scoring;
#[path = "commands/second_driver.rs"]
mod second_driver;
#[path = "commands/signals.rs"]
mod signals;
#[path = "commands/small_disk.rs"]
mod small_disk;
#[path = "commands/strict.rs"]
mod strict;
#[path = "../examples/train.rs"]
mod train_example;
#[path = "commands/training.rs"]
mod training;
#[path = "commands/tuning.rs"]
mod tuning;
#[path = "commands/viewing.rs"]
mod viewing;
#[path = "commands/watched.rs"]
mod watched;
#[path = "commands/weights.rs"]
mod weights;
