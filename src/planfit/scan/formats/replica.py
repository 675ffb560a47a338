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
from typing import Any

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.scan.images.files import ImageFiles
from planfit.scan.images.lens import Lens
from planfit.scan.intrinsics import make_camera
from planfit.scan.options import ScanOptions
from planfit.scan.poses import UP_Z, check_recorded_pose
from planfit.scan.recording import Frame, Recording, Size
from planfit.scan.source import FileSource, FolderSource
from planfit.scan.tables import number_list, read_json, read_matrix

EXPECTS = "traj.txt with results/frameNNNNNN.jpg and results/depthNNNNNN.png"
CHECKED = (
    "the camera and png_depth_scale in programs that read NICE-SLAM's renderings. No real file",
    "size, focal length and scale of depth",
)
"""Where the layout is known from, and what was checked with it."""
POSES, CALIBRATION = "traj.txt", "cam_params.json"
PUBLISHED = {"fx": 600.0, "fy": 600.0, "cx": 599.5, "cy": 339.5, "scale": 6553.5}

_DEPTH = re.compile(r"depth(\d+)\.png$", re.IGNORECASE)
_COLOR = re.compile(r"frame(\d+)\.(jpg|jpeg|png)$", re.IGNORECASE)
PARTS = (POSES, "results/")


def recognise(source: FileSource) -> bool:
    """Whether a folder has this layout."""
    return source.exists(POSES) and any(_COLOR.match(name) for name in source.names("results"))


def read(source: FileSource, options: ScanOptions) -> Recording:
    """List a scan.

    Raises:
        ScanError: its files are missing, unreadable, or contradict each other.
    """
    poses = _read_poses(source)
    frames, skipped = _list_frames(source, poses)
    values, tables = _calibration(source)

    def lens(_: Frame, size: Size) -> Lens:
        numbers = [values.get(key, np.nan) for key in ("fx", "fy", "cx", "cy")]
        return Lens(make_camera(*size, numbers, f"{source.path}: {CALIBRATION}"))

    def write_poses(
        directory: Path, written: Sequence[Frame], refined: Float[np.ndarray, "k 4 4"]
    ) -> None:
        rows = poses.copy()  # rows of frames that are left out stay as recorded
        rows[[int(frame.frame_id) for frame in written]] = refined
        lines = [" ".join(f"{v:.10g}" for v in row.ravel()) for row in rows]
        (directory / POSES).write_text("\n".join(lines) + "\n")

    stored = values.get("scale", PUBLISHED["scale"])
    scale = float(number_list(stored, 1, f"{source.path}: {CALIBRATION}, scale")[0])
    if not 0 < scale < np.inf:
        raise ScanError(f"{source.path}: expected a scale above 0 in {CALIBRATION}, found {scale}")
    images = ImageFiles(source, options.depth_scale or 1 / scale)
    return Recording(
        format="replica",
        path=source.path,
        frames=frames,
        images=images,
        color_lens=lens,
        write_poses=write_poses,
        fingerprint=images.fingerprint([POSES, *tables], frames, options, values),
        up_world=UP_Z,
        skipped=skipped,
    )


def _read_poses(source: FileSource) -> Float[np.ndarray, "n 4 4"]:
    table = read_matrix(source, POSES, "16 numbers a line")
    if table.shape[1] != 16:
        raise ScanError(
            f"{source.path / POSES}: expected 16 numbers a line, found {table.shape[1]}"
        )
    return table.reshape(-1, 4, 4)


def _list_frames(
    source: FileSource, poses: Float[np.ndarray, "n 4 4"]
) -> tuple[list[Frame], list[str]]:
    """Frames in the order of their numbers, which are rows of the poses, and a line for each that lacks
    colour or a row."""
    frames, skipped = [], []
    names = source.names("results")
    for name in names:
        match = _COLOR.match(name)
        if match is None:
            continue
        number = int(match[1])
        if number >= len(poses):
            skipped.append(f"frame {match[1]}: {POSES} has only {len(poses)} rows")
            continue
        check_recorded_pose(poses[number], f"{source.path / POSES}, row {number}")
        depth = f"results/depth{match[1]}.png"
        frames.append(Frame(match[1], float(number), poses[number], f"results/{name}", depth))
    listed = {frame.frame_id for frame in frames}
    numbers = {found[1] for name in names if (found := _DEPTH.match(name))}
    skipped += [
        f"frame {number}: results/frame{number}.jpg is missing"
        for number in sorted(numbers - listed)
        if int(number) < len(poses)
    ]
    return sorted(frames, key=lambda frame: frame.time), skipped


def _calibration(source: FileSource) -> tuple[dict[str, Any], list[str]]:
    """What cam_params.json says of the camera, and its name where it lies inside the source."""
    if source.exists(CALIBRATION):
        return _camera(source), [CALIBRATION]
    above = FolderSource(source.path.resolve().parent)
    if source.path.is_dir() and above.exists(CALIBRATION):
        return _camera(above), []
    return PUBLISHED, []


def _camera(source: FileSource) -> dict[str, Any]:
    camera = read_json(source, CALIBRATION).get("camera")
    if not isinstance(camera, dict):
        raise ScanError(
            f"{source.path / CALIBRATION}: expected an object `camera` with fx fy cx cy scale, found none"
        )
    return camera
