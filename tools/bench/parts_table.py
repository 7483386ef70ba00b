#!/usr/bin/env python3
"""Prints what the parts of psrgs are worth, and psrgs beside lean of as many splats or as much time, from the metrics kept in docs/results.

  tools/bench/parts_table.py

Files: parts-early-320-1500-val-SCENE-PART-s0.json beside early-320-1500-val-SCENE-64-dssim-0.3-thresholds-2.4e-3-s0.json (nothing left out);
of earlier forms of psrgs parts-320-1500-val-SCENE-PART-sSEED.json beside parts-320-1500-val-SCENE-psrgs-sSEED.json,
ablate-320-1500-val-SCENE-psrgs-PART-s0.json beside rim-320-1500-val-SCENE-both-s0.json,
ablate-160-1500-val-SCENE-psrgs-paper-PART-s0.json beside ablate-160-1500-val-SCENE-psrgs-paper-s0.json,
wide-ablate-320-1500-val-SCENE-psrgs-PART-s0.json beside starts-320-1500-val-SCENE-60k-5e-4-s0.json, and
each-look-equal-320-STEPS-SCENE-lean[-THRESHOLD]-sSEED.json beside each-look-compare-320-1500-SCENE-psrgs-sSEED.json; their times are compared with those of the
psrgs of their build, wide-320-1500-SCENE-psrgs-sSEED. Intervals are those of results_table.py.
"""

import json
import math

from results_table import DIGITS, METRICS, RESULTS, SCENES, quantile, seconds

PARTS = ["no-stereo", "sfm-depth", "no-stereo-splats", "round-stereo-splats", "wide-stereo-splats", "faint-stereo-splats", "texture-left-out",
         "no-lone-splats", "no-skirt", "depth-loss", "no-depth-loss", "no-smoothness", "no-flattening", "no-exposures", "gate-off",
         "gate-gradient", "gate-phase", "gate-random", "fixed-sigma", "no-low-stage", "one-threshold", "low-threshold-first",
         "no-low-weights", "no-mask-growth", "no-error-growth", "along-gradient", "coarse-steps", "no-coarse-steps", "no-early-cutoff",
         "steps-of-all", "short-memory", "published-dssim", "no-pruning", "free-harmonics", "no-gradient-maps", "no-constrained-maps",
         "no-perceptual", "perceptual"]
SPLATS = {"fox": "1500-fox-lean-2.8e-4", "caliterra": "1500-caliterra-lean-2.8e-4", "copr": "1500-copr-lean-4e-4", "world": "1500-world-lean-2.8e-4"}
TIME = {"fox": "2500-fox-lean", "caliterra": "2200-caliterra-lean", "copr": "2100-copr-lean", "world": "2200-world-lean"}


def run(name):
    file = RESULTS / f"{name}.json"
    return json.loads(file.read_text()) if file.exists() else None


def time(name):
    return seconds(json.loads((RESULTS / f"{name}.process.json").read_text()))


def parts(whole, changed):
    base = {scene: found for scene in SCENES if (found := run(whole.format(scene)))}
    print("| left out or changed | " + " | ".join(base) + " | PSNR in the mean |")
    print("|" + "---|" * (2 + len(base)))

    def row(name, cells):
        print(f"| {name} | {' | '.join(cells)} |")

    row("nothing", [f"{r['psnr']:.2f} dB, {r['ssim']:.4f}, {r['lpips_squeeze']:.4f}, {r['splats']:,}" for r in base.values()] + [""])
    for part in PARTS:
        runs = {scene: run(changed.format(scene, part)) for scene in base}
        if not any(runs.values()):
            continue
        change = lambda r, b, key: f"{100 * (r[key] / b[key] - 1):+.0f} %"
        cells = [f"{r['psnr'] - b['psnr']:+.2f} dB, {r['ssim'] - b['ssim']:+.4f}, {change(r, b, 'lpips_squeeze')}, {change(r, b, 'splats')}" if r else ""
                 for r, b in ((runs[s], base[s]) for s in base)]
        found = [r["psnr"] - base[s]["psnr"] for s, r in runs.items() if r]
        row(part, cells + [f"{sum(found) / len(found):+.2f} dB"])
    print()


def interval(values, digits):
    """Mean and 95 % interval of paired differences; a star where it has no zero in it."""
    n, mean = len(values), sum(values) / len(values)
    half = quantile(n - 1) * math.sqrt(sum((v - mean) ** 2 for v in values) / (n - 1) / n)
    return f"{mean:+.{digits}f} [{mean - half:+.{digits}f}, {mean + half:+.{digits}f}]{' *' if abs(mean) > half else ''}"


def with_seeds(whole, changed):
    """Parts that have been left out in three seeds of every scene."""
    print("| with, minus without | PSNR, dB | SSIM | LPIPS | PSNR by scene | pairs |\n|" + "---|" * 6)
    for part in PARTS:
        pairs = {scene: [(run(whole.format(scene, seed)), run(changed.format(scene, part, seed))) for seed in range(3)] for scene in SCENES}
        if not all(a and b for of in pairs.values() for a, b in of):
            continue
        every = [pair for of in pairs.values() for pair in of]
        cells = [interval([a[m] - b[m] for a, b in every], DIGITS.get(m, 4)) for m in ("psnr", "ssim", "lpips_squeeze")]
        scenes = ", ".join(f"{scene} {sum(a['psnr'] - b['psnr'] for a, b in of) / 3:+.2f}" for scene, of in pairs.items())
        print(f"| {part} | {' | '.join(cells)} | {scenes} | {len(every)} |")
    print()


def beside_lean():
    print("| lean with | scene | seed | PSNR, psrgs | PSNR, lean | SSIM, psrgs | SSIM, lean | LPIPS, psrgs | LPIPS, lean | GMSD, psrgs | GMSD, lean "
          "| splats of psrgs | CPU time of psrgs |\n|" + "---|" * 13)
    differences = {}
    for title, names in (("as many splats", SPLATS), ("as much time", TIME)):
        for scene, name in names.items():
            for seed in range(5):
                of = f"each-look-compare-320-1500-{scene}-psrgs-s{seed}"
                lean, psrgs = run(f"each-look-equal-320-{name}-s{seed}"), run(of)
                if not lean or not psrgs:
                    continue
                cells = [f"{r[m]:.{DIGITS.get(m, 4)}f}" for m in ("psnr", "ssim", "lpips_squeeze", "gmsd") for r in (psrgs, lean)]
                ratio = time(f"each-look-equal-320-{name}-s{seed}") / time(f"wide-320-1500-{scene}-psrgs-s{seed}")
                print(f"| {title} | {scene} | {seed} | {' | '.join(cells)} | {100 * lean['splats'] / psrgs['splats']:.0f} % | {ratio:.2f} |")
                for metric in METRICS:
                    differences.setdefault((title, metric), []).append(psrgs[metric] - lean[metric])
    print("\n| psrgs - lean | PSNR, dB | psnr_cc, dB | SSIM | LPIPS | GMSD | PSNR where texture is, dB | pairs |\n|" + "---|" * 8)
    for title in ("as many splats", "as much time"):
        cells = [interval(differences[title, metric], DIGITS.get(metric, 4)) for metric in METRICS]
        print(f"| {title} | {' | '.join(cells)} | {len(differences[title, METRICS[0]])} |")


if __name__ == "__main__":
    parts("early-320-1500-val-{}-64-dssim-0.3-thresholds-2.4e-3-s0", "parts-early-320-1500-val-{}-{}-s0")
    parts("parts-320-1500-val-{}-psrgs-s0", "parts-320-1500-val-{}-{}-s0")
    with_seeds("parts-320-1500-val-{}-psrgs-s{}", "parts-320-1500-val-{}-{}-s{}")
    parts("rim-320-1500-val-{}-both-s0", "ablate-320-1500-val-{}-psrgs-{}-s0")
    parts("ablate-160-1500-val-{}-psrgs-paper-s0", "ablate-160-1500-val-{}-psrgs-paper-{}-s0")
    parts("starts-320-1500-val-{}-60k-5e-4-s0", "wide-ablate-320-1500-val-{}-psrgs-{}-s0")
    beside_lean()
