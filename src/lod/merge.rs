//! Fewer splats that look alike from afar: pairs of splats that change pictures least are merged, round by round.
//!
//! Of a merged splat, mass (opacity times projected area), mean and covariance are those of all its splats together,
//! and spherical harmonics are their mean weighted by mass. A merged splat that would have to be more than opaque is
//! widened.

use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use super::blob::Blob;
use super::likeness::{Look, cost};
use crate::scene::Gaussians;

/// Neighbours, a splat itself among them, of which one may be merged with the splat.
const NEIGHBOURS: NonZero<usize> = NonZero::new(13).expect("not zero");
/// Splats that go in one round, of a hundred. In smaller rounds more pairs know what the others did before.
const ROUND: usize = 15;

/// Splats by their moments, to be merged further and further.
#[derive(Clone, Debug, Default)]
pub struct Splats(Vec<Blob>);

/// A possible merge: what it costs, and the rows of the splats.
type Pair = (f64, u32, u32);

impl Splats {
    /// The splats of a model.
    pub fn of(g: &Gaussians) -> Self {
        Self((0..g.len()).into_par_iter().map(|i| Blob::of(g, i)).collect())
    }

    /// Number of splats.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are no splats.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Adds the splats of another set.
    pub fn append(&mut self, mut other: Self) {
        self.0.append(&mut other.0);
    }

    /// Merges until at most `most` splats, or one, are left. The same splats in the same order give the same result.
    pub fn merge(&mut self, most: usize) {
        let most = most.max(1);
        while self.0.len() > most {
            let wanted = (self.0.len() - most).min((self.0.len() * ROUND / 100).max(1));
            let mut gone = vec![false; self.0.len()];
            for (cost, a, b) in self.pairs(wanted) {
                let (a, b) = (a as usize, b as usize);
                self.0[a] = self.0[a].merged(&self.0[b], cost);
                gone[b] = true;
            }
            let mut gone = gone.into_iter();
            self.0.retain(|_| gone.next() != Some(true));
        }
    }

    /// Up to `wanted` pairs, the cheapest ones, at least one. No splat is in two pairs.
    fn pairs(&self, wanted: usize) -> Vec<Pair> {
        let blobs = &self.0;
        let points: Vec<[f64; 3]> = blobs.iter().map(|blob| blob.mean.to_array()).collect();
        let tree: ImmutableKdTree<f64, 3> = ImmutableKdTree::new_from_slice(&points);
        let looks: Vec<Look> = blobs.par_iter().map(Look::of).collect();
        let near = |i: usize| {
            let (blobs, looks) = (blobs, &looks);
            let near = tree.nearest_n::<SquaredEuclidean>(&points[i], NEIGHBOURS);
            near.into_iter().map(|near| near.item as usize).filter(move |j| *j != i).map(move |j| {
                let (a, b) = (i.min(j), i.max(j));
                (cost((&blobs[a], &looks[a]), (&blobs[b], &looks[b])), a as u32, b as u32)
            })
        };
        let mut pairs: Vec<Pair> = (0..blobs.len()).into_par_iter().flat_map_iter(near).collect();
        pairs.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut taken = vec![false; blobs.len()];
        let free = |(_, a, b): &Pair| {
            let free = !taken[*a as usize] && !taken[*b as usize];
            if free {
                (taken[*a as usize], taken[*b as usize]) = (true, true);
            }
            free
        };
        pairs.into_iter().filter(free).take(wanted).collect()
    }

    /// The splats as a model has them, with ids 0, 1, 2, ..
    pub fn gaussians(&self) -> Gaussians {
        let mut out = Gaussians::zeros(self.0.len());
        self.0.iter().enumerate().for_each(|(i, blob)| blob.store(&mut out, i));
        out
    }

    /// The root of the mean squared distance over which mass was moved by merging, in the units of the means.
    pub fn error(&self) -> f64 {
        let mass: f64 = self.0.iter().map(|blob| blob.mass).sum();
        let moved: f64 = self.0.iter().map(|blob| blob.mass * blob.spread).sum();
        if mass > 0.0 { (moved / mass).sqrt() } else { 0.0 }
    }
}
