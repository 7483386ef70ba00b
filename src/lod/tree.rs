//! A tree of tiles. Leaves hold the splats of the model, each splat in one leaf. An inner tile holds a quarter of the
//! splats of its children, merged.

use super::Splats;
use super::blob::covariance;
use crate::scene::Gaussians;

/// Most children of a tile, and the splats of the children for each splat of the tile.
const CHILDREN: usize = 4;
/// Standard deviations within which a splat is drawn.
const REACH: f64 = 3.0;

/// A box, in the coordinates of the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Least coordinates.
    pub low: [f64; 3],
    /// Largest coordinates.
    pub high: [f64; 3],
}

impl Bounds {
    /// Nothing.
    pub(super) const EMPTY: Self = Self { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] };

    /// The box of splats, as far as they are drawn.
    pub(super) fn of(g: &Gaussians) -> Self {
        (0..g.len()).fold(Self::EMPTY, |all, i| {
            let [xx, _, _, yy, _, zz] = covariance(g, i);
            let deviations = [xx, yy, zz].map(|v| v.sqrt().min(f64::from(f32::MAX)));
            let (mean, reach) = (|k: usize| f64::from(g.means[3 * i + k]), |k: usize| REACH * deviations[k]);
            let low = std::array::from_fn(|k| mean(k) - reach(k));
            all.with(&Self { low, high: std::array::from_fn(|k| mean(k) + reach(k)) })
        })
    }

    /// The box of both.
    pub(super) fn with(&self, other: &Self) -> Self {
        Self {
            low: std::array::from_fn(|k| self.low[k].min(other.low[k])),
            high: std::array::from_fn(|k| self.high[k].max(other.high[k])),
        }
    }

    /// Length of the diagonal.
    pub fn diagonal(&self) -> f64 {
        (0..3).map(|k| (self.high[k] - self.low[k]).powi(2)).sum::<f64>().sqrt()
    }
}

/// A tile.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// The way from the root: the number of a child for each level below. Empty for the root.
    pub path: Vec<u8>,
    /// Splats of the tile.
    pub splats: usize,
    /// The root of the mean squared distance over which mass was moved, in the units of the model. Zero for leaves, and
    /// never less than that of a child.
    pub error: f64,
    /// Where the splats of the tile and of all tiles below are drawn.
    pub bounds: Bounds,
    /// Indices of the children.
    pub children: Vec<usize>,
}

/// The tiles, children before parents: the root is the last one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tree {
    /// The tiles.
    pub tiles: Vec<Tile>,
}

impl Tree {
    /// Builds the tree of at least one splat, with at most `most` splats in a tile, and gives each tile away as soon as
    /// there is one. Beside the model, the memory holds the splats of at most four tiles a level, and row numbers.
    pub fn build<E>(
        model: &Gaussians,
        most: usize,
        mut take: impl FnMut(&Tile, &Gaussians) -> Result<(), E>,
    ) -> Result<Self, E> {
        let most = most.max(1);
        let mut rows: Vec<u32> = (0..model.len() as u32).collect();
        let mut tree = Self::default();
        if !rows.is_empty() {
            let mut builder = Builder { model, most, tree: &mut tree, take: &mut take };
            builder.tile(&mut rows, Vec::new())?;
        }
        Ok(tree)
    }

    /// The root; `None` without splats.
    pub fn root(&self) -> Option<&Tile> {
        self.tiles.last()
    }

    /// Number of levels.
    pub fn levels(&self) -> usize {
        self.tiles.iter().map(|tile| tile.path.len() + 1).max().unwrap_or(0)
    }
}

struct Builder<'a, F> {
    model: &'a Gaussians,
    most: usize,
    tree: &'a mut Tree,
    take: F,
}

impl<E, F: FnMut(&Tile, &Gaussians) -> Result<(), E>> Builder<'_, F> {
    /// Builds the tile of some rows and all tiles below, and returns the tile's index and splats.
    fn tile(&mut self, rows: &mut [u32], path: Vec<u8>) -> Result<(usize, Splats), E> {
        let leaves = rows.len().div_ceil(self.most);
        if leaves <= 1 {
            rows.sort_unstable();
            let mut g = self.model.rows(rows);
            g.ids = (0..g.len() as u32).collect();
            let tile = Tile { path, splats: g.len(), error: 0.0, bounds: Bounds::of(&g), children: Vec::new() };
            return Ok((self.give(tile, &g)?, Splats::of(&g)));
        }
        let (mut splats, mut children) = (Splats::default(), Vec::new());
        for (k, part) in parts(self.model, rows, leaves).into_iter().enumerate() {
            let below = path.iter().copied().chain([k as u8]).collect();
            let (index, of_part) = self.tile(part, below)?;
            children.push(index);
            splats.append(of_part);
        }
        splats.merge(splats.len().div_ceil(CHILDREN).min(self.most));
        let g = splats.gaussians();
        let below = children.iter().filter_map(|k| self.tree.tiles.get(*k));
        let (bounds, error) = below.fold((Bounds::of(&g), splats.error()), |(bounds, error), child| {
            (bounds.with(&child.bounds), error.max(child.error))
        });
        let index = self.give(Tile { path, splats: g.len(), error, bounds, children }, &g)?;
        Ok((index, splats))
    }

    fn give(&mut self, tile: Tile, g: &Gaussians) -> Result<usize, E> {
        (self.take)(&tile, g)?;
        self.tree.tiles.push(tile);
        Ok(self.tree.tiles.len() - 1)
    }
}

/// Up to four parts of rows that together make the given number of leaves, about equally full.
pub(super) fn parts<'a>(model: &Gaussians, rows: &'a mut [u32], leaves: usize) -> Vec<&'a mut [u32]> {
    let ((first, of_first), (second, of_second)) = halves(model, rows, leaves);
    let mut out = Vec::new();
    for (half, leaves) in [(first, of_first), (second, of_second)] {
        if leaves < 2 {
            out.push(half);
        } else {
            let ((a, _), (b, _)) = halves(model, half, leaves);
            out.extend([a, b]);
        }
    }
    out
}

/// Rows and the number of their leaves.
type Half<'a> = (&'a mut [u32], usize);

/// Rows on both sides of a plane across the longest side of their box, shared as their leaves are. Of splats in the
/// same place those of lower rows come first.
fn halves<'a>(model: &Gaussians, rows: &'a mut [u32], leaves: usize) -> (Half<'a>, Half<'a>) {
    let at = |row: u32, k: usize| model.means[3 * row as usize + k];
    let side = |k: usize| {
        let ends = rows.iter().map(|row| at(*row, k));
        let (low, high) = ends.fold((f32::MAX, f32::MIN), |(low, high), v| (low.min(v), high.max(v)));
        f64::from(high) - f64::from(low)
    };
    let sides = [side(0), side(1), side(2)];
    let axis = (1..3).fold(0, |best, k| if sides[k] > sides[best] { k } else { best });
    let first = leaves / 2;
    // In u64: rows times leaves may be more than 32 bits hold.
    let middle = (rows.len() as u64 * first as u64 / leaves as u64) as usize;
    rows.select_nth_unstable_by(middle, |a, b| at(*a, axis).total_cmp(&at(*b, axis)).then(a.cmp(b)));
    let (a, b) = rows.split_at_mut(middle);
    ((a, first), (b, leaves - first))
}
