"""What the fit made of the walls of the plan: the wall patches that each face was given, and how far from it
they lie. Verdicts on walls are those of `planfit.as_built`."""

from dataclasses import dataclass

import numpy as np

from planfit.adjust import PlanAdjustment
from planfit.adjust.moved_walls import MIN_PATCHES
from planfit.as_built import AsBuilt
from planfit.floorplan import Floorplan
from planfit.priors import WALL_SPREAD_M
from planfit.report import formatting
from planfit.units import in_units

AGREES_WITHIN_M = WALL_SPREAD_M.value
FEW_PATCHES = MIN_PATCHES
"""With fewer wall patches a face's offset may be an accident."""


@dataclass(frozen=True)
class SeenFace:
    """A face of the plan with the wall patches of the scan that belong to it."""

    number: int
    """As in the table of walls; without one, 1 for the face with most patches."""
    face_idx: int
    middle_xy: tuple[float, float]
    """Plan frame, m."""
    length: float
    """m"""
    n_patches: int
    offset: float
    """Median of the patches' offsets, m; positive towards the face's normal."""
    mad: float
    """Median absolute deviation from it, m."""
    is_oriented: bool
    solved: tuple[float, float] | None = None
    """Offset that the adjustment gave the face, and its sigma, m, where it gave any."""

    @property
    def agrees(self) -> bool:
        """Whether the scanned wall lies where it is drawn."""
        return abs(self.offset) <= AGREES_WITHIN_M

    @property
    def is_moved(self) -> bool:
        """Whether enough patches say that it does not."""
        return not self.agrees and self.n_patches >= FEW_PATCHES

    @property
    def verdict(self) -> str:
        """In words."""
        if self.agrees:
            words = "agrees within " + in_units(AGREES_WITHIN_M, ".0f", "cm", formatting.SPACE)
        else:
            words = f"moved by {formatting.centimetres(abs(self.offset))}"
            if self.is_oriented:
                words += " into the room" if self.offset > 0 else " into the wall"
        if self.n_patches < FEW_PATCHES:
            words += f" (only {self.n_patches} patch{'es' if self.n_patches > 1 else ''})"
        return words


def seen_faces(
    floorplan: Floorplan, walls: PlanAdjustment, as_built: AsBuilt | None = None
) -> list[SeenFace]:
    """Faces with wall patches, most patches first.

    Args:
        floorplan: plan frame, m.
        walls: of `planfit.refine` with that plan.
        as_built: whose numbers faces have; those that it does not judge, as they are short, have the next.
    """
    judged = () if as_built is None else as_built.walls
    numbers = {wall.face_idx: number for number, wall in enumerate(judged, start=1)}
    association, sigmas_m = walls.association, walls.offset_sigmas_m
    seen, counts = np.unique(association.face_idx[association.face_idx >= 0], return_counts=True)
    faces = []
    next_number = len(judged) + 1
    for k in np.lexsort((seen, -counts)):
        face = int(seen[k])
        number = numbers.get(face, next_number)
        next_number += number == next_number
        offsets = association.distance_m[association.face_idx == face]
        x, y = floorplan.ends[face].mean(axis=0)
        median = float(np.median(offsets))
        faces.append(
            SeenFace(
                number=number,
                face_idx=face,
                middle_xy=(float(x), float(y)),
                length=float(floorplan.lengths[face]),
                n_patches=int(counts[k]),
                offset=median,
                mad=float(np.median(np.abs(offsets - median))),
                is_oriented=bool(floorplan.is_oriented[face]),
                solved=(float(walls.offsets_m[face]), float(sigmas_m[face]))
                if face < len(sigmas_m) and np.isfinite(sigmas_m[face])
                else None,
            )
        )
    return faces
