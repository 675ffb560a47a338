"""Walls of the plan as the 3D view shows them: upright rectangles with what the scan says of each."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from planfit.as_built import AsBuilt, AsBuiltWall, Verdict, in_words
from planfit.floorplan import Floorplan
from planfit.pipeline.result import RefineResult
from planfit.priors import WALL_HEIGHT_M
from planfit.report import formatting
from planfit.report.scene.scene import SceneWall
from planfit.report.walls import SeenFace, seen_faces

_MARGIN_M = 3.0
"""Walls further from the scan are left out: a plan may be of a whole campus."""
_LEAST_LENGTH_M = 0.02
_STATUS = {
    Verdict.AGREES: "agrees",
    Verdict.MOVED: "displaced",
    Verdict.MISSING: "missing",
    Verdict.NOT_SEEN: "unseen",
}


def scene_walls(
    floorplan: Floorplan,
    result: RefineResult,
    bounds: Float[np.ndarray, "2 3"],
    as_built: AsBuilt | None = None,
) -> tuple[SceneWall, ...]:
    """Faces of the plan near the scan and those that it tells of, and walls that the plan lacks.

    Args:
        floorplan: plan frame, m.
        result: of `planfit.refine` with that plan.
        bounds: lower and upper corner of the scan, plan frame, m.
        as_built: verdicts on the faces; without, they have the colours of the fit.
    """
    seen = {face.face_idx: face for face in seen_faces(floorplan, result.adjustment, as_built)}
    low, high = bounds[0, :2] - _MARGIN_M, bounds[1, :2] + _MARGIN_M
    near = np.all(
        (floorplan.ends.max(axis=1) >= low) & (floorplan.ends.min(axis=1) <= high), axis=1
    )
    # What was seen through a window is further away than nearly all points, and in the table all the same.
    near[list(seen)] = True
    if as_built is not None:
        near[[w.face_idx for w in as_built.walls if w.face_idx >= 0 and _is_told(as_built, w)]] = (
            True
        )
    shown = np.flatnonzero(near & (floorplan.lengths >= _LEAST_LENGTH_M))
    walls = (_wall(floorplan, result, int(face), seen.get(int(face))) for face in shown)
    if as_built is None:
        return tuple(walls)
    # Of several storeys nothing tells the floor that a new wall stands on.
    new = _new_walls(as_built) if floorplan.storeys is None else ()
    return (*_with_verdicts(walls, as_built), *new)


def _is_told(as_built: AsBuilt, wall: AsBuiltWall) -> bool:
    return as_built.verdict(wall) is not Verdict.NOT_SEEN


def _with_verdicts(walls: Iterable[SceneWall], as_built: AsBuilt) -> Iterator[SceneWall]:
    """The same, coloured by verdict and saying it; faces that are not judged as they are."""
    judged = {wall.face_idx: (number, wall) for number, wall in enumerate(as_built.walls, 1)}
    for wall in walls:
        if wall.face_idx not in judged:
            yield wall
            continue
        number, found = judged[wall.face_idx]
        verdict = as_built.verdict(found)
        seen = ", not seen" if verdict is Verdict.NOT_SEEN else ""
        rows = (("As built", in_words(found, verdict)), *wall.rows)
        title = f"Wall No. {number} of the plan{seen}"
        yield replace(wall, status=_STATUS[verdict], title=title, rows=rows)


def _new_walls(as_built: AsBuilt) -> Iterator[SceneWall]:
    """Walls that the plan does not draw; as faces they are numbered -1, -2 by their numbers in the table."""
    for number, wall in enumerate(as_built.walls, 1):
        if wall.face_idx < 0:
            yield SceneWall(
                face_idx=-number,
                ends=wall.ends,
                normal=wall.normal,
                heights=(0.0, WALL_HEIGHT_M.value),
                status="new",
                title=f"Wall No. {number}, which the plan lacks",
                rows=(("As built", in_words(wall, as_built.verdict(wall))),),
            )


def _wall(
    floorplan: Floorplan, result: RefineResult, face: int, seen: SeenFace | None
) -> SceneWall:
    floor_m = _floor_m(floorplan, result, face)
    length = ("Length", formatting.length(float(floorplan.lengths[face])))
    status, title = "unseen", "A wall of the plan, not seen"
    rows: tuple[tuple[str, str], ...] = (length,)
    if seen is not None:
        status = "agrees" if seen.agrees else "displaced" if seen.is_displaced else "few"
        title = f"Wall No. {seen.number} of the plan"
        rows = (
            ("Verdict", seen.verdict),
            ("Offset", formatting.centimetres(seen.offset, signed=True)),
            ("MAD", formatting.centimetres(seen.mad)),
            ("Patches", str(seen.n_patches)),
            length,
        )
    return SceneWall(
        face_idx=face,
        ends=floorplan.ends[face],
        normal=floorplan.normals[face],
        heights=(floor_m, floor_m + WALL_HEIGHT_M.value),
        status=status,
        title=title,
        rows=rows,
    )


def _floor_m(floorplan: Floorplan, result: RefineResult, face: int) -> float:
    """Height of the floor that a face stands on, m."""
    if floorplan.storeys is None or result.storeys is None:
        return 0.0
    return result.storeys.walked[int(floorplan.storeys[face])].floor_m
