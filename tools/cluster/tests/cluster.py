"""A cluster of Ray on this machine, and the command beside it."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

FAKE = Path(__file__).with_name("fake_program.py")
TOKEN = "0123456789abcdef" * 2
# Before Ray is loaded: Ray reads its environment then.
os.environ |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": TOKEN, "RAY_USAGE_STATS_ENABLED": "0"}
os.environ["RAY_DEDUP_LOGS"] = "0"
STORE = 200 << 20


class TwoMachines:
    """A head without devices, on which commands run, and machines with a device each."""

    def __init__(self, folder: Path) -> None:
        from ray.cluster_utils import Cluster

        self.folder = folder
        self.events = folder / "events"
        self.cluster = Cluster(
            initialize_head=True,
            head_node_args={"num_cpus": 0, "object_store_memory": STORE, "include_dashboard": False},
        )
        self._count = 0

    def add(self, **environment: str) -> Any:
        """A machine whose workers have an environment of their own."""
        self._count += 1
        name = f"machine{self._count}"
        cache = environment.pop("cache", str(self.folder / name))
        own = {"XDG_CACHE_HOME": cache, "FAKE_NODE": name, "FAKE_EVENTS": str(self.events), **environment}
        node = self.cluster.add_node(
            num_cpus=1, resources={"vulkan": 1}, object_store_memory=STORE, env_vars=own, wait=True
        )
        node.name = name
        return node

    def remove(self, node: Any, gently: bool = False) -> None:
        self.cluster.remove_node(node, allow_graceful=gently)

    def start(self, plan: Path, *options: str, **environment: str) -> "subprocess.Popen[str]":
        command = [sys.executable, "-c", "import sys; from psrgs_cluster.command import main; sys.exit(main())"]
        arguments = ["run", str(plan), "--address", self.cluster.address, "--program", str(FAKE), *options]
        # Not into pipes: nobody would read them while a test waits.
        said = tempfile.TemporaryFile("w+")
        process = subprocess.Popen(
            command + arguments, stdin=subprocess.DEVNULL, stdout=said, stderr=said, env={**os.environ, **environment}
        )
        process.said = said  # type: ignore[attr-defined]
        return process  # type: ignore[return-value]

    def run(self, plan: Path, *options: str, **environment: str) -> tuple[int, str]:
        return end(self.start(plan, *options, **environment))

    def started(self) -> list[tuple[str, int, int, str]]:
        """Starts of the program: block, first step, process, machine."""
        lines = self.events.read_text().split("\n")[:-1] if self.events.exists() else []
        return [(block, int(step), int(pid), node) for block, step, pid, node in map(str.split, lines)]


def end(process: Any) -> tuple[int, str]:
    """Exit code and what the command said."""
    code = process.wait(timeout=90)
    process.said.seek(0)
    return code, process.said.read()


def wait_until(what: str, condition: Any, seconds: float = 40.0) -> Any:
    begin = time.monotonic()
    while not (found := condition()):
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
