"""Walls of the plan as the 3D view shows them: upright rectangles with what the scan says of each."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from planfit.as_built import AsBuilt, Verdict, in_words
from planfit.floorplan import Floorplan
from planfit.pipeline.result import RefineResult
from planfit.report import formatting
from planfit.report.scene.scene import SceneWall
from planfit.report.walls import SeenFace, seen_faces

WALL_HEIGHT_M = 2.5
"""That walls are drawn with: a plan tells none."""
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
    """Faces of the plan near the scan.

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
    shown = np.flatnonzero(near & (floorplan.lengths >= _LEAST_LENGTH_M))
    walls = (_wall(floorplan, result, int(face), seen.get(int(face))) for face in shown)
    return tuple(walls if as_built is None else _with_verdicts(walls, as_built))


def _with_verdicts(walls: Iterable[SceneWall], as_built: AsBuilt) -> Iterator[SceneWall]:
    """The same, coloured by verdict and saying it; faces that are not judged as they are."""
    judged = {wall.face_idx: wall for wall in as_built.walls}
    for wall in walls:
        found = judged.get(wall.face_idx)
        if found is None:
            yield wall
            continue
        verdict = as_built.verdict(found)
        title = f"A wall of the plan, {verdict.value}" if wall.status == "unseen" else wall.title
        rows = (("As built", in_words(found, verdict)), *wall.rows)
        yield replace(wall, status=_STATUS[verdict], title=title, rows=rows)


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
        heights=(floor_m, floor_m + WALL_HEIGHT_M),
        status=status,
        title=title,
        rows=rows,
    )


def _floor_m(floorplan: Floorplan, result: RefineResult, face: int) -> float:
    """Height of the floor that a face stands on, m."""
    if floorplan.storeys is None or result.storeys is None:
        return 0.0
    return result.storeys.walked[int(floorplan.storeys[face])].floor_m
