//! Made-up surfaces of known error.

use super::*;
use crate::scene::random::Random;
use crate::world::{World, WorldParams};

const GSD: f64 = 0.1;
const SIDE: usize = 240;
const CELLS: Cells = Cells { width: SIDE, height: SIDE, gsd: GSD };

/// Brightness at a place in cells: waves of many lengths and directions, none shorter than four cells.
fn brightness(x: f64, y: f64) -> f64 {
    let mut random = Random::new(3);
    let waves = (0..40).map(|_| {
        let (length, angle) = (random.range(4.0, 24.0), random.range(0.0, 3.1));
        let (phase, strength) = (random.range(0.0, 6.3), random.range(2.0, 8.0));
        strength * (std::f64::consts::TAU / length * (x * angle.cos() + y * angle.sin()) + phase).sin()
    });
    128.0 + waves.sum::<f64>()
}

fn picture(shift: [f64; 2], gain: f64, noise: f64) -> Vec<f32> {
    let mut random = Random::new(5);
    (0..SIDE * SIDE)
        .map(|k| {
            let (x, y) = ((k % SIDE) as f64 - shift[0], (k / SIDE) as f64 - shift[1]);
            ((gain * brightness(x, y) + 9.0) + noise * random.normal()) as f32
        })
        .collect()
}

fn of(values: &[f32]) -> Picture<'_> {
    Picture { width: SIDE, height: SIDE, values }
}

#[test]
fn a_shift_of_fractions_of_a_cell_is_found() {
    let truth = picture([0.0; 2], 1.0, 0.0);
    for by in [[0.3, 0.0], [-0.5, 0.25], [0.0, -0.1], [2.7, -3.4]] {
        let found = patches(&of(&truth), &of(&picture(by, 0.8, 2.0)), GSD).expect("patches");
        assert!(found.count >= 100 && found.coarse == 0, "{found:?}");
        let off = [found.median[0] / GSD - by[0], -found.median[1] / GSD - by[1]];
        assert!(off.iter().all(|v| v.abs() < 0.02), "{by:?}: {off:?} cells off");
        let length = by[0].hypot(by[1]);
        assert!((found.rmse / GSD - length).abs() < 0.05, "{by:?}: {found:?}");
    }
}

#[test]
fn plain_and_empty_patches_have_no_shift_and_wrong_ones_count() {
    let (truth, plain) = (picture([0.0; 2], 1.0, 0.0), vec![77.0; SIDE * SIDE]);
    assert_eq!(patches(&of(&plain), &of(&truth), GSD), None);
    let mut half = picture([0.3, 0.0], 1.0, 0.0);
    half[SIDE * SIDE / 2..].fill(f32::NAN);
    let found = patches(&of(&truth), &of(&half), GSD).expect("patches");
    assert!(found.count < found.textured * 6 / 10 && found.count > found.textured * 3 / 10, "{found:?}");
    assert!((found.rmse / GSD - 0.3).abs() < 0.02, "{found:?}");
    // A tenth of the map shows something else: the root of the mean square tells, the median does not.
    let mut wrong = picture([0.3, 0.0], 1.0, 0.0);
    let part = wrong[..SIDE * SIDE / 10].iter_mut().enumerate();
    part.for_each(|(k, v)| *v = (128.0 + brightness(0.3 * k as f64, 7.0)) as f32);
    let found = patches(&of(&truth), &of(&wrong), GSD).expect("patches");
    assert!(found.rmse / GSD > 0.6 && (found.median_length / GSD - 0.3).abs() < 0.05, "{found:?}");
}

/// A ground that rises to the east, with a block of 3 m on it.
fn heights() -> (Vec<f32>, Vec<Kind>) {
    let block = |k: usize| (60..140).contains(&(k % SIDE)) && (80..160).contains(&(k / SIDE));
    let height = |k: usize| 500.0 + 0.02 * (k % SIDE) as f32 + if block(k) { 3.0 } else { 0.0 };
    let cells = 0..SIDE * SIDE;
    (cells.clone().map(height).collect(), cells.map(|k| if block(k) { Kind::Roof } else { Kind::Ground }).collect())
}

#[test]
fn cells_by_a_step_are_left_out_and_slopes_are_not() {
    let (heights, kinds) = heights();
    let found = mask(CELLS, &Reference { heights: &heights, kinds: Some(&kinds), picture: None });
    let at = |x: usize, y: usize| found.kinds[y * SIDE + x];
    // The step is between the columns 59 and 60: a middle 2.5 cells away counts, one 1.5 cells away does not.
    assert_eq!([57, 58, 61, 62].map(|x| at(x, 120)), [Some(Kind::Ground), None, None, Some(Kind::Roof)]);
    assert_eq!([at(0, 0), at(100, 120)], [Some(Kind::Ground), Some(Kind::Roof)]);
    let left_out = found.kinds.iter().filter(|kind| kind.is_none()).count();
    // Of the cells diagonal to the block's corners, the outer ones are farther than 2 cells.
    assert_eq!(left_out, 84 * 84 - 76 * 76 - 4);
    assert!(found.share > 0.9);
}

#[test]
fn a_tilt_and_a_shift_of_the_whole_are_told_and_outliers_stay() {
    let (truth, kinds) = heights();
    let mut random = Random::new(1);
    let map: Vec<f32> = truth
        .iter()
        .enumerate()
        .map(|(k, z)| {
            let (east, north) = ((k % SIDE) as f64 + 0.5 - 120.0, 119.5 - (k / SIDE) as f64);
            let error = 0.25 + GSD * (0.004 * east - 0.002 * north) + 0.01 * random.normal();
            // One in fifty is far off.
            let wrong = if random.unit() < 0.02 { 5.0 } else { 0.0 };
            (f64::from(*z) + error + wrong) as f32
        })
        .collect();
    let reference = Reference { heights: &truth, kinds: Some(&kinds), picture: None };
    let mask = mask(CELLS, &reference);
    let found = assess(CELLS, &reference, &mask, &Surface { heights: &map, picture: None, seen: None });
    assert!((found.whole.up - 0.25).abs() < 0.002, "{:?}", found.whole);
    assert!((found.whole.tilt[0] - 0.004).abs() < 1e-4 && (found.whole.tilt[1] + 0.002).abs() < 1e-4);
    assert!((found.whole.tilt_degrees - 0.2562).abs() < 0.01, "{:?}", found.whole);
    assert!((found.vertical.rmse - (0.02_f64 * 27.5 + 0.063).sqrt()).abs() < 0.03, "{:?}", found.vertical);
    assert!((found.vertical.median - 0.25).abs() < 0.01 && found.vertical.rmse > 0.6, "{:?}", found.vertical);
    assert!(found.roofs.count > 5000 && found.ground.count + found.roofs.count == found.vertical.count);
    assert_eq!(found.planimetric, None);
}

#[test]
fn cells_without_height_are_incomplete_only_where_two_look() {
    let (truth, kinds) = heights();
    let reference = Reference { heights: &truth, kinds: Some(&kinds), picture: None };
    let mask = mask(CELLS, &reference);
    let mut map = truth.clone();
    let mut seen = vec![2; SIDE * SIDE];
    // A quarter has no height; of that, half is seen by one photograph alone.
    map[..SIDE * SIDE / 4].fill(f32::NAN);
    seen[..SIDE * SIDE / 8].fill(1);
    // A strip is 0.25 m off, one 0.35 m: three ground sample distances are 0.3 m.
    map[SIDE * 200..SIDE * 210].iter_mut().for_each(|z| *z += 0.25);
    map[SIDE * 210..SIDE * 220].iter_mut().for_each(|z| *z += 0.35);
    let found = assess(CELLS, &reference, &mask, &Surface { heights: &map, picture: None, seen: Some(&seen) });
    let cells = found.completeness.cells as f64;
    assert!((found.completeness.with_height - (1.0 - 30.0 * 240.0 / cells)).abs() < 1e-9, "{:?}", found.completeness);
    assert!((found.completeness.complete - (1.0 - 40.0 * 240.0 / cells)).abs() < 1e-9, "{:?}", found.completeness);
    let other = vec![f32::NAN; SIDE * SIDE];
    assert_eq!(on_common_cells(&reference, &mask, [&map, &other]), [Errors::default(); 2]);
    let [mine, same] = on_common_cells(&reference, &mask, [&map, &truth]);
    assert!(mine.count == same.count && mine.rmse > 0.0 && same.rmse == 0.0);
}

#[test]
fn clouds_become_medians_and_points_are_looked_up() {
    let corner = [1000.0, 2000.0];
    let cells = Cells { width: 3, height: 2, gsd: 1.0 };
    let points = [[1000.2, 1999.5, 5.0], [1000.7, 1999.1, 6.0], [1000.5, 1999.6, 90.0], [1002.5, 1998.5, 1.0]];
    let outside = [[999.9, 1999.5, 1.0], [1003.0, 1999.5, 1.0], [1001.5, 1999.5, f64::NAN]];
    let heights = gridded(cells, corner, points.into_iter().chain(outside));
    assert_eq!(heights[0], 6.0);
    assert_eq!(heights[5], 1.0);
    assert!([1, 2, 3, 4].iter().all(|k| heights[*k].is_nan()));

    let plane: Vec<f32> = (0..6).map(|k| (10 * (k / 3) + k % 3) as f32).collect();
    let found = at_points(cells, corner, &plane, &[[1001.0, 1999.0, 5.0], [1004.0, 1999.0, 0.0]]);
    // Between four cells: half of 0, 1, 10, 11.
    assert_eq!(found.each, [Some(0.5), None]);
    assert_eq!((found.vertical.count, found.vertical.rmse), (1, 0.5));
    assert_eq!(Errors::of(&[1.0, -3.0, 2.0, 4.0]).median, 1.5);
}

#[test]
fn the_truth_of_a_world_lies_on_the_map() {
    let params = WorldParams { extent: 40.0, images: 4, max_side: 32, supersample: 1, ..WorldParams::default() };
    let world = World::new(&params).expect("a world");
    let way = world.georeference().expect("a place");
    let middle = way.to_map([0.0; 3]);
    let cells = Cells { width: 100, height: 90, gsd: 0.25 };
    let corner = [middle[0] - 12.0, middle[1] + 11.0];
    let known = Known::of_world(&world, cells, corner, way.system()).expect("a truth");
    let truth = known.reference();
    let mut ground = 0;
    for (k, z) in
        truth.heights.iter().enumerate().filter(|(k, _)| truth.kinds.is_some_and(|kinds| kinds[*k] == Kind::Ground))
    {
        let (column, row) = ((k % 100) as f64 + 0.5, (k / 100) as f64 + 0.5);
        let [x, y, _] = way.to_dataset([corner[0] + 0.25 * column, corner[1] - 0.25 * row, middle[2]]);
        let want = way.to_map([x, y, world.terrain().height(x, y)])[2];
        assert!((f64::from(*z) - want).abs() < 1e-3, "{z} is not {want}");
        ground += 1;
    }
    assert!(ground > 1000, "{ground}");
    let map = Surface { heights: truth.heights, picture: truth.picture, seen: None };
    let report = Report::of("itself".to_owned(), cells, &known, &map, Some(truth.heights));
    assert_eq!((report.map.vertical.rmse, report.map.completeness.complete), (0.0, 1.0));
    assert!(report.map.planimetric.is_some_and(|shifts| shifts.rmse < 1e-6), "{:?}", report.map.planimetric);
    assert!(report.compared > 0.4 && report.lines().len() > 8, "{}", report.compared);
    let bare = known.ground().heights;
    let told = |heights: &[f32]| report.clone().with_terrain(&known, heights, None).terrain.expect("a terrain");
    let (right, surface) = (told(bare), told(truth.heights));
    assert_eq!((right.vertical.rmse, right.completeness.complete, right.open.count), (0.0, 1.0, ground));
    // What stands on the ground is no ground.
    assert!(surface.open.rmse < 1e-6 && surface.covered.rmse > 1.0, "{surface:?}");
    assert!(surface.completeness.complete < 0.9 && surface.completeness.with_height == 1.0, "{surface:?}");
    let lines = report.with_terrain(&known, truth.heights, None).lines();
    assert!(lines.iter().any(|line| line.starts_with("terrain: vertical, covered: RMSE ")), "{lines:?}");
}

#[test]
fn terrain_is_judged_in_every_cell_with_known_ground() {
    let ground = [1.0, 1.0, 1.0, 1.0, f32::NAN, 1.0];
    let kinds = [Kind::Ground, Kind::Ground, Kind::Roof, Kind::Other, Kind::Ground, Kind::Ground];
    let heights = [1.1, 1.5, 3.0, f32::NAN, 9.0, 1.0];
    let known = Ground { heights: &ground, kinds: Some(&kinds) };
    let found = Terrain::of(GSD, &known, &heights, Some(&[2, 2, 2, 2, 2, 1]));
    assert_eq!((found.vertical.count, found.open.count, found.covered.count), (4, 3, 1));
    assert!((found.covered.rmse - 2.0).abs() < 1e-6 && (found.open.median - 0.1).abs() < 1e-6, "{found:?}");
    // Of four that two photographs see, three have a height, and one is within three ground sample distances.
    let complete = found.completeness;
    assert_eq!((complete.cells, complete.with_height, complete.complete), (4, 0.75, 0.25));
}
