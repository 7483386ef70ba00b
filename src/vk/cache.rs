//! The pipeline cache on disk: the driver's data after a header with length and checksum.
//!
//! A driver may crash on damaged cache data, so data with a wrong length or checksum are dropped. The driver checks by
//! its own header whether the content fits. The file is named after the driver's cache identifier.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::error::{Error, Result};

const MAGIC: &[u8; 8] = b"psrgsvk1";
const HEADER: usize = 8 + 8 + 4;

/// The file for a driver in the cache folder.
pub(super) fn file(folder: &Path, identifier: [u8; 16]) -> PathBuf {
    let hex: String = identifier.iter().map(|byte| format!("{byte:02x}")).collect();
    folder.join(format!("pipelines-{hex}.bin"))
}

/// The driver's data; empty when the file is missing or damaged, because the cache can always be rebuilt.
pub(super) fn load(path: &Path) -> Vec<u8> {
    std::fs::read(path).ok().and_then(|bytes| unframe(&bytes).map(<[u8]>::to_vec)).unwrap_or_default()
}

/// Writes the driver's data through a temporary file, so that a reader sees either the old file or the new file.
pub(super) fn save(path: &Path, data: &[u8]) -> Result<()> {
    let failed = |source: std::io::Error| Error::File { path: path.to_owned(), source };
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(failed)?;
    let mut temporary = tempfile::NamedTempFile::new_in(folder).map_err(failed)?;
    temporary.write_all(&frame(data)).map_err(failed)?;
    temporary.persist(path).map_err(|error| failed(error.error))?;
    Ok(())
}

fn frame(data: &[u8]) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    bytes.extend_from_slice(&(data.len() as u64).to_le_bytes());
    bytes.extend_from_slice(&crc32fast::hash(data).to_le_bytes());
    bytes.extend_from_slice(data);
    bytes
}

fn unframe(bytes: &[u8]) -> Option<&[u8]> {
    let (header, data) = bytes.split_at_checked(HEADER)?;
    let length = u64::from_le_bytes(header[8..16].try_into().ok()?);
    let checksum = u32::from_le_bytes(header[16..20].try_into().ok()?);
    let whole = &header[..8] == MAGIC && length == data.len() as u64 && checksum == crc32fast::hash(data);
    whole.then_some(data)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_whole_files_reach_the_driver() {
        let folder = tempfile::tempdir().unwrap();
        let path = file(folder.path(), [7; 16]);
        assert!(load(&path).is_empty());
        let data: Vec<u8> = (0..200).collect();
        save(&path, &data).unwrap();
        assert_eq!(load(&path), data);
        let good = std::fs::read(&path).unwrap();
        for bad in [&good[..good.len() - 1], &good[1..], &good[..HEADER - 1], &[]] {
            std::fs::write(&path, bad).unwrap();
            assert!(load(&path).is_empty());
        }
        for i in 0..good.len() {
            let mut flipped = good.clone();
            flipped[i] ^= 4;
            assert!(unframe(&flipped).is_none(), "byte {i}");
        }
        assert!(save(Path::new("/dev/null/x/y.bin"), &data).is_err());
    }
}
