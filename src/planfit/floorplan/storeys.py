"""Plans of several storeys as one: faces in one frame, each with its storey."""

from collections.abc import Mapping

import numpy as np

from planfit.floorplan.types import Floorplan, PlanSource


def join_storeys(plans: Mapping[int, Floorplan]) -> Floorplan:
    """All faces of plans that are in one frame, in metres, each face with the storey of its plan.

    What only one drawing has, such as its own coordinates and the openings to draw, stays with the plans.

    Args:
        plans: by storey; at least one.
    """
    parts = list(plans.values())
    sizes = [len(part) for part in parts]
    is_thick = any(part.thickness is not None for part in parts)
    return Floorplan(
        " and ".join(dict.fromkeys(part.name for part in parts)),
        np.concatenate([part.ends for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.is_oriented for part in parts]),
        fingerprint=" ".join(part.fingerprint for part in parts),
        thickness=np.concatenate([_thickness(part) for part in parts]) if is_thick else None,
        source=PlanSource(warnings=tuple(w for part in parts for w in part.source.warnings)),
        storeys=np.repeat(list(plans), sizes),
    )


def _thickness(plan: Floorplan) -> np.ndarray:
    return np.full(len(plan), np.nan) if plan.thickness is None else plan.thickness
