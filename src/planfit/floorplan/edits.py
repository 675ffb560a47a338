"""Corrections of a plan that was read: faces left out, regions kept, walls added; in a file of their own.

Faces are told by where they lie, not by number: a number changes when anything about the reading does.
"""

import hashlib
import json
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import shapely
from jaxtyping import Float, Int
from shapely.geometry.base import BaseGeometry

from planfit.errors import FloorplanError, OptionError
from planfit.floorplan.faces import Ends, line_strings
from planfit.floorplan.types import Floorplan
from planfit.floorplan.vector.line_work import ends_of
from planfit.geometry import segments
from planfit.runtime import write_whole

SAME_SHARE = 0.002
"""A face is the one that an edit names where its ends lie within this share of the plan's size."""
MAX_ENTRIES = 100_000


@dataclass(frozen=True)
class PlanEdits:
    """In the coordinates at the rim of `planfit plan PLAN -o plan.png`."""

    drop: Float[np.ndarray, "d 2 2"] = field(default_factory=lambda: np.zeros((0, 2, 2)))
    """Ends of faces that are left out."""
    keep: tuple[Float[np.ndarray, "_ 2"], ...] = ()
    """Corners of regions; what lies outside of all of them is left out, unless there are none."""
    add: Float[np.ndarray, "a 2 2"] | None = None
    """Ends of walls that were missed, seen from either side."""


def read_edits(path: Path) -> PlanEdits:
    """Edits of a JSON file; see docs/formats.md.

    Raises:
        FloorplanError: the file is missing, or holds something else.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise FloorplanError(
            f"{path}: expected a JSON file of plan edits, found {type(error).__name__}; write one with "
            "`planfit plan PLAN --drop N --write-edits FILE`"
        ) from error
    known = {"planfit_edits", "drop", "keep_regions", "add"}
    if not isinstance(content, dict) or content.get("planfit_edits") != 1 or set(content) - known:
        raise FloorplanError(
            f"{path}: expected plan edits of version 1 ({', '.join(sorted(known))}), found others; see "
            "'planfit help formats'"
        )
    try:
        ends = [_ends(content.get(name) or []) for name in ("drop", "add")]
        keep = tuple(_region(corners) for corners in content.get("keep_regions") or [])
    except (TypeError, ValueError, OverflowError) as error:
        raise FloorplanError(
            f"{path}: expected pairs of ends [[x, y], [x, y]] and regions of three corners or more, found "
            f"{error}; see 'planfit help formats'"
        ) from error
    return PlanEdits(ends[0], keep, ends[1])


def write_edits(path: Path, edits: PlanEdits) -> None:
    """Write what `read_edits` reads."""
    content = {
        "planfit_edits": 1,
        "drop": np.round(edits.drop, 6).tolist(),
        "keep_regions": [corners.tolist() for corners in edits.keep],
        "add": [] if edits.add is None else edits.add.tolist(),
    }
    write_whole(path, json.dumps(content, indent=1) + "\n")


def regions_of_words(words: tuple[str, ...]) -> tuple[tuple[tuple[float, float], ...], ...]:
    """Corners of the regions of a command line, each "x0,y0,x1,y1" or "x,y,x,y,x,y,...".

    Raises:
        OptionError: a region is of another form.
    """
    regions = []
    for text in words:
        try:
            corners = np.array([float(word) for word in text.split(",")]).reshape(-1, 2)
            if len(corners) == 2:
                (x0, y0), (x1, y1) = corners
                corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
            regions.append(tuple((float(x), float(y)) for x, y in _region(corners)))
        except ValueError as error:
            raise OptionError(
                f"--keep-region: expected x0,y0,x1,y1 or the corners x,y,x,y,x,y, found {text!r}"
            ) from error
    return tuple(regions)


def ends_of_faces(floorplan: Floorplan, numbers: tuple[int, ...]) -> Float[np.ndarray, "d 2 2"]:
    """Ends of faces that `--drop` numbers, in the coordinates at the rim.

    Raises:
        OptionError: there is no face of a number.
    """
    for number in numbers:
        if not 0 <= number < len(floorplan):
            raise OptionError(
                f"--drop: expected numbers of faces from 0 to {len(floorplan) - 1}, found {number}; see them "
                "in `planfit plan PLAN --numbers -o plan.png`"
            )
    ends = floorplan.ends[np.array(numbers, dtype=int)]
    return segments.moved(ends, floorplan.source.rim_from_plan)


def edited(floorplan: Floorplan, edits: PlanEdits, name: str) -> Floorplan:
    """The plan with corrections.

    `name`: of the edits, for messages.

    Raises:
        FloorplanError: a face that is to be left out is not there, or none is left.
    """
    plan_from_rim = np.linalg.inv(floorplan.source.rim_from_plan)
    before = floorplan.lengths.sum()
    plan = floorplan
    if edits.keep:
        corners = [segments.moved(c, plan_from_rim) for c in edits.keep]
        plan = _within(
            plan, shapely.union_all([shapely.make_valid(shapely.Polygon(c)) for c in corners])
        )
    # Numbers of faces are those of the picture, which shows what lies in the regions.
    kept = np.ones(len(plan), dtype=bool)
    kept[faces_at(plan, edits.drop, name)] = False
    plan = _taken(plan, np.flatnonzero(kept), plan.ends[kept])
    n_added = 0 if edits.add is None else len(edits.add)
    if edits.add is not None and n_added:
        plan = _with_walls(plan, segments.moved(edits.add, plan_from_rim))
    gone = before - sum(segments.lengths(plan.ends)[: len(plan.ends) - n_added])
    unit = "m" if floorplan.is_metric else "units"
    words = f"{gone:.3g} {unit} of faces by {name}" + (f", which adds {n_added}" if n_added else "")
    digest = hashlib.sha256()
    for part in (edits.drop, *edits.keep, np.zeros((0, 2, 2)) if edits.add is None else edits.add):
        digest.update(np.ascontiguousarray(part).tobytes() + str(part.shape).encode())
    source = replace(plan.source, dropped=(*plan.source.dropped, words))
    mark = digest.hexdigest()[:8]
    return replace(plan, source=source, fingerprint=f"{floorplan.fingerprint} edited {mark}")


def faces_at(
    floorplan: Floorplan, ends: Float[np.ndarray, "d 2 2"], name: str
) -> Int[np.ndarray, " d"]:
    """Indices of the faces that lie at ends in the coordinates at the rim.

    Raises:
        FloorplanError: one does not; the message begins with `name`.
    """
    plan_from_rim = np.linalg.inv(floorplan.source.rim_from_plan)
    near = SAME_SHARE * max(floorplan.size)
    found = []
    for each in segments.moved(ends, plan_from_rim):
        apart = np.minimum(
            np.abs(floorplan.ends - each).max(axis=(1, 2)),
            np.abs(floorplan.ends - each[::-1]).max(axis=(1, 2)),
        )
        if apart.min() > near:
            raise FloorplanError(
                f"{name}: expected a face from {np.round(each[0], 3).tolist()} to "
                f"{np.round(each[1], 3).tolist()} (plan frame) to leave out, found none; the plan is read "
                "otherwise than when the edits were made: make them again"
            )
        found.append(int(apart.argmin()))
    return np.array(found, dtype=int)


def _ends(values: object) -> Ends:
    ends = np.array(values, dtype=float)
    ends = ends.reshape(0, 2, 2) if ends.size == 0 else ends
    if ends.ndim != 3 or ends.shape[1:] != (2, 2) or len(ends) > MAX_ENTRIES:
        raise ValueError(f"an array of shape {ends.shape}")
    if not (np.isfinite(ends).all() and (segments.lengths(ends) > 0).all()):
        raise ValueError("no finite numbers, or a face without length")
    return ends


def _region(values: object) -> Float[np.ndarray, "k 2"]:
    corners = np.array(values, dtype=float)
    if corners.ndim != 2 or corners.shape[1:] != (2,) or not 3 <= len(corners) <= MAX_ENTRIES:
        raise ValueError(f"a region of shape {corners.shape}")
    if not np.isfinite(corners).all() or shapely.Polygon(corners).area == 0:
        raise ValueError("a region without area")
    return corners


def _taken(floorplan: Floorplan, of: np.ndarray, ends: Ends) -> Floorplan:
    """Parts of faces: `ends` of each, and the face it is of."""
    if len(ends) == 0:
        raise FloorplanError(
            f"{floorplan.name}: expected edits that leave a wall, found none left; keep more"
        )
    return floorplan.take(of, ends=ends)


def _within(floorplan: Floorplan, region: BaseGeometry) -> Floorplan:
    """Parts of faces and openings inside a region."""
    ends, of = _clipped(floorplan.ends, region, 1e-3 * max(floorplan.size))
    openings = floorplan.openings
    if openings is not None:
        openings, _ = _clipped(openings, region, 0.0)
    return replace(_taken(floorplan, of, ends), openings=openings)


def _clipped(
    ends: Ends, region: BaseGeometry, least: float
) -> tuple[Float[np.ndarray, "m 2 2"], np.ndarray]:
    if len(ends) == 0:
        return ends, np.zeros(0, dtype=int)
    parts, of = shapely.get_parts(
        shapely.intersection(line_strings(ends), region), return_index=True
    )
    long = shapely.length(parts) > least
    # Overlays may turn a line round; its face looks the way it did.
    return ends_of(parts[long]), of[long]


def _with_walls(floorplan: Floorplan, ends: Float[np.ndarray, "a 2 2"]) -> Floorplan:
    n = len(ends)
    thickness = floorplan.thickness
    storeys = floorplan.storeys
    return replace(
        floorplan,
        ends=np.concatenate([floorplan.ends, ends]),
        normals=np.concatenate([floorplan.normals, segments.left_normals(ends)]),
        is_oriented=np.concatenate([floorplan.is_oriented, np.zeros(n, dtype=bool)]),
        thickness=None if thickness is None else np.concatenate([thickness, np.full(n, np.nan)]),
        storeys=None if storeys is None else np.concatenate([storeys, np.zeros(n, dtype=int)]),
    )
