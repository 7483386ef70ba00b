//! What a plan was made from: files by their length and SHA-256.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::format;

/// Bytes that are read at one time.
const PIECE: usize = 1 << 18;

/// A file as it was.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileRecord {
    /// Path inside the dataset's folder, with `/` between its parts.
    pub name: String,
    /// SHA-256 of the content, in lower-case hexadecimal digits.
    pub sha256: String,
    /// Length in bytes.
    pub bytes: u64,
}

/// SHA-256 in hexadecimal digits, and length of a file. Takes the memory of one piece of the file.
pub fn sha256_of(file: &Path) -> Result<(String, u64), format::Error> {
    let failed = |error: io::Error| format::Error::Io { file: file.to_owned(), action: "read", source: error };
    let mut opened = File::open(file).map_err(failed)?;
    let (mut hasher, mut bytes, mut piece) = (Sha256::new(), 0, vec![0; PIECE]);
    loop {
        let count = match opened.read(&mut piece) {
            Ok(0) => break,
            Ok(count) => count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => return Err(failed(error)),
        };
        hasher.update(&piece[..count]);
        bytes += count as u64;
    }
    Ok((hexadecimal(&hasher.finalize()), bytes))
}

/// SHA-256 of files together: of a line with hash and name for each, in the order of their names.
pub(super) fn sha256_of_all(files: &[FileRecord]) -> String {
    let mut lines: Vec<String> = files.iter().map(|file| format!("{}  {}\n", file.sha256, file.name)).collect();
    lines.sort_unstable();
    hexadecimal(&Sha256::digest(lines.concat()))
}

/// Whether a text is a SHA-256 in hexadecimal digits.
pub(super) fn is_sha256(text: &str) -> bool {
    text.len() == 64 && text.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'))
}

fn hexadecimal(bytes: &[u8]) -> String {
    let mut text = String::with_capacity(2 * bytes.len());
    for byte in bytes {
        // Writing to a String cannot fail.
        let _ = write!(text, "{byte:02x}");
    }
    text
}
