//! A terrain model from a surface model: the progressive morphological filter of Zhang et al. (2003), on coarse
//! cells.
//!
//! Coarse cells have the lower quartile of their heights. Pits go first, because openings widen them. The filter opens
//! the cells (a minimum, then a maximum over a square) with ever larger squares; where an opening takes away more than a
//! threshold, something stands on the ground. The threshold grows with the square, as the ground may slope. What stands
//! on the ground is filled from the ground around it by means of ever coarser cells.

/// Side in metres that coarse cells have at least.
const COARSE: f64 = 0.5;
/// Most coarse cells.
const MOST: u64 = 16_000_000;
/// Half the side in metres of the largest square: what is wider than twice this is taken for ground.
const REACH: f64 = 25.0;
/// Steepest ground, as height over distance.
const SLOPE: f64 = 0.3;
/// Thresholds in metres of the smallest square, and of the largest.
const THRESHOLDS: [f64; 2] = [0.3, 3.0];
/// Side in metres of the squares in which pits are looked for.
const PIT_SQUARE: f64 = 16.0;
/// A cell this far in metres below nine tenths of the squares around it is a pit: a hole between splats, not ground.
const PIT_DEPTH: f32 = 2.0;
/// A cell this near to the ground, in metres, keeps its own height.
const NEAR: f64 = 0.3;

/// Coarse cells that are collected from the heights of a surface, then filtered.
pub(super) struct Ground {
    /// Fine cells along the side of a coarse one: a power of two.
    step: u32,
    side: f64,
    width: usize,
    height: usize,
    cells: Vec<f32>,
}

impl Ground {
    /// For a picture of this size and ground sample distance. Coarse cells do not cross lines at multiples of `tile`
    /// cells, a power of two.
    pub(super) fn new(width: u32, height: u32, gsd: f64, tile: u32) -> Self {
        let mut step = 1;
        let size = |step: u32| (width.div_ceil(step), height.div_ceil(step));
        let cells = |step: u32| u64::from(size(step).0) * u64::from(size(step).1);
        while step < tile && (f64::from(step) * gsd < COARSE || cells(step) > MOST) {
            step *= 2;
        }
        let (width, height) = (size(step).0 as usize, size(step).1 as usize);
        Self { step, side: f64::from(step) * gsd, width, height, cells: vec![f32::NAN; width * height] }
    }

    /// Takes in the heights of a square tile whose first cell is (left, top); NaN where there is none.
    pub(super) fn take(&mut self, (left, top): (u32, u32), side: u32, heights: &[f32]) {
        let mut some = Vec::new();
        for y in (0..side).step_by(self.step as usize) {
            for x in (0..side).step_by(self.step as usize) {
                let (column, row) = (((left + x) / self.step) as usize, ((top + y) / self.step) as usize);
                if column >= self.width || row >= self.height {
                    continue;
                }
                some.clear();
                for inner in y..(y + self.step).min(side) {
                    let row = &heights[(inner * side + x) as usize..][..self.step.min(side - x) as usize];
                    some.extend(row.iter().filter(|v| v.is_finite()));
                }
                if !some.is_empty() {
                    let quarter = some.len() / 4;
                    let (_, value, _) = some.select_nth_unstable_by(quarter, f32::total_cmp);
                    self.cells[row * self.width + column] = *value;
                }
            }
        }
    }

    /// Leaves the ground alone, in all cells.
    pub(super) fn filter(&mut self) {
        self.drop_pits();
        let mut level = self.cells.clone();
        let most = (REACH / self.side).ceil().max(1.0) as usize;
        let mut before = 0;
        let mut radius = 1;
        loop {
            let radius_now = radius.min(most);
            let opened = self.opened(&level, radius_now);
            let grown = SLOPE * (radius_now - before) as f64 * 2.0 * self.side;
            let threshold = (THRESHOLDS[0] + grown).min(THRESHOLDS[1]) as f32;
            for ((cell, level), opened) in self.cells.iter_mut().zip(&level).zip(&opened) {
                if level - opened > threshold {
                    *cell = f32::NAN;
                }
            }
            level = opened;
            if radius_now == most {
                break;
            }
            (before, radius) = (radius_now, 2 * radius);
        }
        filled(&mut self.cells, self.width, self.height);
    }

    /// Leaves out cells far below a tenth of the heights of their square and of each square beside it.
    fn drop_pits(&mut self) {
        let square = ((PIT_SQUARE / self.side).ceil() as usize).max(2);
        let (across, down) = (self.width.div_ceil(square), self.height.div_ceil(square));
        let mut members: Vec<Vec<f32>> = vec![Vec::new(); across * down];
        let width = self.width;
        let square_of = |cell: usize| cell / width / square * across + cell % width / square;
        for (cell, height) in self.cells.iter().enumerate().filter(|(_, height)| height.is_finite()) {
            members[square_of(cell)].push(*height);
        }
        let low = |heights: &mut Vec<f32>| {
            let tenth = heights.len() / 10;
            if heights.is_empty() { f32::NAN } else { *heights.select_nth_unstable_by(tenth, f32::total_cmp).1 }
        };
        let levels: Vec<f32> = members.iter_mut().map(low).collect();
        let lowest = spread(&levels, (across, down), 1, f32::min);
        for (cell, height) in self.cells.iter_mut().enumerate() {
            if *height < lowest[square_of(cell)] - PIT_DEPTH {
                *height = f32::NAN;
            }
        }
    }

    fn opened(&self, cells: &[f32], radius: usize) -> Vec<f32> {
        let least = spread(cells, (self.width, self.height), radius, f32::min);
        spread(&least, (self.width, self.height), radius, f32::max)
    }

    /// The terrain at a cell: its own height where that is near the ground.
    pub(super) fn at(&self, column: u32, row: u32, height: f32) -> f32 {
        let place = |cell: u32, size: usize| {
            let at = ((f64::from(cell) + 0.5) / f64::from(self.step) - 0.5).clamp(0.0, (size - 1) as f64);
            let first = (at.floor() as usize).min(size.saturating_sub(2));
            (first, (first + 1).min(size - 1), (at - first as f64) as f32)
        };
        let (x0, x1, fx) = place(column, self.width);
        let (y0, y1, fy) = place(row, self.height);
        let cell = |x: usize, y: usize| self.cells[y * self.width + x];
        let along = |y: usize| cell(x0, y) + fx * (cell(x1, y) - cell(x0, y));
        let ground = along(y0) + fy * (along(y1) - along(y0));
        if !ground.is_finite() || f64::from((height - ground).abs()) <= NEAR { height } else { ground }
    }
}

/// The least or the greatest of the numbers in the square about each cell, rows first. NaN where there is none.
fn spread(cells: &[f32], (width, height): (usize, usize), radius: usize, pick: fn(f32, f32) -> f32) -> Vec<f32> {
    let mut rows = vec![f32::NAN; cells.len()];
    for (from, to) in cells.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
        windowed(from, to, radius, pick);
    }
    let mut out = vec![f32::NAN; cells.len()];
    let (mut from, mut to) = (vec![0.0; height], vec![0.0; height]);
    for x in 0..width {
        from.iter_mut().enumerate().for_each(|(y, v)| *v = rows[y * width + x]);
        windowed(&from, &mut to, radius, pick);
        to.iter().enumerate().for_each(|(y, v)| out[y * width + x] = *v);
    }
    out
}

/// The least or greatest within `radius` of each place: in blocks of the window's length, with the running picks from
/// either end of each block (van Herk 1992), so that the time does not depend on the radius. `pick` passes over NaN.
fn windowed(from: &[f32], to: &mut [f32], radius: usize, pick: fn(f32, f32) -> f32) {
    let block = 2 * radius + 1;
    let padded = from.len() + 2 * radius;
    let value = |at: usize| at.checked_sub(radius).and_then(|at| from.get(at)).copied().unwrap_or(f32::NAN);
    let mut ahead: Vec<f32> = (0..padded).map(value).collect();
    let mut behind = ahead.clone();
    for at in 1..padded {
        if at % block != 0 {
            ahead[at] = pick(ahead[at - 1], ahead[at]);
        }
    }
    for at in (0..padded.saturating_sub(1)).rev() {
        if (at + 1) % block != 0 {
            behind[at] = pick(behind[at + 1], behind[at]);
        }
    }
    for (at, to) in to.iter_mut().enumerate() {
        *to = pick(behind[at], ahead[at + block - 1]);
    }
}

/// Fills cells that are not numbers from means over 2x2 cells, which are filled in the same way.
fn filled(cells: &mut [f32], width: usize, height: usize) {
    if (width <= 1 && height <= 1) || cells.iter().all(|v| v.is_finite()) {
        return;
    }
    let (half_width, half_height) = (width.div_ceil(2), height.div_ceil(2));
    let mut half = vec![f32::NAN; half_width * half_height];
    for (k, out) in half.iter_mut().enumerate() {
        let (x, y) = (2 * (k % half_width), 2 * (k / half_width));
        let (mut sum, mut count) = (0.0f64, 0u32);
        for (x, y) in [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)] {
            if x < width && y < height && cells[y * width + x].is_finite() {
                sum += f64::from(cells[y * width + x]);
                count += 1;
            }
        }
        if count > 0 {
            *out = (sum / f64::from(count)) as f32;
        }
    }
    filled(&mut half, half_width, half_height);
    let at = |x: usize, y: usize| half[y.min(half_height - 1) * half_width + x.min(half_width - 1)];
    for (k, cell) in cells.iter_mut().enumerate().filter(|(_, v)| !v.is_finite()) {
        let (x, y) = (k % width, k / width);
        // The nearer coarse cell counts three quarters along each axis.
        let other = |v: usize| if v.is_multiple_of(2) { (v / 2).saturating_sub(1) } else { v / 2 + 1 };
        let along = |y: usize| 0.75 * at(x / 2, y) + 0.25 * at(other(x), y);
        *cell = 0.75 * along(y / 2) + 0.25 * along(other(y));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windowed_picks_are_those_of_plain_loops() {
        let values: Vec<f32> = (0..53).map(|k| if k % 11 == 3 { f32::NAN } else { ((k * 37) % 53) as f32 }).collect();
        for radius in [0, 1, 4, 26, 60] {
            for pick in [f32::min as fn(f32, f32) -> f32, f32::max] {
                let mut got = vec![0.0; values.len()];
                windowed(&values, &mut got, radius, pick);
                for (at, got) in got.iter().enumerate() {
                    let around = &values[at.saturating_sub(radius)..(at + radius + 1).min(values.len())];
                    let want = around.iter().fold(f32::NAN, |a, b| pick(a, *b));
                    assert!(got == &want || (got.is_nan() && want.is_nan()), "radius {radius} at {at}: {got}, {want}");
                }
            }
        }
    }

    /// Pits so close to one another that every large square holds one.
    #[test]
    fn pits_between_splats_do_not_pull_the_ground_down() {
        const SIDE: u32 = 256;
        let pit = |x: u32, y: u32| x % 40 < 4 && y % 40 < 4;
        let heights: Vec<f32> = (0..SIDE * SIDE).map(|k| if pit(k % SIDE, k / SIDE) { -30.0 } else { 1.0 }).collect();
        let mut ground = Ground::new(SIDE, SIDE, 0.5, SIDE);
        ground.take((0, 0), SIDE, &heights);
        ground.filter();
        for (k, own) in heights.iter().enumerate() {
            let found = ground.at(k as u32 % SIDE, k as u32 / SIDE, *own);
            assert!((found - 1.0).abs() < 0.01, "{found} m at {k}");
        }
    }

    /// A slope of a tenth with a house, a tree and a hole.
    #[test]
    fn ground_filter_takes_away_what_stands_on_a_slope() {
        const SIDE: u32 = 256;
        let gsd = 0.25;
        let slope = |x: u32| 0.1 * gsd as f32 * x as f32;
        let house = |x: u32, y: u32| (60..120).contains(&x) && (80..140).contains(&y);
        let tree = |x: u32, y: u32| (200..206).contains(&x) && (30..36).contains(&y);
        let hole = |x: u32, y: u32| (150..160).contains(&x) && (200..210).contains(&y);
        let height = |x: u32, y: u32| match () {
            () if hole(x, y) => f32::NAN,
            () if house(x, y) => slope(x) + 6.0,
            () if tree(x, y) => slope(x) + 3.0,
            () => slope(x),
        };
        let heights: Vec<f32> = (0..SIDE * SIDE).map(|k| height(k % SIDE, k / SIDE)).collect();
        let mut ground = Ground::new(SIDE, SIDE, gsd, SIDE);
        ground.take((0, 0), SIDE, &heights);
        ground.filter();
        let mut worst = 0f32;
        for (k, own) in heights.iter().enumerate().filter(|(_, v)| v.is_finite()) {
            let (x, y) = (k as u32 % SIDE, k as u32 / SIDE);
            worst = worst.max((ground.at(x, y, *own) - slope(x)).abs());
        }
        assert!(worst < 0.5, "off by {worst} m");
        assert_eq!(ground.at(10, 10, slope(10)), slope(10), "ground keeps its height");
    }
}
