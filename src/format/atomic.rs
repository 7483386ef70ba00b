//! Files that appear whole or not at all.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use super::Error;

/// Writes a file so that a reader, or a crash at any moment, finds either the old content or the new one: into a temporary
/// file of the same folder, flushed to the disk, renamed, the folder flushed. On an error the temporary file is removed and
/// what stood there before stays.
pub fn write(file: &Path, content: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), Error> {
    let (folder, mut temporary) = beside(file)?;
    let mut out = BufWriter::with_capacity(1 << 18, temporary.as_file_mut());
    content(&mut out).and_then(|()| out.flush()).map_err(Error::io(file, "write"))?;
    drop(out);
    temporary.as_file().sync_all().map_err(Error::io(file, "flush to the disk"))?;
    temporary.persist(file).map_err(|e| Error::io(file, "rename the temporary file to it")(e.error))?;
    flush_folder(folder).map_err(Error::io(folder, "flush to the disk"))
}

/// Whether [`write()`] finds a place for its temporary file, for who would learn at the end of long work that it does not.
pub fn check(file: &Path) -> Result<(), Error> {
    if file.is_dir() {
        return Err(Error::io(file, "write")(io::ErrorKind::IsADirectory.into()));
    }
    beside(file).map(drop)
}

/// The folder of a file, and a temporary file in it.
fn beside(file: &Path) -> Result<(&Path, tempfile::NamedTempFile), Error> {
    let folder = match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let temporary =
        temporary_file(folder, &format!(".{name}.")).map_err(Error::io(file, "create a temporary file beside it"))?;
    Ok((folder, temporary))
}

/// Removes what a process that was killed while it wrote a file has left in a folder, of files whose names begin with `prefix`: it takes
/// room. Only for who alone writes there. Where it does not work, nothing is lost.
pub fn remove_unfinished(folder: &Path, prefix: &str) {
    let prefix = format!(".{prefix}");
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if name.starts_with(&prefix) && name.ends_with(".tmp") {
            // An error here is not worth stopping for.
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

fn temporary_file(folder: &Path, prefix: &str) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(prefix).suffix(".tmp");
    // Temporary files are private by default; this one becomes an ordinary file, which the umask rules.
    #[cfg(unix)]
    let permissions = std::os::unix::fs::PermissionsExt::from_mode(0o666);
    #[cfg(unix)]
    builder.permissions(permissions);
    builder.tempfile_in(folder)
}

#[cfg(unix)]
fn flush_folder(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

#[cfg(not(unix))]
fn flush_folder(_: &Path) -> io::Result<()> {
    // Folders cannot be opened there; the rename itself is journalled.
    Ok(())
}
