//! Leaves out a few unusable records of a file, with a warning.

use crate::numbers::grouped;
use std::fmt;
use std::path::{Path, PathBuf};

/// At most 1 / `ONE_OF` of the records may be left out. A file with more bad records is damaged as a whole.
const ONE_OF: usize = 10;

/// The records left out of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeftOut {
    /// The file or folder.
    pub file: PathBuf,
    /// The kind of the records, in the plural.
    pub what: &'static str,
    /// Number of records left out.
    pub count: usize,
    /// Number of all records.
    pub of: usize,
    /// The first record left out.
    pub first: String,
    /// The problem of the first record.
    pub problem: String,
}

impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, what, count, of, first, problem } = self;
        let (are, one) = if *count == 1 { ("is", "") } else { ("are", "the first of them ") };
        write!(
            f,
            "{}: {} of {} {what} cannot be used and {are} left out, {one}{first}: {problem}",
            file.display(),
            grouped(*count),
            grouped(*of)
        )
    }
}

/// An error about one record.
pub(crate) trait OfRecord: fmt::Display {
    /// The error with an appended note on the number of bad records.
    fn with(self, more: String) -> Self;
}

/// Counts unusable records while a file is read.
pub(crate) struct Tally<E> {
    strict: bool,
    count: usize,
    first: Option<(String, E)>,
}

impl<E: OfRecord> Tally<E> {
    /// Counts records; where `strict` is set, the first bad record is an error.
    pub(crate) fn new(strict: bool) -> Self {
        Self { strict, count: 0, first: None }
    }

    /// Counts an unusable record.
    pub(crate) fn bad(&mut self, name: impl fmt::Display, error: E) -> Result<(), E> {
        if self.strict {
            return Err(error);
        }
        self.count += 1;
        if self.first.is_none() {
            self.first = Some((name.to_string(), error));
        }
        Ok(())
    }

    /// The record, or `None` after counting its error.
    pub(crate) fn take<T>(&mut self, name: impl fmt::Display, record: Result<T, E>) -> Result<Option<T>, E> {
        match record {
            Ok(record) => Ok(Some(record)),
            Err(error) => self.bad(name, error).map(|()| None),
        }
    }

    /// Number of records left out so far.
    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// The records left out besides `kept` good ones. Where they are more than one in ten, the first error.
    pub(crate) fn end(self, file: &Path, what: &'static str, kept: usize) -> Result<Option<LeftOut>, E> {
        let (count, of) = (self.count, self.count + kept);
        match self.first {
            Some((_, error)) if count * ONE_OF > of && count == 1 => Err(error),
            Some((_, error)) if count * ONE_OF > of => {
                let (count, of) = (grouped(count), grouped(of));
                Err(error.with(format!("; {count} of {of} {what} cannot be used, which is more than one of {ONE_OF}")))
            }
            _ => Ok(self.told(file, what, of)),
        }
    }

    /// The records left out of `of` records, regardless of their share.
    pub(crate) fn told(self, file: &Path, what: &'static str, of: usize) -> Option<LeftOut> {
        let (first, error) = self.first?;
        let said = error.to_string();
        // The warning names the file already.
        let problem = said.strip_prefix(&format!("{}: ", file.display())).unwrap_or(&said).to_owned();
        Some(LeftOut { file: file.to_owned(), what, count: self.count, of, first, problem })
    }
}

/// Whether so few of `of` records are missing that the rest can be used.
pub(crate) fn few(missing: u64, of: u64) -> bool {
    missing.saturating_mul(ONE_OF as u64) <= of
}

#[cfg(test)]
mod tests {
    use super::*;

    impl OfRecord for String {
        fn with(self, more: String) -> Self {
            self + &more
        }
    }

    #[test]
    fn a_tenth_may_be_left_out_and_more_is_an_error() {
        let file = Path::new("images.txt");
        let end = |bad: usize, kept: usize| {
            let mut tally = Tally::new(false);
            (0..bad).for_each(|k| tally.bad(format!("'{k}'"), format!("images.txt: {k} is wrong")).expect("counted"));
            tally.end(file, "images", kept)
        };
        assert_eq!(end(0, 0), Ok(None));
        let told = |bad, kept| end(bad, kept).expect("few").expect("some").to_string();
        assert_eq!(told(1, 9), "images.txt: 1 of 10 images cannot be used and is left out, '0': 0 is wrong");
        assert_eq!(
            told(2, 18),
            "images.txt: 2 of 20 images cannot be used and are left out, the first of them '0': 0 is wrong"
        );
        assert_eq!(end(1, 8), Err("images.txt: 0 is wrong".to_owned()));
        let many = "images.txt: 0 is wrong; 2 of 19 images cannot be used, which is more than one of 10";
        assert_eq!(end(2, 17), Err(many.to_owned()));
        assert_eq!(Tally::new(true).bad("'0'", "wrong".to_owned()), Err("wrong".to_owned()));
    }
}
