"""Shows how far the jobs are: a line per block, and the plan's drawing coloured by state."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TextIO

from . import picture
from .plan import GLOBAL
from .schedule import FAILED, RUNNING, WAITING, Progress


class Display:
    """On a terminal the lines stay in place; elsewhere a line is printed when the block's state changes."""

    def __init__(self, folder: Path, out: TextIO) -> None:
        self._folder = folder
        self._out = out
        self._before: list[str] = []
        self._coloured: dict[str, str] = {}

    def show(self, jobs: list[Progress]) -> None:
        is_terminal = self._out.isatty()
        width = shutil.get_terminal_size().columns - 1 if is_terminal else None
        lines = [line(progress, detailed=is_terminal)[:width] for progress in jobs]
        if is_terminal:
            back = f"\x1b[{len(self._before)}A" if self._before else ""
            self._out.write(back + "".join(f"\x1b[2K{text}\n" for text in lines))
        else:
            known = dict.fromkeys(self._before)
            self._out.write("".join(f"{text}\n" for text in lines if text not in known))
        self._out.flush()
        self._before = lines
        states = {progress.job.id: progress.state for progress in jobs if progress.job.id != GLOBAL}
        if states != self._coloured:
            picture.write(self._folder, states)
            self._coloured = states


def line(progress: Progress, detailed: bool) -> str:
    """What is known of a job; with details that change often."""
    known = progress.known
    parts = [f"{progress.job.id:<6} {progress.state:<7}"]
    if progress.state == RUNNING:
        parts.append(f"on {known.node}")
        if progress.attempt > 1:
            parts.append(f"attempt {progress.attempt}")
        if detailed:
            parts += [f"{known.landed} checkpoints have landed", known.note]
    elif progress.state in (WAITING, FAILED) and progress.problem:
        parts.append(progress.problem.replace("\n", " | "))
    return "  ".join(parts).rstrip()
