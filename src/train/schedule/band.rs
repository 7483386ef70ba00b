//! Bands of a photograph. The gradients of all bands add up to the gradient of the photograph, except that SSIM
//! compares no pixels past the ends of a band.

/// A band begins at a multiple of this many rows, which is the height of a tile.
const GRAIN: u32 = 16;
/// Fewest rows of a band: in a lower band SSIM would compare too few pixels.
const FEWEST: u32 = 32;

/// One of several bands of rows, from the top.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Band {
    /// Number of the band from the top, from 0.
    pub index: u32,
    /// Number of bands. A photograph with too few rows has fewer.
    pub of: u32,
}

impl Band {
    /// The first row and the number of rows of the band in a photograph with `height` rows. The bands cover the
    /// photograph without overlap. If the photograph is too low for `of` bands, it has fewer, and indices wrap around.
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
