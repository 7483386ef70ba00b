use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use super::*;

fn photograph(name: &str) -> PlannedPhotograph {
    let mask = FileRecord { name: format!("masks/{name}.png"), sha256: "0f".repeat(32), bytes: 12 };
    PlannedPhotograph {
        name: name.to_owned(),
        file: Some(format!("images/{name}")),
        sha256: "ab".repeat(32),
        bytes: 1 << 40,
        share: 0.25,
        mask: Some(mask).filter(|_| name == "a.jpg"),
    }
}

fn block(id: &str, cell: [Option<f64>; 4], photographs: &[&str]) -> Block {
    Block {
        id: id.to_owned(),
        cell: cell.into(),
        margin: 0.5,
        photographs: photographs.iter().map(|name| photograph(name)).collect(),
        steps: 500,
        predicted_splats: 1 << 33,
        predicted_memory: 1 << 34,
        predicted_seconds: None,
    }
}

fn plan() -> PlanFile {
    let settings = Settings::default();
    PlanFile {
        format: FORMAT.to_owned(),
        version: VERSION,
        program: "0.1.0".to_owned(),
        dataset: DatasetRecord {
            path: "/data/flight".into(),
            model_sha256: "cd".repeat(32),
            photographs: 9,
            files: vec![FileRecord { name: "sparse/0/images.bin".into(), sha256: "ef".repeat(32), bytes: 77 }],
        },
        settings: settings.to_toml().unwrap(),
        seed: 7,
        ground: Ground {
            origin: [5e5, 4.6e6, 0.1 + 0.2],
            east: [1.0, 0.0, 0.0],
            north: [0.0, 1.0, 0.0],
            up: [0.0, 0.0, 1.0],
        },
        global: GlobalModel {
            photographs: vec!["a.jpg".into(), "deep/b.jpg".into()],
            max_side: 160,
            steps: 100,
            max_splats: 900,
        },
        blocks: vec![
            block("b00", [None, Some(1.5), None, None], &["a.jpg"]),
            block("b01", [Some(1.5), None, None, Some(-2.0)], &["a.jpg", "deep/b.jpg"]),
            block("b02", [Some(1.5), None, Some(-2.0), None], &["deep/b.jpg"]),
        ],
    }
}

/// The error of a plan that was changed as JSON.
fn refused(change: impl FnOnce(&mut Value)) -> String {
    let mut value = serde_json::to_value(plan()).unwrap();
    change(&mut value);
    let text = serde_json::to_string_pretty(&value).unwrap();
    PlanFile::parse(&text, Path::new("p/blocks.json")).expect_err("it was read").to_string()
}

#[test]
fn a_plan_comes_back_as_it_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(PLAN_FILE);
    let plan = plan();
    plan.write(&file).unwrap();
    assert_eq!(PlanFile::read(&file).unwrap(), plan);
    assert_eq!(plan.settings().unwrap(), Settings::default());
    let value: Value = serde_json::from_str(&fs::read_to_string(&file).unwrap()).unwrap();
    assert_eq!(value["blocks"][1]["cell"], json!([1.5, null, null, -2.0]));
    assert_eq!((&value["format"], &value["blocks"][0]["predicted_seconds"]), (&json!(FORMAT), &Value::Null));
    assert!(plan.block("b02").is_some() && plan.block("b03").is_none());
    let at = |x: f64, y: f64| plan.owner([5e5 + x, 4.6e6 + y, 99.0]);
    assert_eq!([at(0.0, 0.0), at(1.5, -2.5), at(1.5, -2.0), at(f64::NAN, 0.0)], [Some(0), Some(1), Some(2), None]);
}

#[test]
fn a_plan_cut_off_anywhere_is_an_error_with_a_remedy() {
    let text = serde_json::to_string_pretty(&plan()).unwrap();
    for length in (0..text.len()).filter(|length| text.is_char_boundary(*length)) {
        let error = PlanFile::parse(&text[..length], Path::new("p/blocks.json")).expect_err("it was read").to_string();
        assert!(error.contains("blocks.json") && error.contains("at line") && error.contains("plan anew"), "{error}");
    }
    assert!(PlanFile::parse(&format!("{text} x"), Path::new("x")).is_err(), "more than a plan");
}

#[test]
fn foreign_files_and_other_versions_are_told_apart() {
    for text in ["{}", "{\"format\": \"glTF\", \"version\": 2}", "[1, 2]", "7", "psrgs-vk blocks", ""] {
        assert!(PlanFile::parse(text, Path::new("blocks.json")).is_err(), "{text}");
    }
    assert!(refused(|plan| plan["format"] = json!("psrgs-vk block")).contains("no plan of blocks"));
    let error = refused(|plan| (plan["version"], plan["program"]) = (json!(2), json!("9.9.9")));
    assert!(error.contains("version") && error.contains("9.9.9") && error.contains("plan anew"), "{error}");
    // Another version may look altogether different.
    let later = "{\"format\": \"psrgs-vk blocks\", \"version\": 3, \"tiles\": []}";
    let error = PlanFile::parse(later, Path::new("blocks.json")).unwrap_err().to_string();
    assert!(error.contains("it is 3"), "{error}");
    assert!(refused(|plan| drop(plan.as_object_mut().unwrap().remove("version"))).contains("version"));
    assert!(refused(|plan| plan["surprise"] = json!(1)).contains("surprise"));
}

#[test]
fn names_that_lead_out_of_a_folder_are_refused() {
    let names =
        ["../a.jpg", "/etc/a.jpg", "", ".", "a/../../b", "a//b", "a\\..\\b", "C:\\a", "c:a", "a\u{0}b", "a\nb", "a/"];
    for name in names {
        assert!(!is_inside(name), "{name:?}");
        for error in [
            refused(|plan| plan["blocks"][1]["photographs"][1]["name"] = json!(name)),
            refused(|plan| plan["blocks"][1]["photographs"][1]["file"] = json!(name)),
            refused(|plan| plan["blocks"][0]["photographs"][0]["mask"]["name"] = json!(name)),
            refused(|plan| plan["global"]["photographs"][0] = json!(name)),
            refused(|plan| plan["dataset"]["files"][0]["name"] = json!(name)),
        ] {
            assert!(error.contains("leads out of its folder") && error.contains("at line"), "{name:?}: {error}");
        }
    }
    for name in ["a.jpg", "deep/b.jpg", "a b.jpg", "..a", "a..b", "\u{e9}.png", "x/.hidden", "2020-01-01T10:00.jpg"] {
        assert!(is_inside(name), "{name:?}");
    }
    for id in ["", "b", "b0", "00", "../b00", "b00/", "B00", "b0x", "b1234567"] {
        assert!(refused(|plan| plan["blocks"][2]["id"] = json!(id)).contains("no name of a block"), "{id}");
    }
    assert!(refused(|plan| plan["blocks"][2]["id"] = json!("b00")).contains("two blocks"));
}

#[test]
fn numbers_that_cannot_be_are_refused() {
    type Change = fn(&mut Value);
    let changes: [(Change, &str); 16] = [
        (|plan| plan["blocks"][0]["margin"] = json!(-0.1), "margin"),
        (|plan| plan["blocks"][0]["steps"] = json!(0), "steps"),
        (|plan| plan["blocks"][0]["steps"] = json!(1.5), "expected u32"),
        (|plan| plan["blocks"][0]["predicted_splats"] = json!(-1), "expected u64"),
        (|plan| plan["blocks"][0]["predicted_seconds"] = json!(-1.0), "predicted_seconds"),
        (|plan| plan["blocks"][1]["photographs"][0]["share"] = json!(1.01), "share"),
        (|plan| plan["blocks"][1]["photographs"][0]["sha256"] = json!("AB"), "SHA-256"),
        (|plan| plan["blocks"][1]["photographs"][1]["name"] = json!("a.jpg"), "twice"),
        (|plan| plan["dataset"]["model_sha256"] = json!("x".repeat(64)), "SHA-256"),
        (|plan| plan["blocks"] = json!([]), "there is none"),
        (|plan| plan["blocks"][0]["cell"] = json!([null, 1.4, null, null]), "belongs to no cell"),
        (|plan| plan["blocks"][0]["cell"] = json!([null, 1.6, null, null]), "overlap"),
        (|plan| plan["blocks"][1]["cell"] = json!([1.5, 1.5, null, -2.0]), "lower edge"),
        (|plan| plan["blocks"][1]["cell"] = json!([1.5, null, null]), "plan anew"),
        (|plan| plan["ground"]["up"] = json!([0, 0, -1]), "mirrored"),
        (|plan| plan["ground"]["east"] = json!([1, 0.1, 0]), "unit vectors"),
    ];
    for (change, words) in changes {
        let error = refused(change);
        assert!(error.contains(words) && error.contains("p/blocks.json"), "{words}: {error}");
    }
    assert!(refused(|plan| plan["settings"] = json!("[run]\nspeed = 9\n")).contains("speed"));
    assert!(refused(|plan| plan["global"]["max_side"] = json!(0)).contains("global"));
    let text = serde_json::to_string(&plan()).unwrap().replace("\"margin\":0.5", "\"margin\":1e999");
    assert!(PlanFile::parse(&text, Path::new("x")).is_err());
}

#[test]
fn a_plan_that_could_not_be_read_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(PLAN_FILE);
    plan().write(&file).unwrap();
    let before = fs::read(&file).unwrap();
    let mut broken = plan();
    broken.blocks[1].photographs[0].name = "../a.jpg".to_owned();
    let error = broken.write(&file).unwrap_err().to_string();
    assert!(error.contains("leads out of its folder"), "{error}");
    broken = plan();
    broken.blocks[0].margin = f64::NAN;
    assert!(broken.write(&file).is_err());
    assert_eq!(fs::read(&file).unwrap(), before);
}
