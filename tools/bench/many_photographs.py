#!/usr/bin/env python3
"""Makes a COLMAP dataset of many large photographs with the poses and points of a small one, for measuring memory and uploads.
    many_photographs.py DATA COPY COUNT WIDTH HEIGHT
The pictures are waves with noise, as PNG; a few of them are named again and again, each time with a pose that is moved by a
thousandth of a unit. There is nothing to be seen in them, but all have to be read, decoded and uploaded."""
import math
import os
import random
import struct
import sys
import zlib

PICTURES = 8


def images(blob):
    """(pose without its number, name) of each image of an images.bin."""
    count = struct.unpack_from("<Q", blob)[0]
    at = 8
    for _ in range(count):
        pose = struct.unpack_from("<7dI", blob, at + 4)
        end = blob.index(b"\0", at + 64)
        points = struct.unpack_from("<Q", blob, end + 1)[0]
        yield pose, blob[at + 64:end].decode()
        at = end + 9 + 24 * points


def picture(path, width, height, seed):
    noise = random.Random(seed)
    waves = [[100 + 60 * math.sin(0.013 * (1 + c) * x + seed) for c in range(3)] for x in range(width)]
    rows = []
    for y in range(height):
        lift = [40 * math.sin(0.017 * (1 + c) * y) for c in range(3)]
        grain = noise.randbytes(3 * width)
        row = bytes(int(waves[k // 3][k % 3] + lift[k % 3]) + (grain[k] & 7) for k in range(3 * width))
        # Differences to the pixel on the left, as PNG files of photographs mostly have them.
        rows.append(b"\1" + row[:3] + bytes((a - b) & 255 for a, b in zip(row[3:], row)))
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    head = struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"".join(rows), 6)) + chunk(b"IEND", b""))


def main(data, copy, count, width, height):
    source, target = os.path.join(data, "sparse/0"), os.path.join(copy, "sparse/0")
    for folder in (target, os.path.join(copy, "images"), os.path.join(copy, "pictures")):
        os.makedirs(folder)
    for k in range(min(PICTURES, count)):
        picture(os.path.join(copy, "pictures", f"{k}.png"), width, height, k)
    with open(os.path.join(source, "images.bin"), "rb") as file:
        known = list(images(file.read()))
    rows = []
    for i in range(count):
        pose, name = known[i % len(known)]
        again = f"{i:05d}_{os.path.splitext(name)[0].replace('/', '_')}.png"
        os.symlink(os.path.join("..", "pictures", f"{i % PICTURES}.png"), os.path.join(copy, "images", again))
        moved = pose[:4] + tuple(t + 0.001 * (i // len(known)) for t in pose[4:7]) + pose[7:]
        rows.append(struct.pack("<I7dI", i + 1, *moved) + again.encode() + b"\0" + struct.pack("<Q", 0))
    with open(os.path.join(target, "images.bin"), "wb") as file:
        file.write(struct.pack("<Q", len(rows)) + b"".join(rows))
    for name in ("cameras.bin", "points3D.bin"):
        os.symlink(os.path.abspath(os.path.join(source, name)), os.path.join(target, name))
    print(f"{count} photographs of {width}x{height} in {copy}")


main(sys.argv[1], sys.argv[2], *map(int, sys.argv[3:6]))
