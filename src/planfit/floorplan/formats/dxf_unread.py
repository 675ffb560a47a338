"""What a DXF holds that is not read as a plan: other files, bodies in space, layouts."""

from collections import Counter
from typing import Any

from ezdxf.document import Drawing as Document

from planfit.findings.finding import FEW_NAMED

_BODIES = {"MESH", "3DSOLID", "BODY", "REGION", "SURFACE", "EXTRUDEDSURFACE", "LOFTEDSURFACE"}
_FLAT = 1e-6
"""A face is upright where its area seen from above is less than this share of its box's diagonal squared."""
_MOST_NAMED = FEW_NAMED


def unread_words(document: Document, space: Any) -> tuple[str, ...]:
    """A sentence for each kind of thing of a space that is not read, with what to do."""
    return tuple(filter(None, (_other_files(document, space), _bodies(space))))


def only_layout(document: Document) -> Any | None:
    """The layout with the most on it of a drawing whose model space is empty; None of others."""
    if len(document.modelspace()) > 0:
        return None
    layouts = [
        layout for layout in document.layouts if not layout.is_modelspace and len(layout) > 0
    ]
    return max(layouts, key=len, default=None)


def _other_files(document: Document, space: Any) -> str:
    names = {insert.dxf.name for insert in space.query("INSERT")}
    blocks: list[Any] = [document.blocks.get(name) for name in sorted(names)]
    heads = [block.block for block in blocks if block is not None]
    paths = [
        head.dxf.get("xref_path", "") or head.dxf.name
        for head in heads
        if head.is_xref or head.is_xref_overlay
    ]
    if not paths:
        return ""
    more = f" and {len(paths) - _MOST_NAMED} more" if len(paths) > _MOST_NAMED else ""
    listed = ", ".join(paths[:_MOST_NAMED]) + more
    count = "another file" if len(paths) == 1 else f"{len(paths)} other files"
    return (
        f"the drawing shows {count}, which is not in it and so not read ({listed}): bind it (XREF, Bind) "
        "and save again, or give that file"
    )


def _bodies(space: Any) -> str:
    count: Counter[str] = Counter()
    for entity in space:
        kind = entity.dxftype()
        is_net = kind == "POLYLINE" and not entity.is_2d_polyline and not entity.is_3d_polyline
        if kind in _BODIES or is_net or (kind == "3DFACE" and _is_upright(entity)):
            count["polyface" if is_net else kind] += 1
    if not count:
        return ""
    listed = ", ".join(f"{n} of {kind}" for kind, n in sorted(count.items()))
    return (
        f"{sum(count.values())} bodies or upright faces in space are not read ({listed}): export the model "
        "as IFC, OBJ or STL, which are cut at --cut-height-m, or its section as lines"
    )


def _is_upright(face: Any) -> bool:
    corners = face.wcs_vertices()
    doubled = sum(
        a.x * b.y - a.y * b.x for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)
    )
    spans = [max(c[k] for c in corners) - min(c[k] for c in corners) for k in range(3)]
    return abs(doubled) < _FLAT * sum(span**2 for span in spans)
