"""Datasets and plans of a few small files."""

import hashlib
import json
from pathlib import Path

BLOCKS = ("b00", "b01", "b02", "b03")


def record(folder: Path, name: str) -> dict[str, object]:
    data = (folder / name).read_bytes()
    return {"name": name, "sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)}


def photograph(data: Path, name: str) -> dict[str, object]:
    kept = record(data, f"images/{name}")
    mask = record(data, f"masks/{name}.png")
    return {**kept, "name": name, "file": kept["name"], "share": 0.5, "mask": mask}


def make(folder: Path, seconds: float = 0.03, bulk: int = 1, words: dict[str, bytes] | None = None) -> Path:
    """A dataset and a plan of four blocks that share photographs. Returns the plan's folder.

    A step of the fake program takes so many seconds, and a checkpoint has so many times 32 bytes. Photographs may begin
    with words of their own; p5 belongs to b02 alone, and p7 to b03.
    """
    data, plan = folder / "data", folder / "plan"
    for name in ("images", "masks", "sparse/0"):
        (data / name).mkdir(parents=True)
    (data / "sparse/0/cameras.txt").write_text("cameras\n")
    (data / "sparse/0/nothing.txt").write_text("")
    for k in range(8):
        (data / f"images/p{k}.jpg").write_bytes((words or {}).get(f"p{k}", b"") + bytes([k]) * (1000 + k))
        (data / f"masks/p{k}.jpg.png").write_bytes(bytes([100 + k]) * 20)
    blocks = [
        {
            "id": block,
            "cell": [None, None, None, None],
            "margin": 1.0,
            "photographs": [photograph(data, f"p{2 * k + i}.jpg") for i in range(2)],
            "steps": 20,
            "predicted_splats": 100,
            "predicted_memory": 1000,
            "predicted_seconds": None,
        }
        for k, block in enumerate(BLOCKS)
    ]
    described = {
        "format": "psrgs-vk blocks",
        "version": 1,
        "program": "1.2.3",
        "dataset": {
            "path": str(data),
            "model_sha256": "0" * 64,
            "photographs": 8,
            "files": [record(data, f"sparse/0/{name}.txt") for name in ("cameras", "nothing")],
        },
        "settings": f"seconds = {seconds}\nbulk = {bulk}",
        "seed": 0,
        "ground": {},
        "global": {"photographs": ["p0.jpg", "p3.jpg"], "max_side": 8, "steps": 20, "max_splats": 10},
        "blocks": blocks,
    }
    plan.mkdir()
    write(plan, described)
    rectangles = "".join(f'<rect id="{block}" width="1" height="1"/>' for block in BLOCKS)
    (plan / "plan.svg").write_text(f'<svg xmlns="http://www.w3.org/2000/svg">{rectangles}</svg>')
    return plan


def read(plan: Path) -> dict:
    return json.loads((plan / "blocks.json").read_text())


def write(plan: Path, described: dict) -> None:
    (plan / "blocks.json").write_text(json.dumps(described))


def models(plan: Path) -> dict[str, str]:
    """Hashes of the models of a plan's folder."""
    found = sorted(plan.glob("global/point_cloud.ply")) + sorted(plan.glob("blocks/*/point_cloud.ply"))
    return {path.parent.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in found}
