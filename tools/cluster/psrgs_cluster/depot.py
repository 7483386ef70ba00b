"""The process beside the plan: gives out files, takes results in, and is the only writer of the plan's folder."""

from __future__ import annotations

import fcntl
import os
import shutil
import threading
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

from .errors import Interruption, PlanProblem
from .files import PIECE, FileRecord, is_same, link_or_copy, read_piece, record_of, records_under
from .names import to_read, to_write
from .plan import DONE_FILE, GLOBAL, MODEL_FILE, PLAN_FILE, Job, Plan, done_problem

# Inside the plan's folder: the lock, and files that arrive.
OWN_FOLDER = ".cluster"
# The lock of a run folder, which psrgs-vk takes too.
RUN_LOCK = ".lock"
# Seconds for the depot of a driver that was killed to end.
LONGEST_WAIT = 30.0


@dataclass(frozen=True)
class JobState:
    """What is known of the training of a job."""

    attempt: int = 0
    node_id: str = ""
    node: str = ""
    # Times that a checkpoint, or the result, has landed.
    landed: int = 0
    note: str = ""


@dataclass
class _Run:
    """A run folder that is being written."""

    job: Job
    folder: Path
    arriving: Path
    state: JobState = field(default_factory=JobState)
    # What lies in the folder, by name in the plan's folder.
    held: dict[str, FileRecord] = field(default_factory=dict)
    # Held from the first attempt to the end, so that no psrgs-vk beside this process trains the job too.
    lock: int | None = None


class Depot:
    """Methods may run on several threads at the same time."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._lock = -1
        self._mutex = threading.Lock()
        self._sources: dict[str, tuple[Path, FileRecord]] = {}
        self._verified: set[str] = set()
        self._runs: dict[str, _Run] = {}
        for job in (plan.everything, *plan.blocks):
            self._offer(plan.dataset, job.files)
            arriving = plan.folder / OWN_FOLDER / "arriving" / job.id
            self._runs[job.id] = _Run(job, plan.folder / job.folder, arriving)

    def open(self) -> None:
        """Locks the plan's folder until the depot ends."""
        other = f"{self._plan.folder}: another psrgs-cluster works on this plan; wait for its end"
        self._lock = self._lock_file(f"{OWN_FOLDER}/lock", LONGEST_WAIT, other)

    def _lock_file(self, name: str, seconds: float, other: str) -> int:
        """Locks a file of the plan's folder, as psrgs-vk does. `other` says that another process holds the lock."""
        try:
            path = to_write(self._plan.folder, name)
            file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise PlanProblem(f"{error.filename}: {error.strerror}") from error
        end = time.monotonic() + seconds
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return file
            except OSError as error:
                if not isinstance(error, BlockingIOError) or time.monotonic() > end:
                    os.close(file)
                    is_held = isinstance(error, BlockingIOError)
                    raise PlanProblem(other if is_held else f"{path}: cannot be locked: {error.strerror}") from None
                time.sleep(0.2)

    def _offer(self, folder: Path, records: tuple[FileRecord, ...]) -> None:
        self._sources.update({record.sha256: (folder, record) for record in records})

    def begin(self, job: str, attempt: int, node_id: str, node: str) -> tuple[list[FileRecord], list[FileRecord]]:
        """Begins an attempt. Returns files of the plan's folder: those that the job needs, and those of its run folder.

        Attempts with lower numbers cannot write from here on.
        """
        with self._mutex:
            run = self._runs[job]
            if attempt < run.state.attempt:
                raise Interruption(f"attempt {attempt} of {job} has been replaced")
            run.state = replace(run.state, attempt=attempt, node_id=node_id, node=node, note="receives files")
            if run.lock is None:
                other = f"{run.folder}: another program trains this block; wait for its end, and run again"
                run.lock = self._lock_file(f"{run.job.folder}/{RUN_LOCK}", 0.0, other)
            shutil.rmtree(run.arriving, ignore_errors=True)
            earlier = _named(run.job.folder, records_under(run.folder))
            run.held = {record.name: record for record in earlier}
            needed = [record_of(self._plan.folder, PLAN_FILE)]
            if job != GLOBAL:
                # Checkpoints and pictures of the coarse model, which lie in folders, serve nobody else.
                results = records_under(self._plan.folder / GLOBAL)
                needed += _named(GLOBAL, [record for record in results if "/" not in record.name])
            self._offer(self._plan.folder, (*needed, *earlier))
            return needed, earlier

    def piece(self, sha256: str, index: int) -> bytes:
        """A piece of a file that a job needs, by the file's SHA-256."""
        folder, record = self._sources[sha256]
        path = to_read(folder, record.name)
        try:
            if sha256 not in self._verified:
                if not is_same(path, record):
                    found = "has changed since the plan was made" if path.is_file() else "is missing"
                    raise PlanProblem(f"{folder / record.name}: {found}; put the file back as it was, or plan anew")
                self._verified.add(sha256)
            return read_piece(path, index)
        except OSError as error:
            raise PlanProblem(f"{path}: {error.strerror}") from error

    def missing(self, job: str, attempt: int, records: list[FileRecord]) -> list[FileRecord]:
        """Those files of a worker's run folder that are not here."""
        held = {record.sha256 for record in self._current(job, attempt).held.values()}
        return [record for record in records if record.sha256 not in held]

    def take(self, job: str, attempt: int, sha256: str, index: int, data: bytes) -> None:
        """A piece of a file of a worker's run folder."""
        run = self._current(job, attempt)
        try:
            run.arriving.mkdir(parents=True, exist_ok=True)
            path = to_write(run.arriving, sha256)
            with open(path, "r+b" if path.exists() else "wb") as file:
                file.seek(index * PIECE)
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise PlanProblem(f"{run.arriving}: {error.strerror}; make room there and run again") from error

    def publish(self, job: str, attempt: int, records: list[FileRecord], is_end: bool) -> None:
        """Makes the run folder here equal to the worker's, whose files have all arrived. `done.json` comes last."""
        run = self._current(job, attempt)
        with self._mutex:
            wanted = {f"{run.job.folder}/{record.name}": record for record in records}
            held = {name: record.sha256 for name, record in run.held.items()}
            new = {name: record for name, record in wanted.items() if held.get(name) != record.sha256}
            sources = {name: self._source(run, record) for name, record in new.items()}
            if is_end:
                self._check_done(run, records, sources)
            try:
                for name in sorted(new, key=lambda name: name.endswith(f"/{DONE_FILE}")):
                    self._put(sources[name], name)
                for name in set(run.held) - set(wanted):
                    (self._plan.folder / name).unlink(missing_ok=True)
            except OSError as error:
                raise PlanProblem(f"{run.folder}: {error.strerror}; make room there and run again") from error
            run.held = {name: replace(record, name=name) for name, record in wanted.items()}
            shutil.rmtree(run.arriving, ignore_errors=True)
            run.state = replace(run.state, landed=run.state.landed + 1)
            if is_end and run.lock is not None:
                os.close(run.lock)
                run.lock = None

    def _source(self, run: _Run, record: FileRecord) -> Path:
        """Where the bytes of a record lie: among the files that arrived, or under another name."""
        arrived = run.arriving / record.sha256
        kept = (self._plan.folder / held.name for held in run.held.values() if held.sha256 == record.sha256)
        path = next((path for path in (arrived, *kept) if path.is_file()), arrived)
        if not is_same(path, record):
            raise Interruption(f"{record.name} arrived damaged, or changed while it was sent")
        return path

    def _put(self, source: Path, name: str) -> None:
        path = to_write(self._plan.folder, name)
        unfinished = path.with_name(f".{path.name}.part")
        link_or_copy(source, unfinished)
        os.replace(unfinished, path)

    def _check_done(self, run: _Run, records: list[FileRecord], sources: dict[str, Path]) -> None:
        models = [record.sha256 for record in records if record.name == MODEL_FILE]
        done = f"{run.job.folder}/{DONE_FILE}"
        # What has landed with a checkpoint lies in place already.
        source = sources.get(done, self._plan.folder / done)
        data = source.read_bytes() if source.is_file() else b""
        if problem := done_problem(data, run.job.id, self._plan.sha256, models[0] if models else ""):
            raise PlanProblem(f"the program ended well, but {problem}")

    def tell(self, job: str, attempt: int, note: str) -> None:
        """What a worker does right now."""
        run = self._current(job, attempt)
        run.state = replace(run.state, note=note)

    def states(self) -> dict[str, JobState]:
        return {job: run.state for job, run in self._runs.items()}

    def _current(self, job: str, attempt: int) -> _Run:
        run = self._runs[job]
        if run.state.attempt != attempt:
            raise Interruption(f"attempt {attempt} of {job} has been replaced")
        return run


def _named(folder: str, records: list[FileRecord]) -> list[FileRecord]:
    return [replace(record, name=f"{folder}/{record.name}") for record in records]
