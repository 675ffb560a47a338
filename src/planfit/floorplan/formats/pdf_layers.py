"""Layers of a PDF (optional content): of which an object is, and which are off."""

import ctypes
import io
import logging
from typing import Any

import pypdfium2.raw as raw

_MOST_LETTERS = 256
"""Of a layer's name that are read; programs allow 255."""


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

    Args:
        data: the whole file.

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
