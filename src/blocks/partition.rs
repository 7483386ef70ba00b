//! Cuts the ground into cells of equal work.

use super::Cell;

/// A point of the ground, and the work that it stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Weighted {
    pub(super) place: [f64; 2],
    pub(super) work: f64,
}

/// Share of the points at either end of an axis that do not say how long a cell is: they may be strays.
const STRAYS: f64 = 0.005;

/// At most `count` cells of about equal work, which together are the whole plane. Each cut is across the longer side
/// of what lies in a cell, where it divides the work in proportion to the numbers of cells on both sides. There are
/// fewer cells where the points lie in fewer places.
pub(super) fn partition(points: &[Weighted], count: usize) -> Vec<Cell> {
    let known = |of: &&Weighted| of.place.iter().all(|v| v.is_finite()) && of.work.is_finite() && of.work > 0.0;
    let mut points: Vec<Weighted> = points.iter().filter(known).copied().collect();
    let mut cells = Vec::with_capacity(count);
    cut(&mut points, Cell::WHOLE, count.max(1), &mut cells);
    cells
}

fn cut(points: &mut [Weighted], cell: Cell, count: usize, cells: &mut Vec<Cell>) {
    let first = count / 2;
    if first == 0 {
        return cells.push(cell);
    }
    let [across, down] = [0, 1].map(|axis| length(points, axis));
    let longer = usize::from(down > across);
    // Where all points lie on a line across the longer side, the shorter one can still be cut.
    for axis in [longer, 1 - longer] {
        if let Some((at, split)) = place_of_cut(points, axis, first as f64 / count as f64) {
            let [low, high] = cell.cut(axis, at);
            let (below, above) = points.split_at_mut(split);
            cut(below, low, first, cells);
            return cut(above, high, count - first, cells);
        }
    }
    cells.push(cell);
}

/// The length of the points' range along an axis, without strays.
fn length(points: &mut [Weighted], axis: usize) -> f64 {
    if points.is_empty() {
        return 0.0;
    }
    sort(points, axis);
    let strays = (STRAYS * points.len() as f64) as usize;
    points[points.len() - 1 - strays].place[axis] - points[strays].place[axis]
}

/// Points in one order, whatever order they were in.
fn sort(points: &mut [Weighted], axis: usize) {
    points.sort_unstable_by(|a, b| {
        let along = |k: usize| a.place[k].total_cmp(&b.place[k]);
        along(axis).then(along(1 - axis)).then(a.work.total_cmp(&b.work))
    });
}

/// Where a cut across an axis leaves about `share` of the work below, and the number of points below. `None` where all
/// points have one place along the axis.
fn place_of_cut(points: &mut [Weighted], axis: usize, share: f64) -> Option<(f64, usize)> {
    sort(points, axis);
    let wanted = share * points.iter().map(|point| point.work).sum::<f64>();
    let mut below = 0.0;
    let mut best: Option<(f64, usize)> = None;
    for (k, pair) in points.windows(2).enumerate() {
        below += pair[0].work;
        let [a, b] = [pair[0].place[axis], pair[1].place[axis]];
        let off = (below - wanted).abs();
        if a < b && best.is_none_or(|(least, _)| off < least) {
            best = Some((off, k + 1));
        }
    }
    let (_, split) = best?;
    let [a, b] = [points[split - 1].place[axis], points[split].place[axis]];
    let middle = 0.5 * a + 0.5 * b;
    // The middle of neighbouring numbers is one of them; the lower edge of a cell belongs to it.
    Some((if middle > a { middle } else { b }, split))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blocks::cell::no_partition;
    use crate::scene::random::Random;

    fn random(count: usize, seed: u64, place: impl Fn([f64; 3]) -> [f64; 2]) -> Vec<Weighted> {
        let mut random = Random::new(seed);
        let mut next = || random.unit();
        (0..count).map(|_| Weighted { place: place([next(), next(), next()]), work: 0.2 + next() }).collect()
    }

    fn works(points: &[Weighted], cells: &[Cell]) -> Vec<f64> {
        let of = |cell: &Cell| points.iter().filter(|p| cell.contains(p.place)).map(|p| p.work).sum();
        cells.iter().map(of).collect()
    }

    /// Scenes of every shape, with points on the edges of cells and far outside.
    #[test]
    fn each_point_of_the_ground_is_in_one_cell() {
        type Shape = fn([f64; 3]) -> [f64; 2];
        let shapes: [Shape; 7] = [
            |[x, y, _]| [x, y],
            |[x, ..]| [x, 0.0],
            |[_, y, _]| [-3.0, 1e-9 * y],
            |[x, y, _]| [4.6e6 + x, 5e5 + y],
            |[x, y, _]| [1e12 * x, 1e-12 * y],
            |[x, y, z]| [(8.0 * x).floor(), (3.0 * y).floor() * z.signum()],
            |_| [7.0, 7.0],
        ];
        for (shape, of) in shapes.iter().enumerate() {
            for count in [1, 2, 3, 4, 7, 9, 16, 33] {
                let points = random(300, count as u64 + 40, of);
                let cells = partition(&points, count);
                assert!((1..=count).contains(&cells.len()), "{shape}, {count}");
                assert_eq!(no_partition(&cells), None, "{shape}, {count}");
                let edges: Vec<[Vec<f64>; 2]> =
                    cells.iter().map(|c| [c.x, c.y].map(|e| e.into_iter().flatten().collect())).collect();
                let corners = edges.iter().flat_map(|[x, y]| x.iter().flat_map(|x| y.iter().map(|y| [*x, *y])));
                let anywhere = random(300, 9, |[x, y, z]| [1e3 * (x - 0.5) / (z + 1e-9), 1e3 * (y - 0.5)]);
                let far = [[1e300, -1e300], [-1e300, 1e300], [0.0, 0.0]];
                let all = corners.chain(points.iter().chain(&anywhere).map(|p| p.place)).chain(far);
                for place in all {
                    let owners = cells.iter().filter(|cell| cell.contains(place)).count();
                    assert_eq!(owners, 1, "{shape}, {count}: {place:?} of {cells:?}");
                }
            }
        }
        assert!(partition(&[], 4) == [Cell::WHOLE] && !Cell::WHOLE.contains([f64::NAN, 0.0]));
    }

    #[test]
    fn cells_have_equal_work_for_any_number_of_cells() {
        for count in [2, 3, 4, 5, 6, 7, 9, 12] {
            let points = random(5000, 3, |[x, y, z]| [x * x, (if z < 0.8 { 0.2 } else { 1.0 }) * y]);
            let cells = partition(&points, count);
            let works = works(&points, &cells);
            let mean = works.iter().sum::<f64>() / count as f64;
            assert_eq!(cells.len(), count);
            assert!(works.iter().all(|work| (work / mean - 1.0).abs() < 0.02), "{count}: {works:?}");
        }
    }

    #[test]
    fn cells_are_no_strips_where_the_ground_is_square() {
        let points = random(8000, 5, |[x, y, _]| [x, y]);
        for cell in partition(&points, 16) {
            let [x0, x1, y0, y1] = cell.inside([0.0, 1.0, 0.0, 1.0]);
            let ratio = (x1 - x0) / (y1 - y0);
            assert!((0.4..2.5).contains(&ratio), "{cell:?}");
        }
    }

    #[test]
    fn points_in_fewer_places_than_cells_make_fewer_cells() {
        let at = |x: f64| Weighted { place: [x, 2.0], work: 1.0 };
        let cells = partition(&[at(1.0), at(1.0), at(1.0_f64.next_up()), at(4.0)], 9);
        assert_eq!(cells.len(), 3);
        assert_eq!(works(&[at(1.0), at(1.0_f64.next_up()), at(4.0)], &cells), [1.0; 3]);
        assert_eq!(partition(&[at(f64::NAN), at(1.0)], 9), [Cell::WHOLE], "what is no number has no place");
    }

    /// The order in which a dataset lists its points changes no cell.
    #[test]
    fn the_order_of_points_changes_no_cell() {
        let mut points = random(1000, 8, |[x, y, _]| [x, y]);
        let cells = partition(&points, 9);
        points.reverse();
        assert_eq!(partition(&points, 9), cells);
    }
}
