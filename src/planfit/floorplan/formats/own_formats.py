"""Plans as bare segments (`floorplan.npy` of the FACaP layout), and JSON: planfit's own, or of RoomPlan."""

import json
import zipfile
from dataclasses import replace
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from jaxtyping import Float

from planfit.errors import FloorplanError
from planfit.floorplan.faces import first_of_each
from planfit.floorplan.formats import fingerprint_of
from planfit.floorplan.formats.room_plan import is_room_plan, plan_of_rooms
from planfit.floorplan.options import PlanOptions, choose_unit
from planfit.floorplan.types import Floorplan, PlanSource
from planfit.geometry import segments
from planfit.runtime import write_whole

_OF_EDITORS = {"walls", "rooms", "floorplan", "layers", "corners", "floors"}
"""What JSON of editors of floorplans holds: react-planner layers, blueprint3d a floorplan of corners."""


def write_floorplan_json(path: Path, floorplan: Floorplan) -> None:
    """Write planfit's own form, lossless; see docs/formats.md."""
    thickness = floorplan.thickness
    if thickness is None:
        thickness = np.full(len(floorplan), np.nan)
    faces = []
    for ends, normal, oriented, thick in zip(
        floorplan.ends, floorplan.normals, floorplan.is_oriented, thickness, strict=True
    ):
        face = {"ends": ends.tolist(), "normal": normal.tolist() if oriented else None}
        if np.isfinite(thick):
            face["thickness"] = float(thick)
        faces.append(face)
    unit = "m" if floorplan.is_metric else "unknown"
    content = {"planfit_floorplan": 1, "unit": unit, "faces": faces}
    if floorplan.openings is not None:
        content["openings"] = floorplan.openings.tolist()
    write_whole(path, json.dumps(content, indent=1))


def read_npy(path: Path, options: PlanOptions) -> Floorplan:
    """FACaP's (n, 4) array of (u1, v1, u2, v2) m in world (x, z): plan points are (u, -v)."""
    try:
        with path.open("rb") as file:  # numpy leaves it open where it is no array
            values = np.load(file, allow_pickle=False)
    # A damaged header is parsed as Python, or claims more than there is memory for.
    except (ValueError, OSError, EOFError, zipfile.BadZipFile, MemoryError, TokenError) as error:
        raise FloorplanError(
            f"{path}: expected a NumPy array of numbers saved by numpy.save, found something else"
        ) from error
    if not isinstance(values, np.ndarray):
        raise FloorplanError(f"{path}: expected one NumPy array, found an archive of several")
    if values.ndim != 2 or values.shape[1] != 4:
        raise FloorplanError(
            f"{path}: expected an array of shape (n, 4), u1 v1 u2 v2 a segment, "
            f"found {values.shape}"
        )
    if values.dtype.kind not in "fiu" or not np.isfinite(values).all():
        raise FloorplanError(f"{path}: expected finite coordinates, found NaN or other values")
    ends = values.astype(float).reshape(-1, 2, 2) * (1.0, -1.0)
    unit = choose_unit(options.unit, options.metres_per_unit, "m", "the format")
    metres = unit.scale
    floorplan = Floorplan.from_segments(
        ends * metres,
        name=str(path),
        is_metric=unit.metres is not None,
        fingerprint=fingerprint_of(path),
    )
    source = PlanSource(
        kind="segments (.npy)",
        unit=unit.name,
        unit_from=unit.known_from,
        dropped=_dropped(ends * metres, len(floorplan)),
        file_from_plan=np.diag([1 / metres, -1 / metres, 1.0]),
    )
    return replace(floorplan, source=source)


def _dropped(ends: Float[np.ndarray, "n 2 2"], n_kept: int) -> tuple[str, ...]:
    """What became of segments of which `n_kept` are left, in words."""
    n_first = len(first_of_each(ends))
    said = [(n_first - n_kept, "without length"), (len(ends) - n_first, "drawn twice")]
    return tuple(f"{n} segment{'' if n == 1 else 's'} {words}" for n, words in said if n)


def read_json(path: Path, options: PlanOptions) -> Floorplan:
    """Wall faces of a plan in JSON, of either kind.

    Raises:
        FloorplanError: it is of neither, or damaged.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise _other_content(path, error) from error
    if is_room_plan(content):
        return plan_of_rooms(content, path, options)
    other = _of_another_kind(content)
    if other:
        raise FloorplanError(
            f"{path}: expected a plan in planfit's own JSON or of RoomPlan, found {other}"
        )
    return _read_own(content, path, options)


def _other_content(path: Path, found: object) -> FloorplanError:
    return FloorplanError(
        f"{path}: expected a plan as JSON (unit, faces with ends and normal), found another content "
        f"({found}); see 'planfit help formats'"
    )


def _of_another_kind(content: object) -> str:
    """What JSON of a kind that is not read here is, and what to do with it; empty where nothing tells."""
    if not isinstance(content, dict):
        return ""
    if content.get("type") == "CityJSON":
        return (
            f"a CityJSON model of {len(content.get('CityObjects') or ())} objects, which is not read; "
            "export it as IFC or OBJ, or its rooms as GeoJSON"
        )
    if content.get("type") in ("FeatureCollection", "Feature"):
        return "GeoJSON; rename it to .geojson"
    if "faces" in content:
        return ""
    parts = " and ".join(sorted(_OF_EDITORS & set(content)))
    return (
        f"the {parts or 'parts'} of another program's own form, which is not read; export the plan from that "
        "program as DXF, SVG, PDF or IFC, or write its walls as 'planfit help formats' shows"
    )


def _read_own(data: Any, path: Path, options: PlanOptions) -> Floorplan:
    """planfit's own form; see docs/formats.md. `Floorplan` checks what is true of any plan."""
    try:
        faces, unit = data["faces"], data["unit"]
        ends = np.array([face["ends"] for face in faces], dtype=float).reshape(-1, 2, 2)
        has_normal = np.array([face.get("normal") is not None for face in faces], dtype=bool)
        given = [face["normal"] for face in faces if face.get("normal") is not None]
        given = np.array(given, dtype=float).reshape(-1, 2)
        thickness = np.array([face.get("thickness", np.nan) for face in faces], dtype=float)
        openings = data.get("openings")
        if openings is not None:
            openings = np.array(openings, dtype=float).reshape(-1, 2, 2)
        if not len(ends) == len(has_normal) == len(thickness) == thickness.size:
            raise ValueError(f"{len(has_normal)} faces with {len(ends)} pairs of ends")
        if len(given) != has_normal.sum():
            raise ValueError(f"{len(given)} normals of x and y for {has_normal.sum()} faces")
        if unit not in ("m", "unknown"):
            raise ValueError(f"the unit {unit!r}")
        if not all(np.isfinite(each).all() for each in (ends, given, openings) if each is not None):
            raise ValueError("numbers that are not finite")
        if not (segments.lengths(ends) > 0).all() or len(ends) == 0:
            raise ValueError(f"{len(ends)} faces, or one without length")
        if (thickness <= 0).any():
            raise ValueError("the thickness of a wall that is not above 0")
    except KeyError as error:
        raise FloorplanError(
            f"{path}: expected a plan as JSON (planfit's own, with unit and faces, or of RoomPlan), found "
            f"one without {error}; see 'planfit help formats'"
        ) from error
    except (ValueError, TypeError, AttributeError) as error:
        raise _other_content(path, error) from error
    normals = segments.left_normals(ends)
    normals[has_normal] = given
    told = choose_unit(
        options.unit, options.metres_per_unit, None if unit == "unknown" else "m", "the file"
    )
    floorplan = Floorplan(
        str(path),
        ends,
        normals,
        has_normal,
        fingerprint_of(path),
        None if np.isnan(thickness).all() else thickness,
        openings,
        told.metres is not None,
        PlanSource("planfit's own (.json)", told.name, told.known_from, file_from_plan=np.eye(3)),
    )
    return floorplan if told.metres in (None, 1.0) else floorplan.scaled(told.metres)
