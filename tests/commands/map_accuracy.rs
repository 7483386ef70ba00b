//! The accuracy of a map: against the truth of a made-up world, against files of the user, and what is refused.

use std::fs;
use std::path::Path;

use crate::run::{fails, psrgs, shared, stderr, text};
use crate::viewing::json;

fn mapped(model: &Path, data: &Path, out: &Path, more: &[&str]) -> String {
    let args = ["map", text(model), "--cameras", text(data), "--gsd", "1", "--out", text(out)];
    let output = psrgs(&[&args[..], more].concat());
    let said = stderr(&output);
    assert!(output.status.success(), "{said}");
    said
}

#[test]
fn a_map_of_a_world_tells_its_accuracy() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (model, data, out) = (shared.model(), shared.data(), folder.path().join("map"));
    let said = mapped(&model, &data, &out, &["--check-stereo", "--dtm"]);
    let told = json(&out.join("accuracy.json"));
    assert!(said.contains("accuracy against the made-up world itself") && said.contains("stereo: "), "{said}");
    assert_eq!(told["gsd"], 1.0);
    let number = |at: &str| told.pointer(at).and_then(|v| v.as_f64()).unwrap_or_else(|| panic!("no {at}: {told}"));
    assert!(number("/compared") > 0.3, "{told}");
    for of in ["map", "stereo"] {
        let of = |at: &str| number(&format!("/{of}{at}"));
        assert!(of("/vertical/count") > 20.0 && of("/vertical/rmse") > 0.0, "{told}");
        assert!((0.0..=1.0).contains(&of("/completeness/complete")), "{told}");
        assert!(of("/whole/tilt_degrees") < 90.0, "{told}");
    }
    let of = |at: &str| number(&format!("/terrain/{at}"));
    assert_eq!(of("vertical/count"), of("open/count") + of("covered/count"), "{told}");
    assert!(of("vertical/count") > number("/map/vertical/count") && of("covered/rmse") > 0.0, "{told}");
    assert!((0.0..=1.0).contains(&of("completeness/complete")), "{told}");
    assert!(said.contains("terrain: vertical, covered: RMSE") && said.contains("terrain: complete"), "{said}");
    let common = told["on_common_cells"].as_array().expect("both");
    assert_eq!(common[0]["count"], common[1]["count"]);

    // The true surface model beside the dataset says the same of the same map, but for kinds and interpolation.
    let truth = data.join("truth/dsm.tif");
    let again = folder.path().join("again");
    mapped(&model, &data, &again, &["--check", text(&truth)]);
    let other = json(&again.join("accuracy.json"));
    assert!(other["reference"].as_str().is_some_and(|name| name.ends_with("dsm.tif")) && other["stereo"].is_null());
    assert!(other["terrain"].is_null(), "no terrain was made");
    let medians =
        [&told, &other].map(|t| t.pointer("/map/vertical/median").and_then(|v| v.as_f64()).expect("a number"));
    assert!((medians[0] - medians[1]).abs() < 1.0, "{medians:?}");

    // Control points of the world as check points, and its true ground.
    let bare = folder.path().join("bare");
    mapped(&model, &data, &bare, &["--dtm", "--check", text(&data.join("truth/dtm.tif"))]);
    let other = json(&bare.join("accuracy.json"));
    let off = |told: &serde_json::Value| told.pointer("/terrain/vertical/rmse").and_then(|v| v.as_f64());
    let (off, known) = (off(&other).expect("a number"), off(&told).expect("a number"));
    assert!((off - known).abs() < 0.2 * known, "{off} {known}");
    let points = data.join("gcp_list.txt");
    let third = folder.path().join("third");
    let said = mapped(&model, &data, &third, &["--dtm", "--check", text(&points)]);
    let found = json(&third.join("accuracy.json"));
    let names = found["names"].as_array().expect("names").len();
    assert!(names > 2 && found["points"]["each"].as_array().map(Vec::len) == Some(names), "{found}");
    assert!(said.contains("accuracy at") && said.contains("terrain at") && said.contains("check points of"), "{said}");
    assert_eq!(found["terrain"]["each"].as_array().map(Vec::len), Some(names), "{found}");

    // Check points all over the site: below what stands on the ground, surface and terrain are not the same.
    let bounds = &json(&third.join("map.json"))["bounds"];
    let [west, north] = ["west", "north"].map(|side| bounds[side].as_f64().expect("a bound"));
    let at = |k: u32| (west + 4.5 + f64::from(4 * (k % 18)), north - 4.5 - f64::from(4 * (k / 18)));
    let rows: String = (0..18 * 18).map(at).map(|(east, north)| format!("{east},{north},740\n")).collect();
    let many = folder.path().join("many.csv");
    fs::write(&many, rows).expect("written");
    let fourth = folder.path().join("fourth");
    mapped(&model, &data, &fourth, &["--dtm", "--check", text(&many)]);
    let found = json(&fourth.join("accuracy.json"));
    assert!(found["points"]["vertical"]["count"].as_u64() > Some(20), "{}", found["points"]["vertical"]);
    assert!(found["points"]["each"] != found["terrain"]["each"], "the terrain is the surface");
}

#[test]
fn check_files_that_do_not_suit_are_refused_before_the_map() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (model, data, out) = (shared.model(), shared.data(), folder.path().join("map"));
    let refused = |file: &Path, code: i32, words: &[&str], more: &[&str]| {
        let args = ["map", text(&model), "--cameras", text(&data), "--out", text(&out), "--check", text(file)];
        fails(&[&args[..], more].concat(), code, words);
        assert!(!out.join("dsm.tif").exists(), "a map was made first");
    };
    let file = |name: &str, content: &str| {
        let file = folder.path().join(name);
        fs::write(&file, content).expect("written");
        file
    };
    refused(&file("a.tif", "no picture"), 3, &["a.tif", "GeoTIFF"], &[]);
    refused(&file("a.csv", "a,1,2,3\nb,1,2\n"), 3, &["a.csv", "line 2"], &[]);
    refused(&file("a.laz", "no points"), 3, &["a.laz"], &[]);
    refused(&file("a.xyz", "1 2 3"), 2, &["a.xyz", ".tif"], &[]);
    refused(&folder.path().join("none.csv"), 3, &["none.csv"], &[]);
    let truth = data.join("truth/dsm.tif");
    refused(&truth, 3, &["EPSG:32632", "EPSG:25833", "--crs"], &["--crs", "EPSG:25833"]);
}
