"""The frame of a sheet and the title block that hangs on it: taken away before walls are looked for."""

import cv2
import numpy as np

_DARK = 0.3
_LEAST_MARGIN, _LEAST_LARGEST_MARGIN = 0.012, 0.05
"""Between a frame and what it encloses, of the sheet's size: on every side, and on one of them. The outer
line of a building of double lines is nearer to the rest on all sides."""


def without_frame(darkness: np.ndarray) -> np.ndarray:
    """The picture (h, w) with the frame blanked; the same where there is none."""
    lines = (darkness > _DARK).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(lines, connectivity=8)
    marks = stats[1:][stats[1:, 4] > 40]  # specks lie anywhere
    if len(marks) == 0:
        return darkness
    low = marks[:, :2].min(axis=0)
    width, height = (marks[:, :2] + marks[:, 2:4]).max(axis=0) - low
    is_all_round = (stats[:, 2] > 0.93 * width) & (stats[:, 3] > 0.93 * height)
    is_all_round[0] = False
    result = darkness
    for label in np.flatnonzero(is_all_round):
        others = np.delete(np.arange(1, count), label - 1)
        # Specks outside do not matter.
        inside = others[stats[others, 4] > 1e-4 * height * width]
        if len(inside) == 0 or stats[label, 4] > stats[others, 4].sum():
            continue
        box, rest = stats[label], stats[inside]
        margins = np.array(
            [
                rest[:, 0].min() - box[0],
                rest[:, 1].min() - box[1],
                box[0] + box[2] - (rest[:, 0] + rest[:, 2]).max(),
                box[1] + box[3] - (rest[:, 1] + rest[:, 3]).max(),
            ]
        ) / max(height, width)
        mask = labels == label
        if (
            margins.min() > _LEAST_MARGIN
            and margins.max() > _LEAST_LARGEST_MARGIN
            and _has_four_sides(mask[box[1] : box[1] + box[3], box[0] : box[0] + box[2]])
        ):
            blank = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
            result = np.where(blank, np.float32(0.0), result)
    return result


def _has_four_sides(mask: np.ndarray) -> bool:
    """Whether lines run along most of every side of a component's box."""
    band = max(3, max(mask.shape) // 60)
    sides = (mask[:band].any(axis=0), mask[-band:].any(axis=0),
             mask[:, :band].any(axis=1), mask[:, -band:].any(axis=1))  # fmt: skip
    return all(side.mean() > 0.9 for side in sides)
