#!/usr/bin/env python3
"""Prints what methods make of scenes that nothing but the rules for them was chosen on, from the metrics kept in docs/results.

  tools/bench/others_table.py [val]

Files: others-320-1500-SCENE-METHOD-s0.json (test photographs), others-320-1500-val-SCENE-METHOD-s0.json (validation photographs), each with
its .process.json (processor time).
"""

import json
import sys

from results_table import RESULTS, seconds

SCENES = ["box", "can", "cup", "lego"]


def main():
    prefix = "others-320-1500-val" if sys.argv[1:] == ["val"] else "others-320-1500"
    print("| scene | method | PSNR | SSIM | LPIPS | GMSD | splats | CPU seconds |\n|" + "---|" * 8)
    for scene in SCENES:
        files = sorted(RESULTS.glob(f"{prefix}-{scene}-*-s0.json"), key=lambda f: (not f.name.startswith(f"{prefix}-{scene}-3dgs"), f.name))
        for file in files:
            run = json.loads(file.read_text())
            method = file.name[len(f"{prefix}-{scene}-"):-len("-s0.json")]
            time = seconds(json.loads(file.with_suffix(".process.json").read_text()))
            print(f"| {scene} | {method} | {run['psnr']:.2f} | {run['ssim']:.4f} | {run['lpips_squeeze']:.4f} | {run['gmsd']:.4f} | {run['splats']:,} "
                  f"| {time:.0f} |")


if __name__ == "__main__":
    main()
