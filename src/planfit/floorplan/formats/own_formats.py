"""Plans as bare segments (`floorplan.npy` of the FACaP layout), and planfit's own JSON."""

import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from planfit.errors import FloorplanError
from planfit.floorplan.faces import orient_faces, usual_gap
from planfit.floorplan.file import fingerprint_of
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.types import Floorplan, PlanSource
from planfit.floorplan.units import choose_unit
from planfit.geometry import segments

MAX_THICKNESS_M, MIN_THICKNESS_M = 0.6, 0.02


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
    path.write_text(json.dumps(content, indent=1))


def make_floorplan(
    name: str, ends: np.ndarray, fingerprint: str = "", is_metric: bool = True
) -> Floorplan:
    """Faces from bare segments (n, 2, 2); points (segments without length) and repeated ones are left out.

    Where the segments are not metric, the thickness of walls is taken from the gaps between parallel
    segments: most lines of a plan of thick walls have the other face of their wall next to them.
    """
    extent = float(np.ptp(ends.reshape(-1, 2), axis=0).max()) if len(ends) else 0.0
    ends = ends[segments.lengths(ends) > (1e-6 if is_metric else 1e-6 * extent)]
    if len(ends) == 0:
        raise FloorplanError(f"{name}: expected wall segments, found none; is it the right file?")
    ends = ends[_first_of_each(ends)]
    if is_metric:
        normals, is_oriented = orient_faces(ends, MAX_THICKNESS_M, MIN_THICKNESS_M)
    else:
        # A thirtieth: lines further apart are single, and their neighbours across a room.
        gap = usual_gap(ends, extent / 30)
        normals, is_oriented = segments.left_normals(ends), np.zeros(len(ends), dtype=bool)
        if np.isfinite(gap):
            normals, is_oriented = orient_faces(ends, 2.5 * gap, 0.1 * gap)
    return Floorplan(name, ends, normals, is_oriented, fingerprint, is_metric=is_metric)


def read_npy(path: Path, options: PlanOptions) -> Floorplan:
    """FACaP's (n, 4) array of (u1, v1, u2, v2) m in world (x, z): plan points are (u, -v)."""
    try:
        with path.open("rb") as file:  # numpy leaves it open where it is no array
            values = np.load(file, allow_pickle=False)
    except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
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
    unit = choose_unit(options, "m", "the format")
    metres = 1.0 if unit.metres is None else unit.metres
    floorplan = make_floorplan(
        str(path), ends * metres, fingerprint_of(path), unit.metres is not None
    )
    source = PlanSource(
        kind="segments (.npy)",
        unit=unit.name,
        unit_from=unit.known_from,
        dropped=_dropped(ends * metres, len(floorplan)),
        file_from_plan=np.diag([1 / metres, -1 / metres, 1.0]),
    )
    return replace(floorplan, source=source)


def _first_of_each(ends: np.ndarray) -> np.ndarray:
    """Indices, ascending, of segments (n, 2, 2) without those that repeat one before, in either direction."""
    low_first = np.array([sorted(pair) for pair in ends.tolist()]).reshape(-1, 4)
    _, first = np.unique(low_first, axis=0, return_index=True)
    return np.sort(first)


def _dropped(ends: np.ndarray, n_kept: int) -> tuple[str, ...]:
    """What became of segments (n, 2, 2) of which `n_kept` are left, in words."""
    repeated = len(ends) - len(_first_of_each(ends))
    points = ends[_first_of_each(ends)]
    points = len(points) - n_kept
    said = [(points, "without length"), (repeated, "drawn twice")]
    return tuple(f"{n} segment{'' if n == 1 else 's'} {words}" for n, words in said if n)


def read_json(path: Path, options: PlanOptions) -> Floorplan:
    """planfit's own form; see docs/formats.md."""
    try:
        data = json.loads(path.read_text())
        faces, file_unit = data["faces"], data["unit"]
        ends = np.array([face["ends"] for face in faces], dtype=float).reshape(-1, 2, 2)
        has_normal = np.array([face.get("normal") is not None for face in faces], dtype=bool)
        given = [face["normal"] for face in faces if face.get("normal") is not None]
        given = np.array(given, dtype=float).reshape(-1, 2)
        thickness = np.array([face.get("thickness", np.nan) for face in faces], dtype=float)
        openings = data.get("openings")
        if openings is not None:
            openings = np.array(openings, dtype=float).reshape(-1, 2, 2)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise FloorplanError(
            f"{path}: expected planfit's plan JSON (unit, faces with ends and normal), "
            f"found {type(error).__name__}: {error}; see docs/formats.md"
        ) from error
    if file_unit not in ("m", "unknown"):
        raise FloorplanError(f"{path}: expected unit 'm' or 'unknown', found {file_unit!r}")
    if not np.isfinite(ends).all() or (openings is not None and not np.isfinite(openings).all()):
        raise FloorplanError(f"{path}: expected finite coordinates, found NaN or infinity")
    extent = float(np.ptp(ends.reshape(-1, 2), axis=0).max()) if len(ends) else 0.0
    shortest = 1e-6 if file_unit == "m" else 1e-9 * extent
    if len(ends) == 0 or (segments.lengths(ends) < shortest).any():
        found = "0 faces" if len(ends) == 0 else "one without"
        raise FloorplanError(
            f"{path}: expected faces with length, found {found}; see docs/formats.md"
        )
    if thickness.shape != (len(ends),) or (thickness <= 0).any():
        raise FloorplanError(
            f"{path}: expected the thickness of a wall above 0, or none, found another; "
            "see docs/formats.md"
        )
    normals = segments.left_normals(ends)
    if len(given) != has_normal.sum() or not _are_normals(given, normals[has_normal]):
        raise FloorplanError(
            f"{path}: expected a normal of length 1 at right angles to its face, or null, "
            "found another; see docs/formats.md"
        )
    normals[has_normal] = given
    unit = choose_unit(options, None if file_unit == "unknown" else "m", "the file")
    floorplan = Floorplan(
        str(path),
        ends,
        normals,
        has_normal,
        fingerprint_of(path),
        None if np.isnan(thickness).all() else thickness,
        openings,
        unit.metres is not None,
        PlanSource("planfit's own (.json)", unit.name, unit.known_from, file_from_plan=np.eye(3)),
    )
    return floorplan if unit.metres in (None, 1.0) else floorplan.scaled(unit.metres)


def _are_normals(given: np.ndarray, left_normals: np.ndarray) -> bool:
    """Whether each (n, 2) is the left normal or its opposite, up to rounding."""
    if not np.isfinite(given).all():
        return False
    side = np.where(np.sum(given * left_normals, axis=1, keepdims=True) < 0, -1.0, 1.0)
    return bool((np.abs(given - side * left_normals) < 1e-3).all())
