//! Errors of files.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use super::left_out::OfRecord;

/// A position in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum At {
    /// Bytes from the beginning.
    Byte(u64),
    /// Line number, from 1.
    Line(u64),
}

impl fmt::Display for At {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Byte(offset) => write!(f, "byte {offset}"),
            Self::Line(number) => write!(f, "line {number}"),
        }
    }
}

/// A file could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused.
    #[error("{}: cannot {action}: {source}", file.display())]
    Io {
        /// The file or folder.
        file: PathBuf,
        /// The action that failed ("read", "create the temporary file", ...).
        action: &'static str,
        /// The operating system's error.
        source: io::Error,
    },
    /// The content violates the format.
    #[error("{}: {field} at {at}: {problem}", file.display())]
    Malformed {
        /// The file.
        file: PathBuf,
        /// The field.
        field: String,
        /// Position where the field begins.
        at: At,
        /// The problem.
        problem: String,
    },
    /// A value cannot be written in this format.
    #[error("{}: cannot write {what}: {problem}", file.display())]
    Unwritable {
        /// The file.
        file: PathBuf,
        /// The content that cannot be written.
        what: &'static str,
        /// Why not.
        problem: String,
    },
    /// A checkpoint lacks a section.
    #[error("{}: there is no section '{section}'", file.display())]
    NoSection {
        /// The checkpoint.
        file: PathBuf,
        /// The missing section.
        section: String,
    },
    /// Checkpoints were found, but none can be read.
    #[error("{}: none of the checkpoints can be read: {problems}", folder.display())]
    NoValidCheckpoint {
        /// The folder that was searched.
        folder: PathBuf,
        /// The problem of each checkpoint.
        problems: String,
    },
}

impl Error {
    pub(crate) fn io(file: &Path, action: &'static str) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Io { file: file.to_owned(), action, source }
    }

    pub(crate) fn malformed(file: &Path, field: impl fmt::Display, at: At, problem: impl fmt::Display) -> Self {
        Self::Malformed { file: file.to_owned(), field: field.to_string(), at, problem: problem.to_string() }
    }
}

impl OfRecord for Error {
    fn with(self, more: String) -> Self {
        match self {
            Self::Malformed { file, field, at, problem } => {
                Self::Malformed { file, field, at, problem: problem + &more }
            }
            other => other,
        }
    }
}
