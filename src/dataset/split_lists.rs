//! `train_filenames`, `val_filenames` and `test_filenames` of a `transforms.json`:
//! nerfstudio's way to say what frames are for.

use std::collections::HashMap;

use super::Warning;
use super::model::Parts;
use super::names::Names;

/// Their keys, and what they say of a frame.
const LISTS: [(&str, Parts); 3] =
    [("train_filenames", Parts::TRAIN), ("val_filenames", Parts::VAL), ("test_filenames", Parts::TEST)];

/// The lists of a file, and its frames.
pub(super) struct SplitLists<'a> {
    /// Of all frames.
    pub(super) paths: Vec<&'a str>,
    /// In the order of [`LISTS`].
    pub(super) lists: [Option<&'a [String]>; 3],
}

impl SplitLists<'_> {
    /// The parts of each frame; `None` without lists, and (with a warning) where the lists leave nothing to train on.
    pub(super) fn parts(&self, warnings: &mut Vec<Warning>) -> Option<Vec<Parts>> {
        if self.lists.iter().all(|list| list.is_none_or(<[String]>::is_empty)) {
            return None;
        }
        let mut places: HashMap<&str, Vec<usize>> = HashMap::new();
        self.paths.iter().enumerate().for_each(|(at, path)| places.entry(path).or_default().push(at));
        let mut parts = vec![Parts::default(); self.paths.len()];
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
        // Where only the others are listed, the rest is to train on.
        if self.lists[0].is_none() {
            parts.iter_mut().filter(|part| **part == Parts::default()).for_each(|part| *part = Parts::TRAIN);
        }
        let count = |of: &dyn Fn(&Parts) -> bool| parts.iter().filter(|part| of(part)).count();
        let used = parts.iter().any(|part| part.train && !part.test);
        let in_none = count(&|part| *part == Parts::default());
        let in_both = count(&|part| part.train && (part.test || part.val));
        if unknown > 0 || in_none > 0 || in_both > 0 || !used {
            warnings.push(Warning::SplitLists { used, unknown, first, in_none, in_both });
        }
        used.then_some(parts)
    }
}
