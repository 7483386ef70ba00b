"""Gives jobs to machines until all are done: which machine may train which job, what is tried again, what failed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import ray
from ray.exceptions import RayError, RayTaskError
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from . import depot, worker
from .depot import JobState
from .errors import BlockProblem, NodeProblem, PlanProblem
from .plan import Job, Plan, is_done

# The custom resource of a machine: one for each device.
RESOURCE = "vulkan"
# Interruptions of a job after which the job has failed, if no checkpoint has landed between them.
MOST_INTERRUPTIONS = 3
# Seconds between two looks at machines and states.
LOOK = 1.0
# Threads of the depot. Each may hold a piece in memory.
DEPOT_THREADS = 2

# Shown while there is no machine to wait for.
NOBODY = f"""no machine of the cluster has a device yet: ray start .. --resources '{{"{RESOURCE}": 1}}'"""

WAITING, RUNNING, DONE, FAILED = "waiting", "running", "done", "failed"


@dataclass
class Progress:
    """A job on its way."""

    job: Job
    state: str = WAITING
    # Why the job has failed, or was interrupted the last time.
    problem: str = ""
    known: JobState = field(default_factory=JobState)
    attempt: int = 0
    interruptions: int = 0
    # Checkpoints that had landed at the last interruption.
    landed: int = 0
    # Machines on which the job was interrupted.
    shunned: set[str] = field(default_factory=set)
    # Machines that the newest task avoids.
    avoided: set[str] = field(default_factory=set)


class Schedule:
    """Jobs of a plan on a cluster that `ray.init` has joined."""

    def __init__(self, plan: Plan, program: str, cache: str | None, show: Callable[[list[Progress]], None]) -> None:
        self._plan = plan
        self._program = program
        self._cache = cache
        self._show = show
        # Machines that cannot train any job, and why.
        self._banned: dict[str, str] = {}
        self.jobs = [Progress(job) for job in (plan.everything, *plan.blocks)]
        here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
        options = {"num_cpus": 0, "scheduling_strategy": here, "max_concurrency": DEPOT_THREADS}
        self._depot: Any = ray.remote(depot.Depot).options(**options).remote(plan)
        self._train: Any = ray.remote(worker.train)
        self._tasks: dict[Any, Progress] = {}

    def run(self) -> list[Progress]:
        """Trains what is not done: first the coarse model of everything. Returns the jobs that failed."""
        self._ask("open")
        for progress in self.jobs:
            progress.state = DONE if is_done(self._plan, progress.job) else WAITING
        everything, blocks = self.jobs[0], self.jobs[1:]
        self._finish([everything])
        if everything.state == FAILED:
            return [everything]
        # The longest first: the last machine to end then ends as early as possible.
        self._finish(sorted(blocks, key=lambda progress: -progress.job.predicted_seconds))
        return [progress for progress in blocks if progress.state == FAILED]

    def _ask(self, method: str) -> Any:
        try:
            return ray.get(getattr(self._depot, method).remote())
        except RayTaskError as error:
            raise error.cause from None

    def _finish(self, jobs: list[Progress]) -> None:
        for progress in jobs:
            if progress.state == WAITING:
                self._submit(progress)
        self._look()
        while self._tasks:
            ended, _ = ray.wait(list(self._tasks), timeout=LOOK)
            for task in ended:
                self._end(task, self._tasks.pop(task))
            self._look()

    def _submit(self, progress: Progress) -> None:
        progress.attempt += 1
        progress.state = WAITING
        # Where a job was interrupted it may go on only if no other machine is left.
        others = self._machines() - set(self._banned) - progress.shunned
        progress.avoided = set(self._banned) | (progress.shunned if others else set())
        order = worker.Order(progress.job, progress.attempt, self._plan.program, self._program, self._cache)
        options: dict[str, Any] = {"num_cpus": 0, "resources": {RESOURCE: 1}, "max_retries": 0}
        if progress.avoided:
            options["label_selector"] = {"ray.io/node-id": f"!in({','.join(sorted(progress.avoided))})"}
        self._tasks[self._train.options(**options).remote(order, self._depot)] = progress

    @staticmethod
    def _machines() -> set[str]:
        return {node["NodeID"] for node in ray.nodes() if node["Alive"] and node["Resources"].get(RESOURCE, 0) >= 1}

    def _look(self) -> None:
        """Takes in what the workers say, and looks for tasks that no machine may take any more."""
        self._learn()
        machines = self._machines()
        for task, progress in [(task, progress) for task, progress in self._tasks.items() if progress.state == WAITING]:
            if not machines:
                progress.problem = NOBODY
            elif machines <= progress.avoided | set(self._banned):
                ray.cancel(task)
                del self._tasks[task]
                if machines <= set(self._banned):
                    self._fail(progress, "no machine is left: " + "; ".join(sorted(set(self._banned.values()))))
                else:
                    self._submit(progress)
            elif progress.problem == NOBODY:
                progress.problem = ""
        self._show(self.jobs)

    def _learn(self) -> None:
        states: dict[str, JobState] = self._ask("states")
        for progress in self.jobs:
            progress.known = states[progress.job.id]
            if progress.state == WAITING and progress.known.attempt == progress.attempt > 0:
                progress.state = RUNNING

    def _end(self, task: Any, progress: Progress) -> None:
        self._learn()
        has_begun = progress.known.attempt == progress.attempt
        try:
            ray.get(task)
            progress.state = DONE
            return
        except RayTaskError as error:
            problem = error.cause
        except RayError as error:
            problem = error
        said = f"{progress.known.node if has_begun else 'a machine'}: {_said(problem)}"
        progress.problem = said
        if isinstance(problem, (PlanProblem, BlockProblem)):
            self._fail(progress, said)
        elif isinstance(problem, NodeProblem):
            self._banned[progress.known.node_id] = said
        else:
            self._interrupted(progress, said)
        if progress.state != FAILED:
            self._submit(progress)

    def _interrupted(self, progress: Progress, said: str) -> None:
        known = progress.known
        has_landed = known.landed > progress.landed
        progress.interruptions = 1 if has_landed else progress.interruptions + 1
        progress.landed = known.landed
        if known.attempt == progress.attempt:
            progress.shunned.add(known.node_id)
        if progress.interruptions >= MOST_INTERRUPTIONS:
            self._fail(progress, f"interrupted {progress.interruptions} times, the last time on {said}")

    @staticmethod
    def _fail(progress: Progress, problem: str) -> None:
        progress.state, progress.problem = FAILED, problem


def _said(problem: Exception) -> str:
    if isinstance(problem, RayError):
        first = str(problem).strip().splitlines()[0]
        return f"the worker has ended ({type(problem).__name__}: {first})"
    name = "" if type(problem).__module__.startswith("psrgs_cluster") else f"{type(problem).__name__}: "
    return f"{name}{problem}"
