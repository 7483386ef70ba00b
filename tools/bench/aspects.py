#!/usr/bin/env python3
"""How elongated the splats of a trained model are, in the scene and in pictures.
    aspects.py MODEL.ply DATA SIDE [EVERY]
DATA is a COLMAP dataset (binary, PINHOLE-like intrinsics), SIDE the longer side of the pictures in pixels, EVERY the distance of the
held-out photographs (8: the first and every eighth by name). Prints quantiles of
  longest/middle, longest/shortest   of the three standard deviations, every splat once;
  projected                          of the two of what is drawn (0.3 square pixels added), every splat of each picture once that is
                                     beyond the near plane, reaches the picture within three deviations and has an opacity over 1/255.
frame.json beside the model tells the scale of the scene that the near plane is of.
"""
import array
import json
import math
import os
import struct
import sys

QUANTILES = [0.5, 0.9, 0.99, 0.999, 1.0]
DILATION = 0.3
NEAR = 0.2


def splats(path):
    """(centre, quaternion, log deviations, opacity) of each splat of a 3DGS PLY."""
    with open(path, "rb") as file:
        names, count = [], 0
        for line in iter(file.readline, b"end_header\n"):
            words = line.split()
            if words[:2] == [b"element", b"vertex"]:
                count = int(words[2])
            elif words[:2] == [b"property", b"float"]:
                names.append(words[2].decode())
        values = array.array("f")
        values.fromfile(file, count * len(names))
    at = [names.index(n) for n in ["x", "y", "z", "rot_0", "rot_1", "rot_2", "rot_3", "scale_0", "scale_1", "scale_2", "opacity"]]
    for i in range(count):
        v = [values[i * len(names) + k] for k in at]
        yield v[:3], v[3:7], v[7:10], 1 / (1 + math.exp(-max(-80.0, min(80.0, v[10]))))


def matrix(q):
    length = math.sqrt(sum(v * v for v in q)) or 1.0
    w, x, y, z = (v / length for v in q)
    return [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]


def cameras(folder, side):
    """Intrinsics by camera, for pictures whose longer side is `side`. Distortion is left out, as in trained pictures."""
    blob, found, at = open(f"{folder}/cameras.bin", "rb").read(), {}, 8
    parameters = {0: 3, 1: 4, 2: 4, 3: 5, 4: 8, 5: 8, 6: 12}
    for _ in range(struct.unpack_from("<Q", blob)[0]):
        number, model, width, height = struct.unpack_from("<iiQQ", blob, at)
        p = struct.unpack_from(f"<{parameters[model]}d", blob, at + 24)
        at += 24 + 8 * parameters[model]
        two = model in (1, 4, 5, 6)
        fx, fy, cx, cy = p[:4] if two else (p[0], p[0], p[1], p[2])
        s = min(1.0, side / max(width, height))
        found[number] = [s * v for v in (fx, fy, cx, cy, width, height)]
    return found


def views(folder):
    """(name, rotation, translation, camera) of each image."""
    blob, at = open(f"{folder}/images.bin", "rb").read(), 8
    for _ in range(struct.unpack_from("<Q", blob)[0]):
        pose = struct.unpack_from("<7di", blob, at + 4)
        end = blob.index(b"\0", at + 64)
        points = struct.unpack_from("<Q", blob, end + 1)[0]
        yield blob[at + 64:end].decode(), matrix(pose[:4]), pose[4:7], pose[7]
        at = end + 9 + 24 * points


def projected(model, near, rotation, translation, camera):
    """Aspect of each splat that is seen."""
    fx, fy, cx, cy, width, height = camera
    w0, w1, w2 = rotation
    for (mx, my, mz), axes, opacity in model:
        if opacity < 1 / 255:
            continue
        z = w2[0] * mx + w2[1] * my + w2[2] * mz + translation[2]
        if z <= near:
            continue
        x = (w0[0] * mx + w0[1] * my + w0[2] * mz + translation[0]) / z
        y = (w1[0] * mx + w1[1] * my + w1[2] * mz + translation[1]) / z
        # The Jacobian is taken within 1.3 fields of view.
        sx = max(-(0.15 * width + cx) / fx, min((1.15 * width - cx) / fx, x))
        sy = max(-(0.15 * height + cy) / fy, min((1.15 * height - cy) / fy, y))
        a = c = DILATION
        b = 0.0
        for ux, uy, uz in axes:
            depth = w2[0] * ux + w2[1] * uy + w2[2] * uz
            px = fx / z * (w0[0] * ux + w0[1] * uy + w0[2] * uz - sx * depth)
            py = fy / z * (w1[0] * ux + w1[1] * uy + w1[2] * uz - sy * depth)
            a, b, c = a + px * px, b + px * py, c + py * py
        u, v, reach_x, reach_y = fx * x + cx, fy * y + cy, 3 * math.sqrt(a), 3 * math.sqrt(c)
        if u + reach_x < 0 or u - reach_x > width or v + reach_y < 0 or v - reach_y > height:
            continue
        middle, reach = (a + c) / 2, math.hypot((a - c) / 2, b)
        # The determinant over the larger of the two variances: their difference would cancel.
        small = (a * c - b * b) / (middle + reach)
        yield math.sqrt((middle + reach) / max(small, DILATION))


def show(what, values):
    values.sort()
    of = [values[max(0, math.ceil(q * len(values)) - 1)] for q in QUANTILES]
    print(f"{what:24}" + "".join(f"{v:12.4g}" for v in of), flush=True)


def main():
    path, data, side = sys.argv[1], sys.argv[2], float(sys.argv[3])
    every = int(sys.argv[4]) if len(sys.argv) > 4 else 8
    folder = f"{data}/sparse/0"
    model, middle, shortest = [], [], []
    for mean, quat, logs, opacity in splats(path):
        low, mid, high = sorted(logs)
        middle.append(math.exp(high - mid))
        shortest.append(math.exp(min(80.0, high - low)))
        r, s = matrix(quat), [math.exp(v) for v in logs]
        model.append((mean, [[r[i][j] * s[j] for i in range(3)] for j in range(3)], opacity))
    print(f"{len(model)} splats{'':12}" + "".join(f"{f'{100 * q:g} %':>12}" for q in QUANTILES))
    show("longest/middle", middle)
    show("longest/shortest", shortest)
    with open(os.path.join(os.path.dirname(path) or ".", "frame.json")) as file:
        near = NEAR / json.load(file)["scale"]
    intrinsics, seen = cameras(folder, side), []
    for _, rotation, translation, camera in sorted(views(folder))[::every]:
        seen += projected(model, near, rotation, translation, intrinsics[camera])
    show("projected", seen)


main()
