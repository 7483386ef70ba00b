//! The cells of a map.

use super::Error;

/// Most cells of a map.
const MOST: u64 = 1 << 31;

/// An area in metres of the map.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Bounds {
    /// Least easting.
    pub west: f64,
    /// Least northing.
    pub south: f64,
    /// Greatest easting.
    pub east: f64,
    /// Greatest northing.
    pub north: f64,
}

/// Square cells between lines at multiples of their side, so that maps of neighbouring areas fit to each other.
/// Columns go east, rows go south.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Side of a cell in metres: the ground sample distance.
    pub gsd: f64,
    /// Easting of the western edge, in cells.
    pub west: i64,
    /// Northing of the northern edge, in cells.
    pub north: i64,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// A rectangle of cells of a grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First column.
    pub left: u32,
    /// First row.
    pub top: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Grid {
    /// All cells that the bounds touch.
    pub fn covering(bounds: &Bounds, gsd: f64) -> Result<Self, Error> {
        if !(gsd.is_finite() && gsd > 0.0) {
            return Err(Error::Gsd(gsd));
        }
        let Bounds { west, south, east, north } = *bounds;
        let sound = [west, south, east, north].iter().all(|v| v.is_finite()) && west < east && south < north;
        if !sound {
            return Err(Error::Bounds(format!("{west},{south},{east},{north}")));
        }
        // A bound that rounding moved by a billionth of a cell beyond a line does not take another cell.
        let line = |v: f64, outwards: f64| {
            let near = (v / gsd).round();
            let here = v / gsd;
            if (here - near).abs() < 1e-6 { near } else { (here + 0.5 * outwards).round() }
        };
        let (left, right) = (line(west, -1.0), line(east, 1.0));
        let (bottom, top) = (line(south, -1.0), line(north, 1.0));
        let (width, height) = ((right - left).max(1.0), (top - bottom).max(1.0));
        let far = [left, right, bottom, top].iter().any(|v| v.abs() > 1e15);
        if far || width * height > MOST as f64 {
            let fitting = ((east - west) * (north - south) / MOST as f64).sqrt();
            return Err(Error::Cells { width: width as u64, height: height as u64, fitting: two_digits(fitting) });
        }
        Ok(Self { gsd, west: left as i64, north: top as i64, width: width as u32, height: height as u32 })
    }

    /// Easting and northing of the north-western corner.
    pub fn corner(&self) -> [f64; 2] {
        [micrometres(self.west as f64 * self.gsd), micrometres(self.north as f64 * self.gsd)]
    }

    /// Easting and northing of the middle of a cell.
    pub fn centre(&self, column: u32, row: u32) -> [f64; 2] {
        let east = self.west as f64 + f64::from(column) + 0.5;
        let north = self.north as f64 - f64::from(row) - 0.5;
        [east * self.gsd, north * self.gsd]
    }

    /// The area of all cells.
    pub fn bounds(&self) -> Bounds {
        let [west, north] = self.corner();
        let (width, height) = (f64::from(self.width) * self.gsd, f64::from(self.height) * self.gsd);
        Bounds { west, south: micrometres(north - height), east: micrometres(west + width), north }
    }

    /// Number of cells.
    pub fn cells(&self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }

    /// The whole grid.
    pub fn whole(&self) -> Window {
        Window { left: 0, top: 0, width: self.width, height: self.height }
    }

    /// Windows of at most `side` cells a side that cover the grid, row by row.
    pub fn windows(&self, side: u32) -> impl Iterator<Item = Window> + use<> {
        let Self { width, height, .. } = *self;
        let tops = (0..height).step_by(side.max(1) as usize);
        tops.flat_map(move |top| {
            (0..width).step_by(side.max(1) as usize).map(move |left| Window {
                left,
                top,
                width: side.min(width - left),
                height: side.min(height - top),
            })
        })
    }
}

impl Window {
    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// Rounded to a millionth, which takes away the digits that products add.
fn micrometres(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

/// Rounded up to two digits.
pub(super) fn two_digits(value: f64) -> f64 {
    if !(value.is_finite() && value > 0.0) {
        return value;
    }
    let step = 10f64.powf(value.log10().floor() - 1.0);
    let rounded = (value / step - 1e-9).ceil() * step;
    // Without the digits that a product adds.
    format!("{rounded:.12}").parse().unwrap_or(rounded)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_lie_at_multiples_of_their_side() {
        let bounds = Bounds { west: 500_000.07, south: 4_600_000.0, east: 500_010.0, north: 4_600_005.01 };
        let grid = Grid::covering(&bounds, 0.1).unwrap();
        assert_eq!((grid.west, grid.north), (5_000_000, 46_000_051));
        assert_eq!((grid.width, grid.height), (100, 51));
        let [east, north] = grid.centre(99, 50);
        assert!((east - 500_009.95).abs() < 1e-6 && (north - 4_600_000.05).abs() < 1e-6, "{east} {north}");
        let negative = Bounds { west: -3.2, south: -7.9, east: -1.0, north: -1.1 };
        let grid = Grid::covering(&negative, 1.0).unwrap();
        assert_eq!((grid.west, grid.north, grid.width, grid.height), (-4, -1, 3, 7));
        assert_eq!(grid.bounds(), Bounds { west: -4.0, south: -8.0, east: -1.0, north: -1.0 });
    }

    #[test]
    fn impossible_grids_are_refused_with_a_remedy() {
        let bounds = Bounds { west: 0.0, south: 0.0, east: 5000.0, north: 5000.0 };
        for gsd in [0.0, -0.1, f64::NAN, f64::INFINITY] {
            assert!(matches!(Grid::covering(&bounds, gsd), Err(Error::Gsd(_))), "{gsd}");
        }
        let many = Grid::covering(&bounds, 0.1).unwrap_err().to_string();
        assert!(many.contains("50000 x 50000") && many.contains("distance of 0.11 m"), "{many}");
        assert!(Grid::covering(&bounds, 0.11).is_ok());
        let turned = Grid::covering(&Bounds { east: -1.0, ..bounds }, 1.0);
        assert!(turned.is_err_and(|error| error.to_string().contains("0,0,-1,5000")));
    }

    #[test]
    fn windows_cover_the_grid_once() {
        let grid = Grid { gsd: 1.0, west: 0, north: 0, width: 70, height: 33 };
        let mut seen = vec![0; 70 * 33];
        for window in grid.windows(32) {
            for k in 0..window.cells() as u32 {
                let (x, y) = (window.left + k % window.width, window.top + k / window.width);
                seen[(y * 70 + x) as usize] += 1;
            }
        }
        assert!(seen.iter().all(|n| *n == 1));
    }

    #[test]
    fn distances_are_rounded_up_to_two_digits() {
        for (value, rounded) in [(0.0473, 0.048), (0.05, 0.05), (12.3, 13.0), (0.99, 0.99), (0.991, 1.0)] {
            assert!((two_digits(value) - rounded).abs() < 1e-12, "{value}: {}", two_digits(value));
        }
    }
}
