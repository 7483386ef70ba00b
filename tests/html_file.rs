//! HTML files of models, in a browser.
#![cfg(all(unix, feature = "html-viewer"))]

mod common;

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use base64::prelude::{BASE64_STANDARD, Engine};
use common::browser::{Browser, chromium};
use image::RgbImage;
use psrgs_vk::format::html::{FROM_VIEWER, Shown};
use psrgs_vk::format::ply;
use psrgs_vk::format::splats::sog;
use psrgs_vk::pass::camera::Projection;
use psrgs_vk::raster::{RenderView, Viewer};
use psrgs_vk::scene::random::Random;
use psrgs_vk::scene::viewpoints::viewpoints;
use psrgs_vk::scene::{Camera, Frame, Gaussians, Similarity, turn};
use psrgs_vk::twin::projection::project;
use psrgs_vk::twin::splat::{Splat, TwinCamera};
use psrgs_vk::vk::Gpu;
use serde_json::json;

/// The constant spherical harmonic.
const SH_C0: f64 = 0.282_094_791_773_878_14;
/// Size of the browser's window.
const SIZE: (u32, u32) = (320, 240);
/// Up in the model, none of its axes.
const UP: [f64; 3] = [0.48, -0.6, 0.64];
/// The model's own directions across the ground.
const EAST: [f64; 3] = [0.8, 0.6, 0.0];
const NORTH: [f64; 3] = [0.384, -0.512, -0.768];

fn along(east: f64, north: f64, up: f64) -> [f64; 3] {
    std::array::from_fn(|k| east * EAST[k] + north * NORTH[k] + up * UP[k])
}

/// A ground of patches with boxes of splats on it: thin, round and long splats, opaque and faint ones.
fn model() -> Gaussians {
    let mut random = Random::new(7);
    let splats = 900;
    let mut model = Gaussians::zeros(splats);
    for row in 0..splats {
        let high = if row % 3 == 0 { random.range(0.0, 1.2) } else { 0.0 };
        let place = along(2.0 * random.symmetric(), 2.0 * random.symmetric(), high);
        model.opacities[row] = random.range(-1.0, 4.0) as f32;
        for (k, coordinate) in place.into_iter().enumerate() {
            model.means[3 * row + k] = coordinate as f32;
            model.scales[3 * row + k] = random.range(-3.6, -1.6) as f32;
            let colour = random.range(0.05, 0.95);
            model.sh[0][12 * row + k] = ((colour - 0.5) / SH_C0) as f32;
        }
        for k in 0..4 {
            model.quats[4 * row + k] = random.symmetric() as f32;
        }
    }
    model.normalise_quats();
    model
}

/// A camera that looks from `eye` at `at`, without roll.
fn camera(eye: [f64; 3], at: [f64; 3]) -> Camera {
    let unit = |v: [f64; 3]| {
        let length = v.iter().map(|v| v * v).sum::<f64>().sqrt();
        v.map(|v| v / length)
    };
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let forward = unit(std::array::from_fn(|k| at[k] - eye[k]));
    let right = unit(cross(forward, UP));
    let rotation = [right, cross(forward, right), forward];
    let translation = rotation.map(|row| -(0..3).map(|k| row[k] * eye[k]).sum::<f64>());
    let (width, height) = SIZE;
    let focal = 0.9 * f64::from(width);
    let (cx, cy) = (0.5 * f64::from(width), 0.5 * f64::from(height));
    Camera { rotation, translation, fx: focal, fy: focal, cx, cy, width, height }
}

/// Cameras around the model. The first one is nearer to the ground than the others and sees less.
fn cameras(name: &str) -> Vec<(String, Camera)> {
    let around = (0..6).map(|k| {
        let (sin, cos) = f64::from(k).sin_cos();
        let (far, high) = if k == 0 { (1.5, 0.4) } else { (3.6, 2.1 + 0.1 * f64::from(k)) };
        (format!("{name} {k}"), camera(along(far * cos, far * sin, high), along(0.0, 0.0, 0.2)))
    });
    around.collect()
}

fn shown<'a>(title: &'a str, gaussians: &'a Gaussians, cameras: &'a [(String, Camera)]) -> Shown<'a> {
    Shown { title, gaussians, cameras, up: None, sh_degree: 0, background: [0.0; 3], antialias: false }
}

/// Opens a page from the disk, and waits until its model stands still.
fn open(chromium: &Path, folder: &Path, page: &str, query: &str) -> (Browser, RgbImage) {
    let (first, file) = (folder.join("empty.html"), folder.join("model.html"));
    std::fs::write(&first, "<!doctype html><title>empty</title>").expect("written");
    std::fs::write(&file, page).expect("written");
    let software = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"];
    let mut browser = Browser::visit(chromium, &format!("file://{}", first.display()), folder, &software);
    let metrics = json!({ "width": SIZE.0, "height": SIZE.1, "deviceScaleFactor": 1, "mobile": false });
    browser.call("Emulation.setDeviceMetricsOverride", metrics);
    browser.goto(&format!("file://{}?{query}", file.display()));
    let picture = still(&mut browser, "document.body?.className === 'shown'");
    (browser, picture)
}

/// Waits until an expression is true, and from then on until two pictures are the same.
fn still(browser: &mut Browser, ready: &str) -> RgbImage {
    browser.until(ready);
    // The viewer moves to its first camera for a second.
    std::thread::sleep(Duration::from_millis(1100));
    let mut before = browser.picture();
    loop {
        std::thread::sleep(Duration::from_millis(150));
        let now = browser.picture();
        if now == before {
            return now;
        }
        before = now;
    }
}

fn render(gpu: &Gpu, model: &Gaussians, camera: Camera) -> RgbImage {
    let mut viewer = Viewer::new(gpu);
    let planes = viewer.upload(model).expect("room");
    let shot = RenderView { camera, projection: Projection::default(), background: [0.0; 3] };
    let picture = viewer.render(&planes, model.len() as u32, &shot, false).expect("a render");
    RgbImage::from_raw(picture.width, picture.height, picture.rgb8()).expect("a picture")
}

/// How a renderer draws splats.
struct Drawing {
    /// A splat's share of its opacity by the square of the distance in standard deviations.
    falloff: fn(f64) -> f64,
    /// What is added to the variances on the picture, in square pixels.
    blur: f64,
    /// Rows from front to back.
    order: fn(&[Place]) -> Vec<usize>,
}

/// Where a splat is, from the camera.
struct Place {
    depth: f64,
    /// From the camera to the splat, along axes of which the second one is up.
    away: [f64; 3],
}

impl Place {
    fn distance(&self) -> f64 {
        self.away.iter().map(|v| v * v).sum::<f64>().sqrt()
    }
}

/// A Gaussian, by depth.
const OURS: Drawing =
    Drawing { falloff: |square| (-0.5 * square).exp(), blur: 0.3, order: |places| sorted(places, |_, p| p.depth) };

/// The viewer takes the height of the Gaussian at its end, at the root of 8 standard deviations, away from all of it, so
/// that the end is zero. It widens splats by 0.3 square half pixels, and sorts by distance in steps.
const VIEWER: Drawing = Drawing {
    falloff: |square| {
        let end = (-4.0_f64).exp();
        if square > 8.0 { 0.0 } else { ((-0.5 * square).exp() - end) / (1.0 - end) }
    },
    blur: 0.075,
    order: by_steps,
};

/// Rows in the order of a key.
fn sorted(places: &[Place], key: impl Fn(usize, &Place) -> f64) -> Vec<usize> {
    let mut rows: Vec<usize> = (0..places.len()).collect();
    rows.sort_by(|a, b| key(*a, &places[*a]).total_cmp(&key(*b, &places[*b])));
    rows
}

/// The viewer counts splats into 1025 steps of distance, up to that of the farthest corner of the box around their
/// middles. The distances are cut into 32 equal bins, and nearer bins have more steps. Of splats on one step, those later
/// in the file are behind.
fn by_steps(places: &[Place]) -> Vec<usize> {
    const BINS: usize = 32;
    const STEPS: f64 = 1025.0;
    let weight = |bin: usize| match BINS - 1 - bin {
        0 => 40.0,
        1..=2 => 20.0,
        3..=5 => 8.0,
        6..=10 => 3.0,
        _ => 1.0,
    };
    let total: f64 = (0..BINS).map(weight).sum();
    let steps = |bin: usize| (weight(bin) / total * STEPS).floor().max(1.0);
    let side = |k: usize| places.iter().map(|p| p.away[k].abs()).fold(0.0, f64::max);
    let range = (0..3).map(|k| side(k).powi(2)).sum::<f64>().sqrt();
    sorted(places, |row, p| {
        let inverted = (range - p.distance()) * BINS as f64 / range;
        let bin = inverted as usize;
        let step = ((0..bin).map(steps).sum::<f64>() + steps(bin) * inverted.fract()).floor();
        // The row decides between splats of one step.
        row as f64 / (2 * places.len()) as f64 - step
    })
}

/// The conic of a splat that was widened by 0.3 as if by another number of square pixels.
fn widened([a, b, c]: [f64; 3], blur: f64) -> [f64; 3] {
    let det = a * c - b * b;
    let [a, b, c] = [c / det + blur - 0.3, -b / det, a / det + blur - 0.3];
    let det = a * c - b * b;
    [c / det, -b / det, a / det]
}

/// The model of a page, read back from its SOG, in the coordinates of the model that was exported.
fn read_back(page: &str) -> Gaussians {
    let text = page.split("id=\"model\">").nth(1).and_then(|rest| rest.split('<').next()).expect("a model");
    let model = sog::decode(Path::new("page"), &BASE64_STANDARD.decode(text).expect("base64"), true).expect("a SOG");
    let upright = Similarity { rotation: turn(UP, [0.0, 1.0, 0.0]), ..Similarity::IDENTITY };
    let in_file = upright.then(&Similarity { rotation: FROM_VIEWER, ..Similarity::IDENTITY });
    in_file.inverse().gaussians(&model.gaussians)
}

/// The model drawn splat by splat, in double precision.
fn drawn(model: &Gaussians, camera: &Camera, drawing: &Drawing) -> RgbImage {
    let view = TwinCamera::<f64>::exact(camera, &Projection::default());
    let upright = turn(UP, [0.0, 1.0, 0.0]);
    let times = |rows: &[[f64; 3]; 3], v: [f64; 3]| rows.map(|row| (0..3).map(|k| row[k] * v[k]).sum::<f64>());
    let splats = Splat::<f64>::all(model);
    let away = |splat: &Splat<f64>| std::array::from_fn(|k| splat.mean[k] - camera.center()[k]);
    let before: Vec<[f64; 3]> = splats.iter().map(|splat| times(&camera.rotation, away(splat))).collect();
    let place = |(splat, p): (&Splat<f64>, &[f64; 3])| Place { depth: p[2], away: times(&upright, away(splat)) };
    let places: Vec<Place> = splats.iter().zip(&before).map(place).collect();
    let (width, height) = SIZE;
    let mut pixels = vec![([0.0_f64; 3], 1.0_f64); (width * height) as usize];
    for row in (drawing.order)(&places).into_iter().filter(|row| before[*row][2] > 0.01) {
        let (p, splat) = (&before[row], &splats[row]);
        let ewa = project(&view, *p, splat.quat, splat.log_scale);
        let [a, b, c] = widened(ewa.conic, drawing.blur);
        let (u, v) = (camera.fx * p[0] / p[2] + camera.cx, camera.fy * p[1] / p[2] + camera.cy);
        let colour: [f64; 3] = std::array::from_fn(|k| (SH_C0 * splat.sh[0][k] + 0.5).max(0.0));
        for (at, (sum, left)) in pixels.iter_mut().enumerate() {
            let (x, y) = ((at as u32 % width) as f64 + 0.5 - u, (at as u32 / width) as f64 + 0.5 - v);
            let square = a * x * x + 2.0 * b * x * y + c * y * y;
            let alpha = (drawing.falloff)(square) / (1.0 + (-splat.logit).exp());
            if alpha >= 1.0 / 255.0 {
                (0..3).for_each(|k| sum[k] += *left * alpha * colour[k]);
                *left *= 1.0 - alpha;
            }
        }
    }
    let bytes = pixels.iter().flat_map(|(sum, _)| sum.map(|v| (255.0 * v).round().clamp(0.0, 255.0) as u8)).collect();
    RgbImage::from_raw(width, height, bytes).expect("a picture")
}

/// Mean of the differences of two pictures, in 8-bit steps, and the share of values that differ by more than 8.
fn difference(a: &RgbImage, b: &RgbImage) -> (f64, f64) {
    assert_eq!(a.dimensions(), b.dimensions());
    let differences = a.as_raw().iter().zip(b.as_raw()).map(|(a, b)| f64::from(a.abs_diff(*b)));
    let count = a.as_raw().len() as f64;
    (differences.clone().sum::<f64>() / count, differences.filter(|d| *d > 8.0).count() as f64 / count)
}

#[test]
fn html_file_opens_offline_and_shows_the_render() {
    let (Some(chromium), Some(gpu)) = (chromium(), common::gpu()) else {
        common::skipped("no chromium in PATH");
        return;
    };
    let (model, cameras) = (model(), cameras("photograph"));
    let page = Shown { up: Some(UP), ..shown("a model", &model, &cameras) }.html().expect("a page");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (browser, seen) = open(&chromium, folder.path(), &page, "webgl&noui");

    let (asked, problems) = browser.asked_for();
    assert!(
        asked.len() >= 3 && asked.iter().all(|url| ["file:", "data:", "blob:"].iter().any(|of| url.starts_with(of)))
    );
    assert_eq!(asked.iter().filter(|url| url.starts_with("file:")).count(), 1, "{asked:?}");
    assert_eq!(problems, [""; 0]);

    let first = &viewpoints(&model, &cameras, UP, 8)[0];
    let camera = cameras.iter().find(|(name, _)| *name == first.name).expect("the first camera").1;
    let rendered = render(&gpu, &model, camera);
    if let Some(folder) = std::env::var_os("PSRGS_KEEP").map(std::path::PathBuf::from) {
        seen.save(folder.join("seen.png")).expect("saved");
        rendered.save(folder.join("rendered.png")).expect("saved");
    }
    let lit = rendered.as_raw().iter().filter(|v| **v > 40).count();
    assert!(lit > rendered.as_raw().len() / 4, "an empty picture");
    let told = |what: &str, a: &RgbImage, b: &RgbImage| {
        let (mean, far) = difference(a, b);
        println!("{what}: mean difference {mean:.3} of 255, {:.2} % of the values differ by more than 8", 100.0 * far);
        (mean, far)
    };
    let whole = told("viewer and render", &seen, &rendered);
    let ours = drawn(&model, &camera, &OURS);
    let back = read_back(&page);
    let ours = told("render and its splats drawn one by one", &rendered, &ours);
    let viewers = told("viewer and its splats drawn one by one", &seen, &drawn(&back, &camera, &VIEWER));
    let exactly = Drawing { order: |places| sorted(places, |_, p| p.distance()), ..VIEWER };
    told("the same, sorted by exact distances", &seen, &drawn(&back, &camera, &exactly));
    let depths = Drawing { order: OURS.order, ..VIEWER };
    told("the same, sorted by depth", &seen, &drawn(&back, &camera, &depths));
    // The difference between viewer and render is the falloff of a splat, the sort by distance, and the rounding of the
    // distances before the sort. What is left has no pattern: blending in 8 bits.
    assert!(whole.0 < 4.0 && whole.1 < 0.11, "viewer and render: {whole:?}");
    assert!(ours.0 < 0.1 && ours.1 < 1e-3, "render: {ours:?}");
    assert!(viewers.0 < 0.95 && viewers.1 < 1e-3, "viewer: {viewers:?}");
}

/// Names of photographs come from other people's datasets.
#[test]
fn hostile_names_do_not_run_in_the_html_file() {
    let Some(chromium) = chromium() else {
        common::skipped("no chromium in PATH");
        return;
    };
    let name = "</script><img src=x onerror=window.ran=1><script>window.ran=2</script>";
    let (model, cameras) = (model(), cameras(name));
    let page = shown(name, &model, &cameras).html().expect("a page");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (mut browser, with_buttons) = open(&chromium, folder.path(), &page, "webgl");
    assert_eq!(browser.value("document.title"), name);
    browser.click(".sse-annotationNext");
    let moved = still(&mut browser, "document.querySelector('.sse-annotationNavNumber').textContent === '2'");
    let title = browser.value("document.querySelector('.sse-annotationNavTitle').textContent");
    assert!(title.as_str().expect("text").contains("window.ran=2</script>"), "{title}");
    assert!(difference(&with_buttons, &moved).0 > 1.0, "the viewer did not move to the second photograph");
    assert_eq!(browser.value("typeof window.ran"), "undefined");
    assert_eq!(browser.asked_for().1, [""; 0]);
}

/// A dataset of the cameras alone, as nerfstudio writes one, whose axes are those of OpenGL.
fn write_cameras(folder: &Path, cameras: &[(String, Camera)]) {
    let frames: Vec<serde_json::Value> = cameras
        .iter()
        .map(|(name, camera)| {
            let (r, center) = (&camera.rotation, camera.center());
            let row = |k: usize| json!([r[0][k], -r[1][k], -r[2][k], center[k]]);
            json!({ "file_path": format!("{name}.jpg"), "transform_matrix": [row(0), row(1), row(2), [0, 0, 0, 1]] })
        })
        .collect();
    let c = &cameras[0].1;
    let file = json!({ "camera_model": "OPENCV", "w": c.width, "h": c.height, "fl_x": c.fx, "fl_y": c.fy, "cx": c.cx,
                       "cy": c.cy, "frames": frames });
    std::fs::write(folder.join("transforms.json"), file.to_string()).expect("written");
}

#[test]
fn export_writes_an_html_file_with_the_cameras_of_a_dataset() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (file, out) = (folder.path().join("model.ply"), folder.path().join("seen.html"));
    ply::save(&file, &model(), &Frame::IDENTITY, false).expect("saved");
    let data = folder.path().join("data");
    std::fs::create_dir(&data).expect("a folder");
    write_cameras(&data, &cameras("photograph"));
    let export = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_psrgs-vk"));
        let output = command.arg("export").arg(&file).arg("--out").arg(&out).args(more).output().expect("the program");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let data = data.display().to_string();
    let (code, text) = export(&["--cameras", &data, "--sh-degree", "0", "--background", "#ff0000"]);
    assert!(code == Some(0) && text.contains("900 splats") && text.contains("without a network"), "{text}");
    let page = std::fs::read_to_string(&out).expect("a page");
    let options =
        page.split("id=\"options\">").nth(1).and_then(|rest| rest.split("</script>").next()).expect("options");
    let options: serde_json::Value = serde_json::from_str(options).expect("JSON");
    let settings = &options["settings"];
    assert_eq!(settings["background"]["color"], json!([1.0, 0.0, 0.0]));
    assert!(page.contains("<title>seen</title>") && settings["annotations"].as_array().expect("places").len() > 2);
    // The cameras are 0.4 to 2.6 above the ground, in units of the scene in which they are 5 from their middle at most.
    let height = settings["cameras"][0]["initial"]["position"][1].as_f64().expect("a number");
    let target = settings["cameras"][0]["initial"]["target"][1].as_f64().expect("a number");
    assert!(height - target > 0.5, "y is up: {height} above {target}");

    let (code, text) = export(&["--json", "numbers.json"]);
    assert!(code == Some(2) && text.contains("--json"), "{text}");
    assert_eq!(std::fs::read_to_string(&out).expect("a page"), page, "the page of before is lost");
    let (code, text) = export(&[]);
    assert!(code == Some(0) && text.contains("--cameras DATA"), "{text}");
    assert!(std::fs::read_to_string(&out).expect("a page").contains("\"cameras\":[]"));
}
