"""The plan's drawing with its blocks coloured by state."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from .errors import PlanProblem

# The drawing that the program writes, and the coloured one.
PLAN_PICTURE, PICTURE = "plan.svg", "progress.svg"
COLOURS = {"waiting": "#d9d9d9", "running": "#fdd870", "done": "#8fd694", "failed": "#ef8a7d"}
SVG = "http://www.w3.org/2000/svg"


def write(folder: Path, states: dict[str, str]) -> None:
    """Colours the element of each block, whose id is the block's name. Without the plan's drawing there is none."""
    try:
        tree = ElementTree.parse(folder / PLAN_PICTURE)
    except FileNotFoundError:
        return
    except (OSError, ElementTree.ParseError) as error:
        raise PlanProblem(f"{folder / PLAN_PICTURE}: {error}; plan anew, or remove the drawing") from error
    ElementTree.register_namespace("", SVG)
    for element in tree.iter():
        state = states.get(element.get("id", ""))
        if state is not None:
            element.set("style", f"fill:{COLOURS[state]};fill-opacity:0.6")
            ElementTree.SubElement(element, f"{{{SVG}}}title").text = f"{element.get('id')}: {state}"
    unfinished = folder / f".{PICTURE}.part"
    tree.write(unfinished, encoding="utf-8", xml_declaration=True)
    os.replace(unfinished, folder / PICTURE)
