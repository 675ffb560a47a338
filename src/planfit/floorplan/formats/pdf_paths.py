"""Paths, clips and layers of a PDF as points and areas of the page as it is shown."""

import ctypes
import io
import logging
from typing import Any

import numpy as np
import pypdfium2.raw as raw
import shapely
from jaxtyping import Bool, Float
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.vector.drawing import area_of_rings
from planfit.floorplan.vector.line_work import SubPaths
from planfit.floorplan.vector.regions import SelfCrossings
from planfit.geometry import segments

_MOST_LETTERS = 256
"""Of a layer's name that are read; programs allow 255."""


def matrix_of(item) -> Float[np.ndarray, "3 3"]:
    """What an object's own matrix does to homogeneous x-y."""
    m = raw.FS_MATRIX()
    raw.FPDFPageObj_GetMatrix(item, m)
    return np.array([[m.a, m.c, m.e], [m.b, m.d, m.f], [0.0, 0.0, 1.0]])


class Clips:
    """Clip areas by their corners, each made once: thousands of objects share a few."""

    def __init__(self) -> None:
        self._made: dict[bytes, BaseGeometry] = {}

    def of(self, item, transform: Float[np.ndarray, "3 3"]) -> BaseGeometry | None:
        """Area that an object shows in, as shown; None where nothing clips it."""
        clip = raw.FPDFPageObj_GetClipPath(item)
        count = raw.FPDFClipPath_CountPaths(clip) if clip else 0
        paths = [_clip_rings(clip, i) for i in range(max(count, 0))]
        paths = [rings for rings in paths if rings]
        if not paths:
            return None
        key = b"|".join(ring.tobytes() for rings in paths for ring in rings) + transform.tobytes()
        if key not in self._made:
            shown = [[segments.moved(ring, transform) for ring in rings] for rings in paths]
            areas = [area_of_rings(rings, SelfCrossings()) for rings in shown]
            self._made[key] = shapely.intersection_all(areas)
        return self._made[key]


def _clip_rings(clip, path_index: int) -> list[Float[np.ndarray, "_ 2"]]:
    """Corners (k, 2) of each ring of one clip path; control points of its curves count as corners."""
    x, y = ctypes.c_float(), ctypes.c_float()
    rings: list[list[tuple[float, float]]] = []
    for i in range(max(raw.FPDFClipPath_CountPathSegments(clip, path_index), 0)):
        segment = raw.FPDFClipPath_GetPathSegment(clip, path_index, i)
        raw.FPDFPathSegment_GetPoint(segment, x, y)
        if raw.FPDFPathSegment_GetType(segment) == raw.FPDF_SEGMENT_MOVETO or not rings:
            rings.append([])
        rings[-1].append((x.value, y.value))
    return [np.array(ring) for ring in rings if len(ring) >= 3]


def sub_paths(
    item, transform: Float[np.ndarray, "3 3"]
) -> list[tuple[Float[np.ndarray, "_ 2"], Bool[np.ndarray, " _"]]]:
    """Each sub-path as points (k, 2) and which of its segments (k - 1,) are curved, as shown."""
    path, controls = SubPaths(), []
    x, y = ctypes.c_float(), ctypes.c_float()
    for i in range(raw.FPDFPath_CountSegments(item)):
        segment = raw.FPDFPath_GetPathSegment(item, i)
        raw.FPDFPathSegment_GetPoint(segment, x, y)
        at = transform[:2, :2] @ (x.value, y.value) + transform[:2, 2]
        kind = raw.FPDFPathSegment_GetType(segment)
        if kind == raw.FPDF_SEGMENT_MOVETO:
            path.move(at)
            controls = []
        elif kind == raw.FPDF_SEGMENT_BEZIERTO:
            controls.append(at)
            if len(controls) == 3:
                path.cubic(np.array([path.last, *controls]))
                controls = []
        else:
            path.line(at)
        if raw.FPDFPathSegment_GetClose(segment) and len(path) > 1:
            path.close()
    return path.found()


def layer_of(item: Any) -> str:
    """Name of the optional content group that an object of PDFium is marked with; empty where it has none."""
    for i in range(raw.FPDFPageObj_CountMarks(item)):
        mark = raw.FPDFPageObj_GetMark(item, i)
        # Letters, not bytes: PDFium's binding takes nothing else since 5.1, and both before.
        name, size = (ctypes.c_ushort * _MOST_LETTERS)(), ctypes.c_ulong()
        is_named = raw.FPDFPageObjMark_GetParamStringValue(
            mark, b"Name", name, ctypes.sizeof(name), size
        )
        if is_named:
            return bytes(name)[: max(size.value - 2, 0)].decode("utf-16-le", errors="replace")
    return ""


def hidden_layers(data: bytes) -> frozenset[str]:
    """Names of the layers that are off when a file is opened, and not on under the same name elsewhere.

    `data`: the whole file.

    Raises:
        ValueError: the list of layers cannot be read.
    """
    if b"/OCProperties" not in data and b"/ObjStm" not in data:
        return frozenset()
    import pypdf  # PDFium does not tell; most files have no layers
    from pypdf.errors import DependencyError, PyPdfError

    # It warns of every odd entry; what matters here comes back as an error.
    logging.getLogger("pypdf").setLevel(logging.ERROR)
    try:
        root: Any = pypdf.PdfReader(io.BytesIO(data)).trailer["/Root"].get_object()
        layers = root.get("/OCProperties")
        if layers is None:
            return frozenset()
        layers = layers.get_object()
        usual = layers.get("/D", {}).get_object()
        is_off = usual.get("/BaseState") == "/OFF"
        changed = {each.idnum for each in usual.get("/ON" if is_off else "/OFF", [])}
        names: dict[bool, set[str]] = {True: set(), False: set()}
        for each in layers.get("/OCGs", []):
            hides = is_off != (each.idnum in changed)
            names[hides].add(str(each.get_object().get("/Name", "")))
    except (
        PyPdfError,
        DependencyError,
        ValueError,
        KeyError,
        AttributeError,
        TypeError,
        RecursionError,
        OSError,
    ) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from error
    return frozenset(names[True] - names[False])
