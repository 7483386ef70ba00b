//! Every crate of the build has a licence that `deny.toml` allows. This is the check of `cargo deny check licenses`,
//! for machines without cargo-deny, which takes longer to build than this project.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

/// Whether a licence expression (SPDX; also `/` for OR, as older crates have it) can be met with `allowed` licences
/// alone.
fn met(expression: &str, allowed: &BTreeSet<String>) -> Result<bool, String> {
    let text = expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ");
    let words: Vec<&str> = text.split_whitespace().collect();
    let mut at = 0;
    let outcome = any_of(&words, &mut at, allowed).and_then(|good| match words.get(at) {
        None => Ok(good),
        Some(word) => Err(format!("'{word}' is not expected")),
    });
    outcome.map_err(|why| format!("{expression}: {why}"))
}

fn any_of(words: &[&str], at: &mut usize, allowed: &BTreeSet<String>) -> Result<bool, String> {
    let mut good = all_of(words, at, allowed)?;
    while words.get(*at) == Some(&"OR") {
        *at += 1;
        good |= all_of(words, at, allowed)?;
    }
    Ok(good)
}

fn all_of(words: &[&str], at: &mut usize, allowed: &BTreeSet<String>) -> Result<bool, String> {
    let mut good = one(words, at, allowed)?;
    while words.get(*at) == Some(&"AND") {
        *at += 1;
        good &= one(words, at, allowed)?;
    }
    Ok(good)
}

fn one(words: &[&str], at: &mut usize, allowed: &BTreeSet<String>) -> Result<bool, String> {
    let word = *words.get(*at).ok_or("ends too early")?;
    *at += 1;
    match word {
        "(" => {
            let good = any_of(words, at, allowed)?;
            if words.get(*at) != Some(&")") {
                return Err("a parenthesis is not closed".into());
            }
            *at += 1;
            Ok(good)
        }
        ")" | "AND" | "OR" | "WITH" => Err(format!("'{word}' is not expected")),
        name => {
            let mut name = name.to_owned();
            if words.get(*at) == Some(&"WITH") {
                name = format!("{name} WITH {}", words.get(*at + 1).ok_or("ends too early")?);
                *at += 2;
            }
            Ok(allowed.contains(&name))
        }
    }
}

fn allowed() -> BTreeSet<String> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("deny.toml");
    let table: toml::Table = std::fs::read_to_string(file).unwrap().parse().unwrap();
    let list = table["licenses"]["allow"].as_array().unwrap();
    list.iter().map(|name| name.as_str().unwrap().to_owned()).collect()
}

#[test]
fn licence_expressions_are_understood() {
    let allowed = BTreeSet::from(["MIT", "Zlib", "Apache-2.0 WITH LLVM-exception"].map(str::to_owned));
    for (expression, want) in [
        ("MIT", true),
        ("GPL-3.0", false),
        ("GPL-3.0 OR MIT", true),
        ("Unlicense/MIT", true),
        ("MIT AND GPL-3.0", false),
        ("(MIT OR Apache-2.0) AND Zlib", true),
        ("(MIT OR Apache-2.0) AND Unicode-3.0", false),
        ("MIT AND GPL-3.0 OR Zlib", true),
        ("Apache-2.0 WITH LLVM-exception", true),
        ("Apache-2.0", false),
    ] {
        assert_eq!(met(expression, &allowed), Ok(want), "{expression}");
    }
    for broken in ["", "MIT OR", "(MIT", "MIT Zlib", "MIT)", "AND MIT", "MIT WITH"] {
        assert!(met(broken, &allowed).is_err(), "{broken}");
    }
}

#[test]
fn every_crate_has_an_allowed_licence() {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked", "--all-features", "--offline"])
        .args(["--filter-platform", "x86_64-unknown-linux-gnu"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    assert!(output.status.success(), "cargo metadata: {}", String::from_utf8_lossy(&output.stderr));
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let allowed = allowed();
    let packages = metadata["packages"].as_array().unwrap();
    let refused: Vec<String> = packages
        .iter()
        .filter_map(|package| {
            let (name, licence) = (&package["name"], package["license"].as_str().unwrap_or_default());
            match met(licence, &allowed) {
                Ok(true) => None,
                Ok(false) => Some(format!("{name}: {licence} is not in deny.toml")),
                Err(why) => Some(format!("{name}: {why}")),
            }
        })
        .collect();
    assert!(refused.is_empty(), "{refused:#?}");
    assert!(packages.len() > 50, "only {} crates are listed", packages.len());
}

/// The schema of 3D Tiles is as it was published.
#[test]
fn schema_files_have_the_hashes_of_their_readme() {
    use sha2::{Digest, Sha256};

    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/tiles-schema");
    let readme = std::fs::read_to_string(folder.join("README.md")).unwrap();
    let rows: Vec<&str> = readme.lines().filter_map(|line| line.strip_prefix("| `")).collect();
    assert_eq!(rows.len(), 24);
    for row in rows {
        let (name, rest) = row.split_once("` | `").unwrap();
        let bytes = std::fs::read(folder.join("files").join(name)).unwrap();
        let hash: String = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        assert!(rest.starts_with(&hash), "{name}: {hash}");
    }
    let credits = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/CREDITS.md");
    assert!(std::fs::read_to_string(credits).unwrap().contains("tools/tiles-schema"), "CREDITS names no schema");
}

/// The files of the viewer, which HTML files contain, are those of the npm package that their README names.
#[cfg(feature = "html-viewer")]
#[test]
fn viewer_files_have_the_hashes_of_the_npm_package() {
    use psrgs_supersplat_viewer as viewer;
    use sha2::{Digest, Sha256};

    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/supersplat-viewer");
    let readme = std::fs::read_to_string(folder.join("README.md")).unwrap();
    for (name, bytes) in [("index.js", viewer::js()), ("index.css", viewer::css()), ("index.html", viewer::html())] {
        let hash: String = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        assert!(readme.contains(&format!("| `{name}` | `{hash}` |")), "{name} of {} bytes: {hash}", bytes.len());
    }
    let script = String::from_utf8(viewer::js()).unwrap();
    assert!(script.contains(&format!("const version$1 = \"{}\";", viewer::ENGINE_VERSION)), "version of the engine");
    assert!(script.contains(&format!("var version = \"{}\";", viewer::VERSION)), "version of the viewer");
    for version in [viewer::VERSION, viewer::ENGINE_VERSION] {
        assert!(readme.contains(&format!("| {version} | MIT |")), "{version}");
    }
    let sha512 = readme.split("sha512-").nth(1).and_then(|rest| rest.split_whitespace().next()).unwrap();
    assert!(sha512.len() == 88 && sha512.ends_with("=="), "npm's integrity hash: {sha512}");
    for (name, licence) in viewer::LICENSES {
        assert!(licence.contains("Permission is hereby granted, free of charge"), "{name}: not the MIT licence");
    }
    let credits = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/CREDITS.md");
    let credits = std::fs::read_to_string(credits).unwrap();
    assert!(credits.contains("supersplat-viewer") && credits.contains("PlayCanvas"), "CREDITS names no viewer");
}
