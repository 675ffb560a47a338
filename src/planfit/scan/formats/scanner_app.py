"""3D Scanner App (Laan Labs), "All data" export of a LiDAR scan.

    SCAN/frame_NNNNN.jpg, depth_NNNNN.png, conf_NNNNN.png    depth 16-bit millimetres, confidence 0 1 2
    SCAN/depth_NNNNN.exr       newer versions have depth as this, in metres (needs OpenEXR)
    SCAN/frame_NNNNN.json      intrinsics (9 numbers, by row, of the colour image), cameraPoseARFrame (16, by
                               row, world_from_cam, ARKit axes), time

ARKit's world is y-up and level. Depth (256 x 192) shows what colour shows. The app keeps colour of only
some frames.
"""

import json
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from planfit.scan.images.files import ImageFiles
from planfit.scan.images.lens import Lens
from planfit.scan.intrinsics import make_camera
from planfit.scan.options import ScanOptions
from planfit.scan.poses import UP_Y, check_recorded_pose, from_opengl
from planfit.scan.recording import Frame, Recording, Size
from planfit.scan.source import FileSource
from planfit.scan.tables import number_list, read_json

EXPECTS = "frame_NNNNN.json with cameraPoseARFrame, frame_NNNNN.jpg and depth_NNNNN.png (or .exr)"
CHECKED = (
    "the maker's own sample and a corridor scanned by others "
    "(github.com/laanlabs/3dScannerApp_samples and a fork), 3 frames with depth; a converter that reads "
    "depth as EXR",
    "axes, intrinsics by row, units, confidence, frames without a picture",
)
"""Where the layout is known from, and what was checked with it."""
_COLOR = re.compile(r"frame_(\d+)\.jpg$")
_FRAME = re.compile(r"frame_(\d+)\.json$")


def recognise(source: FileSource) -> bool:
    """Whether a folder has this layout."""
    return any(_FRAME.match(name) for name in source.names())


def read(source: FileSource, options: ScanOptions) -> Recording:
    """List a scan.

    Raises:
        ScanError: its files are missing, unreadable, or contradict each other.
    """
    frames, intrinsics, contents = [], {}, {}
    for name in source.names():
        match = _FRAME.match(name)
        if match is None:
            continue
        number, where = match[1], str(source.path / name)
        content = read_json(source, name)
        matrix = number_list(content.get("cameraPoseARFrame"), 16, f"{where}, cameraPoseARFrame")
        pose = from_opengl(matrix.reshape(4, 4))
        check_recorded_pose(pose, where)
        k = number_list(content.get("intrinsics"), 9, f"{where}, intrinsics")
        intrinsics[number] = (k[0], k[4], k[2], k[5])
        contents[number] = content
        time = float(number_list(content.get("time", int(number)), 1, f"{where}, time")[0])
        depths = (f"depth_{number}.png", f"depth_{number}.exr")
        depth = next((n for n in depths if source.exists(n)), depths[0])
        names = (f"frame_{number}.jpg", depth, f"conf_{number}.png")
        frames.append(Frame(number, time, pose, *names))

    colored = {match[1] for name in source.names() if (match := _COLOR.match(name))}
    skipped = [f"frame {n}: frame_{n}.json is missing" for n in sorted(colored - contents.keys())]

    def lens(frame: Frame, size: Size) -> Lens:
        where = str(source.path / f"frame_{frame.frame_id}.json")
        return Lens(make_camera(*size, intrinsics[frame.frame_id], where))

    def write_poses(
        directory: Path, written: Sequence[Frame], poses: Float[np.ndarray, "k 4 4"]
    ) -> None:
        for frame, pose in zip(written, from_opengl(poses), strict=True):
            content = {**contents[frame.frame_id], "cameraPoseARFrame": pose.ravel().tolist()}
            path = directory / f"frame_{frame.frame_id}.json"
            path.write_text(json.dumps(content, indent=1) + "\n")

    scale = options.depth_scale
    images = ImageFiles(
        source, scale or 1e-3, options.min_confidence, metres_per_float=scale or 1.0
    )
    tables = [f"frame_{frame.frame_id}.json" for frame in frames]
    return Recording(
        format="scanner-app",
        path=source.path,
        frames=frames,
        images=images,
        color_lens=lens,
        write_poses=write_poses,
        fingerprint=images.fingerprint(tables, frames, options),
        up_world=UP_Y,
        skipped=skipped,
    )
