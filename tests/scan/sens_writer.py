"""A .sens file as ScanNet's sensorData.h saves one, without planfit's code."""

import struct
import zlib

import numpy as np

from scan_samples import jpg, k_of

JPEG, ZLIB = 2, 1
TOGETHER = np.eye(4), np.eye(4)


def four(matrix):
    whole = np.eye(4)
    whole[: len(matrix), : len(matrix)] = matrix
    return whole.astype("<f4").tobytes()


def write_sens(
    path,
    s,
    color=jpg,
    color_code=JPEG,
    depth=lambda d: zlib.compress(d.astype("<u2").tobytes()),
    depth_code=ZLIB,
    depth_mm=None,
    depth_k=None,
    extrinsics=TOGETHER,
    poses=None,
    times_us=None,
    units=1000.0,
    version=4,
):
    depth_mm = s.depth_mm if depth_mm is None else depth_mm
    depth_k = k_of(s.camera) if depth_k is None else depth_k
    poses = s.poses if poses is None else poses
    times_us = np.arange(len(poses)) * 33_333 if times_us is None else times_us
    name = b"StructureSensor"
    (height, width), (rows, columns) = s.color[0].shape[:2], depth_mm[0].shape
    data = [
        struct.pack("<IQ", version, len(name)), name,
        four(k_of(s.camera)), four(extrinsics[0]), four(depth_k), four(extrinsics[1]),
        struct.pack("<2i4If", color_code, depth_code, width, height, columns, rows, units),
        struct.pack("<Q", len(poses)),
    ]  # fmt: skip
    for i, pose in enumerate(poses):
        images = color(s.color[i]), depth(depth_mm[i])
        data += [
            four(pose),
            struct.pack("<4Q", times_us[i], times_us[i], *map(len, images)),
            *images,
        ]
    data.append(struct.pack("<Q", 0))  # frames of an inertial sensor, which follow
    path.write_bytes(b"".join(data))
