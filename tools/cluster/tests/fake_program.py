#!/usr/bin/env python3
"""Plays `psrgs-vk blocks run` in a few seconds: reads what a block has, checkpoints, goes on from the last one.

What it writes depends on its input alone. The settings of the plan say how long a step takes and how large a checkpoint
is. The environment says which version the program has, and names a file that gets a line for each start.
"""

import hashlib
import json
import os
import sys
import time
from pathlib import Path

# Steps of a block and of the coarse model, and of a block between two checkpoints.
STEPS, GLOBAL_STEPS, EVERY = 20, 4, 4


def write(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.name}.tmp")
    unfinished.write_bytes(data)
    unfinished.rename(path)


def fail(code: int, message: str) -> None:
    print(f"error: {message}", file=sys.stderr)
    sys.exit(code)


def start(plan: Path, block: str, data: Path) -> tuple[bytes, str]:
    """The state of the training before the first step, a hash of all that the block is made from; and the settings."""
    digest = hashlib.sha256((plan / "blocks.json").read_bytes())
    described = json.loads((plan / "blocks.json").read_bytes())
    if block != "global":
        digest.update((plan / "global" / "point_cloud.ply").read_bytes())
        wanted = [p for b in described["blocks"] if b["id"] == block for p in b["photographs"]]
    else:
        every = {p["name"]: p for b in described["blocks"] for p in b["photographs"]}
        wanted = [every[name] for name in described["global"]["photographs"]]
    files = [f["name"] for f in described["dataset"]["files"]] + [p["file"] for p in wanted]
    files += [p["mask"]["name"] for p in wanted if "mask" in p]
    found = sorted(path.relative_to(data).as_posix() for path in data.rglob("*") if path.is_file())
    if found != sorted(files):
        fail(3, f"{data}: holds {found}, wanted {sorted(files)}")
    for name in sorted(files):
        content = (data / name).read_bytes()
        if b"damaged" in content:
            fail(3, f"{name}: the photograph cannot be decoded")
        if b"deadly" in content:
            fail(1, f"{name}: a defect of the program")
        digest.update(content)
    return digest.digest(), described["settings"]


def main() -> None:
    if sys.argv[1:] == ["--version"]:
        print(f"psrgs-vk {os.environ.get('FAKE_VERSION', '1.2.3')} (fake)")
        return
    plan, block, data = Path(sys.argv[3]), sys.argv[5], Path(sys.argv[7])
    assert sys.argv[1:3] + sys.argv[4:7:2] == ["blocks", "run", "--block", "--data"], sys.argv
    run = plan / ("global" if block == "global" else f"blocks/{block}")
    checkpoints = sorted(run.glob("checkpoints/*.ckpt"))
    step, text = json.loads(checkpoints[-1].read_bytes().splitlines()[0]) if checkpoints else (0, "")
    if events := os.environ.get("FAKE_EVENTS"):
        with open(events, "a") as file:
            file.write(f"{block} {step} {os.getpid()} {os.environ.get('FAKE_NODE', '?')}\n")
    first, settings = start(plan, block, data)
    state = bytes.fromhex(text) if checkpoints else first
    settings = dict(line.split(" = ") for line in settings.splitlines())
    write(run / "begun.json", b"{}")
    steps = GLOBAL_STEPS if block == "global" else STEPS
    while step < steps:
        step, state = step + 1, hashlib.sha256(state).digest()
        print(f"step {step} of {steps}", file=sys.stderr, flush=True)
        time.sleep(float(os.environ.get("FAKE_SECONDS", settings["seconds"])))
        if step % EVERY == 0:
            bulk = state * int(settings["bulk"])
            write(run / f"checkpoints/step_{step:06}.ckpt", json.dumps([step, state.hex()]).encode() + b"\n" + bulk)
            for old in sorted(run.glob("checkpoints/*.ckpt"))[:-2]:
                old.unlink()
    model = b"ply\n" + state * 1000
    write(run / "point_cloud.ply", model)
    done = {"format": "psrgs-vk block", "version": 1, "program": "1.2.3", "block": block}
    done |= {"plan_sha256": hashlib.sha256((plan / "blocks.json").read_bytes()).hexdigest()}
    done |= {"model_sha256": hashlib.sha256(model).hexdigest(), "splats": 1, "seconds": 1.0, "metrics": {}}
    write(run / "done.json", json.dumps(done).encode())


if __name__ == "__main__":
    try:
        main()
    except OSError as error:
        fail(8, f"cannot write {error.filename}: {error.strerror}")
