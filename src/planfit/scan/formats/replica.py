"""Replica as rendered for iMAP and NICE-SLAM.

    SCAN/results/frameNNNNNN.jpg, depthNNNNNN.png    depth 16-bit
    SCAN/traj.txt                                    a row of 16 numbers a frame: world_from_cam, OpenCV axes
    SCAN/cam_params.json, or in the folder above     {"camera": {w, h, fx, fy, cx, cy, scale}}

`scale` is how many units of depth make a metre (6553.5). The world is z-up and level. Without
cam_params.json, the published values are taken.
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from planfit.errors import ScanError
from planfit.scan.axes import UP_Z
from planfit.scan.frames import make_camera
from planfit.scan.images.image_files import Entry
from planfit.scan.images.lens import Lens
from planfit.scan.layout import Layout, scan_of_layout
from planfit.scan.options import ScanOptions
from planfit.scan.source import FolderSource, Source
from planfit.scan.tables import number_list, read_json, read_matrix
from planfit.scan.types import Scan, check_pose

LOOKS_FOR = "traj.txt with results/frameNNNNNN.jpg and results/depthNNNNNN.png"
POSES, CALIBRATION = "traj.txt", "cam_params.json"
PUBLISHED = {"fx": 600.0, "fy": 600.0, "cx": 599.5, "cy": 339.5, "scale": 6553.5}

_DEPTH = re.compile(r"depth(\d+)\.png$", re.IGNORECASE)
_COLOR = re.compile(r"frame(\d+)\.(jpg|jpeg|png)$", re.IGNORECASE)
PARTS = (POSES, "results/")


def recognise(source: Source) -> bool:
    """Whether a folder has this layout."""
    return source.exists(POSES) and any(_COLOR.match(name) for name in source.names("results"))


def read(source: Source, options: ScanOptions) -> Scan:
    """Read a scan.

    Raises:
        ScanError: its files are missing, unreadable, or contradict each other.
    """
    table = read_matrix(source, POSES, "16 numbers a line")
    if table.shape[1] != 16:
        raise ScanError(
            f"{source.path / POSES}: expected 16 numbers a line, found {table.shape[1]}"
        )
    poses = table.reshape(-1, 4, 4)
    entries, skipped = [], []
    for name in source.names("results"):
        match = _COLOR.match(name)
        if match is None:
            continue
        number = int(match[1])
        if number >= len(poses):
            skipped.append(f"frame {match[1]}: {POSES} has only {len(poses)} rows")
            continue
        if np.isfinite(poses[number]).all():
            check_pose(poses[number], f"{source.path / POSES}, row {number}")
        entries.append(
            Entry(
                match[1],
                float(number),
                poses[number],
                f"results/{name}",
                f"results/depth{match[1]}.png",
            )
        )
    listed = {entry.frame_id for entry in entries}
    numbers = {found[1] for name in source.names("results") if (found := _DEPTH.match(name))}
    skipped += [
        f"frame {number}: results/frame{number}.jpg is missing"
        for number in sorted(numbers - listed)
        if int(number) < len(poses)
    ]
    values, others = _calibration(source)

    def lens(_: Entry, size: tuple[int, int]) -> Lens:
        numbers = [values.get(key, np.nan) for key in ("fx", "fy", "cx", "cy")]
        return Lens(make_camera(*size, numbers, f"{source.path}: {CALIBRATION}"))

    def write_poses(directory: Path, written: Sequence[Entry], refined: np.ndarray) -> None:
        rows = poses.copy()  # rows of frames that are left out stay as recorded
        rows[[int(entry.frame_id) for entry in written]] = refined
        lines = [" ".join(f"{v:.10g}" for v in row.ravel()) for row in rows]
        (directory / POSES).write_text("\n".join(lines) + "\n")

    stored = values.get("scale", PUBLISHED["scale"])
    scale = float(number_list(stored, 1, f"{source.path}: {CALIBRATION}, scale")[0])
    if not 0 < scale < np.inf:
        raise ScanError(f"{source.path}: expected a scale above 0 in {CALIBRATION}, found {scale}")
    layout = Layout(
        "replica",
        sorted(entries, key=lambda entry: entry.time),
        1 / scale,
        write_poses,
        lens,
        other_files=[POSES, *others],
        up_world=UP_Z,
        skipped=skipped,
    )
    return scan_of_layout(source, layout, options)


def _calibration(source: Source) -> tuple[dict[str, float], list[str]]:
    if source.exists(CALIBRATION):
        return _camera(source), [CALIBRATION]
    above = FolderSource(source.path.resolve().parent)
    if source.path.is_dir() and above.exists(CALIBRATION):
        return _camera(above), []
    return PUBLISHED, []


def _camera(source: Source) -> dict[str, float]:
    camera = read_json(source, CALIBRATION).get("camera")
    if not isinstance(camera, dict):
        raise ScanError(
            f"{source.path / CALIBRATION}: expected an object `camera` with fx fy cx cy scale, found none"
        )
    return camera
