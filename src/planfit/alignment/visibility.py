"""Occlusion: whether a face of the plan stands between a camera and the wall it saw."""

import numpy as np
from jaxtyping import Bool, Float

from planfit.compiled import kernel
from planfit.floorplan.nearest_faces import END_MARGIN_M

OCCLUSION_MARGIN_M = 0.4
"""Faces this near to the wall that is looked at, or to the camera, do not occlude it."""


def is_occluded(
    eyes: Float[np.ndarray, "m 2"],
    xy: Float[np.ndarray, "m 2"],
    ends: Float[np.ndarray, "n 2 2"],
) -> Bool[np.ndarray, " m"]:
    """Whether the line of sight from each eye to its point crosses a face, all in metres.

    One that passes nearer to the end of a face than `END_MARGIN_M`, or than a quarter of the face, does not
    cross it: jambs and corners are where drift shows first.
    """
    return _is_occluded(
        np.ascontiguousarray(eyes),
        np.ascontiguousarray(xy),
        np.ascontiguousarray(ends),
        END_MARGIN_M,
        OCCLUSION_MARGIN_M,
    )


def crosses_face(
    first: Float[np.ndarray, "m 2"],
    second: Float[np.ndarray, "m 2"],
    ends: Float[np.ndarray, "n 2 2"],
) -> Bool[np.ndarray, " m"]:
    """Whether the way from each first point to its second crosses a face, all in metres."""
    return _is_occluded(
        np.ascontiguousarray(first),
        np.ascontiguousarray(second),
        np.ascontiguousarray(ends),
        END_MARGIN_M,
        0.0,
    )


@kernel
def _is_occluded(
    eyes, xy, ends, end_margin, occlusion_margin
):  # pragma: no cover - compiled; has a NumPy twin in the tests
    # Eye + t (point - eye) meets first + u (second - first): Cramer's rule for t and u, both shares of a way.
    occluded = np.zeros(len(xy), dtype=np.bool_)
    for m in range(len(xy)):
        rx, ry = xy[m, 0] - eyes[m, 0], xy[m, 1] - eyes[m, 1]
        reach = np.sqrt(rx * rx + ry * ry)
        if reach <= 2 * occlusion_margin:
            continue
        low, high = occlusion_margin / reach, 1.0 - occlusion_margin / reach
        for n in range(len(ends)):
            ax, ay = ends[n, 1, 0] - ends[n, 0, 0], ends[n, 1, 1] - ends[n, 0, 1]
            cross = rx * ay - ry * ax
            if abs(cross) < 1e-12:
                continue
            dx, dy = ends[n, 0, 0] - eyes[m, 0], ends[n, 0, 1] - eyes[m, 1]
            t = (dx * ay - dy * ax) / cross
            if t <= low or t >= high:
                continue
            u = (dx * ry - dy * rx) / cross
            margin = min(end_margin / np.sqrt(ax * ax + ay * ay), 0.25)
            if u > margin and u < 1.0 - margin:
                occluded[m] = True
                break
    return occluded
