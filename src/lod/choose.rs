//! Which tiles a picture is drawn from.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::{Bounds, Tile, Tree};
use crate::scene::Camera;

/// Pixels over which merging may move mass in a picture: less does not show.
const UNSEEN: f64 = 0.1;

/// A tile that may be replaced by its children.
struct Coarse {
    /// Pixels over which mass of the tile was moved, where it is nearest to the camera.
    pixels: f64,
    tile: usize,
}

impl PartialEq for Coarse {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Coarse {}

impl PartialOrd for Coarse {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Coarse {
    fn cmp(&self, other: &Self) -> Ordering {
        self.pixels.total_cmp(&other.pixels).then(self.tile.cmp(&other.tile))
    }
}

impl Tree {
    /// The tiles from which a camera's picture is drawn, ascending: together they show every place once, and have at
    /// most `most` splats if the root has no more. Where mass was moved furthest in the picture, tiles are replaced
    /// by their children first. Tiles out of sight stay coarse.
    pub fn choose(&self, camera: &Camera, most: usize) -> Vec<usize> {
        let Some(root) = self.root() else { return Vec::new() };
        let mut splats = root.splats;
        let mut chosen = Vec::new();
        let coarse = |tile: usize| Coarse { pixels: self.tiles.get(tile).map_or(0.0, |of| moved(of, camera)), tile };
        let mut left = BinaryHeap::from([coarse(self.tiles.len() - 1)]);
        while let Some(Coarse { pixels, tile }) = left.pop() {
            let Some(of) = self.tiles.get(tile) else { continue };
            let below: usize = of.children.iter().filter_map(|child| self.tiles.get(*child)).map(|of| of.splats).sum();
            if pixels <= UNSEEN || of.children.is_empty() || splats - of.splats + below > most {
                chosen.push(tile);
                continue;
            }
            splats = splats - of.splats + below;
            left.extend(of.children.iter().map(|child| coarse(*child)));
        }
        chosen.sort_unstable();
        chosen
    }
}

/// Pixels over which mass of a tile was moved, where the tile is nearest to the camera; zero out of sight.
fn moved(tile: &Tile, camera: &Camera) -> f64 {
    if !is_in_sight(&tile.bounds, camera) {
        return 0.0;
    }
    let at = camera.center();
    let away = |k: usize| (tile.bounds.low[k] - at[k]).max(at[k] - tile.bounds.high[k]).max(0.0);
    let distance = (0..3).map(|k| away(k).powi(2)).sum::<f64>().sqrt();
    // Within a tile everything is near.
    if tile.error > 0.0 { tile.error * camera.fx.max(camera.fy) / distance } else { 0.0 }
}

/// Whether a part of a box may lie in a picture: not all corners are beyond one edge of the picture, or behind the
/// camera.
fn is_in_sight(bounds: &Bounds, camera: &Camera) -> bool {
    let corners: [[f64; 3]; 8] = std::array::from_fn(|corner| {
        let point: [f64; 3] =
            std::array::from_fn(|k| if corner >> k & 1 == 0 { bounds.low[k] } else { bounds.high[k] });
        let along =
            |row: usize| (0..3).map(|k| camera.rotation[row][k] * point[k]).sum::<f64>() + camera.translation[row];
        [along(0), along(1), along(2)]
    });
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let beyond = |[x, y, z]: [f64; 3]| {
        let (left, right) = (camera.fx * x + camera.cx * z, camera.fx * x + (camera.cx - width) * z);
        let (top, bottom) = (camera.fy * y + camera.cy * z, camera.fy * y + (camera.cy - height) * z);
        [z <= 0.0, left < 0.0, right > 0.0, top < 0.0, bottom > 0.0]
    };
    let corners = corners.map(beyond);
    !(0..5).any(|edge| corners.iter().all(|beyond| beyond[edge]))
}
