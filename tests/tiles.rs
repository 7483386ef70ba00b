//! The ellipse-tile test against brute force over pixels: every pixel in which a splat shows must lie in a listed tile.

use std::collections::HashSet;

use psrgs_vk::scene::random::Random;
use psrgs_vk::scene::tile::{TileGrid, count, list};

fn log_range(random: &mut Random, low: f64, high: f64) -> f64 {
    random.range(low.ln(), high.ln()).exp()
}

fn one_of<T: Copy>(random: &mut Random, items: &[T]) -> T {
    items[(random.bits() % items.len() as u64) as usize]
}

/// A splat as stored.
#[derive(Clone, Copy, Debug)]
struct Splat {
    mean: [f32; 2],
    /// A, B, C, and C - B^2 / A without its cancellation.
    conic: [f32; 4],
    opacity: f32,
}

impl Splat {
    /// A, B, C.
    fn plain(&self) -> [f32; 3] {
        let [a, b, c, _] = self.conic;
        [a, b, c]
    }
}

/// The conic of an ellipse with standard deviations `s`, the first along `angle`.
fn conic(s: [f64; 2], angle: f64) -> [f32; 4] {
    let (sin, cos) = angle.sin_cos();
    let (i, j) = (1.0 / (s[0] * s[0]), 1.0 / (s[1] * s[1]));
    let rest = 1.0 / (sin * sin / i + cos * cos / j);
    [cos * cos * i + sin * sin * j, cos * sin * (i - j), sin * sin * i + cos * cos * j, rest].map(|x| x as f32)
}

fn q(splat: &Splat, x: f64, y: f64) -> f64 {
    let [a, b, c, _] = splat.conic.map(f64::from);
    let (dx, dy) = (x - f64::from(splat.mean[0]), y - f64::from(splat.mean[1]));
    a * dx * dx + 2.0 * b * dx * dy + c * dy * dy
}

/// The alpha that blending computes in f32, with the exponent as two squares.
fn alpha32(splat: &Splat, x: f32, y: f32) -> f32 {
    let [p, q, r] = factor(splat);
    let (dx, dy) = (x - splat.mean[0], y - splat.mean[1]);
    let (u, v) = (p * dx + q * dy, r * dy);
    (splat.opacity * (-(u * u) - v * v).exp()).min(0.99)
}

/// As [`alpha32`], with every possible multiplication and addition contracted.
fn alpha32_fused(splat: &Splat, x: f32, y: f32) -> f32 {
    let [p, q, r] = factor(splat);
    let (dx, dy) = (x - splat.mean[0], y - splat.mean[1]);
    let (u, v) = (p.mul_add(dx, q * dy), r * dy);
    (splat.opacity * (-u).mul_add(u, -(v * v)).exp()).min(0.99)
}

/// The exponent (base e) is -(p dx + q dy)^2 - (r dy)^2.
fn factor(splat: &Splat) -> [f32; 3] {
    let [a, b, _, rest] = splat.conic;
    let p = (0.5 * a).sqrt();
    [p, 0.5 * b / p, (0.5 * rest).sqrt()]
}

/// Smallest q over a rectangle of pixel centres, and its position.
fn least_q(splat: &Splat, x: [f64; 2], y: [f64; 2]) -> (f64, [f64; 2]) {
    let [a, b, c, _] = splat.conic.map(f64::from);
    let mean = splat.mean.map(f64::from);
    let mut best = (f64::INFINITY, [0.0; 2]);
    let mut consider = |px: f64, py: f64| {
        let value = q(splat, px, py);
        if value < best.0 {
            best = (value, [px, py]);
        }
    };
    consider(mean[0].clamp(x[0], x[1]), mean[1].clamp(y[0], y[1]));
    for edge in x {
        let free = mean[1] - b * (edge - mean[0]) / c;
        consider(edge, free.clamp(y[0], y[1]));
    }
    for edge in y {
        let free = mean[0] - b * (edge - mean[1]) / a;
        consider(free.clamp(x[0], x[1]), edge);
    }
    best
}

#[derive(Default)]
struct Tally {
    splats: usize,
    listed: usize,
    beyond: usize,
    visible: usize,
}

/// Checks one splat: no pixel is lost, and with `tight` no tile is listed beyond the documented margins.
fn check(splat: &Splat, grid: &TileGrid, tight: bool, tally: &mut Tally) {
    let tiles = list(splat.mean, splat.plain(), splat.opacity, grid);
    assert_eq!(tiles.len(), count(splat.mean, splat.plain(), splat.opacity, grid) as usize);
    let listed: HashSet<u32> = tiles.iter().copied().collect();
    assert_eq!(listed.len(), tiles.len(), "a tile twice: {splat:?}");
    let columns = grid.counts()[0];
    for j in 0..grid.image[1] {
        for i in 0..grid.image[0] {
            let tile = j / grid.tile[1] * columns + i / grid.tile[0];
            if listed.contains(&tile) {
                continue;
            }
            let (x, y) = (f64::from(i) + 0.5, f64::from(j) + 0.5);
            let value = q(splat, x, y);
            let alpha = f64::from(splat.opacity) * (-0.5 * value).exp();
            let seen = value >= 0.0 && alpha >= (1.0 + 1e-6) * f64::from(grid.alpha_min);
            let (x, y) = (x as f32, y as f32);
            let seen32 = alpha32(splat, x, y).max(alpha32_fused(splat, x, y)) >= grid.alpha_min;
            assert!(
                !seen && !seen32,
                "pixel ({i}, {j}) of tile {tile} is lost: alpha {alpha} q {value} {splat:?} {grid:?}"
            );
        }
    }
    let level = 2.0 * (f64::from(splat.opacity) / f64::from(grid.alpha_min)).ln();
    let [a, b, c, _] = splat.conic.map(f64::from);
    let steepest = 0.5 * (a + c) + (0.25 * (a - c) * (a - c) + b * b).sqrt();
    tally.splats += 1;
    tally.listed += tiles.len();
    tally.visible += usize::from(!tiles.is_empty());
    for tile in tiles {
        let (row, column) = (tile / columns, tile % columns);
        let span =
            |k: u32, size: u32, most: u32| [f64::from(k * size) + 0.5, f64::from(((k + 1) * size).min(most)) - 0.5];
        let x = span(column, grid.tile[0], grid.image[0]);
        let y = span(row, grid.tile[1], grid.image[1]);
        let (least, at) = least_q(splat, x, y);
        tally.beyond += usize::from(least > level);
        if tight {
            let d = [at[0] - f64::from(splat.mean[0]), at[1] - f64::from(splat.mean[1])];
            let reach = f64::from(splat.mean[0].abs() + splat.mean[1].abs()) + d[0].abs() + d[1].abs();
            let end = 2f64.powi(-19) * reach;
            let slack = 2f64.powi(-13)
                + 2f64.powi(-16) * (a * d[0] * d[0] + c * d[1] * d[1])
                + 4.0 * end * (steepest * level.max(1e-3)).sqrt()
                + 2.0 * steepest * end * end;
            assert!(
                least <= level + slack,
                "tile {tile} is listed at q {least} over {level} + {slack}: {splat:?} {grid:?}"
            );
        }
    }
}

fn grids() -> [TileGrid; 6] {
    [
        TileGrid::new([70, 53], [16, 16]),
        TileGrid::new([64, 48], [8, 8]),
        TileGrid::new([129, 33], [32, 4]),
        TileGrid::new([1, 1], [16, 16]),
        TileGrid { alpha_min: 1.0 / 64.0, ..TileGrid::new([64, 48], [8, 8]) },
        TileGrid { alpha_min: 1.0 / 1000.0, ..TileGrid::new([70, 53], [16, 16]) },
    ]
}

fn opacity(random: &mut Random) -> f32 {
    match random.bits() % 4 {
        0 => log_range(random, 1.0 / 256.0, 1.0 / 240.0) as f32,
        1 => random.range(0.9, 1.0) as f32,
        _ => log_range(random, 1.0 / 255.0, 1.0) as f32,
    }
}

fn run(name: &str, number: usize, tight: bool, mut splat: impl FnMut(&mut Random, &TileGrid) -> Splat) -> Tally {
    let mut random = Random::new(name.bytes().fold(1, |h: u64, b| h.wrapping_mul(31).wrapping_add(u64::from(b))));
    let mut tally = Tally::default();
    for i in 0..number {
        let grid = grids()[i % 6];
        check(&splat(&mut random, &grid), &grid, tight, &mut tally);
    }
    let Tally { splats, listed, beyond, visible } = tally;
    println!("{name}: {splats} splats, {visible} visible, {listed} tiles, {beyond} beyond the exact ellipse");
    assert!(visible * 20 > splats, "{name}: too few splats are visible for the test to mean something");
    tally
}

fn inside(random: &mut Random, grid: &TileGrid, margin: f64) -> [f32; 2] {
    grid.image.map(|size| random.range(-margin, f64::from(size) + margin) as f32)
}

#[test]
fn ordinary_splats_are_listed_exactly() {
    let tally = run("ordinary", 4000, true, |random, grid| Splat {
        mean: inside(random, grid, 30.0),
        conic: conic([log_range(random, 0.55, 40.0), log_range(random, 0.55, 40.0)], random.range(0.0, 3.2)),
        opacity: opacity(random),
    });
    assert!(tally.beyond * 2000 < tally.listed, "{} of {} tiles are listed without need", tally.beyond, tally.listed);
}

#[test]
fn needles_lose_no_pixel() {
    run("needles", 2000, true, |random, grid| {
        let thin = log_range(random, 0.55, 2.0);
        Splat {
            mean: inside(random, grid, 30.0),
            conic: conic([thin * log_range(random, 30.0, 300.0), thin], random.range(0.0, 3.2)),
            opacity: opacity(random),
        }
    });
    run("needles of aspect 1000 and more", 2000, false, |random, grid| Splat {
        mean: inside(random, grid, 30.0),
        conic: conic([0.55 * one_of(random, &[1e3, 1.0001e3, 4e3, 1e4, 1e6]), 0.55], random.range(0.0, 3.2)),
        opacity: opacity(random),
    });
}

#[test]
fn far_needles_lose_no_pixel() {
    // Needles far away that point at the image, where the terms of the exponent cancel.
    run("far needles", 2000, false, |random, grid| {
        let target = inside(random, grid, 2.0).map(f64::from);
        let (angle, distance) = (random.range(0.0, 6.3), log_range(random, 50.0, 20_000.0));
        let mean = [target[0] - distance * angle.cos(), target[1] - distance * angle.sin()];
        Splat {
            mean: mean.map(|x| x as f32),
            conic: conic([distance * log_range(random, 0.3, 2.0), log_range(random, 0.55, 5.0)], angle),
            opacity: opacity(random),
        }
    });
}

#[test]
fn giants_and_centres_far_away_lose_no_pixel() {
    run("giants", 1000, true, |random, grid| Splat {
        mean: inside(random, grid, 1000.0),
        conic: conic([log_range(random, 50.0, 1e4), log_range(random, 50.0, 1e4)], random.range(0.0, 3.2)),
        opacity: opacity(random),
    });
    run("far centres", 1000, true, |random, _| {
        let distance = log_range(random, 1e3, 1e7);
        let angle = random.range(0.0, 6.3);
        Splat {
            mean: [(distance * angle.cos()) as f32, (distance * angle.sin()) as f32],
            conic: conic([distance * random.range(0.2, 1.0), distance * random.range(0.2, 1.0)], angle),
            opacity: opacity(random),
        }
    });
}

#[test]
fn means_on_tile_borders_lose_no_pixel() {
    run("borders", 4000, true, |random, grid| {
        let mean = [0, 1].map(|axis| {
            let tile = random.bits() % u64::from(grid.counts()[axis] + 1);
            (tile * u64::from(grid.tile[axis])) as f32 + one_of(random, &[-0.5f32, 0.0, 0.5])
        });
        let size = one_of(random, &[0.55, 1.0, 2.0, 4.0]);
        let angle = one_of(random, &[0.0, std::f64::consts::FRAC_PI_4, std::f64::consts::FRAC_PI_2]);
        let opacity = one_of(random, &[1.0 / 255.0, 1.000_001 / 255.0, 0.5, 1.0]) as f32;
        Splat { mean, conic: conic([size, size * one_of(random, &[1.0, 2.0, 3.0])], angle), opacity }
    });
}

#[test]
fn ill_formed_rows_list_nothing() {
    let grid = TileGrid::new([640, 360], [16, 16]);
    let good = Splat { mean: [100.0, 100.0], conic: [0.1, 0.0, 0.1, 0.1], opacity: 0.5 };
    assert!(count(good.mean, good.plain(), good.opacity, &grid) > 0);
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for column in 0..6 {
            let mut row = [100.0, 100.0, 0.1, 0.0, 0.1, 0.5];
            row[column] = bad;
            assert_eq!(count([row[0], row[1]], [row[2], row[3], row[4]], row[5], &grid), 0, "{row:?}");
        }
    }
    for conic in [[0.0, 0.0, 0.1], [0.1, 0.0, 0.0], [-0.1, 0.0, 0.1], [0.1, 0.0, -0.1]] {
        assert_eq!(count(good.mean, conic, good.opacity, &grid), 0);
    }
    for opacity in [0.0, -1.0, 0.99 / 255.0] {
        assert_eq!(count(good.mean, good.plain(), opacity, &grid), 0);
    }
}
