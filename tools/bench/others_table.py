#!/usr/bin/env python3
"""Prints what methods make of scenes of others, from the metrics kept in docs/results: PSNR, SSIM, LPIPS, splats and seconds of processor time.

  tools/bench/others_table.py [val]

Files: others-320-1500-SCENE-METHOD-s0.json (test photographs), others-320-1500-val-SCENE-METHOD-s0.json (validation photographs), each with
its .process.json.
"""

import json
import sys

from results_table import RESULTS, seconds

SCENES = ["box", "can", "cup", "lego"]
# Forms of a method, in the order in which they were tried; the last of each is what there is.
FORMS = ["3dgs", "3dgs-any-size", "lean-before", "lean-size-0.3", "lean", "psrgs-before", "psrgs-any-size", "psrgs-any-size-no-stereo",
         "psrgs-any-size-no-stereo-grow-on", "psrgs-any-size-grow-on", "psrgs-8k", "psrgs-8k-grow-on", "psrgs-10k", "psrgs-10k-until-half",
         "psrgs-10k-grow-on", "psrgs-22k", "psrgs-22k-grow-on", "psrgs-until-half", "psrgs-skirt", "psrgs", "psrgs-fine", "3dgs-today", "psrgs-short-memory", "psrgs-today", "psrgs-early"]


def cell(prefix, scene, form):
    file = RESULTS / f"{prefix}-{scene}-{form}-s0.json"
    if not file.exists():
        return ""
    run, process = json.loads(file.read_text()), json.loads(file.with_suffix(".process.json").read_text())
    return f"{run['psnr']:.2f}, {run['ssim']:.4f}, {run['lpips_squeeze']:.4f}, {run['splats']:,}, {seconds(process):.0f} s"


def main():
    prefix = "others-320-1500-val" if sys.argv[1:] == ["val"] else "others-320-1500"
    print("| | " + " | ".join(SCENES) + " |\n|" + "---|" * (1 + len(SCENES)))
    for form in FORMS:
        cells = [cell(prefix, scene, form) for scene in SCENES]
        if any(cells):
            print(f"| {form} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
