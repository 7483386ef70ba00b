//! A model drawn from levels of detail within a number of splats.

use std::convert::Infallible;
use std::time::Instant;

use psrgs_vk::lod::Tree;
use psrgs_vk::numbers::{counted, fraction};
use psrgs_vk::scene::{Camera, Gaussians};
use psrgs_vk::vk;

use crate::cli::console::Console;
use crate::cli::model_file::{DrawingArgs, Drawn};

/// Tiles of a full budget. More tiles follow the view more closely, and are merged less well at their edges.
const TILES: usize = 16;
/// Least and most splats of a tile.
const TILE: (usize, usize) = (50, 50_000);

/// The tiles of a model in its scene, and those on the device.
pub(super) struct Levels {
    tree: Tree,
    content: Vec<Gaussians>,
    most: usize,
    drawing: DrawingArgs,
    /// Tiles on the device.
    shown: Vec<usize>,
}

impl Levels {
    /// Merges the splats of a scene level by level, for pictures of at most `most` splats.
    pub(super) fn new(gaussians: &Gaussians, most: usize, drawing: &DrawingArgs, console: &Console) -> Self {
        let begun = Instant::now();
        let mut content = Vec::new();
        let keep = |_: &_, splats: &Gaussians| -> Result<(), Infallible> {
            content.push(splats.clone());
            Ok(())
        };
        let Ok(tree) = Tree::build(gaussians, (most / TILES).clamp(TILE.0, TILE.1), keep);
        console.say(format_args!(
            "levels of detail: {} on {}, made in {} s; a picture has at most {}",
            counted(tree.tiles.len(), "tile"),
            counted(tree.levels(), "level"),
            fraction(begun.elapsed().as_secs_f64(), 1),
            counted(most, "splat"),
        ));
        Self { tree, content, most, drawing: drawing.clone(), shown: Vec::new() }
    }

    /// Puts the tiles for a camera on the device, if others are there.
    pub(super) fn show(&mut self, drawn: &mut Drawn, camera: &Camera) -> Result<(), vk::Error> {
        let chosen = self.tree.choose(camera, self.most);
        if chosen == self.shown {
            return Ok(());
        }
        let mut gaussians = Gaussians::default();
        chosen.iter().filter_map(|tile| self.content.get(*tile)).for_each(|splats| gaussians.append(splats));
        drawn.replace(&gaussians, &self.drawing)?;
        self.shown = chosen;
        Ok(())
    }
}
