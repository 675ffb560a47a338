"""A database as RTAB-Map 0.21 writes one, by its schema and its serialisers, without planfit's code."""

import sqlite3
import struct
import zlib

import cv2
import numpy as np

from scan_samples import N, jpg, k_of, png

SCHEMA = """
CREATE TABLE Node (id INTEGER NOT NULL, map_id INTEGER NOT NULL, weight INTEGER, stamp FLOAT, pose BLOB,
  ground_truth_pose BLOB, velocity BLOB, label TEXT, gps BLOB, env_sensors BLOB, time_enter DATE,
  PRIMARY KEY (id));
CREATE TABLE Data (id INTEGER NOT NULL, image BLOB, depth BLOB, calibration BLOB, scan BLOB, scan_info BLOB,
  user_data BLOB, time_enter DATE, PRIMARY KEY (id));
CREATE TABLE Admin (version TEXT, opt_cloud BLOB, opt_ids BLOB, opt_poses BLOB, opt_last_localization BLOB,
  opt_map BLOB, time_enter DATE);
"""
BASE_FROM_CAM = np.array([[0, 0, 1, 0.1], [-1, 0, 0, 0.02], [0, -1, 0, 0.3], [0, 0, 0, 1.0]])


def pose_blob(pose):
    return pose[:3].astype("<f4").tobytes()


def camera_blob(camera, mount=BASE_FROM_CAM, with_p=False, kind=0):
    p = np.hstack([k_of(camera), np.zeros((3, 1))]).ravel() if with_p else []
    k = k_of(camera) * (2 if with_p else 1)  # where there is a P, K is not what the images show
    header = (0, 21, 10, kind, camera.width, camera.height, 9, 5 if with_p else 0, 0, len(p), 12)
    distortion = [0.1] * 5 if with_p else []
    numbers = np.array([*k.ravel(), *distortion, *p], "<f8").tobytes()
    return struct.pack("<11i", *header) + numbers + pose_blob(mount)


def legacy_camera_blob(camera, mount=BASE_FROM_CAM):
    numbers = [camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height]
    return np.array(numbers, "<f4").tobytes() + pose_blob(mount)


def matrix_blob(matrix, number):
    return zlib.compress(matrix.tobytes()) + struct.pack("<3i", *matrix.shape, number)


def float_png(depth_mm):
    """Metres as float32, by their bytes, in four channels."""
    metres = (depth_mm.astype("<f4") / np.float32(1000)).view("u1").reshape(*depth_mm.shape, 4)
    return cv2.imencode(".png", metres)[1].tobytes()


def rvl(depth_mm):
    """Wilson's code, as his paper lists it."""
    values = depth_mm.astype(int).ravel()
    nibbles = []

    def put(number):
        while True:
            three, number = number & 7, number >> 3
            nibbles.append(three | (8 if number else 0))
            if not number:
                return

    at, previous = 0, 0
    while at < len(values):
        end = at
        while end < len(values) and values[end] == 0:
            end += 1
        put(end - at)
        at = end
        while end < len(values) and values[end] != 0:
            end += 1
        put(end - at)
        for value in values[at:end]:
            step, previous = value - previous, value
            put((step << 1) ^ (step >> 63))
        at = end
    nibbles += [0] * (-len(nibbles) % 8)
    words = [sum(n << (28 - 4 * k) for k, n in enumerate(nibbles[i : i + 8]))
             for i in range(0, len(nibbles), 8)]  # fmt: skip
    size = struct.pack("<2I", depth_mm.shape[1], depth_mm.shape[0])
    return b"DEPTHRVL" + size + np.array(words, "<u4").tobytes()


def inverse_png(depth_mm, quantization=100.0, farthest=20.0):
    a = quantization * (quantization + 1)
    b = 1 - a / farthest
    metres = np.where(depth_mm > 0, depth_mm / 1000, np.inf)
    return b"DEPTHINV" + struct.pack("<2f", a, b) + png(
        np.where(depth_mm > 0, a / metres + b + 0.5, 0).astype(np.uint16)
    )  # fmt: skip


def opt_blobs(ids, poses):
    return (
        matrix_blob(np.array([ids], "<i4"), 4),
        matrix_blob(np.concatenate([p[:3].ravel() for p in poses]).astype("<f4")[None], 5),
    )


def write_rtabmap(path, s, *, odometry=None, optimised=None, map_ids=(0,) * N, calibration=None,
                  depth=png, side_by_side=1):  # fmt: skip
    """Nodes 1 to N at the sample's poses, or at `odometry`; `optimised`: poses by node."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    bases = (s.poses if odometry is None else odometry) @ np.linalg.inv(BASE_FROM_CAM)
    blob = camera_blob(s.camera) if calibration is None else calibration
    con = sqlite3.connect(path)
    con.executescript(SCHEMA)
    for i in range(N):
        con.execute(
            "INSERT INTO Node (id, map_id, weight, stamp, pose) VALUES (?, ?, 0, ?, ?)",
            (i + 1, map_ids[i], float(s.times[i]), pose_blob(bases[i])),
        )
        color = np.hstack([s.color[i]] * side_by_side)
        stored = depth(np.hstack([s.small_mm[i]] * side_by_side))
        con.execute(
            "INSERT INTO Data (id, image, depth, calibration) VALUES (?, ?, ?, ?)",
            (i + 1, jpg(color), stored, blob),
        )
    ids, poses = (None, None)
    if optimised is not None:
        bases = [pose @ np.linalg.inv(BASE_FROM_CAM) for pose in optimised.values()]
        ids, poses = opt_blobs(list(optimised), bases)
    con.execute(
        "INSERT INTO Admin (version, opt_cloud, opt_ids, opt_poses) VALUES ('0.21.10', ?, ?, ?)",
        (b"a cloud", ids, poses),
    )
    con.commit()
    con.close()
