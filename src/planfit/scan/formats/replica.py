"""Replica as rendered for iMAP and NICE-SLAM: a row of a table a frame."""

from dataclasses import replace
from typing import Any

import numpy as np

from planfit.errors import ScanError
from planfit.scan.layout import FolderLayout, Listing
from planfit.scan.pairing import Poses, RowAFrame
from planfit.scan.poses import UP_Z
from planfit.scan.recording import LensOfFrame, pinhole_lens
from planfit.scan.source import FileSource, FolderSource
from planfit.scan.tables import Names, number_list, read_json
from planfit.scan.types import ScanOptions

CALIBRATION = "cam_params.json"
PUBLISHED = {"fx": 600.0, "fy": 600.0, "cx": 599.5, "cy": 339.5, "scale": 6553.5}
FRAMES = RowAFrame(
    color=Names("results/frame{}.jpg", "results/frame{}.jpeg", "results/frame{}.png"),
    depth=Names("results/depth{}.png"),
    poses="traj.txt",
    tables=(CALIBRATION,),
)


def _frames(source: FileSource, options: ScanOptions) -> Listing[Poses]:
    """Frames; a calibration above the folder is told apart by what it says."""
    return replace(FRAMES(source, options), fingerprinted=(_camera(source),))


def _camera(source: FileSource) -> dict[str, Any]:
    """What cam_params.json says of the camera, here or in the folder above."""
    above = FolderSource(source.path.resolve().parent)
    places = [source, above] if source.path.is_dir() else [source]
    place = next((one for one in places if one.exists(CALIBRATION)), None)
    if place is None:
        return PUBLISHED
    camera = read_json(place, CALIBRATION).get("camera")
    if not isinstance(camera, dict):
        raise ScanError(
            f"{place.path / CALIBRATION}: expected an object `camera` with fx fy cx cy scale, found none"
        )
    return camera


def _lens(listing: Listing[Poses]) -> LensOfFrame:
    camera = _camera(listing.source)
    numbers = [camera.get(key, np.nan) for key in ("fx", "fy", "cx", "cy")]
    return pinhole_lens(numbers, f"{listing.source.path}: {CALIBRATION}")


def _metres_per_unit(listing: Listing[Poses]) -> float:
    path, stored = listing.source.path, _camera(listing.source).get("scale", PUBLISHED["scale"])
    scale = float(number_list(stored, 1, f"{path}: {CALIBRATION}, scale")[0])
    if not 0 < scale < np.inf:
        raise ScanError(f"{path}: expected a scale above 0 in {CALIBRATION}, found {scale}")
    return 1 / scale


REPLICA = FolderLayout(
    name="replica",
    page="""Replica as rendered for iMAP and NICE-SLAM.

    SCAN/results/frameNNNNNN.jpg, depthNNNNNN.png    depth 16-bit
    SCAN/traj.txt                                    a row of 16 numbers a frame: world_from_cam, OpenCV axes
    SCAN/cam_params.json, or in the folder above     {"camera": {w, h, fx, fy, cx, cy, scale}}

`scale` is how many units of depth make a metre (6553.5). The world is z-up and level. Without
cam_params.json, the published values are taken.
""",
    expects="traj.txt with results/frameNNNNNN.jpg and results/depthNNNNNN.png",
    checked=(
        "the camera and png_depth_scale in programs that read NICE-SLAM's renderings. No real file",
        "size, focal length and scale of depth",
    ),
    told_by=(FRAMES.poses, "|".join(FRAMES.color.patterns)),
    parts=(FRAMES.poses, "results/"),
    frames=_frames,
    metres_per_unit=_metres_per_unit,
    lens=_lens,
    write=FRAMES.write,
    up_world=UP_Z,
)
