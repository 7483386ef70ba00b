//! The tests, options and tables that the documents name exist.

#[path = "common/skips.rs"]
mod skips;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use psrgs_vk::dataset::{Colourless, Format, NoColours, PoseFault, Renamed, Warning};

/// Names of the test functions under `folder`.
fn tests_under(folder: &Path, found: &mut Vec<String>) {
    let mut entries: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            tests_under(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            let text = fs::read_to_string(&path).unwrap();
            let mut lines = text.lines().map(str::trim);
            while let Some(line) = lines.next() {
                if line == "#[test]"
                    && let Some(name) = lines.find_map(|l| l.strip_prefix("fn "))
                {
                    found.push(name.split('(').next().unwrap_or(name).to_owned());
                }
            }
        }
    }
}

/// Names of all test functions.
fn tests() -> Vec<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    for folder in ["tests", "src"] {
        tests_under(&root.join(folder), &mut found);
    }
    found
}

#[test]
fn names_of_tests_have_at_most_60_letters() {
    let long: Vec<String> = tests().into_iter().filter(|name| name.len() > 60).collect();
    assert!(long.is_empty(), "longer than 60 letters: {long:#?}");
}

/// The number of numbered rows in a document's tables. Checks that the last column of each row names existing tests.
fn rows_with_tests(document: &str) -> usize {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let tests = tests();
    let cases = fs::read_to_string(root.join("tests/twins/main.rs")).unwrap();
    let document = fs::read_to_string(root.join(document)).unwrap();
    let rules = document.lines().filter(|line| {
        line.strip_prefix("| ").and_then(|rest| rest.split(' ').next()).is_some_and(|n| n.parse::<u32>().is_ok())
    });
    let mut count = 0;
    for rule in rules {
        count += 1;
        let guards = rule.trim_end_matches(['|', ' ']).rsplit(" | ").next().unwrap();
        let mut named = 0;
        for name in guards.split('`').skip(1).step_by(2) {
            // `twins::case` is a case of the twin tests, anything else the name of a test function.
            let known = match name.strip_prefix("twins::") {
                Some(case) => cases.lines().any(|line| line.trim().starts_with(&format!("{case}:"))),
                None => tests.iter().any(|test| test == name),
            };
            assert!(known, "no test is called {name}: {rule}");
            named += 1;
        }
        assert!(named > 0, "names no test: {rule}");
    }
    count
}

#[test]
fn every_portability_rule_names_its_test() {
    let count = rows_with_tests("docs/PORTABILITY.md");
    assert!(count >= 15, "{count} rules found");
}

#[test]
fn every_hard_case_and_promise_names_its_test() {
    let count = rows_with_tests("docs/ACCURACY.md");
    assert!(count >= 24 + 8, "{count} hard cases and promises found");
}

/// The part of a file between `ANCHOR: name` and `ANCHOR_END: name`, without common indentation.
fn anchored(text: &str, name: &str) -> Option<String> {
    let (begin, end) = (format!("// ANCHOR: {name}"), format!("// ANCHOR_END: {name}"));
    let mut lines = text.lines().skip_while(|line| line.trim() != begin).skip(1);
    let inside: Vec<&str> = lines.by_ref().take_while(|line| line.trim() != end).collect();
    let indent = inside.iter().filter(|l| !l.trim().is_empty()).map(|l| l.len() - l.trim_start().len()).min()?;
    Some(inside.iter().map(|line| line.get(indent..).unwrap_or("").to_owned() + "\n").collect())
}

#[test]
fn what_the_embedding_guide_quotes_is_in_the_examples() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let document = fs::read_to_string(root.join("docs/EMBEDDING.md")).unwrap();
    let mut quotes = 0;
    // The line before every block of code names its source: `<!-- file: anchor -->`.
    let lines: Vec<&str> = document.lines().collect();
    for (i, _) in lines.iter().enumerate().filter(|(_, line)| **line == "```rust") {
        let source = lines[i - 1].strip_prefix("<!-- ").and_then(|l| l.strip_suffix(" -->"));
        let (file, anchor) =
            source.and_then(|s| s.split_once(": ")).expect("a block of code does not say where it is from");
        let quoted: String =
            lines[i + 1..].iter().take_while(|line| **line != "```").map(|line| format!("{line}\n")).collect();
        let text = fs::read_to_string(root.join(file)).unwrap();
        let there = anchored(&text, anchor).unwrap_or_else(|| panic!("{file} has no {anchor}"));
        assert_eq!(quoted, there, "{file}: {anchor}");
        quotes += 1;
    }
    assert!(quotes >= 8, "{quotes} quotes");
    for example in ["examples/embed.rs", "examples/view_while_training.rs"] {
        assert!(document.contains(&format!("<!-- {example}: ")), "nothing of {example} is quoted");
    }
}

/// Whether a message matches a quote of the guide, in which `...` stands for any text.
fn is_quoted(message: &str, quote: &str) -> bool {
    let mut rest = message;
    quote.split("...").all(|part| match rest.find(part.trim()) {
        Some(at) => {
            rest = &rest[at + part.trim().len()..];
            true
        }
        None => false,
    })
}

#[test]
fn the_guide_says_what_each_warning_of_a_dataset_means() {
    use Warning::*;
    let all = [
        CamerasAtOnePlace { cameras: 3, extent: 2.5 },
        CameraFarAway { name: "a.jpg".into(), times: 1e6 },
        PoseWrong { name: "a.jpg".into(), fault: PoseFault::FarAndBlind { times: 12.0 }, left_out: true },
        PoseWrong { name: "a.jpg".into(), fault: PoseFault::OutOfView { points: 90, inside: 7 }, left_out: false },
        PoseWrong { name: "a.jpg".into(), fault: PoseFault::OtherPose { fit: 0.4, other: 0.8 }, left_out: true },
        PoseDoubtful { name: "a.jpg".into(), fault: PoseFault::Reprojection { points: 90, off: 0.01, usual: 0.0002 } },
        PosesAgainstPoints { file: "images.bin".into(), wrong: 9, of: 12 },
        AllMasked { photographs: 1, first: "a.jpg".into() },
        AllMasked { photographs: 3, first: "a.jpg".into() },
        MasksLeaveOutNothing { masks: 2, of: 9, first: "a.jpg".into() },
        MasksByTransparency { masks: 2, of: 9, first: "a.jpg".into() },
        BrighterThanWhite { photographs: 2, pixels: 70 },
        TransparentLeftOut { photographs: 2, pixels: 70 },
        SeveralFormats { used: Format::Colmap, others: vec![Format::Nerfstudio] },
        OtherParts { used: 9, parts: 2, shots: 3 },
        CoordinatesUnknown { file: "coords.txt".into(), problem: "no such file".to_owned() },
        OtherModels { used: "sparse/1".into(), images: 9, others: vec![("sparse/0".into(), 3)] },
        NoMaskMatches { folder: "masks".into() },
        NothingHeldOut { views: 1 },
        NoPoints { file: None },
        PointsWithoutColours(Colourless { file: "points3D.bin".into(), why: NoColours::OneColour([0; 3]) }),
        LeftOut(psrgs_vk::format::LeftOut {
            file: "images.bin".into(),
            what: "images",
            count: 2,
            of: 50,
            first: "'a.jpg'".to_owned(),
            problem: "qw is NaN".to_owned(),
        }),
        CountDiffers { file: "images.txt".into(), what: "images", announced: 9, found: 8 },
        SharedNumber { number: 7, images: 2 },
        UnknownObservers { file: "points3D.bin".into(), points: 3, point: 8, image: 9 },
        PhotographsWithoutPose { photographs: 4 },
        PhotographsWithoutPose { photographs: 1 },
        BrighterThanWhite { photographs: 1, pixels: 70 },
        TransparentLeftOut { photographs: 1, pixels: 70 },
        MasksLeaveOutNothing { masks: 1, of: 9, first: "a.jpg".into() },
        MasksByTransparency { masks: 1, of: 9, first: "a.jpg".into() },
        OtherPlaces { used: "sparse/0".into(), others: vec![".".into(), "a".into()] },
        OtherPlaces { used: "sparse/0".into(), others: vec![".".into()] },
        OtherNames { what: "photographs", of: 3, renamed: Renamed::default() },
        SplitLists { used: true, unknown: 1, first: Some("'a' of test_filenames".into()), in_none: 1, in_both: 1 },
        UnreadMasks { folder: "mask".into() },
    ];
    let guide = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/GUIDE.md")).unwrap();
    let rows = guide.lines().skip_while(|line| !line.starts_with("| message or sight")).skip(2);
    let cells: Vec<&str> = rows.filter_map(|line| line.strip_prefix("| ")?.split(" | ").next()).collect();
    let quotes: Vec<&str> = cells.iter().flat_map(|cell| cell.split('`').skip(1).step_by(2)).collect();
    assert!(quotes.len() > 20 && !quotes.iter().any(|quote| is_quoted("nothing of the kind", quote)));
    for warning in all {
        // A new kind of warning has to be added above.
        match &warning {
            MasksLeaveOutNothing { .. } | MasksByTransparency { .. } => {}
            CamerasAtOnePlace { .. } | AllMasked { .. } | BrighterThanWhite { .. } | SeveralFormats { .. } => {}
            OtherParts { .. }
            | CoordinatesUnknown { .. }
            | NoMaskMatches { .. }
            | NothingHeldOut { .. }
            | NoPoints { .. }
            | PointsWithoutColours(_) => {}
            PoseWrong { .. } | PoseDoubtful { .. } | PosesAgainstPoints { .. } => {}
            LeftOut(_) | CountDiffers { .. } | SharedNumber { .. } | UnknownObservers { .. } => {}
            OtherPlaces { .. } | OtherNames { .. } | SplitLists { .. } | UnreadMasks { .. } => {}
            PhotographsWithoutPose { .. } | CameraFarAway { .. } | OtherModels { .. } | TransparentLeftOut { .. } => {}
        }
        let message = warning.to_string();
        assert!(quotes.iter().any(|quote| is_quoted(&message, quote)), "the guide has no row for: {message}");
    }
}

/// The help text of a command, or of the program for an empty `command`.
fn help(command: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_psrgs-vk")).args(command).arg("--help").output().unwrap();
    assert!(output.status.success(), "{command:?}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn options_that_the_documents_name_exist() {
    let all = help(&[]);
    let commands: Vec<&str> = all
        .lines()
        .skip_while(|line| *line != "Commands:")
        .skip(1)
        .take_while(|line| line.starts_with("  "))
        .filter_map(|line| line.strip_prefix("  ")?.split(' ').next().filter(|name| !name.is_empty()))
        .collect();
    assert!(commands.len() >= 13 && commands.contains(&"train"), "{commands:?}");
    let parts = ["plan", "run", "merge", "status"].map(|part| help(&["blocks", part])).concat();
    let helps: String = commands.iter().filter(|name| **name != "help").map(|name| help(&[name])).collect();
    let helps = helps + &parts;
    // The name of an option, up to the first character that cannot be a part of it.
    let option = |text: &str| -> Option<String> {
        let name: String =
            text.chars().take_while(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || *c == '-').collect();
        name.starts_with(|c: char| c.is_ascii_lowercase()).then_some(name)
    };
    let names = |text: &str| -> Vec<String> { text.split("--").skip(1).filter_map(option).collect() };
    let known = names(&helps);
    let mut named = 0;
    for document in ["README.md", "docs/GUIDE.md", "docs/MAPS.md", "docs/LARGE.md", "docs/WORLD.md"] {
        let text = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(document)).unwrap();
        // Between backticks in the text; in blocks of code on lines that call this program.
        for (k, part) in text.split("```").enumerate() {
            let spans: Vec<&str> = if k % 2 == 0 {
                part.split('`').skip(1).step_by(2).filter(|span| !span.starts_with("cargo")).collect()
            } else {
                part.lines().filter(|line| line.contains("psrgs-vk ") && !line.starts_with("docker")).collect()
            };
            for name in spans.into_iter().flat_map(names) {
                named += 1;
                assert!(known.contains(&name), "{document}: no command has --{name}");
            }
        }
    }
    assert!(named > 150, "{named} options found in the documents");
    let readme = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md")).unwrap();
    for command in commands.iter().filter(|name| **name != "help") {
        assert!(readme.contains(&format!("| `{command}")), "README.md has no row for {command}");
    }
}

#[test]
fn options_are_those_of_the_program() {
    let output = Command::new(env!("CARGO_BIN_EXE_psrgs-vk")).arg("options").output().unwrap();
    assert!(output.status.success());
    let printed = String::from_utf8(output.stdout).unwrap();
    let kept = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/OPTIONS.md")).unwrap();
    let differs = printed.lines().zip(kept.lines()).find(|(printed, kept)| printed != kept);
    assert!(printed == kept, "write it anew with `psrgs-vk options > docs/OPTIONS.md`; first difference: {differs:?}");
}

/// Texts of all files under a folder whose names end with `ending`.
fn sources(folder: &Path, ending: &str, found: &mut Vec<(PathBuf, String)>) {
    for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if path.is_dir() {
            sources(&path, ending, found);
        } else if path.extension().is_some_and(|e| e == ending) {
            let text = fs::read_to_string(&path).unwrap();
            found.push((path, text));
        }
    }
}

/// Cargo hides the output of passing tests. Only `tests/common/skips.rs` prints past cargo, and can forbid skips.
#[test]
fn tests_that_cannot_run_say_so_where_it_is_heard() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    sources(&root.join("tests"), "rs", &mut found);
    let printed = ["println!(\"skip", "print!(\"skip", "println!(\"left out"];
    for (path, text) in found.iter().filter(|(path, _)| !path.ends_with("tests/documents.rs")) {
        assert!(!printed.iter().any(|words| text.contains(words)), "{} skips a test by itself", path.display());
    }
    let ci = fs::read_to_string(root.join(".ci/run")).unwrap();
    assert!(ci.contains("export PSRGS_REQUIRE_ALL="), "CI would pass without a driver");
}

#[test]
fn tables_of_the_results_page_are_those_of_the_kept_rows() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/bench/results");
    let Ok(checked) = Command::new("python3").arg(script).arg("check").output() else {
        skips::skipped("python3 is not there");
        return;
    };
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
}

/// The anchors of a document: headings as GitHub spells them, and `id="..."`.
fn anchors(text: &str) -> Vec<String> {
    let mut in_code = false;
    let mut found: Vec<String> =
        text.split("id=\"").skip(1).filter_map(|rest| rest.split_once('"').map(|(id, _)| id.to_owned())).collect();
    for line in text.lines() {
        in_code ^= line.starts_with("```");
        let heading = line.trim_start_matches('#');
        if in_code || heading.len() == line.len() || !heading.starts_with(' ') {
            continue;
        }
        // What stands in angle brackets is markup.
        let shown: String = heading.split('<').enumerate().fold(String::new(), |shown, (k, part)| {
            shown + if k == 0 { part } else { part.split_once('>').map_or(part, |(_, after)| after) }
        });
        let kept = shown.trim().to_lowercase().replace(' ', "-");
        found.push(kept.chars().filter(|c| c.is_alphanumeric() || *c == '-' || *c == '_').collect());
    }
    found
}

#[test]
fn links_between_documents_lead_to_files_and_headings() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut documents = vec![(root.join("README.md"), fs::read_to_string(root.join("README.md")).unwrap())];
    documents.push((root.join("CHANGELOG.md"), fs::read_to_string(root.join("CHANGELOG.md")).unwrap()));
    sources(&root.join("docs"), "md", &mut documents);
    let mut followed = 0;
    for (path, text) in &documents {
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            if link.contains("://") || link.starts_with("mailto:") {
                continue;
            }
            let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = if file.is_empty() { path.clone() } else { path.parent().unwrap().join(file) };
            assert!(target.exists(), "{}: no file at {link}", path.display());
            if !anchor.is_empty() && target.extension().is_some_and(|ending| ending == "md") {
                let there = anchors(&fs::read_to_string(&target).unwrap());
                assert!(there.iter().any(|name| name == anchor), "{}: no heading at {link}", path.display());
            }
            followed += 1;
        }
    }
    assert!(followed > 100, "{followed} links found in the documents");
}

/// The drivers are unpacked by `tools/bench/offline-gpu --fetch` into `target/offline-gpu`, or lie in
/// `$PSRGS_OFFLINE_GPU`.
#[test]
fn registers_are_those_that_the_compilers_tell() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = std::env::var_os("PSRGS_OFFLINE_GPU").map_or(root.join("target/offline-gpu"), PathBuf::from);
    let Ok(version) = fs::read_to_string(folder.join("version")) else {
        return skips::left_out(format!("no drivers in {} (tools/bench/offline-gpu --fetch)", folder.display()));
    };
    let document = fs::read_to_string(root.join("docs/PERFORMANCE.md")).unwrap();
    let after = document.split("### Registers, without a GPU").nth(1).expect("the section");
    let table = after.split("```").nth(1).expect("the table").strip_prefix("text\n").expect("plain text");
    let (first, rows) = table.split_once('\n').unwrap();
    if first.strip_prefix("Mesa ") != Some(version.trim()) {
        return skips::left_out(format!("the table is of {first}, the drivers are of {}", version.trim()));
    }
    let asked = Command::new(root.join("tools/bench/offline-gpu"))
        .arg("--folder")
        .arg(&folder)
        .env("PSRGS_VK", env!("CARGO_BIN_EXE_psrgs-vk"))
        .output()
        .unwrap();
    assert!(asked.status.success(), "{}", String::from_utf8_lossy(&asked.stderr));
    let told = String::from_utf8(asked.stdout).unwrap();
    let words = |line: &str| line.split_whitespace().collect::<Vec<_>>().join(" ");
    let told: Vec<String> = told.lines().map(words).collect();
    assert!(rows.lines().count() > 15, "{rows}");
    for row in rows.lines().map(words).filter(|row| !row.is_empty()) {
        assert!(told.contains(&row), "the compilers do not tell: {row}");
    }
}
