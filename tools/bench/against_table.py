#!/usr/bin/env python3
"""The table of tools/bench/against.
    against_table.py WORK ROUNDS STEPS SIZE RESULT"""
import json
import os
import statistics
import sys

work, rounds, steps, size, result = sys.argv[1:6]
steps, runs = int(steps), []
for who in ("ours", "peer"):
    for number in range(1, int(rounds) + 1):
        base = os.path.join(work, f"{who}-{number}")
        with open(base + ".time.json") as times, open(base + ".scores.json") as scores:
            times, scores = json.load(times), json.load(scores)
        runs.append({"who": who, "round": number, **times,
                     **{key: scores[key] for key in ("psnr", "ssim", "splats", "width", "height", "test_images", "device")}})
sizes = {(run["width"], run["height"]) for run in runs}
names = {run["test_images"] for run in runs}
if len(names) != 1:
    sys.exit(f"not the same photographs were scored: {names}")


def median(who, key, divide=1):
    return statistics.median(run[key] for run in runs if run["who"] == who) / divide


with open(result + ".json", "w") as out:
    kept = {"steps": steps, "size": int(size), "peer": os.environ["PEER"], "options": os.environ["OPTIONS"], "runs": runs}
    json.dump(kept, out, indent=2)
    out.write("\n")
lines = [f"{steps} steps, longest side {size}, {names.pop()} held-out photographs, medians of {rounds} alternating rounds; "
         f"ours: `train {os.environ['OPTIONS']}`, the peer: `{os.environ['PEER']}`", ""]
if len(sizes) > 1:
    lines += [f"Scored at different sizes ({', '.join(f'{w}x{h}' for w, h in sorted(sizes))}): not comparable in the last digits.", ""]
lines += ["| | PSNR, dB | SSIM | splats | wall s | wall s / step | CPU s | peak host MiB |", "|---|---|---|---|---|---|---|---|"]
for who in ("ours", "peer"):
    lines.append(f"| {who} | {median(who, 'psnr'):.2f} | {median(who, 'ssim'):.4f} | {median(who, 'splats'):,.0f} | "
                 f"{median(who, 'wall_s'):.1f} | {median(who, 'wall_s', steps):.4f} | {median(who, 'cpu_s'):.1f} | "
                 f"{median(who, 'peak_kib', 1024):.0f} |")
pairs = [[run["wall_s"] for run in runs if run["round"] == number] for number in range(1, int(rounds) + 1)]
ratios = sorted(peer / ours for ours, peer in pairs)
lines += ["", f"Wall time of the peer over ours, round by round: {', '.join(f'{r:.2f}' for r in ratios)}; "
          f"median {statistics.median(ratios):.2f}."]
with open(result + ".md", "w") as out:
    out.write("\n".join(lines) + "\n")
