#!/usr/bin/env python3
"""Prints what the parts of psrgs are worth, and psrgs beside lean of as many splats or as much time, from the metrics kept in docs/results.

  tools/bench/parts_table.py

Files: ablate-320-1500-val-SCENE-psrgs-PART-s0.json beside starts-320-1500-val-SCENE-60k-5e-4-s0.json (nothing left out), and
equal-320-STEPS-SCENE-lean[-THRESHOLD]-sSEED.json beside compare-320-1500-SCENE-psrgs-sSEED.json; their times are compared with those of the
psrgs of their build, wide-320-1500-SCENE-psrgs-sSEED. Intervals are those of results_table.py.
"""

import json
import math

from results_table import DIGITS, METRICS, RESULTS, SCENES, quantile, seconds

PARTS = ["no-stereo", "no-stereo-splats", "no-depth-loss", "gate-off", "no-mask-growth", "no-error-growth", "no-coarse-steps", "no-pruning",
         "free-harmonics", "round-stereo-splats", "perceptual"]
SPLATS = {"fox": "1500-fox-lean-2.8e-4", "caliterra": "1500-caliterra-lean-2.8e-4", "copr": "1500-copr-lean-4e-4", "world": "1500-world-lean-2.8e-4"}
TIME = {"fox": "2500-fox-lean", "caliterra": "2200-caliterra-lean", "copr": "2100-copr-lean", "world": "2200-world-lean"}


def run(name):
    file = RESULTS / f"{name}.json"
    return json.loads(file.read_text()) if file.exists() else None


def time(name):
    return seconds(json.loads((RESULTS / f"{name}.process.json").read_text()))


def parts():
    print("| left out or changed | " + " | ".join(SCENES) + " |")
    print("|" + "---|" * (1 + len(SCENES)))
    base = {scene: run(f"starts-320-1500-val-{scene}-60k-5e-4-s0") for scene in SCENES}

    def row(name, cells):
        print(f"| {name} | {' | '.join(cells)} |")

    row("nothing", [f"{r['psnr']:.2f} dB, {r['ssim']:.4f}, {r['lpips_squeeze']:.4f}, {r['splats']:,}" for r in base.values()])
    for part in PARTS:
        runs = {scene: run(f"ablate-320-1500-val-{scene}-psrgs-{part}-s0") for scene in SCENES}
        if not any(runs.values()):
            continue
        change = lambda r, b, key: f"{100 * (r[key] / b[key] - 1):+.0f} %"
        cells = [f"{r['psnr'] - b['psnr']:+.2f} dB, {r['ssim'] - b['ssim']:+.4f}, {change(r, b, 'lpips_squeeze')}, {change(r, b, 'splats')}" if r else ""
                 for r, b in ((runs[s], base[s]) for s in SCENES)]
        row(part, cells)


def beside_lean():
    print("| lean with | scene | seed | PSNR, psrgs | PSNR, lean | SSIM, psrgs | SSIM, lean | LPIPS, psrgs | LPIPS, lean | GMSD, psrgs | GMSD, lean "
          "| splats of psrgs | CPU time of psrgs |\n|" + "---|" * 13)
    differences = {}
    for title, names in (("as many splats", SPLATS), ("as much time", TIME)):
        for scene, name in names.items():
            for seed in range(5):
                of = f"compare-320-1500-{scene}-psrgs-s{seed}"
                lean, psrgs = run(f"equal-320-{name}-s{seed}"), run(of)
                if not lean or not psrgs:
                    continue
                cells = [f"{r[m]:.{DIGITS.get(m, 4)}f}" for m in ("psnr", "ssim", "lpips_squeeze", "gmsd") for r in (psrgs, lean)]
                ratio = time(f"equal-320-{name}-s{seed}") / time(f"wide-320-1500-{scene}-psrgs-s{seed}")
                print(f"| {title} | {scene} | {seed} | {' | '.join(cells)} | {100 * lean['splats'] / psrgs['splats']:.0f} % | {ratio:.2f} |")
                for metric in METRICS:
                    differences.setdefault((title, metric), []).append(psrgs[metric] - lean[metric])
    print("\n| psrgs - lean | PSNR, dB | psnr_cc, dB | SSIM | LPIPS | GMSD | PSNR where texture is, dB | pairs |\n|" + "---|" * 8)
    for title in ("as many splats", "as much time"):
        cells = []
        for metric in METRICS:
            values = differences[title, metric]
            n, mean = len(values), sum(values) / len(values)
            half = quantile(n - 1) * math.sqrt(sum((v - mean) ** 2 for v in values) / (n - 1) / n)
            digits = DIGITS.get(metric, 4)
            cells.append(f"{mean:+.{digits}f} [{mean - half:+.{digits}f}, {mean + half:+.{digits}f}]{' *' if abs(mean) > half else ''}")
        print(f"| {title} | {' | '.join(cells)} | {n} |")


if __name__ == "__main__":
    parts()
    print()
    beside_lean()
