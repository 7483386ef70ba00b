"""A plan's folder: `blocks.json`, the jobs that follow from the plan, and which of the jobs are done."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .errors import PlanProblem
from .files import FileRecord, sha256_of
from .names import checked

PLAN_FILE = "blocks.json"
FORMAT = "psrgs-vk blocks"
VERSION = 1
DONE_FILE = "done.json"
DONE_FORMAT = "psrgs-vk block"
MODEL_FILE = "point_cloud.ply"
CHECKPOINTS = "checkpoints"
GLOBAL = "global"
SHA256 = re.compile("[0-9a-f]{64}")


@dataclass(frozen=True)
class Job:
    """What one task trains: the coarse model of everything, or a block."""

    id: str
    # The run folder inside the plan's folder.
    folder: str
    # Files of the dataset: the model's, photographs and masks.
    files: tuple[FileRecord, ...]
    predicted_seconds: float

    @property
    def is_global(self) -> bool:
        return self.id == GLOBAL


@dataclass(frozen=True)
class Plan:
    folder: Path
    sha256: str
    # Version of the program that made the plan.
    program: str
    dataset: Path
    everything: Job
    blocks: tuple[Job, ...]


def read(folder: Path) -> Plan:
    """Reads the plan of a folder. The program reads all of the plan; here only what the cluster needs is checked."""
    file = folder / PLAN_FILE
    try:
        data = file.read_bytes()
        plan = json.loads(data)
    except OSError as error:
        raise PlanProblem(f"{file}: {error.strerror}; `psrgs-vk blocks plan` writes the plan") from error
    except ValueError as error:
        raise PlanProblem(f"{file}: no JSON ({error}); copy the plan whole, or plan anew") from error
    try:
        return _read(folder, hashlib.sha256(data).hexdigest(), plan)
    except (KeyError, TypeError, ValueError) as error:
        raise PlanProblem(f"{file}: {type(error).__name__}: {error}; plan anew with `psrgs-vk blocks plan`") from error
    except PlanProblem as error:
        raise PlanProblem(f"{file}: {error}") from error


def _read(folder: Path, sha256: str, plan: dict[str, Any]) -> Plan:
    if not isinstance(plan, dict) or plan.get("format") != FORMAT:
        raise PlanProblem(f"its format is not '{FORMAT}': this is no plan of blocks")
    if plan.get("version") != VERSION:
        raise PlanProblem(f"version is {plan.get('version')!r}, and {VERSION} is read: plan anew")
    dataset = plan["dataset"]
    shared = [_record(record, record["name"]) for record in dataset["files"]]
    known: dict[str, list[FileRecord]] = {}
    blocks = []
    for block in plan["blocks"]:
        if not re.fullmatch(r"b[0-9]{1,6}", block["id"]):
            raise PlanProblem(f"blocks: {block['id']!r} is no name of a block such as b00")
        files = list(shared)
        for photograph in block["photographs"]:
            name = photograph["name"]
            if photograph["file"] is None:
                raise PlanProblem(
                    f"{name}: lies outside of {dataset['path']}, so it is not sent; move it there and plan anew"
                )
            known[name] = [_record(photograph, photograph["file"])]
            if mask := photograph.get("mask"):
                known[name].append(_record(mask, mask["name"]))
            files += known[name]
        blocks.append(Job(block["id"], f"blocks/{block['id']}", tuple(files), float(block["predicted_seconds"] or 0)))
    if len({block.id for block in blocks}) < len(blocks) or not blocks:
        raise PlanProblem("blocks: there is none, or two have the same name")
    photographs = plan["global"]["photographs"]
    if missing := [name for name in photographs if name not in known]:
        raise PlanProblem(f"global: {missing[0]!r} is no photograph of any block")
    files = shared + [file for name in photographs for file in known[name]]
    everything = Job(GLOBAL, GLOBAL, tuple(files), 0.0)
    return Plan(folder, sha256, str(plan["program"]), folder / dataset["path"], everything, tuple(blocks))


def _record(record: dict[str, Any], name: str) -> FileRecord:
    size = record["bytes"]
    if not SHA256.fullmatch(record["sha256"]):
        raise PlanProblem(f"{name!r}: sha256 is no SHA-256 of 64 hexadecimal digits")
    if not isinstance(size, int) or size < 0:
        raise PlanProblem(f"{name!r}: bytes is no length")
    return FileRecord(checked(name, "files of the dataset"), record["sha256"], size)


def is_done(plan: Plan, job: Job) -> bool:
    """Whether a job's results lie in the plan's folder, whole and made from this plan."""
    folder = plan.folder / job.folder
    try:
        done = (folder / DONE_FILE).read_bytes()
        return done_problem(done, job.id, plan.sha256, sha256_of(folder / MODEL_FILE)) is None
    except OSError:
        return False


def done_problem(done: bytes, job: str, plan_sha256: str, model_sha256: str) -> str | None:
    """Why a `done.json` does not tell of the results of a job, if it does not."""
    wanted = {"format": DONE_FORMAT, "block": job, "plan_sha256": plan_sha256, "model_sha256": model_sha256}
    try:
        found = json.loads(done)
        wrong = [key for key, value in wanted.items() if found.get(key) != value]
    except (ValueError, AttributeError) as error:
        return f"{DONE_FILE} is missing or damaged ({error})"
    return f"{DONE_FILE} tells of something else: its {wrong[0]} is {found.get(wrong[0])!r}" if wrong else None
