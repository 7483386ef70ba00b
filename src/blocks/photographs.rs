//! Which photographs a block is trained on.

use std::collections::BTreeMap;

use super::Cell;
use super::surface::Surface;

/// A photograph is of a block if it sees the block with at least this share of the largest share that any photograph
/// does: blocks much larger than photographs take those of their inside, and small blocks those that look at them.
const SHARE: f64 = 0.35;
/// Photographs that see each piece of a cell, at least, as far as there are any: two tell a depth.
const VIEWS_OF_PIECE: usize = 2;
/// Share of the pieces of a cell that may be seen by fewer.
const UNSEEN: f64 = 0.03;

/// A block before its photographs are chosen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    pub(super) cell: Cell,
    pub(super) margin: f64,
}

/// A photograph of a block, with the share of it that sees cell and margin.
pub(super) type Chosen = (u32, f64);

/// The photographs of each part, by ascending position; `views` is the number of all photographs. Every photograph
/// that sees a piece is of one part at least.
pub(super) fn choose(surface: &Surface, parts: &[Part], views: usize) -> Vec<Vec<Chosen>> {
    let shares = shares(surface, parts, views);
    let mut chosen: Vec<BTreeMap<u32, f64>> = shares
        .iter()
        .map(|of| {
            let most = of.values().copied().fold(0.0, f64::max);
            of.iter().filter(|(_, share)| **share >= SHARE * most).map(|(view, share)| (*view, *share)).collect()
        })
        .collect();
    for (part, chosen) in chosen.iter_mut().enumerate() {
        complete(surface, parts[part], &shares[part], chosen);
    }
    place_all(&shares, &mut chosen, views);
    chosen.into_iter().map(|of| of.into_iter().collect()).collect()
}

/// For each part the share of each photograph that sees it.
fn shares(surface: &Surface, parts: &[Part], views: usize) -> Vec<BTreeMap<u32, f64>> {
    let mut whole = vec![0.0_f64; views];
    let mut shares: Vec<BTreeMap<u32, f64>> = vec![BTreeMap::new(); parts.len()];
    for (at, piece) in surface.pieces.iter().enumerate() {
        let sights = surface.sights(at);
        for sight in sights {
            if let Some(whole) = whole.get_mut(sight.view as usize) {
                *whole += f64::from(sight.pixels);
            }
        }
        let holding = parts.iter().zip(&mut shares).filter(|(part, _)| part.cell.holds(piece.place, part.margin));
        for (_, of) in holding {
            for sight in sights {
                *of.entry(sight.view).or_default() += f64::from(sight.pixels);
            }
        }
    }
    for of in &mut shares {
        for (view, share) in of.iter_mut() {
            let whole = whole.get(*view as usize).copied().unwrap_or(0.0);
            *share = if whole > 0.0 { (*share / whole).min(1.0) } else { 0.0 };
        }
    }
    shares
}

/// Adds photographs until nearly every piece of a part is seen by several: of those that see pieces lacking
/// photographs, always the one that sees most of them.
fn complete(surface: &Surface, part: Part, shares: &BTreeMap<u32, f64>, chosen: &mut BTreeMap<u32, f64>) {
    let mut lacking: Vec<(usize, usize)> = Vec::new();
    let mut inside = 0;
    for (at, piece) in surface.pieces.iter().enumerate() {
        if piece.splats <= 0.0 || !part.cell.holds(piece.place, 0.0) {
            continue;
        }
        inside += 1;
        let sights = surface.sights(at);
        let seen = sights.iter().filter(|sight| chosen.contains_key(&sight.view)).count();
        let wanted = VIEWS_OF_PIECE.min(sights.len());
        if seen < wanted {
            lacking.push((at, wanted - seen));
        }
    }
    while lacking.len() as f64 > UNSEEN * f64::from(inside) {
        let mut gains: BTreeMap<u32, usize> = BTreeMap::new();
        for (at, _) in &lacking {
            for sight in surface.sights(*at).iter().filter(|sight| !chosen.contains_key(&sight.view)) {
                *gains.entry(sight.view).or_default() += 1;
            }
        }
        let Some((view, _)) = gains.into_iter().max_by_key(|(view, gain)| (*gain, std::cmp::Reverse(*view))) else {
            return;
        };
        chosen.insert(view, shares.get(&view).copied().unwrap_or(0.0));
        for (at, missing) in &mut lacking {
            *missing -= usize::from(surface.sights(*at).iter().any(|sight| sight.view == view));
        }
        lacking.retain(|(_, missing)| *missing > 0);
    }
}

/// Gives photographs that no part has to the part that they see most of.
fn place_all(shares: &[BTreeMap<u32, f64>], chosen: &mut [BTreeMap<u32, f64>], views: usize) {
    let mut best: Vec<Option<(usize, f64)>> = vec![None; views];
    for (part, of) in shares.iter().enumerate() {
        for (view, share) in of {
            if let Some(best) = best.get_mut(*view as usize)
                && *share > 0.0
                && best.is_none_or(|(_, most)| *share > most)
            {
                *best = Some((part, *share));
            }
        }
    }
    for (view, best) in (0..).zip(best) {
        let placed = chosen.iter().any(|of| of.contains_key(&view));
        if let Some((part, share)) = best.filter(|_| !placed) {
            chosen[part].insert(view, share);
        }
    }
}
