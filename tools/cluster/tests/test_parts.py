"""Parts of the package without a cluster: names, plans, files, the child, the depot, the drawing."""

import fcntl
import json
import os
import signal
import subprocess
import sys
import tempfile
import unittest
from dataclasses import replace
from pathlib import Path
from unittest import mock

import made_up
from cluster import is_running, wait_until

from psrgs_cluster import child, depot, files, names, picture, plan
from psrgs_cluster.errors import Interruption, PlanProblem
from psrgs_cluster.files import Cache, FileRecord, record_of


class Parts(unittest.TestCase):
    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory(prefix="psrgs-cluster-")
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def refused(self, word: str, call: object, *arguments: object, kind: type[Exception] = PlanProblem) -> None:
        with self.assertRaises(kind) as raised:
            call(*arguments)  # type: ignore[operator]
        self.assertIn(word, str(raised.exception))


class Names(Parts):
    def test_names_that_lead_out_are_refused(self) -> None:
        leading_out = ["", ".", "..", "/etc/passwd", "a/../b", "a//b", "a/", "C:a", "a\\b", "a\nb", "a\0b", "x" * 5000]
        for name in leading_out:
            self.assertFalse(names.is_inside(name), name)
            self.refused("leads out", names.to_write, self.folder, name)
            self.refused("leads out", names.to_read, self.folder, name)
        for name in ["a", "a/b.jpg", "ä ö/..b", "a..b"]:
            self.assertTrue(names.is_inside(name), name)

    def test_links_are_not_followed_out_of_a_folder(self) -> None:
        outside, inside = self.folder / "outside", self.folder / "inside"
        for folder in (outside, inside / "real"):
            folder.mkdir(parents=True)
            (folder / "a").write_text("a")
        (inside / "out").symlink_to(outside)
        (inside / "in").symlink_to("real")
        self.refused("a link leads out", names.to_read, inside, "out/a")
        self.assertEqual(names.to_read(inside, "in/a").read_text(), "a")
        for name in ("out/a", "in/a", "out"):
            self.refused("is a link", names.to_write, inside, name)
        for new in (inside / "new", self.folder / "another" / "new"):
            names.to_write(new, "a").write_text("a")
            names.to_write(new, "b/c").write_text("c")


class Plans(Parts):
    def setUp(self) -> None:
        super().setUp()
        self.plan = made_up.make(self.folder)

    def test_jobs_have_the_files_that_they_need(self) -> None:
        found = plan.read(self.plan)
        self.assertEqual([block.id for block in found.blocks], list(made_up.BLOCKS))
        shared = ["sparse/0/cameras.txt", "sparse/0/nothing.txt"]
        b01 = ["images/p2.jpg", "masks/p2.jpg.png", "images/p3.jpg", "masks/p3.jpg.png"]
        self.assertEqual([file.name for file in found.blocks[1].files], shared + b01)
        self.assertEqual(len(found.everything.files), 2 + 2 * 2)

    def test_plans_that_cannot_be_used_are_named(self) -> None:
        described = made_up.read(self.plan)
        block = described["blocks"][0]
        photograph = block["photographs"][0]
        files_of = described["dataset"]["files"]
        for place, key, value, word in (
            (described, "format", "else", "this is no plan of blocks"),
            (described, "version", 2, "plan anew"),
            (described, "blocks", [], "blocks: there is none"),
            (described, "blocks", [block, block], "have the same name"),
            (described, "dataset", None, "plan anew"),
            (block, "id", "../b00", "is no name of a block"),
            (block, "photographs", 7, "plan anew"),
            (photograph, "file", "../../etc/passwd", "leads out"),
            (photograph, "file", None, "lies outside of"),
            (photograph, "sha256", "A" * 64, "is no SHA-256"),
            (photograph, "bytes", -1, "is no length"),
            (photograph["mask"], "name", "/mask", "leads out"),
            (files_of[0], "name", "a/../../b", "leads out"),
            (described["global"], "photographs", ["else"], "is no photograph of any block"),
        ):
            before = place[key]
            place[key] = value
            made_up.write(self.plan, described)
            self.refused(word, plan.read, self.plan)
            place[key] = before
        text = json.dumps(described)
        for damaged in (text[: len(text) // 2], "", "7", "[]"):
            (self.plan / "blocks.json").write_text(damaged)
            self.refused("blocks.json", plan.read, self.plan)
        (self.plan / "blocks.json").unlink()
        self.refused("psrgs-vk blocks plan", plan.read, self.plan)

    def test_only_whole_results_of_this_plan_are_done(self) -> None:
        found = plan.read(self.plan)
        job, run = found.blocks[0], self.plan / "blocks/b00"
        self.assertFalse(plan.is_done(found, job))
        run.mkdir(parents=True)
        (run / "point_cloud.ply").write_text("model")
        model = record_of(run, "point_cloud.ply").sha256
        done = {"format": "psrgs-vk block", "block": "b00", "plan_sha256": found.sha256, "model_sha256": model}
        for key, value in (("format", "x"), ("block", "b01"), ("plan_sha256", "0" * 64), ("model_sha256", "0" * 64)):
            (run / "done.json").write_text(json.dumps({**done, key: value}))
            self.assertFalse(plan.is_done(found, job), key)
        for text in ("", "{", "[]", "7"):
            (run / "done.json").write_text(text)
            self.assertFalse(plan.is_done(found, job), text)
        (run / "done.json").write_text(json.dumps(done))
        self.assertTrue(plan.is_done(found, job))

    def test_blocks_are_coloured_by_state(self) -> None:
        picture.write(self.plan, {"b00": "done", "b01": "running", "b02": "failed", "b03": "waiting"})
        drawn = (self.plan / "progress.svg").read_text()
        for state, colour in picture.COLOURS.items():
            self.assertEqual(drawn.count(colour), 1, state)
        (self.plan / "plan.svg").write_text("<svg")
        self.refused("plan.svg", picture.write, self.plan, {})
        (self.plan / "plan.svg").unlink()
        picture.write(self.plan, {"b00": "done"})


class Files(Parts):
    def test_files_travel_in_pieces(self) -> None:
        (self.folder / "file").write_bytes(bytes(range(250)))
        record = record_of(self.folder, "file")
        asked: list[int] = []

        def pieces(sha256: str, index: int) -> bytes:
            self.assertEqual(sha256, record.sha256)
            asked.append(index)
            return files.read_piece(self.folder / "file", index)

        with mock.patch.object(files, "PIECE", 100):
            cache = Cache(self.folder / "cache")
            for _ in range(2):
                cache.place(record, self.folder / "copy", pieces)
                self.assertEqual((self.folder / "copy").read_bytes(), bytes(range(250)))
            self.assertEqual(asked, [0, 1, 2])
            # A damaged file of the cache is fetched again.
            kept = self.folder / "cache" / record.sha256[:2] / record.sha256
            kept.write_bytes(bytes(250))
            cache.place(record, self.folder / "copy", pieces)
            self.assertEqual((self.folder / "copy").read_bytes(), bytes(range(250)))

    def test_a_file_that_arrives_damaged_is_not_kept(self) -> None:
        record = FileRecord("a", "0" * 64, 3)
        fetch = Cache(self.folder / "cache").place
        self.refused("arrived damaged", fetch, record, self.folder / "a", lambda *_: b"abc", kind=Interruption)
        self.assertEqual([path for path in self.folder.rglob("*") if path.is_file()], [])


class Depots(Parts):
    def setUp(self) -> None:
        super().setUp()
        self.plan = plan.read(made_up.make(self.folder))
        self.depot = depot.Depot(self.plan)
        self.depot.open()
        self.addCleanup(lambda: os.close(self.depot._lock))

    def send(self, attempt: int, contents: dict[str, bytes], is_end: bool = False) -> None:
        worker = self.folder / "worker"
        for name, content in contents.items():
            (worker / name).parent.mkdir(parents=True, exist_ok=True)
            (worker / name).write_bytes(content)
        records = [record_of(worker, name) for name in contents]
        for record in self.depot.missing("b00", attempt, records):
            self.depot.take("b00", attempt, record.sha256, 0, contents[record.name])
        self.depot.publish("b00", attempt, records, is_end)

    def here(self) -> dict[str, bytes]:
        run = self.plan.folder / "blocks/b00"
        return {name: (run / name).read_bytes() for name in files.names_under(run)}

    def test_the_run_folder_becomes_equal_to_that_of_the_worker(self) -> None:
        self.depot.begin("b00", 1, "n", "node")
        for contents in (
            {"settings.toml": b"", "checkpoints/1": b"one", "same": b"one"},
            {"settings.toml": b"new", "checkpoints/1": b"one", "checkpoints/2": b"two"},
            {"checkpoints/3": b"two"},
        ):
            self.send(1, contents)
            self.assertEqual(self.here(), contents)
        _, earlier = self.depot.begin("b00", 2, "n", "node")
        self.assertEqual([record.name for record in earlier], ["blocks/b00/checkpoints/3"])
        self.assertEqual(self.depot.piece(earlier[0].sha256, 0), b"two")

    def test_a_replaced_attempt_writes_nothing(self) -> None:
        self.depot.begin("b00", 1, "n", "node")
        self.depot.begin("b00", 2, "n", "node")
        self.refused("has been replaced", self.send, 1, {"a": b"a"}, kind=Interruption)
        self.refused("has been replaced", self.depot.begin, "b00", 1, "n", "node", kind=Interruption)
        self.assertEqual(self.here(), {})

    def test_results_that_are_not_the_blocks_are_refused(self) -> None:
        self.depot.begin("b00", 1, "n", "node")
        self.send(1, {"checkpoints/1": b"one"})
        self.refused("done.json is missing", self.send, 1, {"point_cloud.ply": b"ply"}, True)
        self.refused("its format is", self.send, 1, {"point_cloud.ply": b"ply", "done.json": b'{"format": ""}'}, True)
        for name in ("../b01/point_cloud.ply", "/point_cloud.ply", "a/../../../x"):
            record = FileRecord(name, "0" * 64, 3)
            self.refused("", self.depot.publish, "b00", 1, [record], False, kind=Exception)
        damaged = FileRecord("a", "0" * 64, 3)
        self.depot.take("b00", 1, damaged.sha256, 0, b"abc")
        self.refused("arrived damaged", self.depot.publish, "b00", 1, [damaged], False, kind=Interruption)
        self.assertEqual(self.here(), {"checkpoints/1": b"one"})
        # Names are checked before anything is written.
        self.depot.take("b00", 1, damaged.sha256, 0, b"abc")
        good = replace(damaged, sha256=record_of(self.plan.folder.parent / "worker", "checkpoints/1").sha256)
        self.refused("leads out", self.depot.publish, "b00", 1, [replace(good, name="../../x")], False)
        self.assertEqual(self.here(), {"checkpoints/1": b"one"})

    def test_one_command_at_a_time_works_on_a_plan(self) -> None:
        with mock.patch.object(depot, "LONGEST_WAIT", 0.0):
            self.refused("another psrgs-cluster works on this plan", depot.Depot(self.plan).open)

    def test_a_block_that_another_program_trains_is_left_alone(self) -> None:
        run = self.plan.folder / "blocks/b00"
        run.mkdir(parents=True)
        with open(run / ".lock", "w") as other:
            fcntl.flock(other, fcntl.LOCK_EX)
            self.refused("another program trains this block", self.depot.begin, "b00", 1, "n", "node")
        self.depot.begin("b00", 2, "n", "node")
        with open(run / ".lock", "w") as other, self.assertRaises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)


class Child(Parts):
    def run_program(self) -> tuple["subprocess.Popen[bytes]", int, int]:
        """A parent, the launcher below it, and the program below the launcher."""
        script = (
            "import subprocess, sys, time\n"
            f"command = [sys.executable, '-I', {child.__file__!r}, 'sleep', '60']\n"
            "launcher = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)\n"
            "print(launcher.pid, flush=True)\n"
            "time.sleep(60)\n"
        )
        parent = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE)
        self.addCleanup(lambda: (parent.kill(), parent.wait(), parent.stdout.close()))
        launcher = int(parent.stdout.readline())
        children = Path(f"/proc/{launcher}/task/{launcher}/children")
        program = int(wait_until("the program starts", lambda: children.read_text().split())[0])
        return parent, launcher, program

    def test_a_program_ends_with_its_killed_parent(self) -> None:
        parent, launcher, program = self.run_program()
        self.assertTrue(is_running(program))
        parent.kill()
        wait_until("the program ends", lambda: not is_running(program) and not is_running(launcher), 10)

    def test_a_program_ends_with_its_killed_launcher(self) -> None:
        _, launcher, program = self.run_program()
        os.kill(launcher, signal.SIGKILL)
        wait_until("the program ends", lambda: not is_running(program), 10)

    def test_a_child_passes_the_exit_code_on(self) -> None:
        for script, code in (("exit 7", 7), ("kill -9 $$", 137)):
            command = [sys.executable, "-I", child.__file__, "sh", "-c", script]
            process = subprocess.Popen(command, stdin=subprocess.PIPE)
            self.assertEqual(process.wait(10), code)
            process.stdin.close()


if __name__ == "__main__":
    unittest.main(verbosity=2)
