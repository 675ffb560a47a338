"""A plan under an affine map: from pixels to the axes of a map, whose units may differ along x and y."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from planfit.floorplan.types import Floorplan


def transformed(floorplan: Floorplan, metres_from_plan: Float[np.ndarray, "3 3"]) -> Floorplan:
    """The same plan in metres and other axes.

    Args:
        floorplan: in a unit of its own.
        metres_from_plan: affine, with an inverse; it may mirror.
    """
    linear, translation = metres_from_plan[:2, :2], metres_from_plan[:2, 2]
    # A line keeps its normal under the inverse transpose; what is left of its length is how far apart
    # parallel lines come to lie.
    across = floorplan.normals @ np.linalg.inv(linear)
    shrink = np.linalg.norm(across, axis=1)
    source = floorplan.source
    if source.file_from_plan is not None:
        source = replace(
            source, file_from_plan=source.file_from_plan @ np.linalg.inv(metres_from_plan)
        )
    openings = floorplan.openings
    return replace(
        floorplan,
        ends=floorplan.ends @ linear.T + translation,
        normals=across / shrink[:, None],
        thickness=None if floorplan.thickness is None else floorplan.thickness / shrink,
        openings=None if openings is None else openings @ linear.T + translation,
        is_metric=True,
        source=source,
    )
