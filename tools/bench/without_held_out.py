#!/usr/bin/env python3
"""Copies a COLMAP dataset without its held-out photographs (every 8th by sorted name), for trainers that hold out otherwise.
    without_held_out.py DATA COPY
Photographs become links. Observations of points keep naming the photographs that are gone, and points keep their places, so
all trainers begin with the same points."""
import os
import struct
import sys

EVERY = 8


def binary_images(blob):
    """(name, bytes) of each image of an images.bin."""
    count = struct.unpack_from("<Q", blob)[0]
    at = 8
    for _ in range(count):
        begin = at
        at += 4 + 7 * 8 + 4
        end = blob.index(b"\0", at)
        name = blob[at:end].decode()
        points = struct.unpack_from("<Q", blob, end + 1)[0]
        at = end + 9 + 24 * points
        yield name, blob[begin:at]


def text_images(lines):
    """(name, two lines) of each image of an images.txt."""
    rows = [line for line in lines if not line.startswith("#")]
    for pose, points in zip(rows[::2], rows[1::2]):
        yield pose.split(maxsplit=9)[9].rstrip("\n"), pose + points


def main(data, copy):
    model = next(p for p in ("sparse/0", "sparse", "") if os.path.isdir(os.path.join(data, p)) and
                 any(os.path.exists(os.path.join(data, p, f)) for f in ("images.bin", "images.txt")))
    source, target = os.path.join(data, model), os.path.join(copy, "sparse/0")
    os.makedirs(target)
    binary = os.path.exists(os.path.join(source, "images.bin"))
    if binary:
        with open(os.path.join(source, "images.bin"), "rb") as file:
            images = list(binary_images(file.read()))
    else:
        with open(os.path.join(source, "images.txt")) as file:
            images = list(text_images(file.readlines()))
    ordered = sorted(name.encode() for name, _ in images)
    held_out = {name.decode() for name in ordered[::EVERY]}
    kept = [(name, row) for name, row in images if name not in held_out]
    if binary:
        with open(os.path.join(target, "images.bin"), "wb") as file:
            file.write(struct.pack("<Q", len(kept)) + b"".join(row for _, row in kept))
    else:
        with open(os.path.join(target, "images.txt"), "w") as file:
            file.write("".join(row for _, row in kept))
    for name in os.listdir(source):
        if name.startswith(("cameras.", "points3D.")):
            os.symlink(os.path.abspath(os.path.join(source, name)), os.path.join(target, name))
    for folder in os.listdir(data):
        if folder == "images" or folder.startswith("images_"):
            for name, _ in kept:
                photograph = os.path.join(data, folder, name)
                if os.path.exists(photograph):
                    link = os.path.join(copy, folder, name)
                    os.makedirs(os.path.dirname(link), exist_ok=True)
                    os.symlink(os.path.abspath(photograph), link)
    print(f"{len(kept)} photographs to train on, {len(held_out)} held out")


main(*sys.argv[1:3])
