"""The command `psrgs-cluster`."""

from __future__ import annotations

import argparse
import logging
import os
import sys
from contextlib import redirect_stdout
from pathlib import Path

from . import plan
from .errors import PlanProblem

# Exit codes, as those of psrgs-vk.
FAILURE, USAGE, INPUT, INTERRUPTED = 1, 2, 3, 130

NO_TOKEN = """error: RAY_AUTH_MODE=token must be set, here and where `ray start` runs: without tokens, anyone who
reaches a port of the cluster can run programs on its machines. README.md of tools/cluster says how."""


def main(arguments: list[str] | None = None) -> int:
    options = parser().parse_args(arguments)
    if os.environ.get("RAY_AUTH_MODE") != "token":
        print(NO_TOKEN, file=sys.stderr)
        return USAGE
    try:
        return run(options)
    except PlanProblem as error:
        print(f"error: {error}", file=sys.stderr)
        return INPUT
    except KeyboardInterrupt:
        print("stopped; the same command goes on from the last checkpoints", file=sys.stderr)
        return INTERRUPTED


def parser() -> argparse.ArgumentParser:
    commands = argparse.ArgumentParser(
        prog="psrgs-cluster", description="Trains the blocks of a plan on many machines."
    )
    run = commands.add_subparsers(required=True, metavar="COMMAND").add_parser(
        "run", help="train what is not done of a plan", description="Trains what is not done of a plan."
    )
    run.add_argument("plan", type=Path, metavar="PLAN", help="folder that `psrgs-vk blocks plan` wrote")
    run.add_argument("--address", required=True, help="the cluster's HOST:PORT, as `ray start --head` prints it")
    run.add_argument("--program", default="psrgs-vk", metavar="PATH", help="the program on the workers [%(default)s]")
    run.add_argument("--cache", metavar="DIR", help="folder on the workers for files [~/.cache/psrgs-cluster]")
    return commands


def run(options: argparse.Namespace) -> int:
    folder = options.plan.resolve()
    plan_read = plan.read(folder)
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    # Ray takes a second to load, and reads the variables above as it does.
    import ray

    from .display import Display
    from .schedule import Schedule

    display = Display(folder, sys.stdout)
    # Ray prints the last lines of its own logs when a machine is lost; the lines of the display say the same.
    with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):
        try:
            ray.init(options.address, logging_level=logging.ERROR, log_to_driver=False)
        except (ConnectionError, RuntimeError, ray.exceptions.RayError) as error:
            raise PlanProblem(f"--address {options.address}: {error}") from error
        try:
            failed = Schedule(plan_read, options.program, options.cache, display.show).run()
        except ray.exceptions.RayError as error:
            print(f"error: the cluster has failed ({error}); the same command goes on", file=sys.stderr)
            return FAILURE
        finally:
            ray.shutdown()
    for progress in failed:
        print(f"error: {progress.job.id}: {progress.problem}", file=sys.stderr)
    if failed:
        print("what is done is kept; the same command goes on with the rest", file=sys.stderr)
        return FAILURE
    print(f"all blocks are done; next: psrgs-vk blocks merge {options.plan}")
    return 0
