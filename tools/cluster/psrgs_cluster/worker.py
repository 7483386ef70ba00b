"""The task that trains a job on a machine: receives files, runs the program, sends checkpoints and results."""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ray
from ray.exceptions import RayTaskError

from . import child
from .errors import BlockProblem, Interruption, NodeProblem
from .files import Cache, FileRecord, fetch, link_or_copy, names_under, number_of_pieces, read_piece, record_of
from .names import to_write
from .plan import CHECKPOINTS, Job

# Seconds between two looks at the program and its checkpoints.
LOOK = 0.5
# Most lines and bytes of what the program said that travel with a failure.
LAST_LINES, LAST_BYTES = 12, 4000
# Exit codes of the program.
USAGE, INPUT, DEVICE, CHECK, OUTPUT = 2, 3, 4, 7, 8


@dataclass(frozen=True)
class Order:
    """What to train."""

    job: Job
    attempt: int
    # Version that the program must have.
    version: str
    # The program on this machine: a path, or a name to look up.
    program: str
    # The folder of the cache on this machine.
    cache: str | None


class Depot:
    """Calls of the depot from here; its failures come as they were raised there."""

    def __init__(self, handle: Any, order: Order) -> None:
        self._handle = handle
        self._of = (order.job.id, order.attempt)

    def ask(self, method: str, *arguments: object) -> Any:
        return self._call(method, *self._of, *arguments)

    def piece(self, sha256: str, index: int) -> bytes:
        piece: bytes = self._call("piece", sha256, index)
        return piece

    def _call(self, method: str, *arguments: object) -> Any:
        try:
            return ray.get(getattr(self._handle, method).remote(*arguments))
        except RayTaskError as error:
            raise error.cause from None


def train(order: Order, handle: Any) -> None:
    """Trains a job. What goes wrong is one of the failures of `errors`."""
    node = ray.get_runtime_context().get_node_id()
    depot = Depot(handle, order)
    needed, earlier = depot.ask("begin", node, ray.util.get_node_ip_address())
    try:
        check_version(order)
        with work_folder(cache_folder(order)) as work:
            receive(order, depot, work, needed, earlier)
            run(order, depot, work)
    except OSError as error:
        remedy = "; make room there" if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG) else ""
        raise NodeProblem(f"{error.filename or cache_folder(order)}: {error.strerror}{remedy}") from error


def cache_folder(order: Order) -> Path:
    usual = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "psrgs-cluster"
    return Path(order.cache) if order.cache else usual


def check_version(order: Order) -> None:
    """Another version may train other bits, or know the plan's settings no more."""
    remedy = f"install psrgs-vk {order.version} there, or name the program with --program"
    try:
        said = subprocess.run([order.program, "--version"], stdin=subprocess.DEVNULL, capture_output=True, timeout=60)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NodeProblem(f"{order.program}: does not run ({error}); {remedy}") from error
    words = said.stdout.decode(errors="replace").split()
    if said.returncode != 0 or words[1:2] != [order.version]:
        found = " ".join(words[:2]) or last_lines(said.stderr)
        raise NodeProblem(f"{order.program} is {found}, and the plan is of {order.version}; {remedy}")


@contextmanager
def work_folder(cache: Path) -> Iterator[Path]:
    """A new folder that is removed at the end. Folders of workers that were killed are removed too."""
    everything = cache / "work"
    everything.mkdir(parents=True, exist_ok=True)
    with ExitStack() as ours:
        # One worker of a machine at a time removes folders, so that none takes a new one for an old one.
        with locked(everything, fcntl.LOCK_EX):
            for old in everything.iterdir():
                with suppress(BlockingIOError), locked(old, fcntl.LOCK_EX | fcntl.LOCK_NB):
                    shutil.rmtree(old, ignore_errors=True)
            work = Path(tempfile.mkdtemp(dir=everything))
            ours.callback(shutil.rmtree, work, ignore_errors=True)
            ours.enter_context(locked(work, fcntl.LOCK_EX))
        yield work


@contextmanager
def locked(folder: Path, how: int) -> Iterator[None]:
    handle = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        fcntl.flock(handle, how)
        yield
    finally:
        os.close(handle)


def receive(order: Order, depot: Depot, work: Path, needed: list[FileRecord], earlier: list[FileRecord]) -> None:
    """Puts the files of a job into place: what does not change from the cache, the run folder as it is at the depot."""
    cache = Cache(cache_folder(order) / "files")
    (work / "plan").mkdir()
    (work / "data").mkdir()
    for folder, records in (("plan", needed), ("data", order.job.files)):
        for record in records:
            cache.place(record, to_write(work / folder, record.name), depot.piece)
    for record in earlier:
        fetch(record, to_write(work / "plan", record.name), depot.piece)


def run(order: Order, depot: Depot, work: Path) -> None:
    """Runs the program to its end, and sends each new checkpoint."""
    arguments = ["blocks", "run", str(work / "plan"), "--block", order.job.id, "--data", str(work / "data")]
    sender = Sender(order, depot, work)
    log = work / "log"
    with open(log, "wb") as said:
        command = [sys.executable, "-I", child.__file__, order.program, *arguments]
        # The program lives as long as this pipe, which closes with this process.
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=said, stderr=said, cwd=work)
        try:
            while process.poll() is None:
                sender.send_checkpoints()
                depot.ask("tell", last_line(log))
                time.sleep(LOOK)
        finally:
            assert process.stdin is not None
            process.stdin.close()
            process.wait()
    if process.returncode == 0:
        sender.send(is_end=True)
    else:
        sender.send_checkpoints()
        raise failure(order, process.returncode, log)


def failure(order: Order, code: int, log: Path) -> Exception:
    """What the end of the program with a code means."""
    with open(log, "rb") as file:
        file.seek(max(0, log.stat().st_size - LAST_BYTES))
        said = f"{Path(order.program).name} ended with code {code}: {last_lines(file.read())}"
    if code in (USAGE, INPUT, CHECK):
        return BlockProblem(said)
    return NodeProblem(said) if code in (DEVICE, OUTPUT) else Interruption(said)


def last_lines(said: bytes) -> str:
    lines = [line for line in said.decode(errors="replace").replace("\r", "\n").splitlines() if line.strip()]
    return "\n".join(lines[-LAST_LINES:])


def last_line(log: Path) -> str:
    with open(log, "rb") as file:
        file.seek(max(0, log.stat().st_size - 500))
        return last_lines(file.read()).rpartition("\n")[2][-100:]


class Sender:
    """Sends what is new in the run folder."""

    def __init__(self, order: Order, depot: Depot, work: Path) -> None:
        self._depot = depot
        self._folder = work / "plan" / order.job.folder
        self._copies = work / "send"
        self._sent = self._checkpoints()
        # By place on the disk, length and time: hashing a large file again takes seconds.
        self._known: dict[tuple[int, int, int], FileRecord] = {}

    def _checkpoints(self) -> list[tuple[str, int]]:
        """Names and times of the checkpoints."""
        folder = self._folder / CHECKPOINTS
        return [(name, (folder / name).stat().st_mtime_ns) for name in names_under(folder)] if folder.is_dir() else []

    def send_checkpoints(self) -> None:
        """Sends the run folder if it has a new checkpoint."""
        # The program replaces files at any time. What is gone meanwhile is sent, as it is then, at the next look.
        with suppress(Interruption, FileNotFoundError):
            found = self._checkpoints()
            if found != self._sent:
                self.send(is_end=False)
                self._sent = found

    def send(self, is_end: bool) -> None:
        shutil.rmtree(self._copies, ignore_errors=True)
        records = []
        for name in names_under(self._folder):
            copy = to_write(self._copies, name)
            link_or_copy(self._folder / name, copy)
            records.append(self._record(name, copy))
        for record in self._depot.ask("missing", records):
            for index in range(number_of_pieces(record.bytes)):
                self._depot.ask("take", record.sha256, index, read_piece(self._copies / record.name, index))
        self._depot.ask("publish", records, is_end)
        shutil.rmtree(self._copies, ignore_errors=True)

    def _record(self, name: str, copy: Path) -> FileRecord:
        stat = copy.stat()
        key = (stat.st_ino, stat.st_size, stat.st_mtime_ns)
        if key not in self._known:
            self._known[key] = record_of(self._copies, name)
        known = self._known[key]
        return FileRecord(name, known.sha256, known.bytes)
