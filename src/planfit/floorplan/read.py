"""`read_floorplan`: from a path to wall faces, whatever the format."""

import hashlib
import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from planfit.errors import FloorplanError
from planfit.floorplan.faces import orient_faces
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.types import Floorplan
from planfit.floorplan.vector_readers import VECTOR_READERS
from planfit.geometry import segments

Reader = Callable[[Path, PlanOptions], Floorplan]

MIN_SIZE_M, MAX_SIZE_M = 1.5, 2000.0
"""A building is larger than a cupboard and smaller than a town: outside, the unit is not metres."""


def read_floorplan(path: str | Path, options: PlanOptions | None = None) -> Floorplan:
    """Read a plan; the suffix tells the format (docs/formats.md).

    Raises:
        FloorplanError: the file is missing, of another kind, without walls, or not in metres.
    """
    path = Path(path)
    if not path.exists():
        raise FloorplanError(f"{path}: expected a floorplan, found nothing; check the path")
    reader = _reader(path)
    floorplan = reader(path, options or PlanOptions())
    extent = max(floorplan.size)
    if floorplan.is_metric and not MIN_SIZE_M <= extent <= MAX_SIZE_M:
        raise FloorplanError(
            f"{path}: expected a building in metres ({MIN_SIZE_M:g} to {MAX_SIZE_M:g} m across), "
            f"found {floorplan.size[0]:.4g} x {floorplan.size[1]:.4g}; "
            "convert it from its own unit to metres"
        )
    return floorplan


def _reader(path: Path) -> Reader:
    reader = readers().get("" if path.is_dir() else path.suffix.lower())
    if reader is None or (not path.suffix and not path.is_dir()):
        raise FloorplanError(
            f"{path}: expected a plan as {', '.join(suffix for suffix in readers() if suffix)}, found "
            f"{path.suffix or 'no suffix'}; trace its walls into one of these (docs/formats.md)"
        )
    return reader


def readers() -> dict[str, Reader]:
    """Suffix to reader."""
    return {".npy": _read_npy, ".json": _read_json, **VECTOR_READERS}


def write_floorplan_json(path: Path, floorplan: Floorplan) -> None:
    """Write planfit's own form, lossless; see docs/formats.md."""
    faces = [
        {"ends": ends.tolist(), "normal": normal.tolist() if oriented else None}
        for ends, normal, oriented in zip(
            floorplan.ends, floorplan.normals, floorplan.is_oriented, strict=True
        )
    ]
    path.write_text(json.dumps({"planfit_floorplan": 1, "unit": "m", "faces": faces}, indent=1))


def make_floorplan(name: str, ends: np.ndarray, fingerprint: str = "") -> Floorplan:
    """Faces from bare segments (n, 2, 2) m; points (segments without length) are left out."""
    ends = ends[segments.lengths(ends) > 1e-6]
    if len(ends) == 0:
        raise FloorplanError(f"{name}: expected wall segments, found none; is it the right file?")
    normals, is_oriented = orient_faces(ends)
    return Floorplan(name, ends, normals, is_oriented, fingerprint)


def _read_npy(path: Path, options: PlanOptions) -> Floorplan:  # noqa: ARG001 - as all readers
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
    return make_floorplan(str(path), ends, _fingerprint(path))


def _read_json(path: Path, options: PlanOptions) -> Floorplan:  # noqa: ARG001
    try:
        data = json.loads(path.read_text())
        faces, unit = data["faces"], data["unit"]
        ends = np.array([face["ends"] for face in faces], dtype=float).reshape(-1, 2, 2)
        has_normal = np.array([face.get("normal") is not None for face in faces], dtype=bool)
        given = [face["normal"] for face in faces if face.get("normal") is not None]
        given = np.array(given, dtype=float).reshape(-1, 2)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise FloorplanError(
            f"{path}: expected planfit's plan JSON (unit, faces with ends and normal), "
            f"found {type(error).__name__}: {error}; see docs/formats.md"
        ) from error
    if unit != "m":
        raise FloorplanError(f"{path}: expected unit 'm', found {unit!r}")
    if not np.isfinite(ends).all():
        raise FloorplanError(f"{path}: expected finite coordinates, found NaN or infinity")
    if len(ends) == 0 or (segments.lengths(ends) < 1e-6).any():
        raise FloorplanError(f"{path}: expected faces with length, found {len(ends)} faces"
                             + (" and one without" if len(ends) else ""))  # fmt: skip
    normals = segments.left_normals(ends)
    if len(given) != has_normal.sum() or not _are_normals(given, normals[has_normal]):
        raise FloorplanError(
            f"{path}: expected a normal of length 1 at right angles to its face, or null, "
            "found another; see docs/formats.md"
        )
    normals[has_normal] = given
    return Floorplan(str(path), ends, normals, has_normal, _fingerprint(path))


def _are_normals(given: np.ndarray, left_normals: np.ndarray) -> bool:
    """Whether each (n, 2) is the left normal or its opposite, up to rounding."""
    if not np.isfinite(given).all():
        return False
    side = np.where(np.sum(given * left_normals, axis=1, keepdims=True) < 0, -1.0, 1.0)
    return bool((np.abs(given - side * left_normals) < 1e-3).all())


def _fingerprint(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]
