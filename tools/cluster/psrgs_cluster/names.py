"""Joins names that come from a plan or from another machine to folders."""

from __future__ import annotations

import os
from pathlib import Path

from .errors import PlanProblem

LONGEST = 4096


def is_inside(name: str) -> bool:
    """Whether a name with `/` between its parts stays inside the folder that it is joined to, on every system."""
    parts = name.split("/")
    return (
        0 < len(name.encode(errors="replace")) <= LONGEST
        and not any(ord(c) < 32 or ord(c) == 127 or c == "\\" for c in name)
        and name[1:2] != ":"
        and all(part not in ("", ".", "..") for part in parts)
    )


def checked(name: str, of: str) -> str:
    """The name, if it stays inside of a folder. `of` says where the name stands."""
    if not is_inside(name):
        raise PlanProblem(f"{of}: the name {name!r} leads out of its folder")
    return name


def to_read(folder: Path, name: str) -> Path:
    """A file of a folder. A link may lead to another place of the folder, but not out of it."""
    path = folder / checked(name, str(folder))
    real = Path(os.path.realpath(path))
    if not real.is_relative_to(os.path.realpath(folder)):
        raise PlanProblem(f"{path}: a link leads out of {folder}; put the file itself there")
    return real


def to_write(folder: Path, name: str) -> Path:
    """A place in a folder for a file, with the folders above it. Links below the folder are refused."""
    path = folder / checked(name, str(folder))
    folder.mkdir(parents=True, exist_ok=True)
    parent = folder
    for part in Path(name).parts[:-1]:
        parent /= part
        refuse_link(parent)
        parent.mkdir(exist_ok=True)
    refuse_link(path)
    return path


def refuse_link(path: Path) -> None:
    if path.is_symlink():
        raise PlanProblem(f"{path}: is a link, and nothing is written through links; remove the link")
