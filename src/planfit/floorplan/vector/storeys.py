"""Several storeys in one drawing: walls that stand apart as plans on a sheet do."""

from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from planfit.floorplan.plans_on_sheet import find_storeys, storey_words
from planfit.floorplan.raster.openings import find_openings
from planfit.floorplan.vector.candidates import LineFaces
from planfit.floorplan.vector.drawing import EDGE
from planfit.floorplan.vector.single_lines import body_of_faces
from planfit.geometry import segments

SIDE = 1200
"""Cells along the longer side of the grid in which is looked at what is drawn between two plans."""
LONGEST_PANE = 0.4
"""Lines longer than this share of the drawing that are no faces join no plans: axes and section lines run
through all that are on a sheet."""
THIN = EDGE
"""Thickness of a wall drawn as one line, of the drawing's size."""


@dataclass(frozen=True)
class DrawnStoreys:
    """Plans beside one another in a drawing, numbered as one reads a page."""

    of_face: Int[np.ndarray, " n"]
    of_opening: Int[np.ndarray, " k"]
    words: tuple[str, ...]
    """Where each is."""


def storeys_of_drawing(
    faces: LineFaces, openings: Float[np.ndarray, "k 2 2"], lines: Float[np.ndarray, "m 2 2"]
) -> DrawnStoreys:
    """Storey of each face and opening; all 0 where there is one plan.

    Args:
        faces: of the walls, in the drawing's unit, y up.
        openings: doors and windows along faces: what is on their two sides is of one storey.
        lines: that were looked at as walls; what joins two parts of a plan, as a glazed front does.
    """
    points = faces.ends.reshape(-1, 2)
    low, high = points.min(axis=0), points.max(axis=0)
    extent = float((high - low).max())
    one = DrawnStoreys(
        np.zeros(len(faces.ends), dtype=int), np.zeros(len(openings), dtype=int), ("all",)
    )
    if extent <= 0.0:
        return one
    cell = extent / SIDE
    # A page's u, v: down is up in the drawing.
    page, origin = np.array([1.0, -1.0]) / cell, np.array([low[0], high[1]])
    body = shapely.transform(body_of_faces(faces, extent), lambda xy: (xy - origin) * page)
    walls = np.array(shapely.get_parts(body), dtype=object)
    known = np.isfinite(faces.thickness)
    thickness = faces.usual_thickness or THIN * extent
    is_short = segments.lengths(lines) < LONGEST_PANE * extent
    drawn = np.concatenate([(lines[is_short] - origin) * page, (faces.ends - origin) * page])
    gaps = (openings - origin) * page
    # Doors and windows that are not drawn, as where the layer of walls alone was chosen.
    bare = find_openings(
        (faces.ends[known] - origin) * page,
        faces.normals[known] * np.sign(page),
        faces.thickness[known] / cell,
    )
    joining = np.concatenate([gaps, bare])
    storey_of = find_storeys(walls, thickness / cell, joining, _grid(drawn))
    if storey_of.max() == 0:
        return one
    tree = shapely.STRtree(walls)

    def nearest(ends: Float[np.ndarray, "n 2 2"]) -> Int[np.ndarray, " n"]:
        return storey_of[tree.nearest(shapely.points(ends.mean(axis=1)))]

    return DrawnStoreys(
        nearest((faces.ends - origin) * page), nearest(gaps), storey_words(walls, storey_of)
    )


def _grid(ends: Float[np.ndarray, "n 2 2"]) -> Bool[np.ndarray, "h w"]:
    """Cells that lines go through, row v and column u."""
    grid = np.zeros((SIDE + 2, SIDE + 2), dtype=bool)
    n_steps = np.ceil(2 * segments.lengths(ends)).astype(int) + 1
    line = np.repeat(np.arange(len(ends)), n_steps)
    step = np.arange(len(line)) - np.repeat(np.cumsum(n_steps) - n_steps, n_steps)
    share = (step / np.maximum(n_steps[line] - 1, 1))[:, None]
    at = np.round((1 - share) * ends[line, 0] + share * ends[line, 1]).astype(int)
    at = at[((at >= 0) & (at < SIDE + 2)).all(axis=1)]
    grid[at[:, 1], at[:, 0]] = True
    return grid
