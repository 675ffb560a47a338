"""What holds the scan to the plan: faces for pieces of wall and columns, heights for ceilings."""

from dataclasses import dataclass

import numpy as np

from planfit.adjust.association import Association, associate
from planfit.adjust.ceilings import find_ceilings
from planfit.adjust.measurements import Measurements
from planfit.adjust.options import AdjustOptions
from planfit.adjust.terms.effective_observations import as_mean
from planfit.adjust.terms.levels import LevelTerm
from planfit.adjust.terms.nearest import NearestTerm, Pull
from planfit.adjust.terms.walls import WallTerm
from planfit.floorplan import Floorplan
from planfit.lsq.term import Term
from planfit.segmentation import WallPatches


@dataclass(frozen=True)
class PlanCorrespondences:
    """What the poses are held to outside the scan."""

    floorplan: Floorplan
    walls: Association
    columns: Association
    ceiling_heights_m: np.ndarray  # (n,) height of the ceiling that each frame sees; NaN: none
    max_distance_m: float
    """Beyond this, wall does not belong to a face."""

    def is_same(self, other: "PlanCorrespondences") -> bool:
        """Whether both hold every piece to the same face."""
        return all(
            np.array_equal(mine.face_idx, theirs.face_idx)
            for mine, theirs in ((self.walls, other.walls), (self.columns, other.columns))
        )


def associate_with_plan(
    measurements: Measurements,
    floorplan: Floorplan,
    plan_from_cams: np.ndarray,
    max_distance_m: float,
    options: AdjustOptions,
    ceiling_heights_m: np.ndarray | None = None,
) -> PlanCorrespondences:
    """Faces within a distance, and ceilings, at poses (n, 4, 4).

    Ceilings are looked for unless their heights (n,) are given.
    """
    structure = measurements.structure
    walls, columns = (
        associate(patches, floorplan, plan_from_cams, max_distance_m, options.association)
        for patches in (structure.walls, structure.columns)
    )
    if ceiling_heights_m is None:
        ceiling_heights_m = find_ceilings(structure, plan_from_cams, options.ceiling_heights)
    return PlanCorrespondences(floorplan, walls, columns, ceiling_heights_m, max_distance_m)


def level_and_column_terms(
    measurements: Measurements, correspondences: PlanCorrespondences, options: AdjustOptions
) -> list[Term]:
    """Ceiling and columns; those without data or weight are left out."""
    terms: list[Term] = []
    structure, is_mean = measurements.structure, options.averaging == "mean"
    if options.ceiling.weight > 0 and np.isfinite(correspondences.ceiling_heights_m).any():
        on_it = np.diff(structure.ceiling.start)[
            np.isfinite(correspondences.ceiling_heights_m)
        ].sum()
        ceiling = as_mean(options.ceiling, int(on_it)) if is_mean else options.ceiling
        heights_m = correspondences.ceiling_heights_m
        terms.append(
            LevelTerm(structure.ceiling, heights_m, ceiling, "ceiling", options.solver.device)
        )
    if options.columns.weight > 0 and correspondences.columns.n_associated:
        n_points = _n_tied(structure.columns, correspondences.columns)
        columns = as_mean(options.columns, n_points) if is_mean else options.columns
        patches = structure.columns
        device = options.solver.device
        terms.append(
            WallTerm(
                patches,
                correspondences.floorplan,
                correspondences.columns,
                columns,
                "columns",
                device=device,
            )
        )
    return terms


def wall_terms(
    measurements: Measurements, correspondences: PlanCorrespondences, options: AdjustOptions
) -> list[Term]:
    """The walls term of the chosen strategy, faces as drawn; nothing where no wall is tied."""
    if options.walls.weight == 0 or correspondences.walls.n_associated == 0:
        return []
    patches, is_fixed = measurements.structure.walls, options.wall_strategy == "fixed"
    walls = options.walls
    if options.averaging == "mean":
        n_points = _n_tied(patches, correspondences.walls) if is_fixed else len(patches.points_cam)
        walls = as_mean(walls, n_points)
    if is_fixed:
        device = options.solver.device
        return [
            WallTerm(
                patches, correspondences.floorplan, correspondences.walls, walls, device=device
            )
        ]
    to = "line" if options.wall_strategy == "iterative" else "point"
    pull = Pull(to, correspondences.max_distance_m, options.association.oriented)
    return [NearestTerm(patches, correspondences.floorplan, walls, pull)]


def costs(
    measurements: Measurements,
    target_from_cams: np.ndarray,
    options: AdjustOptions,
    correspondences: PlanCorrespondences | None = None,
) -> dict[str, float]:
    """Robust cost of each term at poses (n, 4, 4), for reports; faces as drawn."""
    terms = measurements.terms(options)
    if correspondences is not None:
        terms += level_and_column_terms(measurements, correspondences, options)
        terms += wall_terms(measurements, correspondences, options)
    return {term.name: term.reweight(target_from_cams)[1] for term in terms}


def _n_tied(patches: WallPatches, association: Association) -> int:
    return int(np.diff(patches.start)[association.face_idx >= 0].sum())
