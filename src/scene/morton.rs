//! The order of splats along Morton's curve: neighbours in space become neighbours in memory.

use super::{Gaussians, SH_GROUP_FLOATS};

/// Bits of a code per axis.
const BITS: u32 = 21;

impl Gaussians {
    /// Rows of the splats, sorted by the Morton codes (Morton 1966) of their means in their bounding box, 21 bits per
    /// axis. Means that are not finite come last; ties keep their order.
    pub fn morton_order(&self) -> Vec<u32> {
        let mut order: Vec<(u64, u32)> = codes(&self.means).into_iter().zip(0..).collect();
        order.sort_unstable();
        order.into_iter().map(|(_, i)| i).collect()
    }

    /// The same splats in [`Self::morton_order`], with their identities.
    pub fn in_morton_order(&self) -> Self {
        self.rows(&self.morton_order())
    }

    /// The same splats in the order of their identities.
    pub fn in_order_of_birth(&self) -> Self {
        let mut order: Vec<u32> = (0..self.len() as u32).collect();
        order.sort_by_key(|i| self.ids.get(*i as usize));
        self.rows(&order)
    }

    /// The splats of the given rows, with their identities.
    pub fn rows(&self, order: &[u32]) -> Self {
        let rows = |plane: &[f32], row: usize| rows_of(plane, row, order);
        Self {
            means: rows(&self.means, 3),
            quats: rows(&self.quats, 4),
            scales: rows(&self.scales, 3),
            opacities: rows(&self.opacities, 1),
            sh: std::array::from_fn(|g| rows(&self.sh[g], SH_GROUP_FLOATS)),
            ids: rows_of(&self.ids, 1, order),
        }
    }
}

/// Rows of a plane, of `row` values each, in the given order.
pub fn rows_of<T: Copy>(plane: &[T], row: usize, order: &[u32]) -> Vec<T> {
    order.iter().flat_map(|&i| &plane[row * i as usize..row * (i as usize + 1)]).copied().collect()
}

fn codes(means: &[f32]) -> Vec<u64> {
    let finite = |p: &&[f32]| p.iter().all(|v| v.is_finite());
    let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
    for p in means.chunks_exact(3).filter(finite) {
        for k in 0..3 {
            (low[k], high[k]) = (low[k].min(p[k]), high[k].max(p[k]));
        }
    }
    let steps = f64::from((1_u32 << BITS) - 1);
    let code = |p: &[f32]| {
        if !finite(&p) {
            return u64::MAX;
        }
        (0..3).fold(0, |code, k| {
            let extent = f64::from(high[k]) - f64::from(low[k]);
            let share = if extent > 0.0 { (f64::from(p[k]) - f64::from(low[k])) / extent } else { 0.0 };
            code | spread((share * steps) as u64) << k
        })
    };
    means.chunks_exact(3).map(code).collect()
}

/// Moves bit i to bit 3 i.
fn spread(value: u64) -> u64 {
    (0..BITS).fold(0, |out, bit| out | (value >> bit & 1) << (3 * bit))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splats_are_reordered_whole_along_the_curve() {
        let mut g = Gaussians::zeros(8);
        // Corners of a box, numbered against the curve: x is the lowest bit.
        for i in 0..8 {
            let corner = 7 - i;
            for k in 0..3 {
                g.means[3 * i + k] = if corner >> k & 1 == 1 { 4.0 } else { -1.0 };
            }
            g.opacities[i] = i as f32;
            g.quats[4 * i + 3] = i as f32;
            g.scales[3 * i + 2] = i as f32;
            g.sh[2][12 * i + 11] = i as f32;
        }
        let out = g.in_morton_order();
        let want = [7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0, 0.0];
        assert_eq!(out.opacities, want);
        for (i, want) in want.into_iter().enumerate() {
            assert_eq!([out.quats[4 * i + 3], out.scales[3 * i + 2], out.sh[2][12 * i + 11]], [want; 3]);
        }
        assert_eq!(out.ids, [7, 6, 5, 4, 3, 2, 1, 0]);
        assert_eq!(out.in_morton_order(), out, "what is in order stays");
    }

    #[test]
    fn odd_models_are_reordered_too() {
        assert!(Gaussians::default().in_morton_order().is_empty());
        let mut g = Gaussians::zeros(3);
        g.opacities = vec![0.0, 1.0, 2.0];
        assert_eq!(g.in_morton_order(), g, "all at one place");
        g.means[0] = f32::NAN;
        g.means[3] = 5.0;
        assert_eq!(g.in_morton_order().opacities, [2.0, 1.0, 0.0], "what is nowhere comes last");
    }
}
