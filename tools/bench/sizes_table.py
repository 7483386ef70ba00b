#!/usr/bin/env python3
"""Prints what rules for the size of splats come to, from the metrics kept in docs/results.

  tools/bench/sizes_table.py

Files: sizes-320-1500-val-SCENE-METHOD-RULE-s0.json (validation photographs; what is kept without "val" is of test photographs), and for `box` without a rule and with the one of 3dgs
others-320-1500-val-box-METHOD-FORM-s0.json.
"""

import json

from results_table import RESULTS

# Rules, and what the forms of others_table.py call them.
RULES = {"extent-0.1": "before", "any-size": "", "distance-0.1": None, "distance-0.2": None, "screen-0.3": None, "screen-0.6": None,
         "screen-1": None, "twice-0.1": None, "twice-0.2": None, "ended-0.2": None}
COLUMNS = [("psrgs", "box"), ("psrgs", "caliterra"), ("psrgs", "world"), ("lean", "box"), ("lean", "world")]


def load(method, scene, rule):
    names = [f"sizes-320-1500-val-{scene}-{method}-{rule}-s0.json"]
    if RULES[rule] is not None:
        names.append("-".join(filter(None, ["others-320-1500-val", scene, method, RULES[rule], "s0.json"])))
    for file in map(RESULTS.joinpath, names):
        if file.exists():
            return json.loads(file.read_text())
    return None


def cell(run):
    if run is None:
        return ""
    words = [f"{run['psnr']:.2f}"]
    if run.get("lpips_squeeze") is not None:
        words.append(f"{run['lpips_squeeze']:.4f}")
    if run.get("psnr_offpath") is not None:
        words.append(f"{run['psnr_offpath']:.2f} and {100 * run['depth_median_error_offpath']:.1f} % off the path")
    return ", ".join(words)


def main():
    print("| rule | " + " | ".join(f"{method}, {scene}" for method, scene in COLUMNS) + " |\n|" + "---|" * (1 + len(COLUMNS)))
    for rule in RULES:
        cells = [cell(load(method, scene, rule)) for method, scene in COLUMNS]
        if any(cells):
            print(f"| {rule} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
