"""The frame of a sheet and the title block that hangs on it: taken away before walls are looked for."""

import cv2
import numpy as np

_DARK = 0.3
_WIDE, _ALIKE = 0.08, 1.4
"""The outer line of a building of double lines is as far from the next line on all four sides, up to the
factor; a frame is not, or is further away than this share of the sheet."""


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
        if (rest[:, :2] < box[:2]).any() or (rest[:, :2] + rest[:, 2:4] > box[:2] + box[2:4]).any():
            continue
        part = slice(box[1], box[1] + box[3]), slice(box[0], box[0] + box[2])
        mask = labels == label
        if _has_four_sides(mask[part]) and not _is_outline(
            (lines[part] > 0) & ~mask[part], 0.3 * max(height, width)
        ):
            blank = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
            result = np.where(blank, np.float32(0.0), result)
    return result


def _is_outline(inside: np.ndarray, far: float) -> bool:
    """Whether what is inside (h, w) bool a closed line keeps the distance of a wall to it on all sides."""
    gaps = []
    for turned in (inside, inside[::-1], inside.T, inside.T[::-1]):
        first = np.argmax(turned, axis=0)[turned.any(axis=0)]
        first = first[first < far]
        gaps.append(float(np.median(first)) if len(first) else far)
    return max(gaps) < min(_WIDE * max(inside.shape), _ALIKE * min(gaps) + 3.0)


def _has_four_sides(mask: np.ndarray) -> bool:
    """Whether lines run along most of every side of a component's box."""
    band = max(3, max(mask.shape) // 60)
    sides = (mask[:band].any(axis=0), mask[-band:].any(axis=0),
             mask[:, :band].any(axis=1), mask[:, -band:].any(axis=1))  # fmt: skip
    return all(side.mean() > 0.9 for side in sides)
