"""Coloured point clouds of a scan, sampled once and placed by any poses."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.priors import DEPTH_REACH_M
from planfit.runtime import Arrays, Runtime, cache_key
from planfit.scan import Scan

GREY = 180
"""What points of frames without colour are painted."""


@dataclass(frozen=True)
class Cloud:
    """Points in camera frames, with colour."""

    points_cam: Float[np.ndarray, "m 3"]
    """m"""
    colors: UInt8[np.ndarray, "m 3"]
    """RGB"""
    start: Int[np.ndarray, " starts"]
    """(n_frames + 1,): points of frame i are start[i]:start[i + 1]."""

    def without(self, runs: Sequence[tuple[int, int]]) -> "Cloud":
        """The cloud without the points of runs of frames, first and last."""
        n_points = np.diff(self.start)
        is_kept = np.ones(len(n_points), dtype=bool)
        for first, last in runs:
            is_kept[first : last + 1] = False
        of_point = np.repeat(is_kept, n_points)
        start = np.concatenate([[0], np.cumsum(np.where(is_kept, n_points, 0))])
        return Cloud(self.points_cam[of_point], self.colors[of_point], start)

    def of_frames(self, frames: slice) -> "Cloud":
        """The points of frames in a row alone, numbered from the first of them."""
        start = self.start[frames.start : frames.stop + 1]
        of = slice(int(start[0]), int(start[-1]))
        return Cloud(self.points_cam[of], self.colors[of], start - start[0])

    def thinned(self, max_points: int) -> "Cloud":
        """At most `max_points` of the points, evenly."""
        n_points = len(self.points_cam)
        if n_points <= max_points:
            return self
        kept = np.arange(max_points) * n_points // max_points
        start = np.searchsorted(kept, self.start)
        return Cloud(self.points_cam[kept], self.colors[kept], start)


@dataclass(frozen=True)
class Sampling:
    """How many points a cloud has."""

    max_points: int = 500_000
    """Of all frames."""
    max_per_frame: int = 2500
    """Of each frame."""


def sample_cloud(
    scan: Scan,
    runtime: Runtime,
    max_points: int = Sampling.max_points,
    frame_idx: Int[np.ndarray, " k"] | None = None,
) -> Cloud:
    """A regular sample of the pixels that have a depth within reach of a depth camera.

    Of every frame; with `frame_idx`, of these alone, and the others have no points.
    """
    (cloud,) = sample_clouds(scan, runtime, (Sampling(max_points),), frame_idx)
    return cloud


def sample_clouds(
    scan: Scan,
    runtime: Runtime,
    samplings: Sequence[Sampling],
    frame_idx: Int[np.ndarray, " k"] | None = None,
) -> tuple[Cloud, ...]:
    """Clouds as `sample_cloud` gives them, one a sampling: each image is opened once for all."""
    frames = np.arange(len(scan)) if frame_idx is None else frame_idx
    per_frame = tuple(
        max(1, min(each.max_per_frame, each.max_points // len(frames))) for each in samplings
    )
    key = cache_key(scan.fingerprint, per_frame, DEPTH_REACH_M.value, frames.tobytes())
    sample = partial(_sample, scan, frames, per_frame)
    items = runtime.map("clouds", key, len(frames), sample)
    clouds = []
    for k in range(len(samplings)):
        n_points = np.zeros(len(scan), dtype=int)
        n_points[frames] = [len(item[f"points_{k}"]) for item in items]
        points_cam = np.concatenate([item[f"points_{k}"] for item in items])
        colors = np.concatenate([item[f"colors_{k}"] for item in items])
        clouds.append(Cloud(points_cam, colors, start=np.cumsum([0, *n_points])))
    return tuple(clouds)


_SINGLE_WITHIN_M = 5000.0
"""Coordinates beyond it are written in double precision: single rounds by 0.25 mm there, by a quarter of a
metre at the millions of national grids."""
_KINDS = {
    kind: (
        np.dtype([(xyz, size) for xyz in "xyz"] + [(rgb, "u1") for rgb in "rgb"]),
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n"
        + "".join(f"property {kind} {xyz}\n" for xyz in "xyz")
        + "property uchar red\nproperty uchar green\nproperty uchar blue\n{}end_header\n",
    )
    for kind, size in (("float", "<f4"), ("double", "<f8"))
}
"""Of coordinates: a vertex, and the head of the file."""
_FACE = np.dtype([("n", "u1"), ("corners", "<i4", 3)])
_FACES = "element face {}\nproperty list uchar int vertex_indices\n"


def near_origin(points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "3"]:
    """Whole metres to take off points (m), so that single precision loses nothing of them; 0 where it does
    not anyway."""
    reach = np.abs(points).max(axis=0, initial=0.0)
    middle = np.rint(points.mean(axis=0)) if len(points) else np.zeros(3)
    return np.where(reach > _SINGLE_WITHIN_M, middle, 0.0)


def place_cloud(
    cloud: Cloud, target_from_cams: Float[np.ndarray, "n 4 4"]
) -> Float[np.ndarray, "m 3"]:
    """Points (m) in the target frame."""
    frame_idx = np.repeat(np.arange(len(target_from_cams)), np.diff(cloud.start))
    return se3.transform_indexed(target_from_cams, frame_idx, cloud.points_cam)


def write_ply(
    path: Path,
    points: Float[np.ndarray, "m 3"],
    colors: UInt8[np.ndarray, "m 3"],
    triangles: Int[np.ndarray, "t 3"] | None = None,
) -> None:
    """Write points (m) with colours as binary PLY: in single precision, or in double far from the origin.

    With `triangles`, numbers of points, a mesh.
    """
    is_near = len(points) == 0 or np.nanmax(np.abs(points)) <= _SINGLE_WITHIN_M
    vertex, header = _KINDS["float" if is_near else "double"]
    vertices = np.zeros(len(points), dtype=vertex)
    for axis, name in enumerate("xyz"):
        vertices[name] = points[:, axis]
    for channel, name in enumerate("rgb"):
        vertices[name] = colors[:, channel]
    faces = np.zeros(0 if triangles is None else len(triangles), dtype=_FACE)
    if triangles is not None:
        faces["n"], faces["corners"] = 3, triangles
    with path.open("wb") as file:
        of_faces = "" if triangles is None else _FACES.format(len(faces))
        file.write(header.format(len(points), of_faces).encode())
        file.write(vertices.tobytes())
        file.write(faces.tobytes())


def read_ply_points(path: Path, max_points: int) -> Float[np.ndarray, "k 3"]:
    """Points (m) that `write_ply` wrote; of many, evenly taken ones.

    Raises:
        OSError: the file cannot be read.
        ScanError: another program wrote it, or it is cut short.
    """
    with path.open("rb") as file:
        head = file.read(1024)
    size = path.stat().st_size
    for vertex, header in _KINDS.values():
        pattern = re.escape(header.format("{}", "")).replace(r"\{\}", r"(\d+)")
        found = re.match(pattern.encode(), head)
        if found is not None and size == found.end() + int(found[1]) * vertex.itemsize:
            break
    else:
        raise ScanError(
            f"{path}: expected a cloud as planfit writes it, found another file; solve again"
        )
    if int(found[1]) == 0:
        return np.zeros((0, 3))
    vertices = np.memmap(path, dtype=vertex, mode="r", offset=found.end())
    some = vertices[:: max(1, -(-len(vertices) // max_points))]
    return np.stack([some[name] for name in "xyz"], axis=1).astype(float)


def color_or_grey(scan: Scan, frame_idx: int) -> UInt8[np.ndarray, "h w 3"]:
    """Colour image of a frame; one grey where it is depth alone."""
    image, camera = scan.files.color(frame_idx), scan.cameras[frame_idx]
    return np.full((camera.height, camera.width, 3), GREY, np.uint8) if image is None else image


def _sample(scan: Scan, frames: Int[np.ndarray, " k"], per_frame: Sequence[int], k: int) -> Arrays:
    i = int(frames[k])
    depth, image = scan.files.depth(i), color_or_grey(scan, i)
    found = {}
    for at, n_points in enumerate(per_frame):
        step = max(1, int(np.sqrt(depth.size / n_points)))
        rows, columns = np.mgrid[
            step // 2 : depth.shape[0] : step, step // 2 : depth.shape[1] : step
        ]
        depth_m = depth[rows, columns]
        with np.errstate(invalid="ignore"):  # NaN, where there is no depth, is not below anything
            keep = depth_m < DEPTH_REACH_M.value
        uv = np.stack([columns[keep], rows[keep]], axis=1).astype(float)
        found[f"points_{at}"] = scan.cameras[i].lift(uv, depth_m[keep]).astype(np.float32)
        found[f"colors_{at}"] = image[rows[keep], columns[keep]]
    return found
