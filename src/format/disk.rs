//! File system requests beyond reading and writing: flushes and locks. Network file systems refuse some of them.

use std::fs::{File, TryLockError};
use std::io;
use std::path::Path;

/// The file system that writers use. Tests replace it.
pub trait Disk {
    /// Flushes a file to the disk.
    fn flush_file(&self, file: &File) -> io::Result<()>;
    /// Flushes the names in a folder to the disk.
    fn flush_folder(&self, folder: &Path) -> io::Result<()>;
    /// Locks a file for this process until the file is closed.
    fn try_lock(&self, file: &File) -> Result<(), TryLockError>;
}

/// The file system of this machine.
#[derive(Clone, Copy, Debug, Default)]
pub struct System;

impl Disk for System {
    fn flush_file(&self, file: &File) -> io::Result<()> {
        file.sync_all()
    }

    #[cfg(unix)]
    fn flush_folder(&self, folder: &Path) -> io::Result<()> {
        File::open(folder)?.sync_all()
    }

    #[cfg(not(unix))]
    fn flush_folder(&self, _: &Path) -> io::Result<()> {
        // Folders cannot be opened here; the rename itself is journalled.
        Ok(())
    }

    fn try_lock(&self, file: &File) -> Result<(), TryLockError> {
        file.try_lock()
    }
}

/// Whether the error says that the file system cannot flush folders, as opposed to an error of the disk.
pub(crate) fn refuses_flush(error: &io::Error) -> bool {
    let kinds = [io::ErrorKind::Unsupported, io::ErrorKind::InvalidInput, io::ErrorKind::PermissionDenied];
    kinds.contains(&error.kind()) || is_one_of(error, unsupported::FLUSH)
}

/// Whether the error says that the file system has no locks.
pub(crate) fn refuses_lock(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::Unsupported || is_one_of(error, unsupported::LOCK)
}

fn is_one_of(error: &io::Error, codes: &[i32]) -> bool {
    error.raw_os_error().is_some_and(|code| codes.contains(&code))
}

#[cfg(unix)]
mod unsupported {
    use rustix::io::Errno;

    pub(super) const FLUSH: &[i32] = &[
        Errno::INVAL.raw_os_error(),
        Errno::NOTSUP.raw_os_error(),
        Errno::OPNOTSUPP.raw_os_error(),
        Errno::NOSYS.raw_os_error(),
    ];
    pub(super) const LOCK: &[i32] = &[
        Errno::NOLCK.raw_os_error(),
        Errno::NOTSUP.raw_os_error(),
        Errno::OPNOTSUPP.raw_os_error(),
        Errno::NOSYS.raw_os_error(),
    ];
}

#[cfg(not(unix))]
mod unsupported {
    pub(super) const FLUSH: &[i32] = &[];
    pub(super) const LOCK: &[i32] = &[];
}
