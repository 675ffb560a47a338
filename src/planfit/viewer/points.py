"""Points of the report's cloud, of images and of the plan: what is pressed in one is shown in the others,
and the scan is dragged over its plan.

What a hand drags is off by decimetres and some degrees. So its pairs stand near each other, in the middle
of the scan: they say where that is to within the tolerance of a place, and hold its heading loosely, which
the walls then settle.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from planfit.corrections import Place
from planfit.corrections.types import Pixel
from planfit.errors import OptionError, ScanError
from planfit.export.cloud import read_ply_points
from planfit.floorplan import Floorplan
from planfit.geometry import se3, segments
from planfit.geometry.calibration import NOMINAL, SensorCalibration
from planfit.priors import DEPTH_EDGE_SHARE
from planfit.scan import Scan
from planfit.scan.statistics import lift_pixel
from planfit.units import in_units


@dataclass
class PickedPoints:
    """What pixels of a scan show; each image is opened once."""

    scan: Scan
    floorplan: Floorplan | None
    """As read, before corrections."""
    _lifted: dict[tuple[int, Pixel], Float[np.ndarray, "3"]] = field(default_factory=dict)

    def pixel_of(
        self, frame: int, point_cam: Sequence[float], record: dict[str, Any]
    ) -> dict[str, Any]:
        """The pixel of a frame that shows a point of the report's cloud.

        Args:
            frame: whose point it is.
            point_cam: m, in the frame's axes, as the corrected sensor sees it.
            record: of the run that made the cloud.

        Raises:
            OptionError: the point lies at the edge of something, or outside of the image.
        """
        sensor, camera = _sensor(record), self.scan.cameras[frame]
        point = np.array([point_cam], dtype=float)
        u, v = np.round(sensor.camera(camera).project(point)[0], 1)
        try:
            shown = sensor.points(lift_pixel(self.scan, frame, (float(u), float(v)))[None])[0]
        except ScanError as error:
            raise OptionError(str(error)) from error
        apart, away = np.linalg.norm(shown - point[0]), np.linalg.norm(point[0])
        # At the edge of something, depth about the pixel is that of something else.
        if not apart <= DEPTH_EDGE_SHARE.value * away:
            raise OptionError(
                f"frame {frame}: expected a point on something flat, found the edge of something "
                f"{in_units(float(apart))} before or behind it; press another point"
            )
        return {"pixel": [float(u), float(v)]}

    def mark(self, place: Place, record: dict[str, Any]) -> dict[str, Any] | None:
        """Of a place picked in an image: its point in the frame's axes, and where it should be, in the plan
        (m) and at its rim; None where that is not told."""
        if place.frame is None or place.pixel is None or self.floorplan is None:
            return None
        seen = (place.frame, place.pixel)
        if seen not in self._lifted:
            try:
                self._lifted[seen] = lift_pixel(self.scan, *seen)
            except (ScanError, IndexError):
                return None  # the file was changed by hand; a solve names it
        source = self.floorplan.source
        there_from_plan = source.rim_from_plan
        if place.is_of_file and source.file_from_plan is not None:
            there_from_plan = source.file_from_plan
        at = np.linalg.inv(there_from_plan) @ np.array([*place.plan, 1.0])
        scale = metres_per_unit(record)
        point = _sensor(record).points(self._lifted[seen][None])[0]
        return {
            "frame": place.frame,
            "point": np.round(point, 4).tolist(),
            "plan": np.round(at[:2] / at[2] * scale, 4).tolist(),
            "rim": np.round(source.rim_from_plan @ at / at[2], 4)[:2].tolist(),
        }


def metres_per_unit(record: dict[str, Any]) -> Sequence[float]:
    """Of the plan, along x and y, as a run found it."""
    return ((record.get("alignment") or {}).get("metres_per_unit_xy")) or (1.0, 1.0)


def at_rim(
    floorplan: Floorplan, plan_xy_m: Float[np.ndarray, "k 2"], record: dict[str, Any]
) -> Float[np.ndarray, "k 2"]:
    """Points of the plan frame (m) in the coordinates at the rim of its picture."""
    return segments.moved(plan_xy_m / metres_per_unit(record), floorplan.source.rim_from_plan)


def _sensor(record: dict[str, Any]) -> SensorCalibration:
    """As the run corrected it."""
    told = (record.get("sensor") or {}).get("correction")
    return NOMINAL if told is None else SensorCalibration(**told)


NOTE = "dragged"
"""Of places that dragging gave: dragging once more takes their place."""
ANCHOR_M = 2.0
"""Of the pairs, from the middle of the scan."""
READ_POINTS, CELL_M = 400_000, 0.1
"""Points of the cloud that are looked at, and cells of which one is drawn each."""
MAX_CELLS = 6000
HEIGHTS_M = (0.5, 2.0)
"""Over the floor: walls, and little of what stands before them."""


def shape_from_above(folder: Path, positions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "k 2"]:
    """Where the cloud of a run stands, plan frame, m; where it has none, the way of the camera.

    Raises:
        OSError: the cloud cannot be read.
        ScanError: it is damaged.
    """
    path = folder / "cloud_after.ply"
    if not path.exists():
        return positions[:, :2]
    points = read_ply_points(path, READ_POINTS)
    low, high = HEIGHTS_M
    xy = points[(points[:, 2] > low) & (points[:, 2] < high), :2]
    cells = np.unique(np.floor(xy / CELL_M).astype(int), axis=0)
    some = cells[:: max(1, -(-len(cells) // MAX_CELLS))]
    return (some + 0.5) * CELL_M


def to_drag(
    folder: Path, positions: Float[np.ndarray, "n 3"], floorplan: Floorplan, record: dict[str, Any]
) -> dict[str, Any]:
    """What the page drags: points at the rim of the plan, and of the pairs both sides.

    Raises: as `shape_from_above`.
    """
    middle = np.append(positions[:, :2].mean(axis=0), np.median(positions[:, 2]))
    angles = np.deg2rad([90.0, 210.0, 330.0])
    around = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
    anchors = middle + ANCHOR_M * around
    world_from_plan = se3.inverse(np.array(record["plan_from_world_before"], dtype=float))
    world = np.round(se3.transform(world_from_plan, anchors), 4)
    shape_xy = shape_from_above(folder, positions)
    shape, rim = (np.round(at_rim(floorplan, xy, record), 4) for xy in (shape_xy, anchors[:, :2]))
    return {
        "anchor_m": ANCHOR_M,
        "points": shape.tolist(),
        "anchors": [
            {"rim": xy, "scan": point}
            for xy, point in zip(rim.tolist(), world.tolist(), strict=True)
        ],
    }


def is_dragged(place: Place) -> bool:
    """Whether dragging gave it."""
    return place.note == NOTE and place.scan is not None
