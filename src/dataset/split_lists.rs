//! `train_filenames`, `val_filenames` and `test_filenames` of a `transforms.json`: nerfstudio's assignment of frames to
//! parts.

use std::collections::HashMap;

use super::Warning;
use super::model::SplitParts;
use super::names::Names;

/// The keys, and the part of each.
const LISTS: [(&str, SplitParts); 3] =
    [("train_filenames", SplitParts::TRAIN), ("val_filenames", SplitParts::VAL), ("test_filenames", SplitParts::TEST)];

/// The lists and the frames of a file.
pub(super) struct SplitLists<'a> {
    /// Paths of all frames.
    pub(super) paths: Vec<&'a str>,
    /// The lists in the order of [`LISTS`].
    pub(super) lists: [Option<&'a [String]>; 3],
}

impl SplitLists<'_> {
    /// The part of each frame. `None` without lists, and (with a warning) if the lists leave nothing for training.
    pub(super) fn parts(&self, warnings: &mut Vec<Warning>) -> Option<Vec<SplitParts>> {
        if self.lists.iter().all(|list| list.is_none_or(<[String]>::is_empty)) {
            return None;
        }
        let mut places: HashMap<&str, Vec<usize>> = HashMap::new();
        self.paths.iter().enumerate().for_each(|(at, path)| places.entry(path).or_default().push(at));
        let mut parts = vec![SplitParts::default(); self.paths.len()];
        let (mut unknown, mut first) = (0, None);
        for (list, (key, part)) in self.lists.iter().zip(LISTS) {
            let names = list.unwrap_or_default();
            for (name, found) in names.iter().zip(Names::among(&self.paths, names)) {
                match found.file().and_then(|file| places.get(file)) {
                    Some(frames) => frames.iter().for_each(|at| parts[*at] = parts[*at].and(part)),
                    None => {
                        unknown += 1;
                        first = first.or_else(|| Some(format!("'{name}' of {key}")));
                    }
                }
            }
        }
        // If only the other parts are listed, all further frames are for training.
        if self.lists[0].is_none() {
            parts.iter_mut().filter(|part| **part == SplitParts::default()).for_each(|part| *part = SplitParts::TRAIN);
        }
        let count = |of: &dyn Fn(&SplitParts) -> bool| parts.iter().filter(|part| of(part)).count();
        let used = parts.iter().any(|part| part.train && !part.test);
        let in_none = count(&|part| *part == SplitParts::default());
        let in_both = count(&|part| part.train && (part.test || part.val));
        if unknown > 0 || in_none > 0 || in_both > 0 || !used {
            warnings.push(Warning::SplitLists { used, unknown, first, in_none, in_both });
        }
        used.then_some(parts)
    }
}
