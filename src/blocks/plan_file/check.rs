//! What a plan must be like, beyond its syntax.

use std::collections::BTreeSet;

use super::{Block, DatasetRecord, FORMAT, PlanFile, PlannedPhotograph, VERSION};
use crate::blocks::FileRecord;
use crate::blocks::cell::no_partition;
use crate::blocks::hash::is_sha256;

/// Most bytes of a name.
const LONGEST_NAME: usize = 4096;
/// Most digits of a block's number.
const DIGITS: usize = 6;

/// The first problem of a plan.
pub(super) struct Problem {
    pub(super) field: String,
    pub(super) what: String,
    /// A text of the file near the problem.
    pub(super) near: String,
}

fn found(field: impl Into<String>, what: impl Into<String>, near: impl Into<String>) -> Option<Problem> {
    Some(Problem { field: field.into(), what: what.into(), near: near.into() })
}

/// Whether a name with `/` or `\` between its parts stays inside the folder that it is joined to, on every system.
pub fn is_inside(name: &str) -> bool {
    let drive = name.as_bytes().get(1) == Some(&b':');
    let parts = || name.split(['/', '\\']);
    !drive
        && (1..=LONGEST_NAME).contains(&name.len())
        && !name.contains(|c: char| c.is_control())
        && parts().all(|part| !matches!(part, "" | "." | ".."))
}

/// Whether a text is the name of a block: `b` and digits.
fn is_id(id: &str) -> bool {
    let digits = id.strip_prefix('b').unwrap_or_default();
    (2..=DIGITS).contains(&digits.len()) && digits.bytes().all(|b| b.is_ascii_digit())
}

impl PlanFile {
    pub(super) fn problem(&self) -> Option<Problem> {
        if self.format != FORMAT || self.version != VERSION {
            return found("format", format!("it is not '{FORMAT}' of version {VERSION}"), "\"format\"");
        }
        if let Some(problem) = of_dataset(&self.dataset) {
            return Some(problem);
        }
        if let Err(problem) = self.settings() {
            return found("settings", problem.to_string(), "\"settings\"");
        }
        if let Some(problem) = self.ground.problem() {
            return found("ground", problem, "\"ground\"");
        }
        self.of_global().or_else(|| self.of_blocks())
    }

    fn of_global(&self) -> Option<Problem> {
        let global = &self.global;
        if global.max_side == 0 || global.steps == 0 || global.max_splats == 0 {
            return found("global", "max_side, steps and max_splats must be at least 1", "\"global\"");
        }
        names("global", global.photographs.iter().map(String::as_str))
    }

    fn of_blocks(&self) -> Option<Problem> {
        if self.blocks.is_empty() {
            return found("blocks", "there is none", "\"blocks\"");
        }
        let mut ids = BTreeSet::new();
        for block in &self.blocks {
            if !is_id(&block.id) {
                let near = format!("\"id\": {:?}", block.id);
                return found("blocks", format!("'{}' is no name of a block such as b00", block.id), near);
            }
            if !ids.insert(block.id.as_str()) {
                return found(block.id.as_str(), "two blocks have this name", format!("\"{}\"", block.id));
            }
            if let Some(problem) = of_block(block) {
                return Some(problem);
            }
        }
        let cells: Vec<_> = self.blocks.iter().map(|block| block.cell).collect();
        no_partition(&cells).and_then(|problem| found("cells of the blocks", problem, "\"blocks\""))
    }
}

fn of_dataset(dataset: &DatasetRecord) -> Option<Problem> {
    if !is_sha256(&dataset.model_sha256) {
        return found("model_sha256", "it is no SHA-256 of 64 hexadecimal digits", "\"model_sha256\"");
    }
    dataset.files.iter().find_map(|file| of_file("files of the dataset", file))
}

fn of_file(field: &str, file: &FileRecord) -> Option<Problem> {
    let near = format!("{:?}", file.name);
    if !is_inside(&file.name) {
        return found(field, format!("'{}' leads out of its folder", file.name.escape_debug()), near);
    }
    let what = format!("'{}': its sha256 is no SHA-256 of 64 hexadecimal digits", file.name);
    if is_sha256(&file.sha256) { None } else { found(field, what, near) }
}

fn of_block(block: &Block) -> Option<Problem> {
    let near = format!("\"{}\"", block.id);
    let of = |what: &str| found(block.id.as_str(), what, near.as_str());
    if let Some(problem) = block.cell.problem() {
        return of(&format!("cell: {problem}"));
    }
    if !(block.margin.is_finite() && block.margin >= 0.0) {
        return of("margin: it must be a number from 0 on");
    }
    if block.steps == 0 {
        return of("steps: there must be at least one");
    }
    if block.predicted_seconds.is_some_and(|seconds| !(seconds.is_finite() && seconds >= 0.0)) {
        return of("predicted_seconds: it must be a number from 0 on, or null");
    }
    let problem = block.photographs.iter().find_map(|photograph| of_photograph(&block.id, photograph));
    problem.or_else(|| names(&block.id, block.photographs.iter().map(|photograph| photograph.name.as_str())))
}

fn of_photograph(block: &str, photograph: &PlannedPhotograph) -> Option<Problem> {
    let PlannedPhotograph { name, file, sha256, share, mask, .. } = photograph;
    let field = format!("photographs of {block}");
    let near = format!("{name:?}");
    if let Some(file) = file.as_ref().filter(|file| !is_inside(file)) {
        let what = format!("'{}' leads out of its folder", file.escape_debug());
        return found(field, what, format!("{file:?}"));
    }
    if !is_sha256(sha256) {
        return found(field, format!("'{name}': its sha256 is no SHA-256 of 64 hexadecimal digits"), near);
    }
    if !(0.0..=1.0).contains(share) {
        return found(field, format!("'{name}': its share must be from 0 to 1"), near);
    }
    mask.as_ref().and_then(|mask| of_file(&field, mask))
}

/// A name that leads out of its folder, or that is there twice.
fn names<'a>(of: &str, names: impl Iterator<Item = &'a str>) -> Option<Problem> {
    let mut seen = BTreeSet::new();
    for name in names {
        let (field, near) = (format!("photographs of {of}"), format!("{name:?}"));
        if !is_inside(name) {
            return found(field, format!("'{}' leads out of its folder", name.escape_debug()), near);
        }
        if !seen.insert(name) {
            return found(field, format!("'{name}' is there twice"), near);
        }
    }
    None
}
