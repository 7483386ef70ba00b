#!/usr/bin/env python3
"""Prints what methods make of the same number of splats, from the metrics kept in docs/results.

  tools/bench/splats_table.py

Files: percent-320-1500-SCENE-METHOD-SHAREpercent-s0.json (at most that share of the splats of 3dgs) and compare-320-1500-SCENE-METHOD-s0.json
(without a limit).
"""

import json

from results_table import RESULTS, SCENES

METHODS = ["3dgs", "absgs", "gspro", "rsgs", "lean", "psrgs-paper", "psrgs"]
SHARES = [25, 50, 70, 100, None]


def run(scene, method, share):
    name = f"percent-320-1500-{scene}-{method}-{share}percent-s0" if share else f"compare-320-1500-{scene}-{method}-s0"
    file = RESULTS / f"{name}.json"
    return json.loads(file.read_text()) if file.exists() else None


def main():
    print("| scene | at most | " + " | ".join(METHODS) + " |\n|" + "---|" * (2 + len(METHODS)))
    for scene in SCENES:
        for share in SHARES:
            runs = [run(scene, method, share) for method in METHODS]
            if not any(runs):
                continue
            cells = [f"{r['psnr']:.2f}, {r['lpips_squeeze']:.3f}, {r['splats'] / 1000:.0f}k" if r else "" for r in runs]
            print(f"| {scene} | {f'{share} %' if share else 'no limit'} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
