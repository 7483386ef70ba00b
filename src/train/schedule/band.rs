//! Part of a photograph. The gradient of a band is its share in the gradient of the photograph: all bands together add up to that, but for
//! what SSIM compares past their ends.

/// Rows that bands are made of, as a tile has.
const GRAIN: u32 = 16;
/// Fewer rows make no band of their own: much of what SSIM compares would lie past its ends.
const FEWEST: u32 = 32;

/// One of several bands of rows, from the top.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Band {
    /// Which.
    pub index: u32,
    /// Of how many, as far as a photograph has rows for them.
    pub of: u32,
}

impl Band {
    /// Its first row and how many, of a photograph with `height` rows. All bands together are the photograph, none twice; where it is too
    /// low for so many, it has fewer, and they come in turn.
    pub fn rows(self, height: u32) -> (u32, u32) {
        let of = self.of.min(height / FEWEST).max(1);
        let (index, grains) = (u64::from(self.index % of), u64::from(height.div_ceil(GRAIN)));
        let start = |k: u64| (grains * k / u64::from(of) * u64::from(GRAIN)).min(u64::from(height)) as u32;
        let top = start(index);
        (top, start(index + 1) - top)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_are_the_photograph_and_none_is_low() {
        for height in (1..700).chain([1080, 2160, 5304]) {
            for of in 1..12 {
                let bands: Vec<_> = (0..of).map(|index| Band { index, of }.rows(height)).collect();
                let own = of.min(height / FEWEST).max(1);
                let mut next = 0;
                for &(top, rows) in &bands[..own as usize] {
                    assert_eq!((top, top % GRAIN), (next, 0), "{height} rows in {of}");
                    assert!(own == 1 || rows > FEWEST - GRAIN, "{rows} of {height} rows in {of}");
                    next = top + rows;
                }
                assert_eq!(next, height, "{height} rows in {of}");
                assert_eq!(bands.last().copied(), bands.get((of as usize - 1) % own as usize).copied());
            }
        }
    }
}
