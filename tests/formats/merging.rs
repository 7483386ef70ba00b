//! Merged splats, and trees of them, against moments in double precision by other formulas.

use std::collections::BTreeSet;

use psrgs_vk::lod::{Splats, Tree};
use psrgs_vk::scene::random::Random;
use psrgs_vk::scene::{Camera, Gaussians};

/// Splats of random shape in a box of side 2, with opacities up to `most`. The first number of each is its row.
fn cloud(n: usize, most: f64) -> Gaussians {
    let mut g = Gaussians::zeros(n);
    let mut random = Random::new(3);
    g.means.iter_mut().for_each(|v| *v = random.range(-1.0, 1.0) as f32);
    g.quats.iter_mut().for_each(|v| *v = random.range(-1.0, 1.0) as f32);
    g.normalise_quats();
    g.scales.iter_mut().for_each(|v| *v = random.range(-5.0, -2.0) as f32);
    for v in &mut g.opacities {
        let opacity = random.range(0.02, most);
        *v = (opacity / (1.0 - opacity)).ln() as f32;
    }
    g.sh.iter_mut().flatten().for_each(|v| *v = random.range(-0.3, 0.3) as f32);
    g
}

/// Sums over splats: mass, mass times mean, mass times the second moment about the origin, mass times the harmonics.
#[derive(Debug)]
struct Moments {
    mass: f64,
    first: [f64; 3],
    second: [[f64; 3]; 3],
    harmonics: [f64; 48],
}

/// The rotation by sandwich products of quaternions, not by the matrix of the program.
fn turned(q: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let product = |a: [f64; 4], b: [f64; 4]| {
        [
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        ]
    };
    let [_, x, y, z] = product(product(q, [0.0, v[0], v[1], v[2]]), [q[0], -q[1], -q[2], -q[3]]);
    [x, y, z]
}

fn moments(g: &Gaussians) -> Moments {
    let mut sum = Moments { mass: 0.0, first: [0.0; 3], second: [[0.0; 3]; 3], harmonics: [0.0; 48] };
    for i in 0..g.len() {
        let s: [f64; 3] = std::array::from_fn(|k| f64::from(g.scales[3 * i + k]).exp());
        let q: [f64; 4] = std::array::from_fn(|k| f64::from(g.quats[4 * i + k]));
        let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
        let q = q.map(|v| v / length);
        // The second invariant of the covariance, by its principal values.
        let area = ((s[0] * s[1]).powi(2) + (s[0] * s[2]).powi(2) + (s[1] * s[2]).powi(2)).sqrt();
        let mass = area / (1.0 + (-f64::from(g.opacities[i])).exp());
        let axes: [[f64; 3]; 3] = std::array::from_fn(|k| {
            let mut axis = [0.0; 3];
            axis[k] = s[k];
            turned(q, axis)
        });
        let mean: [f64; 3] = std::array::from_fn(|k| f64::from(g.means[3 * i + k]));
        sum.mass += mass;
        for r in 0..3 {
            sum.first[r] += mass * mean[r];
            for c in 0..3 {
                let own: f64 = axes.iter().map(|axis| axis[r] * axis[c]).sum();
                sum.second[r][c] += mass * (own + mean[r] * mean[c]);
            }
        }
        for k in 0..48 {
            sum.harmonics[k] += mass * f64::from(g.sh[k / 12][12 * i + k % 12]);
        }
    }
    sum
}

fn near(a: f64, b: f64, unit: f64) -> bool {
    (a - b).abs() <= 1e-5 * unit
}

#[test]
fn merging_keeps_mass_mean_covariance_and_colour() {
    // So faint that no merged splat has to be widened.
    let g = cloud(300, 0.1);
    let before = moments(&g);
    for most in [200, 40, 7, 1] {
        let mut splats = Splats::of(&g);
        splats.merge(most);
        let out = splats.gaussians();
        assert_eq!((splats.len(), out.len()), (most, most));
        let after = moments(&out);
        assert!(near(after.mass, before.mass, before.mass), "{most}: {} for {}", after.mass, before.mass);
        for r in 0..3 {
            assert!(near(after.first[r], before.first[r], before.mass), "{most}: {after:?} for {before:?}");
            for c in 0..3 {
                assert!(near(after.second[r][c], before.second[r][c], before.mass), "{most}: {after:?} {before:?}");
            }
        }
        assert!((0..48).all(|k| near(after.harmonics[k], before.harmonics[k], before.mass)), "{most}");
    }
}

#[test]
fn opaque_splats_are_widened_so_that_no_mass_is_lost() {
    let mut g = cloud(60, 0.9);
    g.opacities.fill(6.0);
    // All within one another's reach: together they have far more mass than one of the same shape could have.
    g.means.iter_mut().for_each(|v| *v *= 0.01);
    let mut splats = Splats::of(&g);
    splats.merge(3);
    let out = splats.gaussians();
    assert!(out.opacities.iter().all(|logit| *logit < 7.0), "{:?}", out.opacities);
    let (before, after) = (moments(&g).mass, moments(&out).mass);
    assert!(near(after, before, before), "{after} for {before}");
}

#[test]
fn splats_that_look_alike_are_merged_before_others() {
    // Of three in a row the two on the right have one colour; the two on the left are nearer to each other.
    let mut g = Gaussians::zeros(3);
    g.means = vec![0.0, 0.0, 0.0, 0.9, 0.0, 0.0, 2.0, 0.0, 0.0];
    g.quats.iter_mut().step_by(4).for_each(|w| *w = 1.0);
    g.scales.fill(-0.5);
    g.opacities.fill(2.0);
    g.sh[0][0] = 3.0;
    let mut splats = Splats::of(&g);
    splats.merge(2);
    let out = splats.gaussians();
    assert!((out.means[0], out.sh[0][0]) == (0.0, 3.0) && (out.means[3] - 1.45).abs() < 1e-5, "{:?}", out.means);
    assert!((splats.error() - (2.0_f64 / 3.0).sqrt() * 0.55).abs() < 1e-6, "{}", splats.error());
}

#[test]
fn merging_the_same_splats_gives_the_same_bits() {
    let of = |threads: usize| {
        let pool = rayon_pool(threads);
        pool.install(|| {
            let mut splats = Splats::of(&cloud(2000, 0.9));
            splats.merge(300);
            splats.gaussians()
        })
    };
    assert!(of(1) == of(3));
}

fn rayon_pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads")
}

#[test]
fn splats_in_one_place_and_of_no_size_are_merged() {
    let mut g = Gaussians::zeros(700);
    g.scales.fill(-80.0);
    g.scales[0..3].fill(60.0);
    let mut splats = Splats::of(&g);
    splats.merge(5);
    let out = splats.gaussians();
    assert_eq!((out.len(), out.finite_rows()), (5, None));
    let mut none = Splats::of(&Gaussians::zeros(0));
    none.merge(0);
    assert!(none.is_empty() && none.error() == 0.0);
}

/// The tiles of a tree, each with its splats.
fn tree(g: &Gaussians, most: usize) -> (Tree, Vec<Gaussians>) {
    let mut content = Vec::new();
    let tree = Tree::build(g, most, |_, of_tile| {
        content.push(of_tile.clone());
        Ok::<(), ()>(())
    });
    (tree.expect("a tree"), content)
}

#[test]
fn every_splat_is_in_one_leaf_and_tiles_are_bounded() {
    for (n, most) in [(1, 1), (7, 3), (100, 100), (101, 100), (399, 100), (401, 100), (2600, 100), (1700, 33)] {
        let mut g = cloud(n, 0.5);
        (0..n).for_each(|i| g.sh[3][12 * i] = i as f32);
        let (tree, content) = tree(&g, most);
        let mut seen = BTreeSet::new();
        for (tile, of_tile) in tree.tiles.iter().zip(&content) {
            assert_eq!(tile.splats, of_tile.len());
            assert!((1..=most).contains(&tile.splats) && tile.children.len() <= 4, "{n} {most}: {tile:?}");
            let below: usize = tile.children.iter().map(|k| tree.tiles[*k].splats).sum();
            if tile.children.is_empty() {
                let new = of_tile.sh[3].iter().step_by(12).filter(|row| seen.insert(**row as usize)).count();
                assert_eq!(new, of_tile.len(), "a splat in two leaves");
            } else {
                assert_eq!(tile.splats, below.div_ceil(4).min(most), "{n} {most}");
            }
        }
        assert_eq!(seen.len(), n);
        assert_eq!(tree.root().map(|root| root.path.len()), Some(0));
    }
}

#[test]
fn errors_and_bounds_of_tiles_hold_those_below() {
    let (tree, _) = tree(&cloud(2600, 0.5), 50);
    assert!(tree.levels() == 4, "{}", tree.levels());
    for tile in &tree.tiles {
        assert_eq!(tile.error == 0.0, tile.children.is_empty());
        for child in tile.children.iter().map(|k| &tree.tiles[*k]) {
            assert!(child.error <= tile.error && child.path[..tile.path.len()] == tile.path);
            let holds =
                |k: usize| tile.bounds.low[k] <= child.bounds.low[k] && child.bounds.high[k] <= tile.bounds.high[k];
            assert!((0..3).all(holds), "{tile:?} {child:?}");
        }
    }
    // Coarser levels have moved more.
    let of_level = |level: usize| tree.tiles.iter().find(|tile| tile.path.len() == level).map(|tile| tile.error);
    assert!(of_level(0) > of_level(1) && of_level(1) > of_level(2));
}

#[test]
fn a_tree_of_splats_in_one_place_has_full_leaves() {
    let (tree, _) = tree(&Gaussians::zeros(1000), 100);
    let leaves = tree.tiles.iter().filter(|tile| tile.children.is_empty());
    assert!(leaves.clone().count() == 10 && leaves.clone().all(|leaf| leaf.splats == 100));
}

#[test]
fn a_tile_that_cannot_be_kept_ends_the_tree() {
    let mut calls = 0;
    let stopped = Tree::build(&cloud(50, 0.5), 10, |_, _| {
        calls += 1;
        if calls == 3 { Err("full") } else { Ok(()) }
    });
    assert_eq!((stopped, calls), (Err("full"), 3));
}

/// A camera above the cloud that looks down on x = `x`.
fn camera(x: f64, height: f64) -> Camera {
    let rotation = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
    let translation = [-x, 0.0, height];
    Camera { rotation, translation, fx: 200.0, fy: 200.0, cx: 100.0, cy: 100.0, width: 200, height: 200 }
}

/// The leaves below a tile.
fn leaves(tree: &Tree, tile: usize) -> Vec<usize> {
    match tree.tiles[tile].children.as_slice() {
        [] => vec![tile],
        children => children.iter().flat_map(|child| leaves(tree, *child)).collect(),
    }
}

#[test]
fn chosen_tiles_show_every_place_once_within_the_budget() {
    let (tree, _) = tree(&cloud(2600, 0.5), 50);
    let all = leaves(&tree, tree.tiles.len() - 1);
    let mut before = 0;
    for most in [1, 100, 300, 900, 2600, 9000] {
        let chosen = tree.choose(&camera(0.0, 3.0), most);
        let splats: usize = chosen.iter().map(|tile| tree.tiles[*tile].splats).sum();
        assert!(splats <= most.max(tree.tiles[tree.tiles.len() - 1].splats) && splats >= before, "{most}: {splats}");
        before = splats;
        let mut below: Vec<usize> = chosen.iter().flat_map(|tile| leaves(&tree, *tile)).collect();
        below.sort_unstable();
        assert!(below.iter().eq(all.iter()), "{most}: {chosen:?}");
    }
    assert_eq!(before, 2600);
}

#[test]
fn near_tiles_are_fine_and_far_and_unseen_ones_coarse() {
    let mut g = cloud(2600, 0.5);
    g.means.iter_mut().step_by(3).for_each(|x| *x *= 20.0);
    let (tree, _) = tree(&g, 50);
    let splats = |camera: &Camera, within: &dyn Fn(f64) -> bool| -> usize {
        let middle = |tile: &usize| 0.5 * (tree.tiles[*tile].bounds.low[0] + tree.tiles[*tile].bounds.high[0]);
        let chosen = tree.choose(camera, 1000).into_iter().filter(|tile| within(middle(tile)));
        chosen.map(|tile| tree.tiles[tile].splats).sum()
    };
    // The camera sees a tenth of the length.
    let over = |x: f64| camera(x, 3.0);
    let (east, west) = (&|x: f64| x > 10.0, &|x: f64| x < -10.0);
    assert!(splats(&over(15.0), east) > 3 * splats(&over(-15.0), east));
    assert!(splats(&over(-15.0), west) > 3 * splats(&over(15.0), west));
    // From very far no level differs from the model, and the coarsest one is taken whatever the budget.
    assert_eq!(tree.choose(&camera(0.0, 1e7), usize::MAX), [tree.tiles.len() - 1]);
    assert!(Tree::default().choose(&over(0.0), 5).is_empty());
}
