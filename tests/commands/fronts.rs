//! Settings compared by time and error.

use std::fs;

use serde_json::Value;

use crate::run::{fails, psrgs, shared, stderr, text};

fn setting<'a>(table: &'a Value, name: &str) -> &'a Value {
    let settings = table["settings"].as_array().expect("settings");
    settings.iter().find(|s| s["name"] == name).unwrap_or_else(|| panic!("{name} is not among {settings:?}"))
}

fn text_of<'a>(setting: &'a Value, key: &str) -> &'a str {
    setting[key].as_str().expect("a text")
}

#[test]
fn pictures_gradients_and_trainings_have_a_time_and_an_error() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("fronts");
    let (data, model) = (shared.data(), shared.model());
    let ends = ["bench", text(&data), "--pareto", text(&out), "--init", text(&model), "--train-steps", "60"];
    let output = psrgs(&[&ends[..], &["--max-side", "48", "--split", "val"]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    for title in ["## Trainings: 60 steps", "## Pictures: ", "## Gradients: "] {
        assert!(said.contains(title), "{said}");
    }
    let read = |name: &str| fs::read_to_string(out.join(name)).expect(name);
    assert_eq!(read("pareto.md").trim_end(), said.trim_end());
    let json: Value = serde_json::from_str(&read("pareto.json")).expect("JSON");
    let tables = json["tables"].as_array().expect("tables");
    assert_eq!(tables.len(), 3);
    for table in tables {
        let settings = table["settings"].as_array().expect("settings");
        assert!(settings.iter().all(|s| s["time"].as_f64().is_some_and(|t| t > 0.0)), "{table}");
        assert!(settings.iter().all(|s| s["error"].as_f64().is_some()), "{table}");
        assert!(settings.iter().any(|s| s["dominated"] == false), "{table}");
        assert_eq!(settings.iter().filter(|s| s["default"] == true).count(), 1, "{table}");
    }
    // A shortcut has an error, and the default has almost none.
    let error = |name: &str| setting(&tables[1], name)["error"].as_f64().expect("a number");
    assert!(error("default") < 2e-5, "{}", error("default"));
    assert!(error("spherical harmonics of 16 bits") >= error("default"));
    assert!(error("depths sorted by 12 bits") > 100.0 * error("default"));
    for s in tables[2]["settings"].as_array().expect("settings") {
        let name = text_of(s, "name");
        assert!(name.contains("tiles") || name == "default, again", "{s}");
        assert!(s["error"].as_f64().is_some_and(|e| e < 1e-3), "{s}");
    }

    let svg = read("pareto.svg");
    assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>") && svg.contains("default"));
    let page = read("pareto.html");
    assert!(page.contains("<svg") && page.contains("<table>") && !page.contains("src=\"http"));
}

#[test]
fn without_trainings_a_model_is_needed() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, out) = (shared.data(), folder.path().join("fronts"));
    let ends = ["bench", text(&data), "--pareto", text(&out), "--train-steps", "0", "--max-side", "48"];
    fails(&ends, 2, &["--train-steps", "--init"]);
    fails(&["bench", text(&data), "--train-steps", "10"], 2, &["--pareto"]);
}
