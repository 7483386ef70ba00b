//! Where a dataset lies on a map: what `check` tells, what a training keeps, and what exports pass on.

use std::fs;
use std::path::Path;

use psrgs_vk::scene::Similarity;
use serde_json::Value;

use crate::run::{fails, psrgs, shared, stderr, text, works};
use crate::viewing::json;

fn checked(data: &Path, more: &[&str]) -> (Option<i32>, Value, String) {
    let args = ["check", text(data), "--json", "--max-side", "32", "--iterations", "20"];
    let output = psrgs(&[&args[..], more].concat());
    let found = serde_json::from_slice(&output.stdout).unwrap_or_default();
    (output.status.code(), found, stderr(&output))
}

#[test]
fn check_tells_the_system_and_the_residuals() {
    let Some(shared) = shared() else { return };
    let data = shared.data();
    let (_, by_gps, said) = checked(&data, &[]);
    assert_eq!((&by_gps["map"]["epsg"], &by_gps["map"]["known_from"]), (&32_632.into(), &"gps".into()), "{said}");
    assert_eq!(by_gps["fit"]["residuals"].as_array().map(Vec::len), Some(9), "{by_gps}");
    let list = data.join("gcp_list.txt");
    let more = ["--gcp", text(&list), "--crs", "EPSG:25833", "--heights", "EPSG:5783"];
    let (_, by_points, said) = checked(&data, &more);
    let map = &by_points["map"];
    assert_eq!((&map["epsg"], &map["known_from"]), (&25_833.into(), &"control-points".into()), "{said}");
    assert_eq!(map["heights"], "EPSG:5783");
    let output = psrgs(&["check", text(&data), "--gcp", text(&list), "--max-side", "32"]);
    let told = String::from_utf8_lossy(&output.stdout).into_owned();
    for words in ["WGS 84 / UTM zone 32N (EPSG:32632), heights above: ellipsoid of WGS 84", "RMSE", "gcp01: ", "m east"]
    {
        assert!(told.contains(words), "no `{words}`: {told}");
    }
}

#[test]
fn check_lists_a_wrong_control_point_as_a_problem() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let list = folder.path().join("list.txt");
    let lines = fs::read_to_string(shared.data().join("gcp_list.txt")).expect("control points");
    let moved = lines.lines().map(|line| match (line.rsplit_once(' '), line.split_once(' ')) {
        (Some((_, "gcp03")), Some((east, rest))) => {
            format!("{} {rest}\n", east.parse::<f64>().expect("a number") + 30.0)
        }
        _ => format!("{line}\n"),
    });
    fs::write(&list, moved.collect::<String>()).expect("written");
    let (code, found, said) = checked(&shared.data(), &["--gcp", text(&list)]);
    assert_eq!(code, Some(7), "{said}");
    let problems = found["problems"].to_string();
    assert!(problems.contains("left out as wrong: gcp03 (") && problems.contains("m off)"), "{problems}");
}

#[test]
fn wrong_places_are_refused_with_a_remedy() {
    let Some(shared) = shared() else { return };
    let (data, folder) = (shared.data(), tempfile::tempdir().expect("a temporary folder"));
    let list = folder.path().join("list.txt");
    fs::write(&list, "EPSG:32632\n1 2 3 x 5 a.jpg\n").expect("written");
    let check = ["check", text(&data)];
    let with = |more: &[&'static str]| [&check[..], more].concat();
    fails(&with(&["--crs", "EPSG:4326"]), 2, &["--crs", "in degrees", "UTM"]);
    fails(&with(&["--crs", "EPSG:2263"]), 2, &["--crs", "other units"]);
    fails(&with(&["--crs", "EPSG:25832+5783"]), 2, &["name the horizontal part alone"]);
    fails(
        &with(&["--crs", "+proj=utm +zone=32 +datum=WGS84 +geoidgrids=g.gtx"]),
        2,
        &["a geoid", "leave the word out"],
    );
    fails(&with(&["--crs", "EPSG:32617"]), 3, &["UTM zone 17N", "such as WGS 84 / UTM zone 32N (EPSG:32632)"]);
    fails(&[&check[..], &["--gcp", text(&list)]].concat(), 3, &["list.txt", "pixel x at line 2", "'x' is no number"]);
    fails(&with(&["--gcp", "nowhere.txt"]), 3, &["nowhere.txt", "cannot read"]);
}

fn similarity(rows: &Value) -> Similarity {
    let rows: [[f64; 4]; 4] = serde_json::from_value(rows.clone()).expect("a matrix");
    Similarity::from_rows(&[rows[0], rows[1], rows[2]]).expect("a similarity")
}

#[test]
fn exports_lead_to_the_map_that_the_training_kept() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (model, data) = (shared.model(), shared.data());
    let frame = json(&shared.run().join("frame.json"));
    let map = &frame["map"];
    assert_eq!((&map["epsg"], &map["known_from"]), (&32_632.into(), &"gps".into()), "{frame}");
    assert!(map["proj"].as_str().is_some_and(|proj| proj.contains("+zone=32")));
    let to_map = similarity(&map["dataset_to_map"]);
    let at = to_map.point([0.0; 3]);
    assert!(
        (4e5..7e5).contains(&at[0]) && (5.2e6..5.4e6).contains(&at[1]) && (600.0..900.0).contains(&at[2]),
        "{at:?}"
    );
    let score = |file: &Path| {
        let scores = folder.path().join("scores.json");
        works(&["eval", text(file), text(&data), "--json", text(&scores)]);
        json(&scores)["psnr"].as_f64().expect("a number")
    };
    let own = score(&model);
    let plain = folder.path().join("plain.ply");
    let turned = folder.path().join("turned.ply");
    let again = folder.path().join("again.splat");
    let said = works(&["export", text(&model), "--out", text(&plain)]);
    assert!(said.contains("with the matrix to WGS 84 / UTM zone 32N (EPSG:32632)"), "{said}");
    works(&["export", text(&plain), "--out", text(&turned), "--center", "--up", "z"]);
    works(&["export", text(&turned), "--out", text(&again)]);
    for (file, is_turned) in [(&plain, false), (&turned, true)] {
        let mut name = file.file_name().expect("a name").to_owned();
        name.push(".frame.json");
        let told = json(&file.with_file_name(name));
        assert_eq!(told["map"], *map);
        // The first splat, by the numbers in each file.
        let first = |file: &Path| {
            let means = psrgs_vk::format::ply::read(file).expect("a model").gaussians.means;
            [f64::from(means[0]), f64::from(means[1]), f64::from(means[2])]
        };
        let (got, want) = (similarity(&told["file_to_map"]).point(first(file)), to_map.point(first(&model)));
        assert!((0..3).all(|k| (got[k] - want[k]).abs() < 1e-3), "{got:?} {want:?}");
        assert_eq!(first(file) == first(&model), !is_turned);
        assert!((score(file) - own).abs() < 0.02, "{}: {} {own}", file.display(), score(file));
    }
    assert_eq!(json(&folder.path().join("again.splat.frame.json"))["map"], *map);
}

/// Pages with and without a dataset's cameras hold a SOG file in coordinates of their own.
#[cfg(feature = "html-viewer")]
#[test]
fn html_pages_say_where_their_model_lies_on_the_map() {
    use base64::prelude::{BASE64_STANDARD, Engine};
    use psrgs_vk::format::{ply, splats::sog};

    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (model, data) = (shared.model(), shared.data());
    let map = &json(&shared.run().join("frame.json"))["map"];
    let middle = |means: &[f32], way: &Similarity| {
        let mut sum = [0.0; 3];
        for mean in means.chunks_exact(3) {
            let at = way.point([0, 1, 2].map(|k| f64::from(mean[k])));
            (0..3).for_each(|k| sum[k] += at[k]);
        }
        sum.map(|v| 3.0 * v / means.len() as f64)
    };
    let want = middle(&ply::read(&model).expect("a model").gaussians.means, &similarity(&map["dataset_to_map"]));
    for (name, more) in [("seen.html", &["--cameras", text(&data)][..]), ("alone.html", &["--up", "z"])] {
        let page = folder.path().join(name);
        let said = works(&[&["export", text(&model), "--out", text(&page)], more].concat());
        assert!(said.contains("with the matrix to WGS 84 / UTM zone 32N (EPSG:32632)"), "{said}");
        let told = json(&folder.path().join(format!("{name}.frame.json")));
        assert_eq!(told["map"], *map);
        let html = fs::read_to_string(&page).expect("a page");
        let packed = html.split("id=\"model\">").nth(1).and_then(|rest| rest.split('<').next()).expect("a model");
        let packed = BASE64_STANDARD.decode(packed).expect("base64");
        let means = sog::decode(Path::new(name), &packed, true).expect("a SOG").gaussians.means;
        let got = middle(&means, &similarity(&told["file_to_map"]));
        // SOG rounds positions; the roundings of many splats are even.
        assert!((0..3).all(|k| (got[k] - want[k]).abs() < 0.05), "{name}: {got:?} {want:?}");
    }
    // A model without a place on a map leaves nothing of an older page's place beside the page.
    let plain = folder.path().join("plain.ply");
    fs::copy(&model, &plain).expect("copied");
    let page = folder.path().join("seen.html");
    works(&["export", text(&plain), "--out", text(&page)]);
    assert!(!folder.path().join("seen.html.frame.json").exists());
}
