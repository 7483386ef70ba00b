"""Files as records of name, SHA-256 and length, and their pieces."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from .errors import Interruption

# Most bytes of a file that travel at a time.
PIECE = 64 << 20

# The bytes of a piece: by SHA-256 of the file and number of the piece.
Pieces = Callable[[str, int], bytes]


@dataclass(frozen=True)
class FileRecord:
    """A file as it was: its name with `/` between the parts, SHA-256 in hexadecimal digits, length in bytes."""

    name: str
    sha256: str
    bytes: int


def sha256_of(path: Path) -> str:
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def names_under(folder: Path) -> Iterator[str]:
    """Names of the regular files of a folder and of its folders, sorted. Hidden ones are locks and unfinished files."""
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder)
        if not any(part.startswith(".") for part in name.parts) and stat.S_ISREG(path.lstat().st_mode):
            yield name.as_posix()


def record_of(folder: Path, name: str) -> FileRecord:
    path = folder / name
    return FileRecord(name, sha256_of(path), path.stat().st_size)


def records_under(folder: Path) -> list[FileRecord]:
    """Records of all regular files of a folder."""
    return [record_of(folder, name) for name in names_under(folder)]


def is_same(path: Path, record: FileRecord) -> bool:
    """Whether a file has the content of a record."""
    return path.is_file() and path.stat().st_size == record.bytes and sha256_of(path) == record.sha256


def number_of_pieces(size: int) -> int:
    """At least one, so that an empty file arrives too."""
    return max(1, -(-size // PIECE))


def read_piece(path: Path, index: int) -> bytes:
    with open(path, "rb") as file:
        file.seek(index * PIECE)
        return file.read(PIECE)


def fetch(record: FileRecord, path: Path, pieces: Pieces) -> None:
    """Writes a file from its pieces, whole or not at all."""
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with open(unfinished, "wb") as file:
            for index in range(number_of_pieces(record.bytes)):
                file.write(pieces(record.sha256, index))
        if not is_same(unfinished, record):
            raise Interruption(f"{path}: {record.name} arrived damaged")
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)


class Cache:
    """Files by their SHA-256, kept between blocks and runs."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def place(self, record: FileRecord, path: Path, pieces: Pieces) -> None:
        """Puts a file at `path`, fetched only if the cache lacks the file or holds other bytes by now."""
        kept = self.folder / record.sha256[:2] / record.sha256
        if not is_same(kept, record):
            kept.parent.mkdir(parents=True, exist_ok=True)
            fetch(record, kept, pieces)
        link_or_copy(kept, path)


def link_or_copy(source: Path, path: Path) -> None:
    """A second name for a file, or a copy where the file system has no such names."""
    path.unlink(missing_ok=True)
    try:
        os.link(source, path)
    except OSError:
        with open(source, "rb") as file, open(path, "wb") as copy:
            while block := file.read(1 << 20):
                copy.write(block)
