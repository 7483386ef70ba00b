//! The report page and metrics.json.

// Nothing of a test binary is reachable from outside.
#![allow(unreachable_pub)]

#[cfg(unix)]
#[path = "report/browser.rs"]
mod browser;
mod common;
#[path = "report/geometry.rs"]
mod geometry;

use std::path::{Path, PathBuf};
use std::process::Command;

use common::browser::chromium;
use image::{Rgb, RgbImage};
use psrgs_vk::eval::{
    Curve, CurveForm, DepthMap, ExposureScores, Geometry, ImageScore, Interactive, Metrics, ReportData, ReportError,
    StagePanel, TrainingScores, ViewPanel, render_report, write_report,
};
use psrgs_vk::world::{World, WorldParams};

fn metrics(images: Vec<ImageScore>) -> Metrics {
    Metrics {
        method: "3dgs".into(),
        iterations: 1500,
        scene: "demo".into(),
        train_images: 35,
        test_images: 0,
        width: 160,
        height: 120,
        seed: 7,
        device: "llvmpipe (LLVM 15.0.6, 256 bits)".into(),
        forms: None,
        psnr: None,
        psnr_seen: None,
        seen: None,
        psnr_cc: None,
        ssim: None,
        lpips_squeeze: None,
        gmsd: None,
        psnr_high_frequency: None,
        psnr_training: None,
        ssim_training: None,
        first_splats: Some(1),
        splats: 48_213,
        bytes: 11_957_120,
        seconds: 283.4,
        seconds_stereo: 0.0,
        seconds_saliency: 0.0,
        seconds_per_iteration: 0.171,
        peak_device_bytes: 412_000_000,
        peak_host_bytes: Some(620_000_000),
        streaming: None,
        exposures: None,
        geometry: Geometry { floaters: Some(0.0123), surface_distance: Some(0.0456), ..Geometry::default() },
        images: Vec::new(),
        training_photographs: Vec::new(),
    }
    .with_images(images)
}

/// Views of the synthetic world, with a blurred copy as render, and curves like those of a training.
fn example(views: usize, side: u32) -> ReportData {
    let world =
        World::new(&WorldParams { images: 8, max_side: side, supersample: 3, ..WorldParams::default() }).unwrap();
    let panels: Vec<ViewPanel> = (0..views)
        .map(|k| {
            // Oblique views come last; begin with one.
            let view = &world.views()[(5 + 3 * k) % 8];
            let (photograph, values) = world.photograph(&view.camera, k as u32);
            let render = image::imageops::blur(&photograph, 0.8 + 0.3 * k as f32);
            let (width, height) = photograph.dimensions();
            let stages = (k == 0).then(|| StagePanel {
                mask: image::imageops::blur(&photograph, 8.0),
                low: image::imageops::blur(&photograph, 3.0),
                high: photograph.clone(),
            });
            ViewPanel {
                name: view.name.clone(),
                photograph,
                render,
                depth: Some(DepthMap { width, height, values }),
                counting: Vec::new(),
                stages,
                psnr: 24.31 - 1.2 * k as f64,
                psnr_cc: 24.9 - 1.1 * k as f64,
                ssim: 0.831 - 0.02 * k as f64,
                lpips_squeeze: Some(0.137 + 0.01 * k as f64),
                gmsd: Some(0.05),
                psnr_high_frequency: None,
            }
        })
        .collect();
    let scores = panels.iter().map(ViewPanel::score).collect();
    let wobble = |k: u32| f64::from(k.wrapping_mul(2_654_435_761) >> 16) / 65_536.0;
    let loss = (1..=1500).map(|k| {
        let s = f64::from(k);
        (s, 0.05 + 0.24 * (-s / 220.0).exp() + 0.03 * wobble(k))
    });
    let psnr = (1..=6).map(|k| (250.0 * f64::from(k), 24.4 - 7.0 * (-0.55 * f64::from(k)).exp()));
    let splats = (0..=15).map(|k| (100.0 * f64::from(k), 11_485.0 + 36_728.0 * (f64::from(k) / 15.0).powf(0.7)));
    ReportData {
        title: "A village, seen from above".into(),
        settings: [("iterations", "1500"), ("scale_schedule", "true"), ("max_side", "320"), ("sh_degree", "3")]
            .map(|(a, b)| (a.into(), b.into()))
            .into(),
        curves: vec![
            Curve {
                name: "Loss".into(),
                unit: "L1 and SSIM, 0.8 : 0.2".into(),
                points: loss.collect(),
                form: CurveForm::Line,
            },
            Curve { name: "Held-out PSNR".into(), unit: "dB".into(), points: psnr.collect(), form: CurveForm::Line },
            Curve { name: "Splats".into(), unit: String::new(), points: splats.collect(), form: CurveForm::Steps },
        ],
        metrics: metrics(scores),
        views: panels,
        files: [
            ("point_cloud.ply", "the model, for any viewer of Gaussian splats"),
            ("metrics.json", "the numbers"),
            ("settings.toml", "repeats the run with train --config"),
        ]
        .map(|(a, b)| (a.into(), b.into()))
        .into(),
        notes: vec!["The scene is synthetic: its true depth lies in demo/depth.".into()],
        drawing: None,
        model: None,
    }
}

/// Values of an attribute.
fn attributes<'a>(page: &'a str, name: &str) -> Vec<&'a str> {
    let mark = format!(" {name}=\"");
    page.split(&mark).skip(1).map(|rest| rest.split_once('"').unwrap().0).collect()
}

fn decode(address: &str) -> RgbImage {
    let (head, body) = address.split_once(";base64,").expect("base64");
    assert!(head == "data:image/png" || head == "data:image/jpeg", "{head}");
    assert_eq!(body.len() % 4, 0);
    let value = |c: u8| match c {
        b'A'..=b'Z' => u32::from(c - b'A'),
        b'a'..=b'z' => u32::from(c - b'a') + 26,
        b'0'..=b'9' => u32::from(c - b'0') + 52,
        b'+' => 62,
        b'/' => 63,
        b'=' => 0,
        _ => panic!("not base64: {c}"),
    };
    let padding = body.bytes().rev().take_while(|&c| c == b'=').count();
    let mut data: Vec<u8> = body
        .as_bytes()
        .chunks(4)
        .flat_map(|q| {
            let word = q.iter().fold(0, |w, &c| w << 6 | value(c));
            [(word >> 16) as u8, (word >> 8) as u8, word as u8]
        })
        .collect();
    data.truncate(data.len() - padding);
    image::load_from_memory(&data).expect("a picture").to_rgb8()
}

#[test]
fn page_is_self_contained_and_shows_everything() {
    let data = example(2, 96);
    let page = render_report(&data).unwrap();
    for needle in ["http:", "https:", "url(", "@import", "//fonts", "<iframe", "{{"] {
        assert!(!page.contains(needle), "{needle}");
    }
    let sources = attributes(&page, "src");
    assert_eq!(sources.len(), 11, "four pictures a view, and three of the stages");
    let pictures: Vec<RgbImage> = sources.iter().map(|s| decode(s)).collect();
    for (first, view) in [0, 7].into_iter().zip(&data.views) {
        // Small pages are lossless.
        assert_eq!(pictures[first], view.photograph);
        assert_eq!(pictures[first + 1], view.render);
        if let Some(stages) = &view.stages {
            assert_eq!(pictures[first + 4..first + 7], [stages.mask.clone(), stages.low.clone(), stages.high.clone()]);
        }
        for p in &pictures[first..first + 4] {
            assert_eq!(p.dimensions(), view.photograph.dimensions());
        }
        assert!(page.contains(&view.name));
    }
    for address in attributes(&page, "href") {
        assert!(address == "data:," || address.starts_with("./"), "{address}");
    }
    for needle in
        ["A village, seen from above", "22.", "48,213", "12.0 MB", "4 min 43 s", "scale_schedule", "./point_cloud.ply"]
    {
        assert!(page.contains(needle), "{needle}");
    }
    assert_eq!(page.matches("<svg").count(), 3);
    assert_eq!(page.matches("type=\"range\"").count(), 2);
    // Errors and depths of both views have a colour bar with numbers at both ends.
    assert_eq!(page.matches("class=\"ramp\"").count(), 4);
}

/// A view whose left half is masked and wrong.
fn half_masked() -> ReportData {
    let mut data = example(1, 96);
    let view = &mut data.views[0];
    let (width, height) = view.photograph.dimensions();
    view.stages = None;
    view.render = view.photograph.clone();
    for (x, y, pixel) in view.render.enumerate_pixels_mut() {
        *pixel = match pixel.0.map(|v| 255 - v) {
            inverted if x < width / 2 => Rgb(inverted),
            _ => Rgb(pixel.0.map(|v| v.saturating_add(((x + y) % 4) as u8))),
        };
    }
    view.counting = (0..width * height).map(|k| k % width >= width / 2).collect();
    data
}

/// Views of photographs in portrait format, with or without pictures of stages and depth.
fn portraits(stages: bool, depth: bool) -> ReportData {
    let mut data = example(2, 160);
    for view in &mut data.views {
        view.photograph = image::imageops::rotate90(&view.photograph);
        view.render = image::imageops::rotate90(&view.render);
        view.depth = view.depth.take().filter(|_| depth).map(|map| DepthMap {
            width: map.height,
            height: map.width,
            values: map.values,
        });
        let picture = || view.photograph.clone();
        view.stages = stages.then(|| StagePanel { mask: picture(), low: picture(), high: picture() });
    }
    data
}

#[test]
fn masked_pixels_are_hatched_and_left_out_of_the_error_scale() {
    let mut data = half_masked();
    let page = render_report(&data).unwrap();
    assert!(page.contains("Hatched: masked, 50 % of the pixels"));
    // Unmasked errors are at most three steps: the scale ends at its minimum, whatever the masked half holds.
    assert!(page.contains("\u{2265} 8 / 255"), "the masked half changes the scale");
    let pictures: Vec<RgbImage> = attributes(&page, "src").iter().map(|s| decode(s)).collect();
    let view = &data.views[0];
    let half = view.photograph.width() / 2;
    for (shown, of) in
        [(&pictures[0], Some(&view.photograph)), (&pictures[1], Some(&view.render)), (&pictures[2], None)]
    {
        let greys: std::collections::BTreeSet<u8> =
            shown.enumerate_pixels().filter(|(x, ..)| *x < half).map(|(.., p)| p.0[0]).collect();
        assert!(greys.len() > 1, "stripes");
        for (x, y, pixel) in shown.enumerate_pixels() {
            if x < half {
                assert!(pixel.0[0] == pixel.0[1] && pixel.0[1] == pixel.0[2], "{pixel:?} at {x}, {y} is no grey");
            } else if let Some(of) = of {
                assert_eq!(pixel, of.get_pixel(x, y), "an unmasked pixel was changed");
            }
        }
    }
    data.views[0].counting.clear();
    let page = render_report(&data).unwrap();
    assert!(!page.contains("Hatched") && !page.contains("\u{2265} 8 / 255"));
    data.views[0].counting = vec![true; 3];
    assert!(matches!(render_report(&data), Err(ReportError::Size { what: "mask", got: (3, 1), .. })));
}

#[test]
fn the_first_figure_is_that_of_the_models_own_colours() {
    let mut data = example(1, 32);
    let first = |page: &str| {
        let tiles: Vec<String> = page
            .split("<div class=\"tile\">")
            .skip(1)
            .map(|tile| tile.split("</dt>").next().unwrap_or_default().replace("<dt>", ""))
            .collect();
        tiles
    };
    let page = render_report(&data).unwrap();
    assert_eq!(first(&page)[..2], ["PSNR", "SSIM"]);
    data.metrics.exposures =
        Some(ExposureScores { follows_order: 0.5, follows_place: 0.2, psnr_own_colours: Some(20.25) });
    let page = render_report(&data).unwrap();
    assert_eq!(first(&page)[..3], ["PSNR", "PSNR, exposed", "SSIM"]);
    let own = page.find("20.25").expect("the model's own");
    assert!(own < page.find("24.31").expect("exposed"), "the model's own colours come first");
    assert!(page.contains("in the model's own colours"));
}

#[test]
fn names_are_escaped() {
    let mut data = example(1, 32);
    data.title = "<script>alert(1)</script>".into();
    data.views[0].name = "a\"><img onerror=x>.jpg".into();
    data.files = vec![("//evil/a b.ply".into(), "<b>".into())];
    data.metrics.scene = "{{script}}".into();
    let page = render_report(&data).unwrap();
    assert!(!page.contains("<script>alert") && !page.contains("<img onerror") && !page.contains("<b></"));
    assert_eq!(page.matches("<script>").count(), 1);
    assert!(page.contains("href=\"./evil/a%20b.ply\""));
}

#[test]
fn pages_stay_small() {
    let [a, b] = [3, 4].map(|seed| common::noise(seed, 640, 480));
    let mut data = example(1, 32);
    // Noise does not compress: the lossless pictures would be more than 50 MB.
    data.views = (0..16)
        .map(|k| ViewPanel {
            name: format!("{k}.png"),
            photograph: a.clone(),
            render: b.clone(),
            depth: None,
            counting: Vec::new(),
            stages: None,
            psnr: 8.0,
            psnr_cc: 8.5,
            ssim: 0.0,
            lpips_squeeze: None,
            gmsd: None,
            psnr_high_frequency: None,
        })
        .collect();
    let page = render_report(&data).unwrap();
    assert!(page.len() < 20_000_000, "{} bytes", page.len());
    assert_eq!(attributes(&page, "src").len(), 48, "a picture of a view is missing");
}

#[test]
fn largest_model_leaves_the_page_below_its_limit() {
    let noise = common::noise(5, 2000, 1000);
    let text = |bytes: usize| -> String {
        let letter = |v: &u8| char::from(b'a' + v % 16);
        noise.as_raw().iter().cycle().take(bytes).map(letter).collect()
    };
    assert_eq!(Interactive::page(&text(40_000_000)), None, "too large for a page");
    let mut data = example(1, 32);
    data.model = Some(Interactive::page(&text(5_000_000)).expect("room"));
    let with_model = render_report(&data).unwrap();
    let [a, b] = [6, 7].map(|seed| common::noise(seed, 640, 480));
    data.views[0].depth = None;
    data.views[0].stages = None;
    data.views[0].photograph = a;
    data.views[0].render = b;
    data.views = vec![data.views[0].clone(); 16];
    let page = render_report(&data).unwrap();
    assert!(page.len() < 20_000_000 && page.len() > with_model.len(), "{} bytes", page.len());
    assert!(page.contains("id=\"model-page\"") && page.contains("src=\"data:image/"));
    data.model = Some(Interactive::absent("No <viewer>."));
    let without = render_report(&data).unwrap();
    assert!(without.contains("No &lt;viewer&gt;.") && !without.contains("blob:"), "nothing is allowed needlessly");
}

#[test]
fn empty_runs_have_a_page() {
    let data = ReportData {
        title: "Nothing".into(),
        settings: vec![],
        curves: vec![Curve::default()],
        metrics: metrics(vec![]),
        views: vec![],
        files: vec![],
        notes: vec![],
        drawing: None,
        model: None,
    };
    let page = render_report(&data).unwrap();
    assert!(!page.contains("NaN") && !page.contains(">inf"));
}

#[test]
fn sizes_that_differ_are_refused() {
    let mut data = example(1, 32);
    data.views[0].render = RgbImage::new(5, 4);
    let error = render_report(&data).unwrap_err();
    assert!(matches!(error, ReportError::Size { what: "render", got: (5, 4), .. }), "{error}");
    let mut data = example(1, 32);
    if let Some(d) = &mut data.views[0].depth {
        d.values.pop();
    }
    assert!(matches!(render_report(&data).unwrap_err(), ReportError::Size { what: "depth", .. }));
    let error = write_report(&example(1, 32), Path::new("/nowhere/report.html")).unwrap_err();
    assert!(error.to_string().contains("/nowhere/report.html"));
}

#[test]
fn metrics_have_exactly_the_promised_keys() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("metrics.json");
    let score = |name: &str, psnr, ssim| {
        let name = name.into();
        ImageScore {
            name,
            psnr,
            psnr_seen: Some(psnr + 1.0),
            seen: Some(0.9),
            psnr_cc: psnr + 2.0,
            ssim,
            lpips_squeeze: None,
            gmsd: None,
            psnr_high_frequency: None,
        }
    };
    let m = metrics(vec![score("a.jpg", 20.0, 0.5), score("b.jpg", 23.0, 0.7)]);
    let m = m.with_training(TrainingScores { psnr: Some(25.0), ssim: Some(0.75) });
    assert_eq!(m.fitted_by_heart(), Some(3.5));
    m.write(&path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let mut keys: Vec<&str> = json.as_object().unwrap().keys().map(String::as_str).collect();
    keys.sort_unstable();
    let mut expected = vec![
        "method",
        "iterations",
        "scene",
        "train_images",
        "test_images",
        "width",
        "height",
        "seed",
        "device",
        "psnr",
        "psnr_seen",
        "seen",
        "psnr_cc",
        "ssim",
        "psnr_training",
        "ssim_training",
        "first_splats",
        "splats",
        "bytes",
        "seconds",
        "seconds_saliency",
        "seconds_stereo",
        "seconds_per_iteration",
        "peak_device_bytes",
        "peak_host_bytes",
        "images",
        // Only the known geometry metric.
        "floaters",
        "surface_distance",
    ];
    expected.sort_unstable();
    assert_eq!(keys, expected);
    assert_eq!((json["psnr"].as_f64(), json["ssim"].as_f64()), (Some(21.5), Some(0.6)));
    assert_eq!((json["psnr_seen"].as_f64(), json["seen"].as_f64()), (Some(22.5), Some(0.9)));
    assert_eq!((json["psnr_cc"].as_f64(), json["images"][0]["psnr_cc"].as_f64()), (Some(23.5), Some(22.0)));
    assert_eq!((json["psnr_training"].as_f64(), json["ssim_training"].as_f64()), (Some(25.0), Some(0.75)));
    assert_eq!(json["images"][1]["name"], "b.jpg");
    assert_eq!(Metrics::read(&path).unwrap(), m);

    // Equal images have an infinite PSNR: written as null, and read back as infinity.
    let perfect = metrics(vec![score("a.jpg", f64::INFINITY, 1.0)]);
    perfect.write(&path).unwrap();
    assert!(std::fs::read_to_string(&path).unwrap().contains("\"psnr\": null"));
    assert_eq!(Metrics::read(&path).unwrap(), perfect);

    std::fs::write(&path, "{\"method\": 3}").unwrap();
    let error = Metrics::read(&path).unwrap_err().to_string();
    assert!(error.contains("metrics.json") && error.contains("line 1"), "{error}");
    if cfg!(target_os = "linux") {
        assert!(psrgs_vk::eval::peak_host_bytes().unwrap() > 1_000_000);
    }
}

/// Loads the page in a headless browser, with an appended script that writes findings into the document. Returns the
/// final document and the browser's log.
fn browse(chromium: &Path, page: &Path, width: u32, extra: &[&str]) -> (String, String) {
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new(chromium)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
        .args(["--enable-logging=stderr", "--virtual-time-budget=4000"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--window-size={width},1600"))
        .args(extra)
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    (String::from_utf8_lossy(&output.stdout).into(), String::from_utf8_lossy(&output.stderr).into())
}

#[test]
fn page_works_in_a_browser() {
    let Some(chromium) = chromium() else {
        common::skipped("no chromium in PATH");
        return;
    };
    let dir = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("report");
    std::fs::create_dir_all(&dir).unwrap();
    let path = dir.join("report.html");
    let mut data = example(3, 320);
    data.metrics.images[0].name = "IMG_161122_163234_0000_RGB.jpg".into();
    write_report(&data, &path).unwrap();
    let probe = r#"<script>
const range = document.querySelector(".stage input");
range.focus();
range.stepUp(20);
range.dispatchEvent(new Event("input"));
document.querySelector('.panel button[data-kind="depth"]').click();
const stage = document.querySelector(".stage");
const chart = document.querySelector(".chart svg");
const box = chart.getBoundingClientRect();
chart.dispatchEvent(new PointerEvent("pointermove", { clientX: box.left + 5, clientY: box.top + 50 }));
const splats = document.querySelectorAll(".chart .reading")[2].textContent;
const lines = (cell) => {
  const range = document.createRange();
  range.selectNodeContents(cell);
  return range.getClientRects().length;
};
const found = {
  names: Math.max(...[...document.querySelectorAll(".tables .scores tbody th")].map(lines)),
  focused: document.activeElement === range,
  share: stage.style.getPropertyValue("--share"),
  spoken: range.getAttribute("aria-valuetext"),
  right: stage.querySelector(".right").textContent,
  broken: [...document.images].filter((i) => !i.complete || i.naturalWidth === 0).length,
  images: document.images.length,
  sliders: [...document.querySelectorAll(".compare")].filter((c) => c.offsetWidth > 150 && c.offsetHeight > 100).length,
  reading: document.querySelector(".reading").textContent,
  splats,
  outside: performance.getEntriesByType("resource").length,
  overflow: document.documentElement.scrollWidth - document.documentElement.clientWidth,
};
document.body.dataset.found = JSON.stringify(found);
</script></body>"#;
    let probed = dir.join("probed.html");
    std::fs::write(&probed, std::fs::read_to_string(&path).unwrap().replace("</body>", probe)).unwrap();
    for width in [1400, 500] {
        let (document, log) = browse(&chromium, &probed, width, &["--dump-dom"]);
        assert!(!log.contains("CONSOLE"), "{log}");
        let found = document.split_once("data-found=\"").unwrap().1.split_once('"').unwrap().0.replace("&quot;", "\"");
        let found: serde_json::Value = serde_json::from_str(&found).unwrap();
        assert!(found["names"].as_u64().unwrap() <= 2, "a name takes more than two lines at {width} px: {found}");
        assert_eq!(found["focused"], true, "{found}");
        assert_eq!(found["share"], "70%", "{found}");
        assert_eq!(found["spoken"], "70 % photograph, the rest depth", "{found}");
        assert_eq!(found["right"], "Depth", "{found}");
        assert_eq!((found["broken"].as_u64(), found["images"].as_u64()), (Some(0), Some(21)), "{found}");
        assert_eq!(found["sliders"], 3, "{found}");
        assert!(found["reading"].as_str().unwrap().ends_with("at step 4"), "{found}");
        assert_eq!(found["splats"], "48,213 at step 1500", "{found}");
        assert_eq!(found["outside"].as_u64().unwrap(), 0, "{found}");
        assert!(found["overflow"].as_i64().unwrap() <= 0, "no sideways scrolling at {width} px: {found}");
    }
    let shot = dir.join("report.png");
    browse(&chromium, &path, 1400, &[&format!("--screenshot={}", shot.display())]);
    let picture = image::open(&shot).unwrap().to_rgb8();
    let colours: std::collections::HashSet<[u8; 3]> = picture.pixels().map(|p| p.0).collect();
    assert!(picture.width() == 1400 && colours.len() > 2000, "{} colours", colours.len());
}
