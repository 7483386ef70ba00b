"""A cluster of Ray on this machine, and the command beside it."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

FAKE = Path(__file__).with_name("fake_program.py")
TOKEN = "0123456789abcdef" * 2
# Before Ray is loaded: Ray reads its environment then.
os.environ |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": TOKEN, "RAY_USAGE_STATS_ENABLED": "0"}
STORE = 200 << 20
# Machines have caches of their own, but what drivers have compiled is that of this machine: compiling again takes longer
# than the trainings of the tests.
_KEPT = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
COMPILED = {"PSRGS_CACHE": str(_KEPT / "psrgs-vk"), "MESA_SHADER_CACHE_DIR": str(_KEPT)}


class Start(NamedTuple):
    """A start of the fake program."""

    block: str
    step: int
    process: int
    machine: str


class TwoMachines:
    """A head without devices, on which commands run, and machines with a device each: usually two."""

    def __init__(self, folder: Path) -> None:
        from ray.cluster_utils import Cluster

        self.folder = folder
        self.events = folder / "events"
        self.cluster = Cluster(
            initialize_head=True,
            head_node_args={
                "num_cpus": 0,
                "object_store_memory": STORE,
                "include_dashboard": False,
                "include_log_monitor": False,
                # A machine that is gone is noticed within 3 seconds, not 15 and more.
                "_system_config": {
                    "health_check_initial_delay_ms": 1000,
                    "health_check_period_ms": 1000,
                    "health_check_failure_threshold": 3,
                },
            },
        )
        # By name; with whether the machine is like any other.
        self._machines: dict[str, tuple[Any, bool]] = {}
        self._count = 0

    def add(self, cache: str | None = None, **environment: str) -> str:
        """A machine whose workers may have an environment of their own. Returns its name."""
        self._count += 1
        name = f"machine{self._count}"
        own = {"XDG_CACHE_HOME": cache or str(self.folder / name), "FAKE_NODE": name, "FAKE_EVENTS": str(self.events)}
        node = self.cluster.add_node(
            num_cpus=1,
            resources={"vulkan": 1},
            object_store_memory=STORE,
            include_log_monitor=False,
            env_vars=own | COMPILED | environment,
            wait=True,
        )
        self._machines[name] = (node, not cache and not environment)
        return name

    def remove(self, name: str) -> None:
        """Removes a machine at once, as if its power were cut."""
        self.cluster.remove_node(self._machines.pop(name)[0], allow_graceful=False)

    def keep(self, count: int) -> None:
        """Leaves or adds as many usual machines."""
        usual = [name for name, (_, is_usual) in self._machines.items() if is_usual]
        for name in set(self._machines) - set(usual[:count]):
            self.remove(name)
        for _ in range(count - len(usual)):
            self.add()

    def start(self, plan: Path, *options: str, **environment: str) -> "subprocess.Popen[str]":
        command = [sys.executable, "-c", "import sys; from psrgs_cluster.command import main; sys.exit(main())"]
        arguments = ["run", str(plan), "--address", self.cluster.address, *(options or ["--program", str(FAKE)])]
        # Not into pipes: nobody would read them while a test waits.
        said = tempfile.TemporaryFile("w+")
        process = subprocess.Popen(
            command + arguments, stdin=subprocess.DEVNULL, stdout=said, stderr=said, env={**os.environ, **environment}
        )
        process.said = said  # type: ignore[attr-defined]
        return process  # type: ignore[return-value]

    def run(self, plan: Path, *options: str, **environment: str) -> tuple[int, str]:
        return end(self.start(plan, *options, **environment))

    def started(self) -> list[Start]:
        """All starts of the fake program."""
        lines = self.events.read_text().split("\n")[:-1] if self.events.exists() else []
        return [Start(block, int(step), int(pid), node) for block, step, pid, node in map(str.split, lines)]


def end(process: Any) -> tuple[int, str]:
    """Exit code and what the command said."""
    code = process.wait(timeout=180)
    with process.said:
        return code, said_by(process)


def said_by(process: Any) -> str:
    """What the command has said so far. The place at which the command writes stays."""
    file = process.said.fileno()
    return os.pread(file, os.fstat(file).st_size, 0).decode()


def wait_until(what: str, condition: Any, seconds: float = 90.0, command: Any = None) -> Any:
    """Waits until a condition holds, at most until a command ends."""
    begin = time.monotonic()
    while not (found := condition()):
        if command is not None and command.poll() is not None:
            raise AssertionError(f"the command ended without {what}: {end(command)[1]}")
        if time.monotonic() - begin > seconds:
            raise AssertionError(f"not within {seconds} s: {what}")
        time.sleep(0.05)
    return found


def is_running(pid: int) -> bool:
    """Whether a process runs; one that has ended and waits for its parent does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


def parent_of(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
