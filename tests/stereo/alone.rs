//! Surfaces that are continued where few or no views look.

use psrgs_vk::scene::Camera;
use psrgs_vk::stereo::{
    FusedPoint, InitialPlanes, Prior, SkirtPoint, StereoView, extend, skirt, surface, surface_of_points,
};

const WIDTH: u32 = 96;
const HEIGHT: u32 = 72;
/// The ground is the plane z = SLOPE x; cameras look down from the height ABOVE.
const SLOPE: f64 = 0.2;
const ABOVE: f64 = 5.0;

/// A camera above (x, y) that looks down: x to the right, y towards the top of the photograph.
fn camera(x: f64, y: f64) -> Camera {
    let rotation = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
    Camera {
        rotation,
        translation: [-x, y, ABOVE],
        fx: 80.0,
        fy: 80.0,
        cx: 0.5 * f64::from(WIDTH),
        cy: 0.5 * f64::from(HEIGHT),
        width: WIDTH,
        height: HEIGHT,
    }
}

/// Depth of the ground at a pixel position.
fn depth(camera: &Camera, u: f64, v: f64) -> f64 {
    let [x, _, z] = camera.center();
    let (a, _) = ((u - camera.cx) / camera.fx, v);
    // z - d = SLOPE (x + a d)
    (z - SLOPE * x) / (1.0 + SLOPE * a)
}

fn seen_by(camera: &Camera, point: [f64; 3]) -> bool {
    let c = camera.center();
    let d = [0, 1, 2].map(|k| point[k] - c[k]);
    let [x, y, z] = camera.rotation.map(|row| (0..3).map(|k| row[k] * d[k]).sum::<f64>());
    let (u, v) = (camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy);
    z > 0.0 && (0.0..f64::from(WIDTH)).contains(&u) && (0.0..f64::from(HEIGHT)).contains(&v)
}

fn on_ground(camera: &Camera, u: f64, v: f64) -> [f64; 3] {
    let (c, d) = (camera.center(), depth(camera, u, v));
    [c[0] + (u - camera.cx) / camera.fx * d, c[1] - (v - camera.cy) / camera.fy * d, c[2] - d]
}

fn middle(pixel: usize) -> (f64, f64) {
    ((pixel % WIDTH as usize) as f64 + 0.5, (pixel / WIDTH as usize) as f64 + 0.5)
}

/// Views of the ground. Depths are known where three or more views look, multiplied by `wrong` of the pixel.
fn views(at: &[(f64, f64)], wrong: impl Fn(usize) -> f64) -> (Vec<StereoView>, Vec<Prior>) {
    let cameras: Vec<Camera> = at.iter().map(|&(x, y)| camera(x, y)).collect();
    let pixels = (WIDTH * HEIGHT) as usize;
    let colour = |p: usize| [(p % WIDTH as usize) as u8, (p / WIDTH as usize) as u8, 200];
    let view = |camera: &Camera| StereoView {
        camera: *camera,
        luma: vec![0.5; pixels],
        colours: (0..pixels).map(colour).collect(),
        sources: Vec::new(),
        depths: [1.0, 100.0],
        start: InitialPlanes::Random,
        wanted: None,
    };
    let prior = |camera: &Camera| {
        let known = |p: usize| {
            let (u, v) = middle(p);
            cameras.iter().filter(|c| seen_by(c, on_ground(camera, u, v))).count() >= 3
        };
        let depth = |p: usize| {
            let (u, v) = middle(p);
            if known(p) { (depth(camera, u, v) * wrong(p)) as f32 } else { 0.0 }
        };
        Prior {
            width: WIDTH,
            height: HEIGHT,
            depth: (0..pixels).map(depth).collect(),
            normals: vec![[0.0, 0.0, -1.0]; pixels],
            confidence: vec![1.0; pixels],
        }
    };
    (cameras.iter().map(view).collect(), cameras.iter().map(prior).collect())
}

const ROW: [(f64, f64); 4] = [(0.0, 0.0), (1.2, 0.1), (2.4, -0.1), (3.6, 0.0)];

#[track_caller]
fn lies_on_the_ground(point: &FusedPoint) {
    let [x, _, z] = point.position;
    assert!((z - SLOPE * x).abs() < 1e-3, "{point:?}");
    let length = (1.0 + SLOPE * SLOPE).sqrt();
    let normal = [-SLOPE / length, 0.0, 1.0 / length];
    for (got, want) in point.normal.iter().zip(normal) {
        assert!((f64::from(*got) - want).abs() < 1e-3, "{point:?} instead of {normal:?}");
    }
}

#[test]
fn a_plane_goes_on_where_one_or_two_views_look() {
    let (views, priors) = views(&ROW, |_| 1.0);
    let looking = |p: &FusedPoint| views.iter().filter(|v| seen_by(&v.camera, p.position)).count();
    let unknown = |v: usize| priors[v].depth.iter().filter(|d| **d == 0.0).count();
    let all: usize = (0..views.len()).map(unknown).sum();
    let mut counts = Vec::new();
    for most in [1, 2] {
        let points = extend(&views, &priors, most);
        points.iter().for_each(lies_on_the_ground);
        // Some points fall on the other side of a photograph's edge.
        let wrong = points.iter().filter(|p| !(1..=most).contains(&looking(p))).count();
        assert!(50 * wrong < points.len(), "{wrong} of {}", points.len());
        counts.push(points.len());
    }
    let alone: usize = (0..views.len())
        .map(|v| {
            let camera = &views[v].camera;
            let alone = |p: &usize| {
                let at = on_ground(camera, middle(*p).0, middle(*p).1);
                views.iter().filter(|other| seen_by(&other.camera, at)).count() == 1
            };
            (0..views[v].pixels()).filter(alone).count()
        })
        .sum();
    assert!((alone.abs_diff(counts[0])) * 50 < alone, "{alone} pixels, {} points", counts[0]);
    // Places that two views see are used once.
    let shared = (all - alone) as f64 / 2.0;
    let added = (counts[1] - counts[0]) as f64;
    assert!((added / shared - 1.0).abs() < 0.1, "{added} points of {shared} places");
    assert!(extend(&views, &priors, 0).is_empty());
}

#[test]
fn neither_masked_pixels_nor_rough_surfaces_go_on() {
    let (mut views, priors) = views(&ROW, |_| 1.0);
    let whole = extend(&views, &priors, 1).len();
    // The left half of every photograph is masked.
    for view in &mut views {
        view.wanted = Some((0..view.pixels()).map(|p| middle(p).0 > 0.5 * f64::from(WIDTH)).collect());
    }
    let half = extend(&views, &priors, 1);
    assert!(!half.is_empty() && half.len() < whole);
    assert!(half.iter().all(|p| u32::from(p.colour[0]) >= WIDTH / 2), "a point comes from a masked pixel");
    let jitter = |p: usize| 1.0 + 0.05 * ((p * 7919 % 101) as f64 / 50.0 - 1.0);
    let (views, priors) = self::views(&ROW, jitter);
    assert!(extend(&views, &priors, 2).is_empty(), "depths that vary by some hundredths");
    // A prior of another size than its view.
    let (views, mut priors) = self::views(&ROW, |_| 1.0);
    for prior in &mut priors {
        prior.depth.truncate(40);
    }
    assert!(extend(&views, &priors, 2).is_empty() && skirt(&views, &priors, 0.25).is_empty());
    // No depth is known, or almost none.
    let (views, mut priors) = self::views(&ROW, |_| 1.0);
    for prior in &mut priors {
        prior.depth.iter_mut().skip(40).for_each(|d| *d = 0.0);
    }
    assert!(extend(&views, &priors, 2).is_empty() && skirt(&views, &priors, 0.25).is_empty());
}

#[test]
fn a_skirt_lies_on_the_ground_where_no_view_looks() {
    let (views, priors) = views(&ROW, |_| 1.0);
    let points = skirt(&views, &priors, 0.25);
    assert!(points.len() > 40, "{}", points.len());
    for p in &points {
        lies_on_the_ground(&p.point);
        assert!(!views.iter().any(|v| seen_by(&v.camera, p.point.position)), "{p:?}");
        // At most a quarter of the longer side beyond the photographs: 24 pixels of about ABOVE / 80.
        let [x, y, _] = p.point.position;
        assert!((-5.5..9.5).contains(&x) && y.abs() < 5.0, "{p:?}");
    }
    // Spacing of 8 pixels beside a photograph, of 16 farther off.
    let steps: Vec<f64> = points.iter().map(|p| p.spacing / (ABOVE / 80.0)).collect();
    assert!(steps.iter().all(|step| (8.0 / 1.5..16.0 * 1.5).contains(step)), "{steps:?}");
    for (i, p) in points.iter().enumerate() {
        let distance =
            |q: &FusedPoint| (0..3).map(|k| (p.point.position[k] - q.position[k]).powi(2)).sum::<f64>().sqrt();
        assert!(points[..i].iter().all(|q| distance(&q.point) > 0.5 * p.spacing), "{p:?}");
    }
    // To the left of the row, points have the colours of the left edge.
    let left = points.iter().filter(|p| p.point.position[0] < -3.3);
    assert!(left.clone().count() > 3 && left.into_iter().all(|p| p.point.colour[0] < 16));
    assert!(skirt(&views, &priors, 0.0).is_empty());
    // Photographs with few known depths have no skirt, unless pixels without depth are masked.
    let (mut views, mut priors) = self::views(&ROW, |_| 1.0);
    for prior in &mut priors {
        let left = |pixel: usize| pixel % (prior.width as usize) < prior.width as usize / 4;
        prior.depth.iter_mut().enumerate().filter(|(pixel, _)| !left(*pixel)).for_each(|(_, d)| *d = 0.0);
    }
    assert!(skirt(&views, &priors, 0.25).is_empty());
    for (view, prior) in views.iter_mut().zip(&priors) {
        view.wanted = Some(prior.depth.iter().map(|d| *d > 0.0).collect());
    }
    assert!(!skirt(&views, &priors, 0.25).is_empty());
}

#[test]
fn many_views_from_one_place_count_as_one_photograph() {
    let filled = |at: &[(f64, f64)], wrong: f64| {
        let (views, mut priors) = views(at, |_| 1.0);
        // The last three views see another surface in the same place.
        priors[at.len() - 3..].iter_mut().flat_map(|p| &mut p.depth).for_each(|d| *d *= wrong as f32);
        surface(&views, &priors)
    };
    let (here, there) = ([(0.0, 0.0); 3], [(0.0, 20.0); 3]);
    assert!((filled(&here, 1.0) - 1.0).abs() < 1e-9);
    assert!((filled(&[here, here].concat(), 1.0) - 1.0).abs() < 1e-9);
    assert!((filled(&[here, there].concat(), 1.0) - 2.0).abs() < 1e-9);
    assert!((filled(&[here, here].concat(), 0.5) - 2.0).abs() < 1e-9, "a nearer surface does not count of its own");
    // Moved by half a photograph: half of the surface is new.
    let half = 0.5 * f64::from(HEIGHT) * ABOVE / 80.0;
    let more = filled(&[here, [(0.0, half); 3]].concat(), 1.0);
    assert!((more - 1.5).abs() < 0.1, "{more}");
    // The upper half is the whole photograph where the lower half is masked.
    let (mut masked, mut priors) = views(&here, |_| 1.0);
    for (view, prior) in masked.iter_mut().zip(&mut priors) {
        let half = view.pixels() / 2;
        view.wanted = Some((0..view.pixels()).map(|pixel| pixel < half).collect());
        prior.depth[half..].fill(0.0);
    }
    assert!((surface(&masked, &priors) - 1.0).abs() < 1e-9);
    // As above by points, before depths are known.
    let ground: Vec<[f64; 3]> = (-40..40)
        .flat_map(|y| (-40..40).map(move |x| [0.1 * f64::from(x), 0.3 * f64::from(y), 0.02 * f64::from(x)]))
        .collect();
    let by_points = |at: &[(f64, f64)]| {
        let cameras: Vec<Camera> = at.iter().map(|&(x, y)| camera(x, y)).collect();
        surface_of_points(&cameras, &ground)
    };
    assert!((by_points(&[here, here].concat()) - 1.0).abs() < 1e-9);
    assert!((by_points(&[here, [(0.0, 8.0); 3]].concat()) - 2.0).abs() < 1e-9);
    assert!((by_points(&[here, [(0.0, half); 3]].concat()) - 1.5).abs() < 0.1);
    assert_eq!((surface_of_points(&[], &ground), surface_of_points(&[camera(0.0, 0.0)], &[])), (0.0, 0.0));
    // A pixel without depth may show the same surface. A view without depths, or with a prior of another size, has no
    // effect.
    let (these, mut priors) = self::views(&[here, here].concat(), |_| 1.0);
    priors[3..].iter_mut().for_each(|p| p.depth[1..].fill(0.0));
    assert!((surface(&these, &priors) - 0.5).abs() < 0.01);
    priors[3..].iter_mut().for_each(|p| p.depth.fill(0.0));
    assert!((surface(&these, &priors) - 1.0).abs() < 1e-9);
    priors[3..].iter_mut().for_each(|p| p.depth = vec![1.0; 40]);
    assert!((surface(&these, &priors) - 1.0).abs() < 1e-9);
    assert_eq!(surface(&[], &[]), 0.0);
    let (views, _) = views(&here, |_| 1.0);
    assert_eq!(surface(&views, &[]), 0.0, "nothing is known");
}

#[test]
fn a_skirt_is_coarser_farther_off() {
    let (views, priors) = views(&ROW, |_| 1.0);
    let points = skirt(&views, &priors, 0.5);
    // Above and below the row, where the ground is level: 24 pixels of ABOVE / 80 beside the photographs, and beyond.
    let pixel = |p: &SkirtPoint| {
        let [x, y, z] = p.point.position;
        (x > -2.0 && x < 5.6).then(|| (y.abs() * 80.0 / (ABOVE - z) - 36.0, p.spacing * 80.0 / (ABOVE - z)))
    };
    let at: Vec<(f64, f64)> = points.iter().filter_map(pixel).collect();
    let (near, far): (Vec<_>, Vec<_>) = at.into_iter().partition(|(beside, _)| *beside < 20.0);
    let far: Vec<_> = far.into_iter().filter(|(beside, _)| *beside > 32.0).collect();
    assert!(near.len() > 20 && far.len() > 4, "{near:?} {far:?}");
    assert!(near.iter().all(|(_, step)| (step / 8.0 - 1.0).abs() < 0.4), "{near:?}");
    assert!(far.iter().all(|(_, step)| (step / 16.0 - 1.0).abs() < 0.4), "{far:?}");
    assert!(far.iter().all(|(beside, _)| *beside < 48.0 + 12.0), "{far:?}");
}

#[test]
fn a_view_beyond_many_that_stand_nearer_looks_all_the_same() {
    const FAR: (f64, f64) = (8.4, 0.0);
    let at: Vec<(f64, f64)> = ROW.into_iter().chain([FAR]).collect();
    let (mut views, mut priors) = self::views(&at, |_| 1.0);
    let without = skirt(&views[..ROW.len()], &priors[..ROW.len()], 0.25);
    let far = views[ROW.len()].camera;
    assert!(without.iter().any(|p| seen_by(&far, p.point.position)), "the far view sees no point");
    for _ in 0..150 {
        views.push(views[0].clone());
        priors.push(priors[0].clone());
    }
    let with = skirt(&views, &priors, 0.25);
    assert!(with.len() > 20, "{}", with.len());
    assert!(!with.iter().any(|p| seen_by(&far, p.point.position)));
}

#[test]
fn a_skirt_continues_rough_ground_that_extension_leaves_out() {
    let spread = |share: f64| move |p: usize| 1.0 + share * ((p * 7919 % 101) as f64 / 50.0 - 1.0);
    // Depths vary by 3 % or so, as over buildings of 5 m from 100 m above: no splats in view of photographs, but a
    // skirt.
    let (views, priors) = views(&ROW, spread(0.05));
    assert!(extend(&views, &priors, 1).is_empty());
    let points = skirt(&views, &priors, 0.25);
    assert!(points.len() > 40, "{}", points.len());
    for p in &points {
        assert!(!views.iter().any(|v| seen_by(&v.camera, p.point.position)), "{p:?}");
        let [x, _, z] = p.point.position;
        assert!((z - SLOPE * x).abs() < 0.05 * ABOVE, "{p:?}");
    }
    let (views, priors) = self::views(&ROW, spread(0.5));
    assert!(skirt(&views, &priors, 0.25).is_empty(), "depths that vary by a third have a skirt");
}
