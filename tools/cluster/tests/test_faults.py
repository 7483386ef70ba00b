"""What happens to a training on a cluster when machines, workers, commands and disks fail."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path
from typing import Any

import made_up
from cluster import FAKE, Start, TwoMachines, end, is_running, parent_of, said_by, wait_until

from psrgs_cluster.picture import COLOURS

# The program itself, and its exit code where there is no device.
PROGRAM = os.environ.get("PSRGS_PROGRAM", "")
NO_DEVICE = 4


def undisturbed(plan: Path) -> dict[str, str]:
    """Hashes of the models of a plan that is trained here, without any cluster."""
    whole = plan.parent / "undisturbed"
    shutil.copytree(plan, whole, ignore=shutil.ignore_patterns("global", "blocks", ".cluster"))
    described = made_up.read(plan)
    for job in ("global", *made_up.BLOCKS):
        data = plan.parent / "data_of" / job
        every = {p["name"]: p for block in described["blocks"] for p in block["photographs"]}
        of = next((b["photographs"] for b in described["blocks"] if b["id"] == job), None)
        wanted = of if of is not None else [every[name] for name in described["global"]["photographs"]]
        files = [f["name"] for f in described["dataset"]["files"]]
        files += [name for p in wanted for name in (p["file"], p["mask"]["name"])]
        for name in files:
            (data / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(plan.parent / "data" / name, data / name)
        command = [sys.executable, FAKE, "blocks", "run", whole, "--block", job, "--data", data]
        subprocess.run(command, check=True, capture_output=True, env={**os.environ, "FAKE_SECONDS": "0"})
    return made_up.models(whole)


def psrgs(*arguments: object) -> None:
    """Runs the program itself. On a machine without a device the test is skipped."""
    command = [PROGRAM, *map(str, arguments)]
    ended = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    if ended.returncode == NO_DEVICE:
        raise unittest.SkipTest("no Vulkan device")
    if ended.returncode != 0:
        raise AssertionError(f"{command}: {ended.stderr}")


def stopped_in_a_block(root: Path) -> tuple[int, str] | None:
    """A process that trains a block in a folder below `root` and has written a checkpoint, and the block. The process is
    stopped: however fast the machine is, the block does not end before the test goes on."""
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        # A process may end at any moment.
        with contextlib.suppress(OSError):
            words = file.read_bytes().decode(errors="replace").split("\0")
            if words[0] != PROGRAM or words[1:3] != ["blocks", "run"] or not words[3].startswith(str(root)):
                continue
            for checkpoint in Path(words[3]).glob("blocks/*/checkpoints/checkpoint-*"):
                os.kill(int(file.parent.name), signal.SIGSTOP)
                return int(file.parent.name), checkpoint.parts[-3]
    return None


class Faults(unittest.TestCase):
    machines: TwoMachines
    root: Path

    @classmethod
    def setUpClass(cls) -> None:
        cls.root = Path(tempfile.mkdtemp(prefix="psrgs-cluster-"))
        cls.machines = TwoMachines(cls.root)

    @classmethod
    def tearDownClass(cls) -> None:
        cls.machines.cluster.shutdown()
        shutil.rmtree(cls.root, ignore_errors=True)

    def setUp(self) -> None:
        self.folder = self.root / self._testMethodName
        self.machines.events.unlink(missing_ok=True)
        self.machines.keep(2)

    def assert_equal_bits(self, plan: Path) -> None:
        found = made_up.models(plan)
        self.assertEqual(list(found), ["global", *made_up.BLOCKS])
        self.assertEqual(found, undisturbed(plan))

    def start_of(self, block: str) -> Start:
        """The last start of the program for a block."""
        return [start for start in self.machines.started() if start.block == block][-1]

    def in_the_middle(self, plan: Path, command: Any) -> Start:
        """The training of a block of which a checkpoint has landed, and which goes on for a while."""

        def landed() -> str | None:
            for block in made_up.BLOCKS:
                steps = [int(path.stem[-6:]) for path in (plan / "blocks" / block).glob("checkpoints/*.ckpt")]
                if steps and max(steps) <= 12:
                    return block
            return None

        return self.start_of(wait_until("a checkpoint", landed, command=command))

    def assert_goes_on_elsewhere(self, plan: Path, command: Any, before: Start) -> None:
        """The program of a block that was interrupted has ended, and goes on from a checkpoint on another machine."""
        wait_until("the program ends with its worker", lambda: not is_running(before.process))
        code, said = end(command)
        self.assertEqual(code, 0, said)
        after = self.start_of(before.block)
        self.assertGreater(after.step, 0)
        self.assertNotEqual(after.machine, before.machine)
        self.assert_equal_bits(plan)

    def test_two_machines_share_the_blocks(self) -> None:
        plan = made_up.make(self.folder)
        code, said = self.machines.run(plan)
        self.assertEqual(code, 0, said)
        self.assertIn("all blocks are done", said)
        started = self.machines.started()
        self.assertEqual(({start.step for start in started}, len({start.machine for start in started})), ({0}, 2))
        self.assertEqual((plan / "progress.svg").read_text().count(COLOURS["done"]), 4)
        self.assert_equal_bits(plan)
        # All is done: nothing starts again.
        code, said = self.machines.run(plan)
        self.assertEqual((code, len(self.machines.started())), (0, 5), said)

    def test_a_removed_machine_loses_nothing_that_landed(self) -> None:
        plan = made_up.make(self.folder, seconds=0.15)
        command = self.machines.start(plan)
        before = self.in_the_middle(plan, command)
        self.machines.remove(before.machine)
        self.assert_goes_on_elsewhere(plan, command, before)

    def test_a_killed_worker_is_replaced_by_another_machine(self) -> None:
        plan = made_up.make(self.folder, seconds=0.15)
        command = self.machines.start(plan)
        before = self.in_the_middle(plan, command)
        os.kill(parent_of(parent_of(before.process)), signal.SIGKILL)
        self.assert_goes_on_elsewhere(plan, command, before)

    def test_a_killed_command_goes_on_when_started_again(self) -> None:
        plan = made_up.make(self.folder, seconds=0.15)
        command = self.machines.start(plan)
        done = wait_until("a finished block", lambda: next(plan.glob("blocks/*/done.json"), None)).parent.name
        before = self.in_the_middle(plan, command)
        command.kill()
        wait_until("the program ends with the command", lambda: not is_running(before.process))
        count = len(self.machines.started())
        code, said = self.machines.run(plan)
        self.assertEqual(code, 0, said)
        again = self.machines.started()[count:]
        self.assertNotIn(done, [start.block for start in again])
        self.assertGreater(self.start_of(before.block).step, 0)
        self.assert_equal_bits(plan)

    def test_machines_that_cannot_train_are_told_and_left_out(self) -> None:
        plan = made_up.make(self.folder, bulk=20_000)
        disk = self.folder / "disk"
        disk.mkdir()
        mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "none", str(disk)]
        if subprocess.run(mount, capture_output=True).returncode != 0:
            self.skipTest("a small disk cannot be mounted here")
        self.machines.keep(0)
        command = self.machines.start(plan)
        nobody = "waiting  no machine of the cluster has a device yet"
        wait_until("word that nobody trains", lambda: nobody in said_by(command), command=command)
        self.machines.add(cache=str(disk))
        self.machines.add(FAKE_VERSION="9.9.9")
        code, said = end(command)
        self.assertEqual(code, 1, said)
        self.assertIn("no machine is left: ", said)
        self.assertIn("fake_program.py is psrgs-vk 9.9.9, and the plan is of 1.2.3; install psrgs-vk 1.2.3 there", said)
        self.assertIn("No space left on device", said)
        good = self.machines.add()
        code, said = self.machines.run(plan)
        self.assertEqual(code, 0, said)
        self.assertEqual({self.start_of(block).machine for block in made_up.BLOCKS}, {good}, said)
        self.assert_equal_bits(plan)
        subprocess.run(["umount", "--lazy", str(disk)], check=True)

    def test_a_missing_photograph_fails_its_blocks_alone(self) -> None:
        # Content of its own: what lies in the cache of a machine is not asked for.
        words = {"p5": b"elsewhere", "p7": b"elsewhere"}
        plan = made_up.make(self.folder, words=words)
        images = self.folder / "data/images"
        (images / "p5.jpg").rename(images / "gone.jpg")
        kept = (images / "p7.jpg").read_bytes()
        (images / "p7.jpg").write_bytes(kept[::-1])
        code, said = self.machines.run(plan)
        self.assertEqual(code, 1, said)
        self.assertRegex(said, f"error: b02: .*{images}/p5.jpg: is missing; put the file back")
        self.assertRegex(said, f"error: b03: .*{images}/p7.jpg: has changed since the plan was made")
        self.assertEqual(list(made_up.models(plan)), ["global", "b00", "b01"])
        (images / "gone.jpg").rename(images / "p5.jpg")
        (images / "p7.jpg").write_bytes(kept)
        code, said = self.machines.run(plan)
        self.assertEqual(code, 0, said)
        self.assert_equal_bits(plan)

    def test_a_refusal_of_the_program_is_told_in_its_own_words(self) -> None:
        plan = made_up.make(self.folder, words={"p5": b"deadly", "p7": b"damaged"})
        code, said = self.machines.run(plan)
        self.assertEqual(code, 1, said)
        ended = "fake_program.py ended with code"
        self.assertRegex(said, f"error: b02: interrupted 3 times, .*{ended} 1: error: images/p5.jpg: a defect")
        self.assertRegex(said, f"error: b03: .*{ended} 3: error: images/p7.jpg: the photograph cannot be decoded")
        # A refusal holds on every machine; what else goes wrong is tried again.
        blocks = [start.block for start in self.machines.started()]
        self.assertEqual((blocks.count("b02"), blocks.count("b03")), (3, 1), said)
        self.assertEqual(list(made_up.models(plan)), ["global", "b00", "b01"])

    def test_a_command_without_the_token_is_refused(self) -> None:
        plan = made_up.make(self.folder)
        code, said = self.machines.run(plan, RAY_AUTH_MODE="disabled")
        self.assertEqual(code, 2, said)
        self.assertIn("RAY_AUTH_MODE=token must be set", said)
        for token in ("f" * 32, ""):
            # Ray tries a refused token once a second.
            few = {"RAY_NUM_REDIS_GET_RETRIES": "2"}
            code, said = self.machines.run(plan, RAY_AUTH_TOKEN=token, HOME=str(self.folder), **few)
            self.assertEqual(code, 3, said)
            self.assertIn("error: --address", said)
            self.assertNotIn("f" * 32, said)

    @unittest.skipUnless(PROGRAM, "no psrgs-vk was named")
    def test_the_program_goes_on_elsewhere_with_equal_bits(self) -> None:
        data, alone, plan = (self.folder / name for name in ("data", "alone", "plan"))
        plain = ["--extent", "40", "--offpath", "0", "--lidar-density", "0.1", "--effects", "none", "--no-train"]
        psrgs("demo", "--out", data, "--images", "8", "--max-side", "96", *plain)
        steps = ["--iterations", "80", "--checkpoint-every", "8", "--deterministic", "--split", "none"]
        small = ["--max-side", "96", "--set", "stereo-side=32", "--set", "stereo-splats=300"]
        psrgs("blocks", "plan", data, "--out", alone, "--blocks", "2", *small, *steps)
        shutil.copytree(alone, plan)
        psrgs("blocks", "run", alone)
        psrgs("blocks", "merge", alone, "--no-scores")

        command = self.machines.start(plan, "--program", PROGRAM)
        trained, block = wait_until(
            "a checkpoint of a block", lambda: stopped_in_a_block(self.folder.parent), command=command
        )
        landed = plan / "blocks" / block / "checkpoints"
        wait_until("the checkpoint lands", lambda: next(landed.glob("checkpoint-*"), None), command=command)
        os.kill(parent_of(parent_of(trained)), signal.SIGKILL)
        wait_until("the program ends with its worker", lambda: not is_running(trained))
        code, said = end(command)
        self.assertEqual(code, 0, said)
        self.assertIn(f"{block}    running  on 127.0.0.1  attempt 2", said)
        psrgs("blocks", "merge", plan, "--no-scores")
        merged = [(folder / "point_cloud.ply").read_bytes() for folder in (alone, plan)]
        self.assertEqual(len(merged[0]), len(merged[1]))
        self.assertTrue(merged[0] == merged[1])
        self.assertEqual((plan / "progress.svg").read_text().count(COLOURS["done"]), 2)


if __name__ == "__main__":
    unittest.main(verbosity=2)
