"""Which of the interpretations of a picture is taken."""

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from planfit.floorplan.raster.candidates import (
    LINE,
    Candidate,
    WallStyle,
    find_candidates,
    find_extent,
)
from planfit.floorplan.raster.ink import ink_share, stroke_length
from planfit.floorplan.raster.interpretation import Interpretation, interpret
from planfit.floorplan.raster.line_work import opened
from planfit.floorplan.raster.mixed import LEAST_SHARE, with_other_styles

_FACTORS = {
    WallStyle.OUTLINED: 1.15,  # says more of the drawing than the other interpretations of the same walls
    WallStyle.LINES: 0.6,  # furniture and dimensions have parallel lines too
    WallStyle.CLOSED_LINES: 0.8,  # furniture is closed too, but little of it is so long and thin
}
_BASES, _LEAST_BASE = 4, 0.3
"""So many interpretations, of this share of the best one's score at least, are looked at for walls that
others have beside theirs."""
_ALL_INK = 0.95
"""Of the ink, what walls are at least where nothing else is drawn."""
_ENOUGH_INK = 0.4
"""Of the ink, what walls are at least in drawings full of furniture and words: 0.43 and more (measured)."""


def choose(
    candidates: list[Candidate], extent_px: float, ink: UInt8[np.ndarray, "h w"]
) -> Interpretation | None:
    """The best interpretation; None where there is no candidate.

    One that leaves most of the ink to furniture and words is taken only where no other has walls: a few
    parallel lines in a street are no plan of the building beside it. Where others have many walls beside
    those of the best one, the drawing has several styles, and theirs are taken too.

    Args:
        candidates: masks of what may be wall.
        extent_px: of the drawing.
        ink: 1 on everything dark.
    """
    weighed = _weighed(candidates, extent_px)
    if not weighed:
        return None

    def worth(found: Interpretation) -> float:
        score = sum(part.score for part in found.parts)
        return score * min(1.0, ink_share(found, ink) / _ENOUGH_INK) if found.walls else score

    ranked = sorted(weighed, key=worth, reverse=True)
    most = worth(ranked[0])
    bases = [found for found in ranked[:_BASES] if worth(found) >= _LEAST_BASE * most]
    mixed = max((with_other_styles(base, weighed, extent_px) for base in bases), key=worth)
    return mixed if worth(mixed) > (1.0 + LEAST_SHARE) * most else ranked[0]


def with_paler_walls(alone: Interpretation, darkness: Float[np.ndarray, "h w"]) -> Interpretation:
    """Walls that seem to be all that is drawn, with those of other styles where much of the ink is no wall.

    Args:
        alone: of everything black.
        darkness: of the picture.
    """
    ink = (darkness > LINE).astype(np.uint8)
    if ink_share(alone, ink) > _ALL_INK:
        return alone
    extent_px = find_extent(darkness)
    weighed = _weighed(find_candidates(darkness), extent_px)
    found = with_other_styles(alone, weighed, extent_px)
    # With others beside, something else was drawn after all.
    return (
        replace(found, candidate=replace(alone.candidate, style=WallStyle.BLACK))
        if found.beside
        else alone
    )


def _weighed(candidates: list[Candidate], extent_px: float) -> list[Interpretation]:
    """Interpretations, their scores by what their styles are worth."""
    found = [interpret(candidate, extent_px) for candidate in candidates]
    outlined = [
        max(alike, key=lambda one: one.score)
        for style in (WallStyle.LINES, WallStyle.OUTLINED)
        if (alike := [one for one in found if one.candidate.style.family is style and one.walls])
    ]
    return [replace(one, score=one.score * _style_factor(one, outlined)) for one in found]


def _style_factor(found: Interpretation, outlined: list[Interpretation]) -> float:
    """How much of its walls an interpretation is worth, by what else its style may come from.

    `outlined` are the best ones of walls with outlines, which may have been taken for solid walls.
    """
    candidate = found.candidate
    if candidate.style.family in (WallStyle.BLACK, WallStyle.GREY):
        return 1.0 - max((_outline_share(found, other) for other in outlined), default=0.0)
    if candidate.style is WallStyle.HATCHED:
        # Filling gaps makes walls of other things too, unless the same lines fill them everywhere.
        return 0.5 + 0.6 * candidate.hatched_share
    return _FACTORS[candidate.style]


def _outline_share(solid: Interpretation, outlined: Interpretation) -> float:
    """Share of the solid walls that are the outlines of walls drawn as two lines, or filled and outlined.

    By length: partitions may be solid beside walls with outlines, and have more ink than these.
    """
    reach = 2 * round(outlined.candidate.grow_px * 2) + 3
    beside = np.asarray(
        cv2.dilate(outlined.candidate.mask, np.ones((reach, reach), np.uint8)), dtype=np.uint8
    )
    mask = solid.candidate.mask
    share = float((mask & beside).sum()) / max(int(mask.sum()), 1)
    thin = mask & (1 - opened(mask, reach))
    length = stroke_length(mask)
    share = max(share, stroke_length(thin & beside) / max(length, 1.0))
    return min(1.0, 2 * share) if share > 0.25 else 0.0
