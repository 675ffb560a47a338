"""A scan that is dragged over its plan: its shape from above, and the pairs of points that dragging it gives.

What a hand drags is off by decimetres and some degrees. So its pairs stand near each other, in the middle of
the scan: they say where that is to within the tolerance of a place, and hold its heading loosely, which the
walls then settle.
"""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from planfit.corrections import Place
from planfit.export.cloud import read_ply_points
from planfit.floorplan import Floorplan
from planfit.geometry import se3

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

    Args:
        folder: of the run.
        positions: of the cameras.

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
    folder: Path,
    positions: Float[np.ndarray, "n 3"],
    floorplan: Floorplan,
    record: dict[str, Any],
) -> dict[str, Any]:
    """What the page drags: points at the rim of the plan, and of the pairs both sides.

    Raises: as `shape_from_above`.
    """
    scale = np.array(((record.get("alignment") or {}).get("metres_per_unit_xy")) or (1.0, 1.0))
    rim = floorplan.source.rim_from_plan
    middle = np.append(positions[:, :2].mean(axis=0), np.median(positions[:, 2]))
    angles = np.deg2rad([90.0, 210.0, 330.0])
    around = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
    anchors = middle + ANCHOR_M * around
    world_from_plan = se3.inverse(np.array(record["plan_from_world_before"], dtype=float))
    world = se3.transform(world_from_plan, anchors)

    def at_rim(xy: Float[np.ndarray, "k 2"]) -> list[list[float]]:
        return np.round((xy / scale) @ rim[:2, :2].T + rim[:2, 2], 4).tolist()

    return {
        "anchor_m": ANCHOR_M,
        "points": at_rim(shape_from_above(folder, positions)),
        "anchors": [
            {"rim": xy, "scan": point}
            for xy, point in zip(at_rim(anchors[:, :2]), np.round(world, 4).tolist(), strict=True)
        ],
    }


def is_dragged(place: Place) -> bool:
    """Whether dragging gave it."""
    return place.note == NOTE and place.scan is not None
