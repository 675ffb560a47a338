"""Which of the interpretations of a picture is taken."""

import cv2
import numpy as np
from jaxtyping import UInt8

from planfit.floorplan.raster.candidates import Candidate
from planfit.floorplan.raster.ink import ink_share
from planfit.floorplan.raster.interpretation import Interpretation, interpret

_ENOUGH_INK = 0.4
"""Of the ink, what walls are at least in drawings full of furniture and words: 0.43 and more (measured)."""


def choose(
    candidates: list[Candidate], extent_px: float, ink: UInt8[np.ndarray, "h w"]
) -> Interpretation | None:
    """The best interpretation; None where there is no candidate.

    One that leaves most of the ink to furniture and words is taken only where no other has walls: a few
    parallel lines in a street are no plan of the building beside it.

    Args:
        candidates: masks of what may be wall.
        extent_px: of the drawing.
        ink: 1 on everything dark.
    """
    interpretations = [interpret(candidate, extent_px) for candidate in candidates]
    if not interpretations:
        return None
    scores = []
    pairs = [r for r in interpretations if r.candidate.style.startswith("double lines") and r.walls]
    best_pairs = max(pairs, key=lambda r: r.score, default=None)
    for found in interpretations:
        score = found.score
        if found.candidate.style.startswith("solid") and best_pairs is not None:
            score *= 1.0 - _outline_share(found, best_pairs)
        if found.candidate.style == "hatched":
            # Filling gaps makes walls of other things too, unless the same lines fill them everywhere.
            score *= 0.5 + 0.6 * found.candidate.hatched_share
        if found.candidate.style == "filled, outlined":
            score *= (
                1.15  # says more of the drawing than the other interpretations of the same walls
            )
        if found.candidate.style == "double lines":
            score *= 0.6  # furniture and dimensions have parallel lines too
        if found.candidate.style == "double lines, closed":
            score *= 0.8  # furniture is closed too, but little of it is so long and thin
        if found.walls:
            score *= min(1.0, ink_share(found, ink) / _ENOUGH_INK)
        scores.append(score)
    return interpretations[int(np.argmax(scores))]


def _outline_share(solid: Interpretation, pairs: Interpretation) -> float:
    """Share of the solid walls that are the outlines of walls drawn as two lines."""
    reach = 2 * round(pairs.candidate.grow_px * 2) + 3
    beside = cv2.dilate(pairs.candidate.mask, np.ones((reach, reach), np.uint8))
    n = int(solid.candidate.mask.sum())
    share = float((solid.candidate.mask & beside).sum()) / max(n, 1)
    return min(1.0, 2 * share) if share > 0.25 else 0.0
