#!/usr/bin/env python3
"""Prints the tables of docs/RESULTS.md from the metrics that are kept in docs/results.

  tools/bench/results_table.py [PREFIX]      PREFIX: compare-320-1500, dssim-0.2-compare-320-1500, short-memory-compare-320-1500 and coarse-compare-320-1500 (psrgs alone), size-drop-compare-320-1500 (without 3dgs), each-look-compare-320-1500 or published-rates-320-1500

Files are PREFIX-SCENE-METHOD-sSEED.json, with PREFIX-SCENE-METHOD-sSEED.process.json (processor time of the whole process and the
commit of its build; "paused" where it was halted on the way) beside some. Times are compared within a build, and with that of "beside" where a
later build on the same machine has steps of the same speed. Differences are paired by scene and seed; intervals are Student's, 95 %. Python's
standard library alone is needed.
"""

import json
import math
import re
import sys
from pathlib import Path

RESULTS = Path(__file__).resolve().parents[2] / "docs" / "results"
SCENES = ["fox", "caliterra", "copr", "world"]
METHODS = ["3dgs", "3dgs-any-size", "3dgs-reference", "3dgs-exposures", "absgs-published", "absgs", "gspro", "rsgs", "lean", "lean-unpruned", "psrgs-paper-round", "psrgs-paper", "psrgs-round", "psrgs-no-exposures", "psrgs"]
METRICS = ["psnr", "psnr_cc", "ssim", "lpips_squeeze", "gmsd", "psnr_high_frequency"]
DIGITS = {"psnr": 2, "psnr_cc": 2, "psnr_high_frequency": 2, "psnr_offpath": 2, "normal_median_degrees": 1, "surface_distance": 2,
          "depth_within_0_5_percent": 3, "depth_within_2_percent": 3, "floaters": 3}
GEOMETRY = ["psnr_offpath", "depth_median_error", "depth_within_0_5_percent", "depth_within_2_percent", "normal_median_degrees",
            "surface_distance", "floaters"]
PAIRS = [("psrgs", "3dgs"), ("psrgs", "lean"), ("lean", "3dgs"), ("psrgs", "lean-unpruned"), ("psrgs", "gspro"), ("psrgs", "absgs"),
         ("psrgs", "psrgs-paper"), ("psrgs", "rsgs"), ("psrgs-no-exposures", "3dgs"), ("psrgs-no-exposures", "lean"),
         ("psrgs", "psrgs-no-exposures"),
         ("3dgs-any-size", "3dgs"), ("psrgs", "3dgs-any-size"), ("3dgs-exposures", "3dgs"), ("psrgs", "3dgs-exposures"), ("psrgs", "psrgs-round"), ("psrgs-paper", "psrgs-paper-round")]
# Two-sided 95 % quantiles of Student's distribution by degrees of freedom.
QUANTILES = [math.nan, 12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131,
             2.120, 2.110, 2.101, 2.093, 2.086]


def quantile(freedom):
    return QUANTILES[freedom] if freedom < len(QUANTILES) else 1.96 + 2.5 / freedom


def load(prefix):
    runs, processes = {}, {}
    methods = "|".join(sorted(METHODS, key=len, reverse=True))
    name = re.compile(rf"{re.escape(prefix)}-({'|'.join(SCENES)})-({methods})-s(\d+)(\.process)?\.json")
    for file in sorted(RESULTS.glob(f"{prefix}-*.json")):
        found = name.fullmatch(file.name)
        if found:
            scene, method, seed, process = found.groups()
            into = processes if process else runs
            into[scene, method, int(seed)] = json.loads(file.read_text())
    return runs, processes


def spread(values, digits):
    mean = sum(values) / len(values)
    if len(values) == 1:
        return f"{mean:.{digits}f}"
    return f"{mean:.{digits}f} ({min(values):.{digits}f}–{max(values):.{digits}f})"


def of(runs, scene, method):
    return {seed: run for (s, m, seed), run in runs.items() if (s, m) == (scene, method)}


def seconds(process):
    return process["user_seconds"] + process["system_seconds"]


def mean(values):
    return sum(values) / len(values)


def timed_with(process):
    return process.get("beside", process.get("build"))


def by_build(processes, scene, method):
    times = {}
    for (s, m, _), process in processes.items():
        if (s, m) == (scene, method):
            times.setdefault(timed_with(process), []).append(seconds(process))
    return times


def main_table(runs, processes):
    print("| scene | method | seeds | PSNR | psnr_cc | SSIM | LPIPS | GMSD | PSNR where texture is | splats | of 3dgs | CPU time of 3dgs |")
    print("|" + "---|" * 12)
    for scene in SCENES:
        base = of(runs, scene, "3dgs")
        for method in METHODS:
            rows = of(runs, scene, method)
            if not rows or method == "lean-unpruned":
                continue
            cells = [spread([run[m] for run in rows.values()], DIGITS.get(m, 4)) for m in METRICS]
            splats = sum(run["splats"] for run in rows.values()) / len(rows)
            pairs = [run["splats"] / base[seed]["splats"] for seed, run in rows.items() if seed in base]
            share = f"{100 * sum(pairs) / len(pairs):.0f} %" if pairs else ""
            own, of_base = by_build(processes, scene, method), by_build(processes, scene, "3dgs")
            ratios = [mean(own[build]) / mean(of_base[build]) for build in own if build in of_base]
            time = f"{mean(ratios):.2f}" if ratios else ""
            print(f"| {scene} | {method} | {len(rows)} | {' | '.join(cells)} | {splats:,.0f} | {share} | {time} |")


def differences(runs):
    print("| difference of | PSNR, dB | psnr_cc, dB | SSIM | LPIPS | GMSD | PSNR where texture is, dB | pairs |")
    print("|" + "---|" * 8)
    for first, second in PAIRS:
        keys = [(s, seed) for (s, m, seed) in runs if m == first and (s, second, seed) in runs]
        if len(keys) < 4:
            continue
        cells = []
        for metric in METRICS:
            values = [runs[s, first, seed][metric] - runs[s, second, seed][metric] for s, seed in keys]
            n, mean = len(values), sum(values) / len(values)
            half = quantile(n - 1) * math.sqrt(sum((v - mean) ** 2 for v in values) / (n - 1) / n)
            digits = DIGITS.get(metric, 4)
            star = " *" if abs(mean) > half else ""
            cells.append(f"{mean:+.{digits}f} [{mean - half:+.{digits}f}, {mean + half:+.{digits}f}]{star}")
        name = f"{first} - {second}".replace("lean-unpruned", "lean without pruning")
        print(f"| {name} | {' | '.join(cells)} | {len(keys)} |")


def geometry(runs):
    print("| method | seeds | PSNR off the path | depth error, median | within 0.5 % | within 2 % | normals, median, degrees "
          "| surface, median, m | floaters | splats |")
    print("|" + "---|" * 10)
    for method in METHODS:
        rows = of(runs, "world", method)
        if not rows or method == "lean-unpruned":
            continue
        cells = [spread([run[m] for run in rows.values()], DIGITS.get(m, 4)) for m in GEOMETRY]
        splats = sum(run["splats"] for run in rows.values()) / len(rows)
        print(f"| {method} | {len(rows)} | {' | '.join(cells)} | {splats:,.0f} |")


def shares(runs, processes):
    """Stereo and masks of psrgs, in wall time of 3dgs on the same scene and seed, where the two may be compared and neither was halted on the way."""
    method = "psrgs-round" if any(m == "psrgs-round" for _, m, _ in runs) else "psrgs"
    print("| scene | seeds | stereo | saliency |")
    print("|" + "---|" * 4)
    for scene in SCENES:
        base, rows = of(runs, scene, "3dgs"), of(runs, scene, method)
        of_run = lambda m, seed: processes.get((scene, m, seed), {})
        comparable = lambda seed: timed_with(of_run(method, seed)) == timed_with(of_run("3dgs", seed))
        halted = lambda seed: any(of_run(m, seed).get("paused") for m in (method, "3dgs"))
        seeds = [seed for seed in rows if seed in base and comparable(seed) and not halted(seed)]
        if seeds:
            part = lambda key: [100 * (rows[s].get(key) or 0) / base[s]["seconds"] for s in seeds]
            print(f"| {scene} | {len(seeds)} | {spread(part('seconds_stereo'), 1)} % | {spread(part('seconds_saliency'), 1)} % |")


def main():
    runs, processes = load(sys.argv[1] if len(sys.argv) > 1 else "compare-320-1500")
    if not runs:
        sys.exit(f"no runs of that name in {RESULTS}")
    for table in (lambda: main_table(runs, processes), lambda: differences(runs), lambda: geometry(runs), lambda: shares(runs, processes)):
        table()
        print()


if __name__ == "__main__":
    main()
