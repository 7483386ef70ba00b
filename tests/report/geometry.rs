//! Geometry metrics against made-up pictures and models with known errors.

use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use psrgs_vk::dataset::{Dataset, HostShare, LoadOptions, Role, Tracks};
use psrgs_vk::eval::geometry::{Agreement, Closest, Judge, JudgedDepth, Known, measure, off_surface};
use psrgs_vk::eval::{Geometry, GeometryTruth, SeenPixels};
use psrgs_vk::format::image_out::{read_depth, read_normals};
use psrgs_vk::format::ply::Mesh;
use psrgs_vk::pass::camera::Projection;
use psrgs_vk::raster::{DepthProbe, Picture, RenderView, Viewer};
use psrgs_vk::scene::random::Random;
use psrgs_vk::scene::{Camera, Frame, Gaussians};
use psrgs_vk::vk::Gpu;
use psrgs_vk::world::{Effects, LidarParams, WorldParams, generate};

use crate::common;

const CAMERA: Camera = Camera {
    rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    translation: [0.0; 3],
    fx: 5.0,
    fy: 5.0,
    cx: 2.5,
    cy: 1.0,
    width: 5,
    height: 2,
};

/// Ten pixels: eight have a true depth, and one of the eight is nearly transparent.
#[test]
fn pictures_with_known_errors_give_these_errors() {
    let scale = 0.25;
    let truth: Vec<f32> = vec![10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 0.0, f32::NAN];
    // Relative errors; the last of the eight is not covered.
    let errors: [f32; 10] = [0.001, -0.004, 0.0049, -0.006, 0.019, 0.03, -0.1, 0.0, 0.5, 0.5];
    let degrees: [f64; 10] = [0.0, 2.0, 5.0, 9.0, 14.0, 60.0, 180.0, 90.0, 0.0, 0.0];
    let opacity: [f32; 10] = [0.51, 0.6, 0.7, 0.8, 0.9, 0.99, 1.0, 0.49, 1.0, 1.0];
    let (mut rgbt, mut aux, mut normals) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..10 {
        let w = opacity[k];
        rgbt.extend([0.0, 0.0, 0.0, 1.0 - w]);
        let z = if truth[k] > 0.0 { truth[k] * (1.0 + errors[k]) } else { 5.0 } * scale as f32;
        let turn = degrees[k].to_radians();
        // Normals of different lengths and weights: only directions count.
        aux.extend([w * z, 0.3 * w * turn.sin() as f32, 0.0, -0.3 * w * turn.cos() as f32]);
        normals.push([0.0, 0.0, -1.0]);
    }
    let picture = Picture { width: 5, height: 2, rgbt, aux: Some(aux) };
    let known = Known { camera: CAMERA, depth: truth, normals: Some(normals) };
    let mut agreement = Agreement::default();
    assert_eq!((agreement.median_error(), agreement.within(0.005), agreement.coverage()), (None, None, None));
    agreement.add(&picture, &known, scale);
    // The median of the seven covered pixels.
    assert!((agreement.median_error().unwrap() - 0.006).abs() < 1e-6);
    assert_eq!(agreement.within(0.005), Some(3.0 / 8.0));
    assert_eq!(agreement.within(0.02), Some(5.0 / 8.0));
    assert_eq!(agreement.coverage(), Some(7.0 / 8.0));
    assert!((agreement.median_degrees().unwrap() - 9.0).abs() < 1e-3);
    // Of the median depths that there are and have a truth, 0.0049 is the middle one; of four seen pixels with a truth
    // a quarter of the weight is in front, and an eighth behind.
    let median = |k: usize| if k < 7 { known.depth[k] * (1.0 + errors[k]) * scale as f32 } else { 0.0 };
    let probe = DepthProbe {
        width: 5,
        height: 2,
        median: (0..10).map(|k| if k == 9 { 5.0 } else { median(k) }).collect(),
        front: vec![0.5, 0.25, 0.25, 0.0, 0.9, 0.9, 0.9, 0.9, 0.9, 0.9],
        behind: vec![0.0, 0.0, 0.0, 0.5, 0.9, 0.9, 0.9, 0.9, 0.9, 0.9],
    };
    assert_eq!((agreement.error_of_median(), agreement.floaters()), (None, [None, None]));
    agreement.add_probe(&probe, &known, &[true, true, true, true, false, false, false, false, true, true], scale);
    assert!((agreement.error_of_median().unwrap() - 0.006).abs() < 1e-6);
    assert_eq!(agreement.floaters(), [Some(0.25), Some(0.125)]);
    // A picture at a wrong scale is wrong all over.
    // A depth map at a wrong scale is wrong everywhere.
    let mut other = Agreement::default();
    other.add(&picture, &known, 1.0);
    assert!((other.median_error().unwrap() - 0.75).abs() < 0.01 && other.within(0.02) == Some(0.0));
}

/// Four places in two photographs: one is nearly transparent, and of another only the expected depth is known.
#[test]
fn judged_depths_are_off_by_known_errors() {
    let judge = |places: &[[f64; 3]]| Judge { camera: CAMERA, places: places.to_vec() };
    let judges = [judge(&[[0.5, 0.5, 10.0], [4.9, 1.9, 20.0]]), judge(&[[2.1, 0.2, 4.0], [0.2, 1.0, 5.0]])];
    // (pixel, opacity, expected depth, median depth)
    let drawn = [[(0, 0.9, 10.1, 10.2), (9, 0.6, 20.6, 0.0)], [(2, 1.0, 3.6, 3.8), (5, 0.4, 9.0, 0.0)]];
    let mut views = drawn.iter();
    let judged = JudgedDepth::of(&judges, |camera, known| {
        assert!(*camera == CAMERA && known.is_none());
        let (mut rgbt, mut aux, mut median) = ([0.0, 0.0, 0.0, 1.0].repeat(10), vec![0.0; 40], vec![0.0; 10]);
        for &(pixel, opacity, expected, of_median) in views.next().unwrap() {
            (rgbt[4 * pixel + 3], aux[4 * pixel]) = (1.0 - opacity, expected * opacity);
            median[pixel] = of_median;
        }
        let probe = DepthProbe { width: 5, height: 2, median, ..DepthProbe::default() };
        anyhow::Ok((Picture { width: 5, height: 2, rgbt, aux: Some(aux) }, probe))
    });
    let judged = judged.unwrap();
    // Of 1, 3 and 10 %; of 2 and 5 %, the upper one.
    assert!((judged.expected.unwrap() - 0.03).abs() < 1e-6, "{judged:?}");
    assert!((judged.median.unwrap() - 0.05).abs() < 1e-6, "{judged:?}");
    let nothing = JudgedDepth::of(&[], |_, _| -> anyhow::Result<(Picture, DepthProbe)> { unreachable!("no judge") });
    assert_eq!(nothing.unwrap(), JudgedDepth::default());
}

/// A square of 20 m at z = 3 in the dataset's units, moved by `offset`.
fn square_at(offset: [f64; 3]) -> Mesh {
    let corner = |x: f64, y: f64| [offset[0] + 100.0 + x, offset[1] + y, offset[2] + 3.0];
    Mesh {
        vertices: vec![corner(-10.0, -10.0), corner(10.0, -10.0), corner(10.0, 10.0), corner(-10.0, 10.0)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    }
}

/// At the origin, and in a national grid with the surface read from a file.
#[test]
fn splats_at_known_distances_give_these_distances() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for offset in [[0.0; 3], [5e5, 4.6e6, 100.0]] {
        let file = folder.path().join("surface.ply");
        square_at(offset).write(&file).expect("written");
        known_distances(offset, &Mesh::read(&file).expect("read"));
    }
}

fn known_distances(offset: [f64; 3], square: &Mesh) {
    let frame = Frame { offset: [offset[0] + 100.0, offset[1], offset[2]], scale: 0.5 };
    // Height above the square in dataset units, opacity, the two larger standard deviations; the third is the smallest.
    let splats = [
        (0.00, 0.9, 0.2, 0.1),
        (0.10, 0.8, 0.1, 0.1),
        (-0.30, 0.6, 0.3, 0.2),
        (0.49, 0.7, 0.1, 0.3),
        (0.51, 0.4, 0.5, 0.5),
        (7.00, 0.95, 0.1, 0.2),
        (-2.00, 0.05, 2.0, 1.0),
    ];
    let mut model = Gaussians::zeros(splats.len());
    for (i, (height, opacity, a, b)) in splats.into_iter().enumerate() {
        let position = frame.to_scene([offset[0] + 100.0 + i as f64, offset[1] + 1.0, offset[2] + 3.0 + height]);
        (0..3).for_each(|k| model.means[3 * i + k] = position[k] as f32);
        model.quats[4 * i] = 1.0;
        let odds: f64 = opacity / (1.0 - opacity);
        model.opacities[i] = odds.ln() as f32;
        // In any order of the axes.
        for (k, s) in [a, b, 0.01f64].into_iter().enumerate() {
            model.scales[3 * i + (k + i) % 3] = s.ln() as f32;
        }
    }
    let mass = |i: usize| splats[i].1 * splats[i].2 * splats[i].3;
    let off = off_surface(&model, &frame, 50.0, &Closest::new(square));
    let total: f64 = (0..7).map(mass).sum();
    let floating: f64 = [4, 5, 6].map(mass).iter().sum();
    assert!((off.floaters.unwrap() - floating / total).abs() < 1e-6, "{off:?}");
    // Opaque ones by distance: 0 (mass 0.018), 0.1 (0.008), 0.3 (0.036), 0.49 (0.021), 7 (0.019):
    // half is reached at 0.3.
    assert!((off.distance.unwrap() - 0.3).abs() < 1e-5, "{off:?}");
    // Without floaters the share is +0, not -0.
    let near = off_surface(&model, &frame, 5000.0, &Closest::new(square));
    assert!(near.floaters.is_some_and(|share| share == 0.0 && share.is_sign_positive()), "{near:?}");
    let geometry = Geometry { floaters: near.floaters, ..Geometry::default() };
    assert!(geometry.rows_in_short().is_empty());
    assert_eq!(geometry.rows(), [("opaque mass off the surface", "0.00 %".to_owned())]);
    let nothing = off_surface(&model, &frame, 50.0, &Closest::new(&Mesh::default()));
    assert_eq!((nothing.distance, nothing.floaters), (None, None));
    let empty = off_surface(&Gaussians::zeros(0), &frame, 50.0, &Closest::new(square));
    assert_eq!((empty.distance, empty.floaters), (None, None));
}

#[test]
fn the_line_after_a_training_has_the_most_telling_numbers() {
    let known = Some(0.25);
    let geometry = Geometry {
        psnr_offpath: known,
        depth_median_error: known,
        depth_of_median_error: known,
        floaters_front: known,
        floaters_behind: known,
        normal_median_degrees: known,
        surface_distance: known,
        surface_distance_gsd: known,
        floaters: known,
        depth_points_error: known,
        ..Geometry::default()
    };
    assert_eq!((geometry.rows().len(), geometry.rows_in_short().len()), (10, 6));
}

#[test]
fn the_nearest_triangle_is_the_nearest_of_all() {
    let mut random = Random::new(9);
    let mut mesh = Mesh::default();
    for k in 0..300u32 {
        let middle = [0; 3].map(|_| 20.0 * random.unit());
        // Large and small triangles, some of which are only a line.
        let size = if k % 3 == 0 { 6.0 } else { 0.5 };
        let mut corners = [[0.0; 3]; 3].map(|_: [f64; 3]| middle.map(|m| m + size * (random.unit() - 0.5)));
        if k % 17 == 0 {
            corners[2] = corners[0];
        }
        mesh.triangles.push([3 * k, 3 * k + 1, 3 * k + 2]);
        mesh.vertices.extend(corners);
    }
    let closest = Closest::new(&mesh);
    for _ in 0..60 {
        let p = [0; 3].map(|_| 30.0 * random.unit() - 5.0);
        // Points spread over each triangle; `gap` bounds the distance between neighbours.
        let mut nearest = (f64::INFINITY, 0.0);
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|k| DVec3::from_array(mesh.vertices[k as usize]));
            const N: u32 = 60;
            let gap = a.distance(b).max(b.distance(c)).max(c.distance(a)) / f64::from(N);
            for i in 0..=N {
                for j in 0..=N - i {
                    let (u, v) = (f64::from(i) / f64::from(N), f64::from(j) / f64::from(N));
                    let d = (a + (b - a) * u + (c - a) * v).distance(DVec3::from_array(p));
                    if d < nearest.0 {
                        nearest = (d, gap);
                    }
                }
            }
        }
        let got = closest.distance(p);
        assert!(got <= nearest.0 + 1e-12 && got >= nearest.0 - nearest.1, "{p:?}: {got}, sampled {nearest:?}");
    }
}

/// Flat splats on all surfaces that the training views see, a little larger than their pixels.
fn model_of_the_truth(root: &Path, data: &Dataset) -> Gaussians {
    let mut rows: Vec<(DVec3, DVec3, f64)> = Vec::new();
    for view in &data.views {
        let file = |kind: &str| root.join(kind).join(&view.name).with_extension("exr");
        let (depth, normals) = (read_depth(&file("depth")).unwrap(), read_normals(&file("normal")).unwrap());
        let camera = &view.camera;
        let axes = camera.rotation.map(DVec3::from_array);
        let back = DMat3::from_cols(axes[0], axes[1], axes[2]);
        for (k, (z, n)) in depth.values.iter().zip(&normals.values).enumerate() {
            let (x, y) = ((k as u32 % depth.width) as f64 + 0.5, (k as u32 / depth.width) as f64 + 0.5);
            let ray = DVec3::new((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0);
            let point = DVec3::from_array(camera.center()) + back * (ray * f64::from(*z));
            rows.push((point, back * DVec3::from_array(n.map(f64::from)), f64::from(*z) / camera.fx));
        }
    }
    let mut model = Gaussians::zeros(rows.len());
    for (i, (point, normal, pixel)) in rows.into_iter().enumerate() {
        let position = data.frame.to_scene(point.to_array());
        (0..3).for_each(|k| model.means[3 * i + k] = position[k] as f32);
        let q = DQuat::from_rotation_arc(DVec3::Z, normal);
        [q.w, q.x, q.y, q.z].into_iter().enumerate().for_each(|(k, v)| model.quats[4 * i + k] = v as f32);
        let side = (0.5 * pixel * data.frame.scale).ln() as f32;
        model.scales[3 * i..3 * i + 3].copy_from_slice(&[side, side, side - 4.0]);
        model.opacities[i] = 4.0;
    }
    model
}

fn compare(gpu: &Gpu, truth: &GeometryTruth, model: &Gaussians) -> Geometry {
    let mut viewer = Viewer::new(gpu);
    let planes = viewer.upload(model).unwrap();
    measure(truth, model, |camera, known| {
        let shot = RenderView { camera: *camera, projection: Projection::default(), background: [0.0; 3] };
        let splats = model.len() as u32;
        anyhow::Ok((viewer.render(&planes, splats, &shot, true)?, viewer.probe(&planes, splats, &shot, known)?))
    })
    .unwrap()
}

fn judged(gpu: &Gpu, data: &Dataset, model: &Gaussians) -> JudgedDepth {
    let mut viewer = Viewer::new(gpu);
    let planes = viewer.upload(model).unwrap();
    let splats = model.len() as u32;
    JudgedDepth::of(&Judge::of_points(data), |camera, known| {
        let view = RenderView { camera: *camera, projection: Projection::default(), background: [0.0; 3] };
        anyhow::Ok((viewer.render(&planes, splats, &view, true)?, viewer.probe(&planes, splats, &view, known)?))
    })
    .unwrap()
}

/// Judges are the points of long tracks and small errors, where held-out photographs observe them; where nobody says
/// who does, wherever they project.
fn points_that_judge(data: &Dataset) {
    let judges = Judge::of_points(data);
    let held_out: Vec<usize> = data.views_of(Role::HeldOut).map(|(k, _)| k).collect();
    let good = |k: &usize| data.points[*k].track >= 4 && data.points[*k].error <= 0.5;
    let count = |view: usize| {
        (0..data.points.len()).filter(good).filter(|k| data.tracks.of(*k).contains(&(view as u32))).count()
    };
    let places: Vec<usize> = judges.iter().map(|judge| judge.places.len()).collect();
    println!("{places:?} points judge, of {}", data.points.len());
    assert_eq!(places, held_out.iter().map(|view| count(*view)).collect::<Vec<_>>());
    assert!(places.iter().sum::<usize>() > 10, "{places:?}");
    let number = |judges: &[Judge]| judges.iter().map(|judge| judge.places.len()).collect::<Vec<_>>();
    let not_by_first = |k| data.tracks.of(k).iter().copied().filter(|view| *view as usize != held_out[0]).collect();
    let tracks = Tracks::new((0..data.points.len()).map(not_by_first));
    assert_eq!(number(&Judge::of_points(&Dataset { tracks, ..data.clone() })), places[1..], "the first observes none");
    let anywhere = number(&Judge::of_points(&Dataset { tracks: Tracks::default(), ..data.clone() }));
    assert!(anywhere.iter().zip(&places).all(|(all, observed)| all >= observed), "{anywhere:?}, {places:?}");
    let mut vague = data.clone();
    vague.points.iter_mut().for_each(|point| point.error = if point.id % 2 == 0 { f64::NAN } else { -1.0 });
    assert_eq!(Judge::of_points(&vague), [], "errors that are not known");
}

/// A model on the surface has no error. Lowered by a metre, depth and distance are off by a metre. Added splats high
/// above the surface are floaters.
#[test]
fn geometry_errors_of_a_moved_model_are_its_displacement() {
    let Some(gpu) = common::gpu() else { return };
    let dir = tempfile::tempdir().unwrap();
    let params = WorldParams {
        images: 9,
        max_side: 96,
        nadir_share: 1.0,
        pixels_per_point: 20,
        offpath: 2,
        effects: Effects::none(),
        supersample: 1,
        lidar: LidarParams { density: 0.1, ..LidarParams::default() },
        ..WorldParams::default()
    };
    generate(&params, dir.path(), &mut |_| ()).unwrap();
    let options = LoadOptions::default();
    let data = Dataset::load(dir.path(), &options).unwrap();
    let truth = GeometryTruth::find(&data, &options).unwrap();
    assert!(!truth.is_empty());
    let model = model_of_the_truth(dir.path(), &data);
    let right = compare(&gpu, &truth, &model);
    println!("{right:?}");
    assert!(right.depth_median_error.unwrap() < 0.002 && right.depth_median_error_offpath.unwrap() < 0.01);
    assert!(right.depth_coverage.unwrap() > 0.999 && right.depth_within_0_5_percent.unwrap() > 0.8);
    assert!(right.normal_median_degrees.unwrap() < 1.0);
    assert!(right.surface_distance.unwrap() < 1e-4 && right.floaters.unwrap() < 1e-3);
    assert!(right.depth_of_median_error.unwrap() < 0.002 && right.depth_of_median_error_offpath.unwrap() < 0.01);
    // At the edges of roofs splats reach over the ground, and seen from half the height twice as many pixels over it.
    assert!(right.floaters_front.unwrap() < 0.03 && right.floaters_behind.unwrap() < 0.001);
    assert!(right.floaters_front_offpath.unwrap() < 0.12 && right.floaters_behind_offpath.unwrap() < 0.01);

    points_that_judge(&data);
    let judged_right = judged(&gpu, &data, &model);
    println!("{judged_right:?}");
    assert!(judged_right.median.unwrap() < 0.005 && judged_right.expected.unwrap() < 0.005);

    // The flight is 48 m high: a metre is 2.1 % of the depth of the ground, and a little more of the roofs'.
    let mut lower = model.clone();
    lower.means.chunks_exact_mut(3).for_each(|p| p[2] -= data.frame.scale as f32);
    let moved = compare(&gpu, &truth, &lower);
    println!("{moved:?}");
    let judged_moved = judged(&gpu, &data, &lower);
    assert!((judged_moved.median.unwrap() - 1.0 / 47.5).abs() < 0.004, "{judged_moved:?}");
    let error = moved.depth_median_error.unwrap();
    assert!((1.0 / 49.5..1.0 / 46.0).contains(&error), "median error {error}");
    assert!(moved.depth_within_0_5_percent.unwrap() < 0.1 && moved.psnr_offpath != right.psnr_offpath);
    let distance = moved.surface_distance.unwrap();
    assert!((distance - 1.0).abs() < 0.02, "{distance} m");
    // From 48 m a pixel is 48 m over the focal length wide; what is on the ground is lower, and on hills higher.
    let sample = distance / moved.surface_distance_gsd.unwrap();
    let flat = 48.0 / data.views[0].camera.fx;
    assert!((0.9 * flat..1.1 * flat).contains(&sample), "a ground sample of {sample} m, {flat} m on flat ground");
    let error = moved.depth_of_median_error.unwrap();
    assert!((1.0 / 49.5..1.0 / 46.0).contains(&error), "error of the median depth {error}");
    assert!(moved.floaters_behind.unwrap() > 0.5 && moved.floaters_front.unwrap() < right.floaters_front.unwrap());
    // Further than 1 % of the extent, but for what is now inside of something.
    // Farther off than 1 % of the extent, except for splats that are now inside an object.
    assert!(data.extent * 0.01 < 1.0 && moved.floaters.unwrap() > 0.8);

    // Half of the splats once more, 30 m above: about a third of the mass floats.
    let (n, mut more) = (model.len(), model.clone());
    for plane in [&mut more.means, &mut more.quats, &mut more.scales, &mut more.opacities] {
        plane.extend_from_within(..plane.len() / 2);
    }
    more.sh.iter_mut().for_each(|plane| plane.extend_from_within(..plane.len() / 2));
    more.ids = (0..more.opacities.len() as u32).collect();
    more.means[3 * n..].chunks_exact_mut(3).for_each(|p| p[2] += (30.0 * data.frame.scale) as f32);
    let mass =
        |g: &Gaussians, from: usize| -> f64 { (from..g.len()).map(|i| (2.0 * f64::from(g.scales[3 * i])).exp()).sum() };
    let floating = mass(&more, n) / mass(&more, 0);
    let with = compare(&gpu, &truth, &more);
    assert!((with.floaters.unwrap() - floating).abs() < 2e-3 && floating > 0.2, "{with:?}, {floating}");
    assert!(with.depth_median_error.unwrap() > 0.1, "what floats hides the ground");
    assert!(with.floaters_front.unwrap() > 0.2 && with.floaters_behind.unwrap() < 0.02, "it floats in front");
    assert!(with.depth_median_error.unwrap() > 0.1, "floaters do not hide the ground");

    // A dataset without ground truth gives no metrics.
    for kind in ["depth", "normal", "offpath"] {
        std::fs::remove_dir_all(dir.path().join(kind)).unwrap();
    }
    std::fs::remove_file(dir.path().join("surface.ply")).unwrap();
    let none = GeometryTruth::find(&data, &options).unwrap();
    assert!(none.is_empty() && compare(&gpu, &none, &model) == Geometry::default());
    assert_eq!(serde_json::to_string(&Geometry::default()).unwrap(), "{}");
}

/// Ground truth of another size is compared at its own size. Ground truth of another shape is refused.
#[test]
fn maps_of_another_size_are_used_and_of_another_shape_refused() {
    let Some(gpu) = common::gpu() else { return };
    let dir = tempfile::tempdir().unwrap();
    let params = WorldParams {
        images: 2,
        max_side: 96,
        nadir_share: 1.0,
        offpath: 0,
        effects: Effects::none(),
        supersample: 1,
        lidar: LidarParams { density: 0.1, ..LidarParams::default() },
        ..WorldParams::default()
    };
    generate(&params, dir.path(), &mut |_| ()).unwrap();
    let full = Dataset::load(dir.path(), &LoadOptions::default()).unwrap();
    let model = model_of_the_truth(dir.path(), &full);
    let options = LoadOptions { max_side: Some(48), ..LoadOptions::default() };
    let data = Dataset::load(dir.path(), &options).unwrap();
    assert_eq!(data.views[0].camera.width, 48);
    let half = compare(&gpu, &GeometryTruth::find(&data, &options).unwrap(), &model);
    let whole = compare(&gpu, &GeometryTruth::find(&full, &LoadOptions::default()).unwrap(), &model);
    assert_eq!(half.depth_median_error, whole.depth_median_error);
    assert_eq!(half.depth_coverage, whole.depth_coverage);

    let file = dir.path().join("depth/view_0000.exr");
    psrgs_vk::format::image_out::write_depth(&file, 72, 96, &vec![1.0; 72 * 96]).unwrap();
    let truth = GeometryTruth::find(&data, &options).unwrap();
    let error =
        measure(&truth, &model, |_, _| -> anyhow::Result<(Picture, DepthProbe)> { unreachable!("not of this shape") });
    let error = error.unwrap_err().to_string();
    assert!(error.contains("view_0000.exr") && error.contains("(72, 96)") && error.contains("shape"), "{error}");
}

/// What is seen by true depths and by points differs in few pixels; a photograph that is not trained on sees nothing,
/// and where nothing tells a depth, all counts as seen.
#[test]
fn what_is_seen_is_made_of_depths_points_and_cameras() {
    let dir = tempfile::tempdir().unwrap();
    let params = WorldParams {
        images: 17,
        max_side: 96,
        nadir_share: 1.0,
        offpath: 0,
        effects: Effects::none(),
        supersample: 1,
        lidar: LidarParams { density: 0.1, ..LidarParams::default() },
        ..WorldParams::default()
    };
    generate(&params, dir.path(), &mut |_| ()).unwrap();
    let seen_of = |trained_on: &dyn Fn(&str) -> bool| {
        let data = Dataset::load(dir.path(), &LoadOptions::default()).unwrap();
        let seen = SeenPixels::of(&data, &HostShare::unlimited(), trained_on).unwrap();
        let of =
            |view: &psrgs_vk::dataset::View| seen.of_photograph(&view.name, (view.camera.width, view.camera.height));
        data.views_of(Role::HeldOut).flat_map(|(_, view)| of(view)).collect::<Vec<bool>>()
    };
    let share = |pixels: &[bool]| pixels.iter().filter(|seen| **seen).count() as f64 / pixels.len() as f64;
    let few = |name: &str| ["1.", "3.", "5."].iter().any(|end| name.contains(end));
    let (truth, all) = (seen_of(&few), seen_of(&|_| true));
    println!("{} of what few see, {} of what all see", share(&truth), share(&all));
    assert!((0.1..0.7).contains(&share(&truth)) && share(&all) > share(&truth) + 0.05);
    assert!(truth.iter().zip(&all).all(|(few, all)| *all || !*few), "more photographs see more");
    assert_eq!(share(&seen_of(&|_| false)), 0.0);
    std::fs::remove_dir_all(dir.path().join("depth")).unwrap();
    let by_points = seen_of(&few);
    let other = truth.iter().zip(&by_points).filter(|(a, b)| a != b).count() as f64 / truth.len() as f64;
    println!("{other} of the pixels are otherwise by points");
    assert!(other < 0.03 && other > 0.0);
    std::fs::remove_file(dir.path().join("sparse/0/points3D.bin")).unwrap();
    assert_eq!(share(&seen_of(&few)), 1.0, "without depths and points");
}
