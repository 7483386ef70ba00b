//! Compares the settings beside a model with those of its scoring.

use std::path::Path;

use psrgs_vk::train::Settings;
use psrgs_vk::train::settings::Photographs;

use super::run_folder::SETTINGS;

/// The differences between the settings beside a model and those of its scoring, a line each. `longest` is the longest
/// side of a scored photograph on disk; `None` where another rule than `--max-side` gives the size. A model without
/// readable settings beside it comes from another program: it has no known differences.
pub(crate) fn differences(
    model: &Path,
    scored: &Photographs,
    background: [f32; 3],
    longest: Option<u32>,
) -> Vec<String> {
    let Ok(trained) = Settings::read(&model.with_file_name(SETTINGS)) else { return Vec::new() };
    let photographs = &trained.photographs;
    let mut out = Vec::new();
    if photographs.split != scored.split {
        out.push(format!(
            "the model was trained with --split {}, and is scored with --split {}: it has seen photographs that are \
             scored here",
            photographs.split, scored.split
        ));
    }
    if longest.is_some_and(|side| photographs.max_side.min(side) != scored.max_side.min(side)) {
        out.push(format!(
            "the model was trained with --max-side {}, and is scored with --max-side {}",
            photographs.max_side, scored.max_side
        ));
    }
    if photographs.transparent != scored.transparent {
        out.push(format!(
            "the model was trained with --transparent {}, and is scored with --transparent {}",
            photographs.transparent, scored.transparent
        ));
    }
    if trained.model.background.evaluated() != background {
        out.push(format!(
            "the model was trained with --background {}, and is scored with another",
            trained.model.background
        ));
    }
    out
}

#[cfg(test)]
mod tests {
    use psrgs_vk::train::settings::{Background, Split, Transparent};

    use super::*;

    #[test]
    fn what_differs_from_the_training_is_told() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let model = folder.path().join("point_cloud.ply");
        let mut trained = Settings::default();
        let scored = Photographs::default();
        let told = |longest| differences(&model, &scored, [0.0; 3], longest).join("\n");
        assert_eq!(told(Some(100)), "", "no settings beside it");
        let write = |settings: &Settings| {
            std::fs::write(folder.path().join(SETTINGS), settings.to_toml().expect("text")).expect("written");
        };
        write(&trained);
        assert_eq!(told(Some(100)), "");
        trained.photographs.split = Split::Val;
        trained.photographs.max_side = 64;
        trained.photographs.transparent = Transparent::Background;
        trained.model.background = Background::White;
        write(&trained);
        let said = told(Some(65));
        for words in ["--split val", "--max-side 64", "--transparent background", "--background white"] {
            assert!(said.contains(words), "{words}: {said}");
        }
        assert!(!told(None).contains("--max-side"));
        assert!(!told(Some(64)).contains("--max-side"), "neither reduces anything");
    }
}
