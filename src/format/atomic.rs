//! Writes files whole or not at all.

use std::fs::{DirEntry, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use super::Error;
use super::disk::{Disk, System, refuses_flush};

/// Prefix of a temporary file's name. Its length does not depend on the file's name, which may have the longest
/// possible length.
const PREFIX: &str = ".psrgs-vk-";
/// Random letters and digits of the name.
const DRAWN: usize = 12;
const SUFFIX: &str = ".tmp";

/// Writes a file so that a reader, or a crash at any moment, finds either the old content or the new. The content goes
/// into a temporary file in the same folder, which is flushed to the disk and renamed, and the folder is flushed. On an
/// error the temporary file is removed and the old file stays. A link in the file's place is replaced, not followed.
/// Where the file system cannot flush folders, the file is still written (see [`unflushed`]).
pub fn write(file: &Path, content: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), Error> {
    write_on(&System, file, content)
}

/// As [`write()`], with a file in which the content may go back and forth. What was written through other handles of the
/// file counts too.
pub fn write_file(file: &Path, content: impl FnOnce(&mut File) -> io::Result<()>) -> Result<(), Error> {
    let (folder, mut temporary) = beside(file)?;
    content(temporary.as_file_mut()).map_err(Error::io(file, "write"))?;
    finish(&System, (file, folder), temporary)
}

fn write_on(
    disk: &impl Disk,
    file: &Path,
    content: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), Error> {
    let (folder, mut temporary) = beside(file)?;
    let mut out = BufWriter::with_capacity(1 << 18, temporary.as_file_mut());
    content(&mut out).and_then(|()| out.flush()).map_err(Error::io(file, "write"))?;
    drop(out);
    finish(disk, (file, folder), temporary)
}

/// Puts a temporary file into its place.
fn finish(disk: &impl Disk, (file, folder): (&Path, &Path), temporary: tempfile::NamedTempFile) -> Result<(), Error> {
    disk.flush_file(temporary.as_file()).map_err(Error::io(file, "flush to the disk"))?;
    temporary.persist(file).map_err(|e| Error::io(file, "rename the temporary file to it")(e.error))?;
    match disk.flush_folder(folder) {
        Err(e) if !refuses_flush(&e) => Err(Error::io(folder, "flush to the disk")(e)),
        _ => Ok(()),
    }
}

/// The error of a file system that cannot flush the names in a folder, for a warning before long work: after a loss of
/// power the last files may have their former content.
pub fn unflushed(folder: &Path, disk: &impl Disk) -> Option<io::Error> {
    disk.flush_folder(folder).err().filter(refuses_flush)
}

/// Fails where [`write()`] could not create its temporary file, for callers that would learn so only after long work.
pub fn check(file: &Path) -> Result<(), Error> {
    if file.is_dir() {
        return Err(Error::io(file, "write")(io::ErrorKind::IsADirectory.into()));
    }
    beside(file).map(drop)
}

/// Removes a file that may not be there.
pub fn remove(file: &Path) -> Result<(), Error> {
    match std::fs::remove_file(file) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(Error::io(file, "remove")(e)),
        _ => Ok(()),
    }
}

/// The folder of a file, and a temporary file in that folder.
fn beside(file: &Path) -> Result<(&Path, tempfile::NamedTempFile), Error> {
    let folder = match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let temporary = temporary_file(folder).map_err(Error::io(file, "create a temporary file beside it"))?;
    Ok((folder, temporary))
}

/// Removes temporary files that killed processes have left in a folder. Files with similar names and files that a
/// process is still writing stay. Errors are ignored.
pub fn remove_unfinished(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if is_temporary(&entry) && is_abandoned(&entry.path()) {
            // A failed removal does no harm.
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Whether a file has a name of [`temporary_file`], and is no link.
fn is_temporary(entry: &DirEntry) -> bool {
    let name = entry.file_name();
    let drawn = name.to_str().and_then(|name| name.strip_prefix(PREFIX)?.strip_suffix(SUFFIX));
    drawn.is_some_and(|drawn| drawn.len() == DRAWN && drawn.bytes().all(|b| b.is_ascii_alphanumeric()))
        && entry.file_type().is_ok_and(|kind| kind.is_file())
}

/// Whether no process has locked the file, as far as the file system says.
#[cfg(unix)]
fn is_abandoned(file: &Path) -> bool {
    File::open(file).is_ok_and(|opened| !matches!(opened.try_lock(), Err(std::fs::TryLockError::WouldBlock)))
}

#[cfg(not(unix))]
fn is_abandoned(_: &Path) -> bool {
    // Here a file that another process has open cannot be removed.
    true
}

fn temporary_file(folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX).rand_bytes(DRAWN).suffix(SUFFIX);
    // Temporary files are private by default. This file becomes an ordinary one with the permissions of the umask.
    #[cfg(unix)]
    let permissions = std::os::unix::fs::PermissionsExt::from_mode(0o666);
    #[cfg(unix)]
    builder.permissions(permissions);
    let temporary = builder.tempfile_in(folder)?;
    // The lock shows that the file is in use. Without locks nothing changes.
    #[cfg(unix)]
    let _ = temporary.as_file().try_lock();
    Ok(temporary)
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::fs;
    use std::fs::TryLockError;

    use super::*;

    /// Records the requests in order. Fails flushes of folders and of files with given system errors.
    #[derive(Default)]
    struct Watched {
        asked: RefCell<Vec<String>>,
        folder: Option<i32>,
        file: Option<i32>,
    }

    impl Watched {
        fn answer(&self, asked: String, code: Option<i32>) -> io::Result<()> {
            self.asked.borrow_mut().push(asked);
            code.map_or(Ok(()), |code| Err(io::Error::from_raw_os_error(code)))
        }
    }

    impl Disk for Watched {
        fn flush_file(&self, file: &File) -> io::Result<()> {
            let bytes = file.metadata()?.len();
            self.answer(format!("file of {bytes} bytes"), self.file)
        }
        fn flush_folder(&self, folder: &Path) -> io::Result<()> {
            let names = fs::read_dir(folder)?.flatten().map(|entry| entry.file_name());
            self.answer(format!("folder with {:?}", names.collect::<Vec<_>>()), self.folder)
        }
        fn try_lock(&self, _: &File) -> Result<(), TryLockError> {
            Ok(())
        }
    }

    /// The whole content is flushed before the rename, and the name after it.
    #[test]
    fn a_file_is_flushed_before_its_rename_and_its_folder_after() {
        let folder = tempfile::tempdir().unwrap();
        let disk = Watched::default();
        write_on(&disk, &folder.path().join("a"), |out| out.write_all(&[7; 300_000])).unwrap();
        assert_eq!(*disk.asked.borrow(), ["file of 300000 bytes", "folder with [\"a\"]"]);
    }

    #[cfg(unix)]
    #[test]
    fn a_folder_without_flushing_is_fine_and_a_broken_disk_is_not() {
        use rustix::io::Errno;
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a");
        for refusal in [Errno::INVAL, Errno::NOTSUP, Errno::OPNOTSUPP, Errno::NOSYS, Errno::ACCESS] {
            let disk = Watched { folder: Some(refusal.raw_os_error()), ..Watched::default() };
            write_on(&disk, &file, |out| write!(out, "{refusal}")).unwrap();
            assert_eq!(fs::read_to_string(&file).unwrap(), refusal.to_string());
            assert!(unflushed(folder.path(), &disk).is_some(), "{refusal}");
        }
        assert!(unflushed(folder.path(), &Watched::default()).is_none());
        let broken = Some(Errno::IO.raw_os_error());
        let disk = Watched { folder: broken, ..Watched::default() };
        assert!(write_on(&disk, &file, |_| Ok(())).is_err() && unflushed(folder.path(), &disk).is_none());
        let before = fs::read(&file).unwrap();
        let disk = Watched { file: broken, ..Watched::default() };
        let error = write_on(&disk, &file, |out| out.write_all(b"new")).unwrap_err().to_string();
        assert!(error.contains("flush"), "{error}");
        assert_eq!(fs::read(&file).unwrap(), before);
    }

    #[test]
    fn the_longest_name_can_be_written() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("n".repeat(255));
        write(&file, |out| out.write_all(b"x")).unwrap();
        check(&file).unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"x");
    }

    #[test]
    fn temporary_files_of_others_stay() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let left = at(".psrgs-vk-0123456789ab.tmp");
        let others = [".notes.tmp", ".point_cloud.ply.x1Y2z3.tmp", ".psrgs-vk-.tmp", ".psrgs-vk-short.tmp", "a.tmp"];
        others.iter().for_each(|name| fs::write(at(name), "theirs").unwrap());
        fs::write(&left, "half a mod").unwrap();
        fs::create_dir(at(".psrgs-vk-aaaaaaaaaaaa.tmp")).unwrap();
        let writing = temporary_file(folder.path()).unwrap();
        remove_unfinished(folder.path());
        assert!(!left.exists());
        assert!(others.iter().all(|name| at(name).exists()) && at(".psrgs-vk-aaaaaaaaaaaa.tmp").exists());
        assert!(writing.path().exists(), "a file that is being written was removed");
    }

    #[cfg(unix)]
    #[test]
    fn a_link_in_place_of_a_file_is_replaced_and_its_target_kept() {
        let folder = tempfile::tempdir().unwrap();
        let (target, link) = (folder.path().join("target"), folder.path().join("metrics.json"));
        fs::write(&target, "theirs").unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        write(&link, |out| out.write_all(b"ours")).unwrap();
        assert_eq!(
            (fs::read_to_string(&target).unwrap(), fs::read_to_string(&link).unwrap()),
            ("theirs".into(), "ours".into())
        );
        assert!(!link.is_symlink());
    }
}
